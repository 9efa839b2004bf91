#include "coordinator/http/routes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <system_error>
#include <utility>

#include "build_id.h"
#include "common/base/nearest_name.h"
#include "common/wire/messages.h"
#include "coordinator/http/json.h"
#include "coordinator/http/openapi.h"
#include "coordinator/http/streams.h"

namespace pf {
namespace {

using nlohmann::json;

std::vector<std::string_view> parts_of(std::string_view path) {
  std::vector<std::string_view> parts;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const std::size_t slash = std::min(path.find('/'), path.size());
    parts.push_back(path.substr(0, slash));
    path.remove_prefix(slash);
  }
  return parts;
}

}  // namespace

std::optional<std::uint64_t> whole_number(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

HttpReply json_reply(const json& value, int status) {
  HttpReply reply;
  reply.status = status;
  reply.body = json_line(value);
  return reply;
}

std::string HttpRequest::header(const std::string& lower_case_name) const {
  const auto found = headers.find(lower_case_name);
  return found == headers.end() ? std::string() : found->second;
}

std::string HttpRequest::param(const std::string& name) const {
  const auto found = params.find(name);
  return found == params.end() ? std::string() : found->second;
}

HttpReply problem(int status, std::string_view type, std::string_view detail) {
  HttpReply reply;
  reply.status = status;
  reply.content_type = "application/problem+json";
  reply.body = problem_json(status, type, detail);
  return reply;
}

/// Counts a stream while it lives, in whatever copies the library makes of it.
class HttpRoutes::StreamTicket {
 public:
  explicit StreamTicket(std::atomic<int>& count) : count_(count) { ++count_; }
  ~StreamTicket() { --count_; }
  StreamTicket(const StreamTicket&) = delete;
  StreamTicket& operator=(const StreamTicket&) = delete;

 private:
  std::atomic<int>& count_;
};

Result<std::unique_ptr<HttpRoutes>> HttpRoutes::make(Options options, JobService& service, const Log& log,
                                                     std::stop_token stop) {
  auto store = BlobStore::open(options.blobs, 0);
  if (!store) return tl::unexpected(store.error());
  auto tokens = TokenStore::open(options.state, options.token);
  if (!tokens) return tl::unexpected(tokens.error());
  return std::unique_ptr<HttpRoutes>(
      new HttpRoutes(std::move(options), service, log, std::move(stop), std::move(*store), std::move(*tokens)));
}

HttpRoutes::HttpRoutes(Options options, JobService& service, const Log& log, std::stop_token stop, BlobStore store,
                       std::unique_ptr<TokenStore> tokens)
    : options_(std::move(options)),
      service_(service),
      log_(log),
      stop_(std::move(stop)),
      store_(std::move(store)),
      tokens_(std::move(tokens)),
      metrics_(options_.metrics != nullptr ? *options_.metrics : own_metrics_),
      limiter_(options_.limits.requests_per_second, options_.limits.request_burst,
               options_.clock != nullptr ? *options_.clock : system_clock_),
      pixel_cache_(options_.pixel_cache_bytes) {}

std::span<const HttpRoutes::Route> HttpRoutes::routes() {
  static constexpr std::array kRoutes = {
      Route{"GET", "/v1/health", &HttpRoutes::health},
      Route{"GET", "/v1/openapi.json", &HttpRoutes::openapi},
      Route{"POST", "/v1/jobs", &HttpRoutes::submit},
      Route{"GET", "/v1/jobs", &HttpRoutes::list_jobs},
      Route{"POST", "/v1/jobs/validate", &HttpRoutes::validate},
      Route{"GET", "/v1/jobs/{}", &HttpRoutes::show_job},
      Route{"PATCH", "/v1/jobs/{}", &HttpRoutes::change_job},
      Route{"DELETE", "/v1/jobs/{}", &HttpRoutes::delete_job},
      Route{"POST", "/v1/jobs/{}/pause", &HttpRoutes::pause_job},
      Route{"POST", "/v1/jobs/{}/resume", &HttpRoutes::resume_job},
      Route{"POST", "/v1/jobs/{}/retry", &HttpRoutes::retry_job},
      Route{"POST", "/v1/jobs/{}/cancel", &HttpRoutes::cancel_job},
      Route{"POST", "/v1/jobs/{}/extend", &HttpRoutes::extend_job},
      Route{"GET", "/v1/jobs/{}/units", &HttpRoutes::units},
      Route{"GET", "/v1/jobs/{}/convergence", &HttpRoutes::convergence},
      Route{"POST", "/v1/estimates", &HttpRoutes::submit_pilot},
      Route{"GET", "/v1/jobs/{}/estimate", &HttpRoutes::estimate},
      Route{"GET", "/v1/jobs/{}/events", &HttpRoutes::events},
      Route{"GET", "/v1/jobs/{}/logs", &HttpRoutes::logs},
      Route{"GET", "/v1/jobs/{}/image.exr", &HttpRoutes::exr},
      Route{"GET", "/v1/jobs/{}/image.png", &HttpRoutes::png},
      Route{"GET", "/v1/jobs/{}/figures.json", &HttpRoutes::figures},
      Route{"GET", "/v1/jobs/{}/checkpoint", &HttpRoutes::checkpoint},
      Route{"GET", "/v1/jobs/{}/preview.png", &HttpRoutes::preview},
      Route{"GET", "/v1/jobs/{}/layers", &HttpRoutes::layers},
      Route{"GET", "/v1/jobs/{}/pixels", &HttpRoutes::pixels},
      Route{"GET", "/v1/workers", &HttpRoutes::list_workers},
      Route{"POST", "/v1/workers/{}/drain", &HttpRoutes::drain_worker},
      Route{"POST", "/v1/workers/{}/disable", &HttpRoutes::disable_worker},
      Route{"POST", "/v1/workers/{}/enable", &HttpRoutes::enable_worker},
      Route{"HEAD", "/v1/blobs/{}", &HttpRoutes::head_blob},
      Route{"GET", "/v1/blobs/{}", &HttpRoutes::get_blob},
      Route{"PUT", "/v1/blobs/{}", &HttpRoutes::put_blob},
      Route{"GET", "/v1/metrics", &HttpRoutes::metrics},
      Route{"GET", "/v1/tokens", &HttpRoutes::list_tokens},
      Route{"POST", "/v1/tokens", &HttpRoutes::create_token},
      Route{"DELETE", "/v1/tokens/{}", &HttpRoutes::revoke_token},
  };
  return kRoutes;
}

std::vector<std::pair<std::string, std::string>> HttpRoutes::addresses() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const Route& route : routes()) all.emplace_back(route.method, route.pattern);
  return all;
}

