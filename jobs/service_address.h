#pragma once

#include <filesystem>
#include <string>

#include "common/base/result.h"

namespace pf {

/// Where a service listens, and what it wants to hear first.
struct ServiceAddress {
  std::string url;  ///< http://HOST:PORT or https://...
  std::string token;
  std::filesystem::path ca;  ///< what an https certificate is checked by; empty: the system's authorities
  std::string origin;        ///< where these were found, for hints: a file or a variable
};

/// `server`: a URL, which takes `token`, or a farm's state folder, which holds both. `ca`: file of certificates; empty:
/// the folder's, or the system's. Read anew for each connection: a coordinator that starts again may listen elsewhere.
/// Errors: kUsage, kUnavailable (no farm was started there).
[[nodiscard]] Result<ServiceAddress> find_service(const std::string& server, const std::string& token,
                                                  const std::filesystem::path& ca);

/// What to do about a service that is not there.
[[nodiscard]] std::string start_hint(const std::string& server);

}  // namespace pf
