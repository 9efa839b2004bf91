// The routes that steer jobs and workers, and what a job remembers of its way.

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <utility>

#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"

namespace pf {

using nlohmann::json;

namespace {

std::optional<double> decimal_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace

HttpReply HttpRoutes::validate(const HttpRequest& request, const Captures&) {
  auto body = json_body(request);
  if (!body) return std::move(body.error());
  auto submission = parse_submission(std::move(*body), FilesMember::kOptional);
  if (!submission) return failure(submission.error());
  const auto valid = service_.validate(*submission);
  if (!valid) return failure(valid.error());
  return json_reply({{"valid", true}, {"spec", json::parse(valid->spec_json)}, {"warnings", valid->warnings}});
}

HttpReply HttpRoutes::pause_job(const HttpRequest& request, const Captures& captures) {
  return reply_job(service_.act(captures[0], JobEvent::kPause, request.caller.name));
}

HttpReply HttpRoutes::resume_job(const HttpRequest& request, const Captures& captures) {
  return reply_job(service_.act(captures[0], JobEvent::kResume, request.caller.name));
}

HttpReply HttpRoutes::retry_job(const HttpRequest& request, const Captures& captures) {
  return reply_job(service_.act(captures[0], JobEvent::kRetry, request.caller.name));
}

HttpReply HttpRoutes::cancel_job(const HttpRequest& request, const Captures& captures) {
  JobEvent verb = JobEvent::kCancel;
  if (const auto length = whole_number(request.header("content-length")); length && *length > 0) {
    const auto body = json_body(request);
    if (!body) return body.error();
    const auto discard = parse_cancel(*body);
    if (!discard) return failure(discard.error());
    if (*discard) verb = JobEvent::kDiscard;
  }
  return reply_job(service_.act(captures[0], verb, request.caller.name));
}

HttpReply HttpRoutes::extend_job(const HttpRequest& request, const Captures& captures) {
  auto body = json_body(request);
  if (!body) return std::move(body.error());
  const auto stops = parse_stops(*body);
  return stops ? reply_job(service_.extend(captures[0], *stops, request.caller.name)) : failure(stops.error());
}

HttpReply HttpRoutes::change_job(const HttpRequest& request, const Captures& captures) {
  auto body = json_body(request);
  if (!body) return std::move(body.error());
  const auto change = parse_change(*body);
  return change ? reply_job(service_.change(captures[0], *change, request.caller.name)) : failure(change.error());
}

HttpReply HttpRoutes::delete_job(const HttpRequest& request, const Captures& captures) {
  const auto removed = service_.remove(captures[0], request.caller.name);
  if (!removed) return failure(removed.error(), kConflict);
  HttpReply reply;
  reply.status = 204;
  return reply;
}

HttpReply HttpRoutes::units(const HttpRequest& request, const Captures& captures) {
  const std::string text = request.param("after");
  const auto after = whole_number(text);
  if (!text.empty() && !after) return problem(400, "bad-request", "after: expected the first sub-pass of a unit");
  const auto page = service_.units(captures[0], after);
  if (!page) return failure(page.error());
  json units = json::array();
  for (const UnitView& unit : page->units) units.push_back(to_json(unit));
  return json_reply({{"units", std::move(units)}, {"after", page->after ? json(*page->after) : json()}});
}

HttpReply HttpRoutes::convergence(const HttpRequest&, const Captures& captures) {
  const auto points = service_.convergence(captures[0]);
  if (!points) return failure(points.error());
  json list = json::array();
  for (const ConvergencePoint& point : *points) list.push_back(to_json(point));
  return json_reply({{"points", std::move(list)}});
}

HttpReply HttpRoutes::submit_pilot(const HttpRequest& request, const Captures&) {
  constexpr double kDefault = 10, kLeast = 0.1, kMost = 86400;
  const std::string text = request.param("seconds");
  const auto seconds = text.empty() ? std::optional(kDefault) : decimal_number(text);
  if (!seconds || *seconds < kLeast || *seconds > kMost)
    return problem(400, "bad-request", fmt::format("seconds: expected {} to {}", kLeast, kMost));
  return take_job(request, *seconds, "/estimate");
}

HttpReply HttpRoutes::estimate(const HttpRequest& request, const Captures& captures) {
  constexpr double kMostPasses = 1e12, kLeastError = 1e-9, kMostError = 1e6;
  EstimateRequest wanted;
  const std::string passes = request.param("passes"), error = request.param("error");
  if (!passes.empty()) {
    const auto number = decimal_number(passes);
    if (!number || *number < 1 || *number > kMostPasses)
      return problem(400, "bad-request", fmt::format("passes: expected 1 to {}", kMostPasses));
    wanted.passes = *number;
  }
  if (!error.empty()) {
    const auto number = decimal_number(error);
    if (!number || *number < kLeastError || *number > kMostError)
      return problem(400, "bad-request", fmt::format("error: expected {} to {}", kLeastError, kMostError));
    wanted.error = *number;
  }
  const auto estimate = service_.estimate(captures[0], wanted);
  if (!estimate) return failure(estimate.error(), kNotYet);
  json document = prediction_json(estimate->pilot, estimate->prediction, estimate->workers);
  document["job"] = captures[0];
  return json_reply(document);
}

HttpReply HttpRoutes::steer_worker(const HttpRequest& request, const Captures& captures, WorkerVerb verb) {
  const auto worker = service_.steer(captures[0], verb, request.caller.name);
  return worker ? json_reply(to_json(*worker)) : failure(worker.error());
}

HttpReply HttpRoutes::drain_worker(const HttpRequest& request, const Captures& captures) {
  return steer_worker(request, captures, WorkerVerb::kDrain);
}

HttpReply HttpRoutes::disable_worker(const HttpRequest& request, const Captures& captures) {
  return steer_worker(request, captures, WorkerVerb::kDisable);
}

HttpReply HttpRoutes::enable_worker(const HttpRequest& request, const Captures& captures) {
  return steer_worker(request, captures, WorkerVerb::kEnable);
}

}  // namespace pf
