#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"

namespace pf {

struct ServiceOptions {
  std::string server;             ///< URL or state folder
  std::string token;              ///< for a URL
  std::filesystem::path ca = {};  ///< certificates that an https service is checked by; empty: as find_service says
  double retry_seconds = 60;      ///< how long a service that answered before may be away
  double first_seconds = 5;       ///< how long one that has never answered
  const std::atomic<bool>* interrupted = nullptr;
  std::function<void(const std::string&)> notice;  ///< told when it begins to try again
};

struct ServiceReply {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;                            ///< unless `take` got it
};

struct ServiceCall {
  std::string method = "GET";
  std::string path;
  std::vector<std::pair<std::string, std::string>> headers = {};
  std::string body = {};            ///< JSON
  std::filesystem::path file = {};  ///< sent instead, in pieces
  /// A reply of 200 or 206: told its head, then its body in pieces; false breaks off.
  std::function<bool(const ServiceReply& head)> begin = {};
  std::function<bool(std::string_view piece)> take = {};
};

/// Speaks to the coordinator's HTTP API (coordinator/README.md). One connection for each call; used from one
/// thread.
class ServiceClient {
 public:
  explicit ServiceClient(ServiceOptions options) : options_(std::move(options)) {}

  /// One try. Errors: kUnavailable when no whole reply came; kInterrupted; those of find_service. Any status
  /// is a reply.
  [[nodiscard]] Result<ServiceReply> try_call(const ServiceCall& call);
  /// Tries again, within the options' seconds, while the service is not reachable or says 503; such a call
  /// must do no harm when it comes twice. Errors as above.
  [[nodiscard]] Result<ServiceReply> call(const ServiceCall& call);
  /// False when interrupted meanwhile.
  [[nodiscard]] bool pause(double seconds) const;
  /// Waits before another try. Errors: `last` when that took too long already; kInterrupted.
  [[nodiscard]] Result<void> wait_to_retry(const Error& last);

  /// The reply's JSON. Errors: as of `call` and those that the service reports: kInvalidSpec, kInvalidInput,
  /// kUsage for what does not exist, kInternal for what cannot be done now. `patient` false: one try.
  [[nodiscard]] Result<nlohmann::json> ask(const ServiceCall& call, bool patient);
  /// Empty, or the error that a reply reports.
  [[nodiscard]] Result<void> check(const ServiceReply& reply) const;

  [[nodiscard]] bool interrupted() const { return options_.interrupted != nullptr && options_.interrupted->load(); }
  [[nodiscard]] const ServiceOptions& options() const { return options_; }
  /// As last used; for messages.
  [[nodiscard]] const std::string& url() const { return url_; }

 private:
  ServiceOptions options_;
  std::string url_, token_origin_;
  bool answered_ = false;  ///< ever
  bool away_ = false;      ///< not reachable since ...
  std::chrono::steady_clock::time_point away_since_{};
  double pause_seconds_ = 0;
};

}  // namespace pf
