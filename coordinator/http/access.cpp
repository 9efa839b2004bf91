// Who may do what, and how often.

#include "coordinator/http/access.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "coordinator/http/routes.h"

namespace pf {
namespace {

HttpReply unauthorized() {
  HttpReply reply =
      problem(401, "unauthorized",
              "no or wrong bearer token; expected the one in the file 'token' of the farm's state folder, or "
              "one that 'photonfarm token create' made");
  reply.headers.emplace_back("WWW-Authenticate", "Bearer realm=\"photonfarm\"");
  return reply;
}

/// `path` itself or something below it.
bool is_below(std::string_view path, std::string_view folder) {
  return path.starts_with(folder) && (path.size() == folder.size() || path[folder.size()] == '/');
}

}  // namespace

double RateLimiter::take(const std::string& who) {
  const double now = clock_.now();
  const std::lock_guard lock(mutex_);
  Bucket& bucket = buckets_.try_emplace(who, Bucket{burst_, now}).first->second;
  bucket.level = std::min(burst_, bucket.level + (now - bucket.filled) * per_second_);
  bucket.filled = now;
  if (bucket.level < 1.0) return (1.0 - bucket.level) / per_second_;
  bucket.level -= 1.0;
  return 0.0;
}

std::optional<Role> needed_role(std::string_view method, std::string_view path) {
  const bool reads = method == "GET" || method == "HEAD";
  // The page's own files hold no data: what it shows, it asks for with a token.
  if (path == "/v1/health" || (reads && (path == "/" || is_below(path, "/assets")))) return std::nullopt;
  if (is_below(path, "/v1/tokens")) return Role::kAdmin;
  if (reads) return Role::kRead;
  const bool of_jobs = is_below(path, "/v1/jobs") || is_below(path, "/v1/estimates") || is_below(path, "/v1/blobs");
  return of_jobs && method != "DELETE" ? Role::kSubmit : Role::kAdmin;
}

std::optional<HttpReply> refused_access(HttpRequest& request, const TokenStore& tokens, RateLimiter& limiter) {
  const auto needed = needed_role(request.method, request.path);
  if (!needed) return std::nullopt;
  constexpr std::string_view kScheme = "Bearer ";
  const std::string given = request.header("authorization");
  if (!given.starts_with(kScheme)) return unauthorized();
  auto caller = tokens.find(std::string_view(given).substr(kScheme.size()));
  if (!caller) return unauthorized();
  request.caller = std::move(*caller);
  if (const double seconds = limiter.take(request.caller.name); seconds > 0) {
    HttpReply reply =
        problem(429, "too-many-requests",
                fmt::format("the token '{}' asks too often; try again in {:.1f} s", request.caller.name, seconds));
    reply.headers.emplace_back("Retry-After", fmt::format("{:.0f}", std::ceil(seconds)));
    return reply;
  }
  if (request.caller.role < *needed) {
    return problem(403, "forbidden",
                   fmt::format("the token '{}' has the role {}; this needs {}", request.caller.name,
                               to_string(request.caller.role), to_string(*needed)));
  }
  return std::nullopt;
}

}  // namespace pf
