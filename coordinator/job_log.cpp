#include "coordinator/job_log.h"

#include <fstream>

#include <nlohmann/json.hpp>

namespace pf {
namespace {

constexpr std::size_t kInMemory = 10000;
constexpr std::size_t kAtOnce = 1000;

}  // namespace

JobLog::JobLog(const std::filesystem::path& folder) : file_(folder / "log.jsonl") {
  std::ifstream stream(file_);
  bool half_a_line = false;
  for (std::string line; std::getline(stream, line);) {
    half_a_line = stream.eof();
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object()) continue;  // the last line of a process that was killed
    LogEntry entry;
    entry.number = json.value("number", std::uint64_t{0});
    entry.unix_ms = json.value("unix_ms", std::int64_t{0});
    entry.level = json.value("level", "");
    entry.source = json.value("source", "");
    entry.text = json.value("text", "");
    last_ = std::max(last_, entry.number);
    entries_.push_back(std::move(entry));
    if (entries_.size() > kInMemory) entries_.pop_front();
  }
  if (half_a_line) std::ofstream(file_, std::ios::app) << '\n';
}

void JobLog::add(std::int64_t unix_ms, std::string_view level, std::string_view source, std::string_view text) {
  entries_.push_back({++last_, unix_ms, std::string(level), std::string(source), std::string(text)});
  if (entries_.size() > kInMemory) entries_.pop_front();
  const nlohmann::json json = {
      {"number", last_}, {"unix_ms", unix_ms}, {"level", level}, {"source", source}, {"text", text}};
  std::ofstream(file_, std::ios::app) << json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
}

std::vector<LogEntry> JobLog::after(std::uint64_t after) const {
  std::vector<LogEntry> found;
  for (const LogEntry& entry : entries_) {
    if (entry.number > after && found.size() < kAtOnce) found.push_back(entry);
  }
  return found;
}

}  // namespace pf
