#pragma once

#include <fmt/format.h>

#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>

namespace spdlog {
class logger;
namespace sinks {
class sink;
}
}  // namespace spdlog

namespace pf {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

/// One `key=value` of a log line. The value is anything that fmt formats.
struct LogField {
  std::string_view key;
  std::string value;

  template <typename T>
  LogField(std::string_view field_key, const T& field_value) : key(field_key), value(fmt::format("{}", field_value)) {}
};

/// Structured log: one line per event on standard error,
///   `2026-01-31T12:00:00.123Z info unit done job=glass round=3 worker="host a"`
/// with the time in UTC. Made in main() and passed on by reference; safe to use from several threads. Not for
/// inner loops.
class Log {
 public:
  explicit Log(LogLevel least = LogLevel::kInfo);
  /// Writes to another sink; for tests and files.
  Log(LogLevel least, std::shared_ptr<spdlog::sinks::sink> sink);

  void debug(std::string_view event, std::initializer_list<LogField> fields = {}) const;
  void info(std::string_view event, std::initializer_list<LogField> fields = {}) const;
  void warning(std::string_view event, std::initializer_list<LogField> fields = {}) const;
  void error(std::string_view event, std::initializer_list<LogField> fields = {}) const;

 private:
  void write(LogLevel level, std::string_view event, std::initializer_list<LogField> fields) const;

  std::shared_ptr<spdlog::logger> logger_;  // shared because spdlog hands loggers out so
};

/// `event key=value ...` on one line: values that are empty or hold a space, `=`, `"`, `\` or a control
/// character are quoted and escaped.
[[nodiscard]] std::string format_log_line(std::string_view event, std::initializer_list<LogField> fields);

}  // namespace pf
