#pragma once

#include <atomic>
#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/blob_store.h"
#include "coordinator/config.h"
#include "coordinator/http/access.h"
#include "coordinator/http/message.h"
#include "coordinator/http/pixel_cache.h"
#include "coordinator/http/streams.h"
#include "coordinator/http/web_routes.h"
#include "coordinator/job_service.h"
#include "coordinator/metrics.h"

namespace pf {

/// What kUnavailable means: that depends on what was asked.
struct Unavailable {
  int status = 503;
  std::string_view type = "unavailable";
};
inline constexpr Unavailable kConflict{409, "conflict"};          ///< the job's state does not permit it
inline constexpr Unavailable kTooManyJobs{429, "too-many-jobs"};  ///< of one token
inline constexpr Unavailable kNotYet{409, "not-yet"};
inline constexpr Unavailable kExpired{410, "expired"};

/// What each address of the API answers; the table is in coordinator/README.md. Called from many threads.
class HttpRoutes {
 public:
  struct Options {
    std::string token;            ///< the one of the state folder
    std::filesystem::path state;  ///< holds the other tokens
    CoordinatorConfig::Limits limits;
    const Clock* clock = nullptr;            ///< of the rate limit; nullptr: the system's
    Metrics* metrics = nullptr;              ///< nullptr: requests alone are counted
    std::filesystem::path blobs;             ///< folder of the blob store
    std::uint64_t max_body_bytes = 8 << 20;  ///< of what is no blob
    int max_streams = 256;                   ///< events and logs being followed at a time
    double heartbeat_seconds = 15;           ///< of silence after which a stream shows that it lives
    std::span<const WebFile> web{};          ///< the dashboard; may be empty
    std::uint64_t pixel_cache_bytes = 96 << 20;
  };
  /// `stop` ends streams. Errors: those of BlobStore::open.
  [[nodiscard]] static Result<std::unique_ptr<HttpRoutes>> make(Options options, JobService& service, const Log& log,
                                                                std::stop_token stop);

  [[nodiscard]] HttpReply answer(HttpRequest request);
  /// Methods and patterns of all routes.
  [[nodiscard]] static std::vector<std::pair<std::string, std::string>> addresses();

 private:
  /// The parts of a path that stand for `{}` in a route's pattern.
  using Captures = std::vector<std::string>;
  struct Route {
    std::string_view method, pattern;
    HttpReply (HttpRoutes::*handler)(const HttpRequest&, const Captures&);
  };
  class StreamTicket;

  HttpRoutes(Options options, JobService& service, const Log& log, std::stop_token stop, BlobStore store,
             std::unique_ptr<TokenStore> tokens);
  [[nodiscard]] static std::span<const Route> routes();
  /// `pattern` becomes that of the route that answers.
  [[nodiscard]] HttpReply route(HttpRequest& request, std::string_view& pattern);
  /// The text of a JSON body, or the reply that refuses it.
  [[nodiscard]] tl::expected<std::string, HttpReply> json_body(const HttpRequest& request) const;
  /// A reply for a job that this caller may not send: too large, or one too many.
  [[nodiscard]] std::optional<HttpReply> over_limits(const Submission& submission, const Caller& caller);
  [[nodiscard]] HttpReply failure(const Error& error, const Unavailable& unavailable) const;
  [[nodiscard]] HttpReply failure(const Error& error) const { return failure(error, Unavailable()); }
  [[nodiscard]] HttpReply reply_job(const Result<JobView>& job, int status = 200) const;

  [[nodiscard]] HttpReply openapi(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply health(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply submit(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply submit_pilot(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply estimate(const HttpRequest&, const Captures&);
  /// Takes a submission; `then` follows the job's address in Location.
  [[nodiscard]] HttpReply take_job(const HttpRequest& request, double pilot_seconds, std::string_view then);
  [[nodiscard]] HttpReply validate(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply list_jobs(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply show_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply cancel_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply pause_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply resume_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply retry_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply extend_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply change_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply delete_job(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply units(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply convergence(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply events(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply logs(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply exr(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply png(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply figures(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply checkpoint(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply artifact(const HttpRequest&, const std::string& id, Artifact kind, std::string_view type);
  [[nodiscard]] HttpReply preview(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply layers(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply pixels(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply list_workers(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply drain_worker(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply disable_worker(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply enable_worker(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply steer_worker(const HttpRequest&, const Captures&, WorkerVerb verb);
  [[nodiscard]] HttpReply head_blob(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply get_blob(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply put_blob(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply metrics(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply list_tokens(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply create_token(const HttpRequest&, const Captures&);
  [[nodiscard]] HttpReply revoke_token(const HttpRequest&, const Captures&);

  const Options options_;
  JobService& service_;
  const Log& log_;
  const std::stop_token stop_;
  std::mutex store_mutex_;
  BlobStore store_;
  std::atomic<int> streams_{0};
  JobTexts texts_{service_};
  std::unique_ptr<TokenStore> tokens_;
  const SystemClock system_clock_;
  Metrics own_metrics_;
  Metrics& metrics_;
  RateLimiter limiter_;
  PixelCache pixel_cache_;
};

[[nodiscard]] HttpReply json_reply(const nlohmann::json& value, int status = 200);
/// A reply that is a problem document.
[[nodiscard]] HttpReply problem(int status, std::string_view type, std::string_view detail);

}  // namespace pf
