#include "coordinator/http/state.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <array>
#include <charconv>
#include <system_error>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"

namespace pf {
namespace {

constexpr std::size_t kTokenBytes = 32;
constexpr std::size_t kLeastToken = 16, kMostToken = 256;

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' ')) text.remove_suffix(1);
  return text;
}

bool is_token(std::string_view text) {
  if (text.size() < kLeastToken || text.size() > kMostToken) return false;
  for (const char c : text) {
    if (c <= ' ' || c > '~') return false;
  }
  return true;
}

}  // namespace

Result<std::string> keep_token(const std::filesystem::path& state, std::string_view wanted) {
  const std::filesystem::path file = state / "token";
  std::string token(wanted);
  std::error_code error;
  if (!wanted.empty() && !is_token(wanted)) {
    return fail(ErrorKind::kUsage,
                fmt::format("token: expected {} to {} printable characters without blanks", kLeastToken, kMostToken));
  }
  if (token.empty() && std::filesystem::exists(file, error)) {
    const auto text = read_file(file, kMostToken + 2);
    if (!text) return tl::unexpected(text.error());
    token = trimmed(*text);
    if (!is_token(token)) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("{}: holds no token; remove it, and a new one is made", file.string()));
    }
  }
  if (token.empty()) {
    auto made = new_token();
    if (!made) return made;
    token = std::move(*made);
  }
  // Written again even when it was there: so its mode is right whatever happened to the file.
  if (auto written = write_file_atomically(file, token + "\n", FileAccess::kOwnerOnly); !written) {
    return tl::unexpected(written.error());
  }
  return token;
}

int former_port(const std::filesystem::path& state) {
  const auto text = read_file(state / "url", 1024);
  if (!text) return 0;
  const std::string_view url = trimmed(*text);
  const std::size_t colon = url.rfind(':');
  if (colon == std::string_view::npos) return 0;
  int port = 0;
  const char* end = url.data() + url.size();
  const auto [parsed, error] = std::from_chars(url.data() + colon + 1, end, port);
  return error == std::errc() && parsed == end && port > 0 && port < 65536 ? port : 0;
}

Result<void> write_url(const std::filesystem::path& state, std::string_view url) {
  return write_file_atomically(state / "url", fmt::format("{}\n", url));
}

Result<std::string> new_token() {
  std::array<unsigned char, kTokenBytes> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) {
    return fail(ErrorKind::kInternal, "the system gives no random bytes for a token");
  }
  std::string token = "pf_";
  for (const unsigned char byte : random) token += fmt::format("{:02x}", byte);
  return token;
}

Result<void> keep_ca(const std::filesystem::path& state, std::string_view pem) {
  if (!pem.empty()) return write_file_atomically(state / "ca.pem", pem);
  std::error_code ignored;
  std::filesystem::remove(state / "ca.pem", ignored);
  return {};
}

}  // namespace pf
