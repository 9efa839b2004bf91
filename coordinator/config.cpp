#include "coordinator/config.h"

#include <sys/stat.h>

#include <algorithm>
#include <functional>
#include <span>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/nearest_name.h"
#include "common/spec/document.h"

namespace pf {
namespace {

constexpr std::uint64_t kMaxConfigBytes = 64 * 1024;

using spec::Value;

/// One key: takes its value, or says what it expected.
struct ConfigKey {
  std::string_view name;  ///< table.key
  std::function<std::string(const Value&)> set;
};

ConfigKey text(std::string_view name, std::string& to) {
  return {name, [&to](const Value& value) {
            const auto* given = std::get_if<std::string>(&value.data);
            if (given == nullptr) return std::string("a string");
            to = *given;
            return std::string();
          }};
}

ConfigKey path(std::string_view name, const std::filesystem::path& folder, std::filesystem::path& to) {
  return {name, [&to, folder](const Value& value) {
            const auto* given = std::get_if<std::string>(&value.data);
            if (given == nullptr || given->empty()) return std::string("a file's path");
            to = folder / *given;
            return std::string();
          }};
}

template <typename T>
ConfigKey number(std::string_view name, double least, double most, T& to) {
  return {
      name, [&to, least, most](const Value& value) {
        const auto* integer = std::get_if<std::int64_t>(&value.data);
        const auto* real = std::is_integral_v<T> ? nullptr : std::get_if<double>(&value.data);
        const double given = integer != nullptr ? static_cast<double>(*integer) : real != nullptr ? *real : least - 1;
        if (!(given >= least && given <= most))
          return fmt::format("{} from {} to {}", std::is_integral_v<T> ? "an integer" : "a number", least, most);
        to = static_cast<T>(given);
        return std::string();
      }};
}

std::vector<ConfigKey> keys_of(CoordinatorConfig& config, const std::filesystem::path& folder) {
  constexpr double kMany = 1e15;
  return {text("http.host", config.http.host),
          number("http.port", 0, 65535, config.http.port),
          path("http.certificate", folder, config.http.certificate),
          path("http.key", folder, config.http.key),
          path("http.ca", folder, config.http.ca),
          number("limits.requests_per_second", 0.1, 1e6, config.limits.requests_per_second),
          number("limits.request_burst", 1, 1e6, config.limits.request_burst),
          number("limits.jobs_per_token", 1, kMany, config.limits.jobs_per_token),
          number("limits.job_bytes", 1, kMany, config.limits.job_bytes),
          number("limits.pixels", 1, kMany, config.limits.pixels),
          text("notify.url", config.notify.url),
          path("notify.secret_file", folder, config.notify.secret_file),
          path("notify.ca", folder, config.notify.ca),
          number("keep.result_days", 0, 1e6, config.keep.result_days),
          number("keep.checkpoint_days", 0, 1e6, config.keep.checkpoint_days),
          number("keep.bytes", 0, kMany, config.keep.bytes)};
}

Result<void> apply(const Value& document, const std::vector<ConfigKey>& keys, const std::string& file) {
  std::vector<std::string_view> names;
  names.reserve(keys.size());
  for (const ConfigKey& key : keys) names.push_back(key.name);
  for (const spec::Member& table : std::get<Value::Table>(document.data)) {
    const auto* members = std::get_if<Value::Table>(&table.value.data);
    if (members == nullptr) {
      return fail(ErrorKind::kUsage,
                  fmt::format("{}: '{}' stands in no table; expected [http], [limits], [notify] or [keep]",
                              spec::location(file, table.place), table.key));
    }
    for (const spec::Member& member : *members) {
      const std::string name = fmt::format("{}.{}", table.key, member.key);
      const auto found = std::find_if(keys.begin(), keys.end(), [&](const ConfigKey& k) { return k.name == name; });
      if (found == keys.end()) {
        std::string message =
            fmt::format("{}: unknown key '{}'", spec::location(file, member.place), spec::printable(name));
        if (const auto near = nearest_name(name, std::span<const std::string_view>(names)))
          message += fmt::format("; did you mean '{}'?", *near);
        return fail(ErrorKind::kUsage, message);
      }
      if (const std::string expected = found->set(member.value); !expected.empty()) {
        return fail(ErrorKind::kUsage,
                    fmt::format("{}: {} is {}; expected {}", spec::location(file, member.value.place), name,
                                spec::describe(member.value), expected));
      }
    }
  }
  return {};
}

Result<void> check(const CoordinatorConfig& config, const std::string& file) {
  if (config.http.certificate.empty() != config.http.key.empty())
    return fail(ErrorKind::kUsage,
                fmt::format("{}: http.certificate and http.key belong together; only one is given", file));
  if (config.notify.url.empty()) return {};
  if (!config.notify.url.starts_with("http://") && !config.notify.url.starts_with("https://"))
    return fail(ErrorKind::kUsage,
                fmt::format("{}: notify.url '{}': expected http://... or https://...", file, config.notify.url));
  if (config.notify.secret_file.empty()) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: notify.url without notify.secret_file; its receiver could not tell who "
                            "speaks",
                            file));
  }
  return {};
}

}  // namespace

Result<void> check_secret_mode(const std::filesystem::path& file) {
  struct stat info {};
  if (stat(file.c_str(), &info) == 0 && (info.st_mode & 077) != 0) {
    return fail(ErrorKind::kUsage, fmt::format("{}: mode {:04o} lets others read a secret; expected 0600: chmod 600 {}",
                                               file.string(), info.st_mode & 07777, file.string()));
  }
  return {};
}

Result<CoordinatorConfig> load_coordinator_config(const std::filesystem::path& file) {
  const Result<std::string> content = read_file(file, kMaxConfigBytes, ErrorKind::kUsage);
  if (!content) return tl::unexpected(content.error());
  CoordinatorConfig config;
  const std::string name = file.string();
  const auto document = spec::parse_toml_document(*content, name);
  if (!document) return tl::unexpected(document.error());
  if (auto applied = apply(*document, keys_of(config, file.parent_path()), name); !applied)
    return tl::unexpected(applied.error());
  if (auto checked = check(config, name); !checked) return tl::unexpected(checked.error());
  return config;
}

}  // namespace pf
