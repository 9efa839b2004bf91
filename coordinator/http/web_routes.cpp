#include "coordinator/http/web_routes.h"

#include <algorithm>

#include "coordinator/http/routes.h"

namespace pf {
namespace {

/// Scripts, styles and data come from here alone, nothing inline; nobody frames the page or learns its
/// address.
constexpr std::string_view kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'";

}  // namespace

std::optional<HttpReply> web_reply(std::span<const WebFile> files, const HttpRequest& request) {
  const auto file = std::ranges::find(files, request.path, &WebFile::path);
  if (file == files.end()) {
    if (files.empty() || !request.path.starts_with("/assets/")) return std::nullopt;
    return problem(404, "not-found", "the dashboard has no such file; reload the page");
  }
  if (request.method != "GET" && request.method != "HEAD") {
    HttpReply reply = problem(405, "method-not-allowed", "expected GET");
    reply.headers.emplace_back("Allow", "GET");
    return reply;
  }
  HttpReply reply;
  reply.content_type = file->content_type;
  reply.headers = {{"Content-Security-Policy", std::string(kPolicy)},
                   {"Referrer-Policy", "no-referrer"},
                   {"Cross-Origin-Opener-Policy", "same-origin"},
                   {"Cross-Origin-Resource-Policy", "same-origin"},
                   {"Cache-Control", file->hashed ? "public, max-age=31536000, immutable" : "no-cache"},
                   {"ETag", std::string(file->etag)}};
  if (request.header("if-none-match") == file->etag) {
    reply.status = 304;
  } else {
    reply.body = std::string(file->content);
  }
  return reply;
}

}  // namespace pf
