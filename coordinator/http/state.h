#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

// The files by which clients on this machine find the service: STATE/url, STATE/token and, with TLS, STATE/ca.pem.

/// The bearer token: `wanted` when given, else the one in STATE/token, else a new one. It is then in that file, which
/// only its owner may read. Errors: kInvalidInput for a file that holds no token, kInternal.
[[nodiscard]] Result<std::string> keep_token(const std::filesystem::path& state, std::string_view wanted);
/// Port of the URL in STATE/url, where a former coordinator listened; 0 when there is none.
[[nodiscard]] int former_port(const std::filesystem::path& state);
[[nodiscard]] Result<void> write_url(const std::filesystem::path& state, std::string_view url);
/// 32 random bytes in hexadecimal, behind `pf_`: so they are found where they got by mistake. Errors: kInternal.
[[nodiscard]] Result<std::string> new_token();
/// STATE/ca.pem: what clients on this machine check the service's certificate by; empty: it has none, and the file
/// goes.
[[nodiscard]] Result<void> keep_ca(const std::filesystem::path& state, std::string_view pem);

}  // namespace pf