HttpReply HttpRoutes::answer(HttpRequest request) {
  const double from = system_clock_.now();
  std::string_view pattern = "none";
  HttpReply reply = route(request, pattern);
  metrics_.request(request.method, pattern, reply.status, system_clock_.now() - from);
  const std::string status = std::to_string(reply.status);
  if (reply.status >= 500) {
    log_.warning("http", {{"method", request.method}, {"path", request.path}, {"status", status}});
  } else {
    log_.debug("http", {{"method", request.method}, {"path", request.path}, {"status", status}});
  }
  return reply;
}

HttpReply HttpRoutes::route(HttpRequest& request, std::string_view& answering) {
  if (auto refused = refused_access(request, *tokens_, limiter_)) return std::move(*refused);
  if (auto page = web_reply(options_.web, request)) {
    answering = "/";
    return std::move(*page);
  }
  if (!request.path.starts_with('/')) return problem(404, "not-found", "no such address; expected one below /v1/");
  const std::vector<std::string_view> parts = parts_of(request.path);
  std::vector<std::string_view> allowed;
  for (const Route& route : routes()) {
    const std::vector<std::string_view> pattern = parts_of(route.pattern);
    if (pattern.size() != parts.size()) continue;
    Captures captures;
    bool fits = true;
    for (std::size_t i = 0; i < parts.size() && fits; ++i) {
      if (pattern[i] == "{}") {
        captures.emplace_back(parts[i]);
        fits = is_wire_name(parts[i]);  // nothing that means something in a path
      } else {
        fits = pattern[i] == parts[i];
      }
    }
    if (!fits) continue;
    // A HEAD is a GET whose body the library leaves out.
    if (route.method == request.method || (route.method == "GET" && request.method == "HEAD")) {
      answering = route.pattern;
      return (this->*route.handler)(request, captures);
    }
    allowed.push_back(route.method);
  }
  if (allowed.empty()) return problem(404, "not-found", "no such address; the API is below /v1/");
  const std::string methods = fmt::format("{}", fmt::join(allowed, ", "));
  HttpReply reply = problem(405, "method-not-allowed", "expected " + methods);
  reply.headers.emplace_back("Allow", methods);
  return reply;
}

