#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/clock.h"
#include "coordinator/http/message.h"
#include "coordinator/http/tokens.h"

namespace pf {

/// A bucket of tokens for each caller: `burst` requests at once, `per_second` on average. May be used from
/// any thread.
class RateLimiter {
 public:
  RateLimiter(double per_second, double burst, const Clock& clock)
      : per_second_(per_second), burst_(burst), clock_(clock) {}
  /// 0: the request may go. Else seconds after which another one may.
  [[nodiscard]] double take(const std::string& who);

 private:
  struct Bucket {
    double level, filled;
  };
  const double per_second_, burst_;
  const Clock& clock_;
  std::mutex mutex_;
  std::map<std::string, Bucket> buckets_;
};

/// The least role that may send this request; empty: needs no token.
[[nodiscard]] std::optional<Role> needed_role(std::string_view method, std::string_view path);

/// Lets a request in, and says in it who sent it; or the reply that refuses it.
[[nodiscard]] std::optional<HttpReply> refused_access(HttpRequest& request, const TokenStore& tokens,
                                                      RateLimiter& limiter);

}  // namespace pf
