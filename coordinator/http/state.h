#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

// The two files by which clients on this machine find the service: STATE/url and STATE/token.

/// The bearer token: `wanted` when given, else the one in STATE/token, else 32 new random bytes in
/// hexadecimal. It is then in that file, which only its owner may read. Errors: kInvalidInput for a file that
/// holds no token, kInternal.
[[nodiscard]] Result<std::string> keep_token(const std::filesystem::path& state, std::string_view wanted);
/// Port of the URL in STATE/url, where a former coordinator listened; 0 when there is none.
[[nodiscard]] int former_port(const std::filesystem::path& state);
[[nodiscard]] Result<void> write_url(const std::filesystem::path& state, std::string_view url);
/// Takes equally long for all wrong tokens.
[[nodiscard]] bool same_token(std::string_view given, std::string_view token);

}  // namespace pf