HttpReply HttpRoutes::failure(const Error& error, const Unavailable& unavailable) const {
  int status = 500;
  std::string_view type = problem_type(error.kind);
  switch (error.kind) {
    case ErrorKind::kUsage:
      status = 404;
      break;
    case ErrorKind::kInvalidSpec:
    case ErrorKind::kInvalidInput:
      status = 422;
      break;
    case ErrorKind::kUnavailable:
      status = unavailable.status;
      type = unavailable.type;
      break;
    case ErrorKind::kTimeout:
    case ErrorKind::kInterrupted:
      status = 503;
      break;
    case ErrorKind::kInternal:
      status = 500;
      break;
  }
  return problem(status, type, error.message);
}

HttpReply HttpRoutes::reply_job(const Result<JobView>& job, int status) const {
  return job ? json_reply(to_json(*job), status) : failure(job.error(), status == 201 ? kTooManyJobs : kConflict);
}

HttpReply HttpRoutes::health(const HttpRequest&, const Captures&) {
  return json_reply({{"status", "ok"}, {"version", kVersion}, {"build_id", kBuildId}});
}

HttpReply HttpRoutes::openapi(const HttpRequest&, const Captures&) { return json_reply(openapi_document()); }

tl::expected<std::string, HttpReply> HttpRoutes::json_body(const HttpRequest& request) const {
  const std::string type = request.header("content-type");
  if (type != "application/json" && !type.starts_with("application/json;")) {
    return tl::unexpected(problem(415, "unsupported-media-type", "expected Content-Type: application/json"));
  }
  const auto length = whole_number(request.header("content-length"));
  if (!length) return tl::unexpected(problem(411, "length-required", "expected a Content-Length"));
  if (*length > options_.max_body_bytes) {
    return tl::unexpected(problem(
        413, "too-large", fmt::format("the body has {} bytes; expected at most {}", *length, options_.max_body_bytes)));
  }
  std::string body;
  const bool whole = request.read_body([&](std::string_view piece) {
    body += piece;
    return body.size() <= *length;
  });
  if (!whole || body.size() != *length)
    return tl::unexpected(problem(400, "bad-request", "the body did not come whole"));
  return body;
}

HttpReply HttpRoutes::submit(const HttpRequest& request, const Captures&) { return take_job(request, 0, ""); }

HttpReply HttpRoutes::take_job(const HttpRequest& request, double pilot_seconds, std::string_view then) {
  const std::string key = request.header("idempotency-key");
  const auto printable = [](char c) { return c > ' ' && c <= '~'; };
  if (key.size() > 128 || !std::ranges::all_of(key, printable)) {
    return problem(400, "bad-request", "Idempotency-Key: expected at most 128 printable characters without blanks");
  }
  auto body = json_body(request);
  if (!body) return std::move(body.error());
  auto submission = parse_submission(std::move(*body));
  if (!submission) return failure(submission.error());
  if (auto refused = over_limits(*submission, request.caller)) return std::move(*refused);
  submission->idempotency_key = key;
  submission->submitted_by = request.caller.name;
  submission->pilot_seconds = pilot_seconds;
  const auto job = service_.submit(*submission);
  HttpReply reply = reply_job(job, 201);
  if (job) reply.headers.emplace_back("Location", fmt::format("/v1/jobs/{}{}", job->id, then));
  return reply;
}

