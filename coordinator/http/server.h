#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "coordinator/config.h"
#include "coordinator/http/socket.h"
#include "coordinator/http/web_routes.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"

namespace pf {

struct HttpServerOptions {
  CoordinatorConfig config;     ///< address, certificate, what callers may cost
  std::string token;            ///< empty: the one of the state folder, made when there is none
  std::filesystem::path state;  ///< must exist; gets `url`, `token`, `ca.pem`
  std::filesystem::path blobs;  ///< folder of the blob store
  HttpLimits limits;
  int max_connections = 512;       ///< served at a time; further ones wait, and beyond as many again are refused
  int max_streams = 256;           ///< of them for events and logs being followed
  double heartbeat_seconds = 15;   ///< of silence on those
  Metrics* metrics = nullptr;      ///< what /v1/metrics shows beside jobs and workers; nullptr: the requests alone
  const Clock* clock = nullptr;    ///< of the rate limit; nullptr: the system's
  std::span<const WebFile> web{};  ///< the dashboard; empty: there is none
};

/// The HTTP API: README.md in this folder lists its addresses. Serves from threads of its own until it is
/// destroyed, which takes a fraction of a second even while clients watch.
class HttpServer {
 public:
  /// Errors: kUnavailable when it cannot listen; kUsage for an address that others reach without a certificate; kUsage,
  /// kInvalidInput, kInternal from the state folder and the store.
  [[nodiscard]] static Result<std::unique_ptr<HttpServer>> start(const HttpServerOptions& options, JobService& service,
                                                                 const Log& log);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// `http://127.0.0.1:34567`
  [[nodiscard]] const std::string& url() const { return url_; }
  [[nodiscard]] const std::string& token() const { return token_; }

 private:
  struct Parts;
  HttpServer(std::unique_ptr<Parts> parts, std::string url, std::string token);
  std::unique_ptr<Parts> parts_;  ///< what needs the HTTP library's headers
  std::string url_, token_;
};

}  // namespace pf
