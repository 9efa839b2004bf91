#include "common/wire/nats/engine.h"

#include <sys/stat.h>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

constexpr std::uint64_t kMaxCredentialsBytes = 64 * 1024;

/// Others than the owner must not read a password.
Result<void> check_mode(const std::filesystem::path& file) {
  struct stat info {};
  if (stat(file.c_str(), &info) == 0 && (info.st_mode & 077) != 0) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: mode {:04o} lets others read a password; expected 0600: chmod 600 {}", file.string(),
                            info.st_mode & 07777, file.string()));
  }
  return {};
}

}  // namespace

Result<EngineOptions> load_credentials(const std::filesystem::path& file) {
  const Result<std::string> text = read_file(file, kMaxCredentialsBytes, ErrorKind::kUsage);
  if (!text) return tl::unexpected(text.error());
  if (Result<void> mode = check_mode(file); !mode) return tl::unexpected(mode.error());
  EngineOptions options;
  const std::filesystem::path folder = file.parent_path();
  const auto set = [&](const std::string& key, const std::string& value) {
    const auto path = [&] { return value.empty() ? std::filesystem::path() : folder / value; };
    if (key == "url") return options.url = value, true;
    if (key == "name") return options.name = value, true;
    if (key == "user") return options.user = value, true;
    if (key == "password") return options.password = value, true;
    if (key == "credentials") return options.credentials = path(), true;
    if (key == "ca") return options.ca = path(), true;
    if (key == "certificate") return options.certificate = path(), true;
    if (key == "key") return options.key = path(), true;
    return false;
  };
  try {
    const toml::table table = toml::parse(*text, file.string());
    for (const auto& [key, node] : table) {
      const std::string name(key.str());
      const auto value = node.value_exact<std::string>();
      if (!value || !set(name, *value)) {
        return fail(
            ErrorKind::kUsage,
            fmt::format("{}:{}: '{}'; expected strings url, name, user, password, credentials, ca, certificate, key",
                        file.string(), key.source().begin.line, name));
      }
    }
  } catch (const toml::parse_error& error) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}:{}:{}: {}; expected key = \"value\"", file.string(), error.source().begin.line,
                            error.source().begin.column, error.description()));
  }
  return options;
}

std::size_t bytes_of(const EngineEvent& event) {
  if (const auto* task = std::get_if<TaskDelivered>(&event)) return task->delivery.bytes.size();
  if (const auto* message = std::get_if<MessageArrived>(&event)) return message->bytes.size();
  return 0;
}

}  // namespace pf