HttpReply HttpRoutes::list_jobs(const HttpRequest& request, const Captures&) {
  JobFilter filter;
  const std::string state = request.param("state"), limit = request.param("limit");
  if (!state.empty()) {
    filter.state = job_state_of(state);
    if (!filter.state) {
      std::vector<std::string_view> names;
      for (const JobState s : all_job_states()) names.push_back(to_string(s));
      std::string detail = fmt::format("state: no such state; expected one of {}", fmt::join(names, ", "));
      if (const auto near = nearest_name(state, std::span<const std::string_view>(names))) {
        detail += fmt::format("; did you mean {}?", *near);
      }
      return problem(400, "bad-request", detail);
    }
  }
  if (!limit.empty()) {
    const auto count = whole_number(limit);
    if (!count || *count == 0 || *count > filter.limit) {
      return problem(400, "bad-request", fmt::format("limit: expected 1 to {}", filter.limit));
    }
    filter.limit = *count;
  }
  filter.name = request.param("name");
  filter.before = request.param("before");
  const auto list = service_.list(filter);
  if (!list) return failure(list.error());
  json jobs = json::array();
  for (const JobView& job : list->jobs) jobs.push_back(to_json(job));
  return json_reply({{"jobs", std::move(jobs)}, {"before", list->before.empty() ? json() : json(list->before)}});
}

HttpReply HttpRoutes::show_job(const HttpRequest&, const Captures& captures) {
  return reply_job(service_.show(captures[0]));
}

HttpReply HttpRoutes::events(const HttpRequest&, const Captures& captures) {
  if (const auto job = service_.show(captures[0]); !job) return failure(job.error());
  auto ticket = std::make_shared<StreamTicket>(streams_);
  if (streams_ > options_.max_streams)
    return problem(503, "unavailable", "too many clients are watching; try again later");
  HttpReply reply;
  reply.content_type = "text/event-stream";
  reply.body = NextPiece([ticket, next = job_events(service_, texts_, captures[0], options_.heartbeat_seconds, stop_)](
                             std::string& piece) { return next(piece); });
  return reply;
}

HttpReply HttpRoutes::logs(const HttpRequest& request, const Captures& captures) {
  const std::string after_text = request.param("after"), follow = request.param("follow");
  const auto after = after_text.empty() ? std::optional<std::uint64_t>(0) : whole_number(after_text);
  if (!after) return problem(400, "bad-request", "after: expected the number of a log entry");
  if (!follow.empty() && follow != "0" && follow != "1") return problem(400, "bad-request", "follow: expected 0 or 1");
  if (const auto job = service_.show(captures[0]); !job) return failure(job.error());
  auto ticket = std::make_shared<StreamTicket>(streams_);
  if (streams_ > options_.max_streams)
    return problem(503, "unavailable", "too many clients are watching; try again later");
  HttpReply reply;
  reply.content_type = "application/x-ndjson";
  reply.body =
      NextPiece([ticket, next = log_lines(service_, captures[0], *after, follow == "1", options_.heartbeat_seconds,
                                          stop_)](std::string& piece) { return next(piece); });
  return reply;
}

HttpReply HttpRoutes::preview(const HttpRequest&, const Captures& captures) {
  auto png = service_.preview_png(captures[0]);
  if (!png) return failure(png.error(), kNotYet);
  HttpReply reply;
  reply.content_type = "image/png";
  reply.headers.emplace_back("Cache-Control", "no-store");
  reply.body = std::move(*png);
  return reply;
}

HttpReply HttpRoutes::list_workers(const HttpRequest&, const Captures&) {
  json workers = json::array();
  for (const WorkerView& worker : service_.workers()) workers.push_back(to_json(worker));
  return json_reply({{"workers", std::move(workers)}});
}

}  // namespace pf
