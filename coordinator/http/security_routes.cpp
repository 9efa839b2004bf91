// The routes of tokens and metrics, and what a caller may cost.

#include <array>
#include <chrono>

#include <fmt/format.h>

#include "common/spec/job_spec.h"
#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"

namespace pf {
namespace {

using nlohmann::json;

json to_json(const TokenView& token) {
  return {{"name", token.name}, {"role", to_string(token.role)}, {"created_unix_ms", token.created_unix_ms}};
}

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Of the image that a spec asks for; 0 when it says so in no way that counts: then the spec's own checks
/// refuse it.
double pixels_of(const std::string& spec_json) {
  const json spec = json::parse(spec_json, nullptr, false);
  const json image = spec.is_object() ? spec.value("image", json::object()) : json();
  if (!image.is_object()) return 0;
  const JobSpec defaults;
  const auto side = [&](const char* key, int otherwise) {
    const json given = image.value(key, json(otherwise));
    return given.is_number() ? given.get<double>() : 0.0;
  };
  return side("width", defaults.image.width) * side("height", defaults.image.height);
}

}  // namespace

HttpReply HttpRoutes::metrics(const HttpRequest&, const Captures&) {
  HttpReply reply;
  reply.content_type = "text/plain; version=0.0.4; charset=utf-8";
  reply.body = metrics_.text(service_.list(), service_.workers());
  return reply;
}

HttpReply HttpRoutes::list_tokens(const HttpRequest&, const Captures&) {
  json tokens = json::array();
  for (const TokenView& token : tokens_->list()) tokens.push_back(to_json(token));
  HttpReply reply;
  reply.body = json_line({{"tokens", std::move(tokens)}});
  return reply;
}

HttpReply HttpRoutes::create_token(const HttpRequest& request, const Captures&) {
  const auto body = json_body(request);
  if (!body) return body.error();
  const json document = json::parse(*body, nullptr, false);
  const auto text = [&](const char* member) {
    return document.contains(member) && document[member].is_string() ? document[member].get<std::string>()
                                                                     : std::string();
  };
  if (!document.is_object() || document.size() != 2 || text("name").empty() || text("role").empty()) {
    return problem(422, "invalid-input",
                   "request body: expected {\"name\": \"...\", \"role\": \"read\", \"submit\" or \"admin\"}");
  }
  const auto role = role_of(text("role"));
  if (!role) return problem(422, "invalid-input", "role: expected read, submit or admin");
  const std::int64_t now = unix_ms();
  const auto token = tokens_->create(text("name"), *role, now);
  if (!token) return failure(token.error());
  log_.info("token created", {{"name", text("name")}, {"role", to_string(*role)}, {"by", request.caller.name}});
  json view = to_json(TokenView{text("name"), *role, now});
  view["token"] = *token;
  HttpReply reply;
  reply.status = 201;
  reply.headers.emplace_back("Cache-Control", "no-store");
  reply.body = json_line(view);
  return reply;
}

HttpReply HttpRoutes::revoke_token(const HttpRequest& request, const Captures& captures) {
  if (const auto revoked = tokens_->revoke(captures[0]); !revoked) return failure(revoked.error());
  log_.info("token revoked", {{"name", captures[0]}, {"by", request.caller.name}});
  HttpReply reply;
  reply.status = 204;
  return reply;
}

std::optional<HttpReply> HttpRoutes::over_limits(const Submission& submission, const Caller&) {
  const CoordinatorConfig::Limits& limits = options_.limits;
  std::uint64_t bytes = 0;  // at most 4096 files of at most 2^34: no overflow
  for (const auto& [path, blob] : submission.files) bytes += blob.bytes;
  if (bytes > limits.job_bytes)
    return problem(413, "too-large",
                   fmt::format("the job's files have {} bytes; expected at most {}", bytes, limits.job_bytes));
  if (const double pixels = pixels_of(submission.spec_json); pixels > static_cast<double>(limits.pixels))
    return problem(413, "too-large",
                   fmt::format("the image has {:.0f} pixels; expected at most {}", pixels, limits.pixels));
  return std::nullopt;
}

}  // namespace pf
