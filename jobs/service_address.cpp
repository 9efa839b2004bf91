#include "jobs/service_address.h"

#include <fmt/format.h>

#include <string_view>
#include <system_error>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

constexpr std::uint64_t kMostBytes = 4096;

bool is_url(std::string_view text) { return text.find("://") != std::string_view::npos; }

std::string trimmed(std::string text) {
  while (!text.empty() && static_cast<unsigned char>(text.back()) <= ' ') text.pop_back();
  return text;
}

/// The URL without a slash at its end. Errors: kUsage.
Result<std::string> checked_url(std::string url, const std::string& origin) {
  while (url.ends_with('/')) url.pop_back();
  const std::size_t scheme = url.find("://");
  const std::string_view name = std::string_view(url).substr(0, scheme);
  const bool known = scheme != std::string::npos && (name == "http" || name == "https");
  const std::string_view host = known ? std::string_view(url).substr(scheme + 3) : std::string_view();
  if (host.empty() || host.find_first_of("/?#@ ") != std::string_view::npos) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: '{}' is no address of a service; expected http://HOST:PORT", origin, url));
  }
  return url;
}

}  // namespace

std::string start_hint(const std::string& server) {
  if (is_url(server)) return "is its coordinator running? 'photonfarm farm' starts one on this machine";
  return fmt::format("start a farm with: photonfarm farm --state {}", server);
}

Result<ServiceAddress> find_service(const std::string& server, const std::string& token,
                                    const std::filesystem::path& ca) {
  std::error_code error;
  if (!ca.empty() && !std::filesystem::is_regular_file(ca, error))
    return fail(ErrorKind::kUsage, fmt::format("--ca {}: no such file; expected certificates in PEM", ca.string()));
  if (server.empty()) {
    return fail(ErrorKind::kUnavailable,
                "no home folder, so no farm's state folder; expected --server or PHOTONFARM_SERVER, a URL or "
                "such a folder");
  }
  if (is_url(server)) {
    auto url = checked_url(server, "--server or PHOTONFARM_SERVER");
    if (!url) return tl::unexpected(url.error());
    if (token.empty()) {
      return fail(ErrorKind::kUsage,
                  fmt::format("{}: PHOTONFARM_TOKEN is not set; expected the service's token (the file "
                              "'token' of its state folder)",
                              *url));
    }
    return ServiceAddress{std::move(*url), token, ca, "PHOTONFARM_TOKEN"};
  }
  const std::filesystem::path folder(server);
  if (!std::filesystem::exists(folder / "url", error)) {
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}: no farm has been started with this state folder (it has no file 'url'); {}", server,
                            start_hint(server)));
  }
  const auto url_text = read_file(folder / "url", kMostBytes, ErrorKind::kUnavailable);
  if (!url_text) return tl::unexpected(url_text.error());
  auto url = checked_url(trimmed(*url_text), (folder / "url").string());
  if (!url) return tl::unexpected(url.error());
  const auto own = read_file(folder / "token", kMostBytes, ErrorKind::kUnavailable);
  if (!own) return tl::unexpected(own.error());
  const bool has_ca = ca.empty() && std::filesystem::exists(folder / "ca.pem", error);
  return ServiceAddress{std::move(*url), trimmed(*own), has_ca ? folder / "ca.pem" : ca, (folder / "token").string()};
}

}  // namespace pf
