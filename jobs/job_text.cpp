#include "jobs/job_text.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <utility>
#include <vector>

namespace pf {
namespace {

using nlohmann::json;
using Row = std::vector<std::string>;

/// Text from elsewhere must not steer the terminal.
std::string plain(std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  return text;
}

std::string time_text(double unix_ms) {
  if (!(unix_ms > 0) || unix_ms > 1e15) return "-";
  const auto seconds = static_cast<std::time_t>(unix_ms / 1000);
  std::tm utc{};
  ::gmtime_r(&seconds, &utc);
  return fmt::format("{:%Y-%m-%d %H:%M:%S}", utc);
}

/// Whichever stops the job first; 0 when nothing is known.
double fraction_done(const json& job) {
  if (job_text(job, "state") == "done") return 1;
  const auto share = [](double done, double wanted) { return wanted > 0 ? done / wanted : 0.0; };
  double fraction = share(job_number(job, "passes_done"), job_number(job, "passes_wanted"));
  fraction = std::max(fraction, share(job_number(job, "seconds"), job_number(job, "stop_seconds")));
  // An error falls with the square root of the work at best, and is taken to.
  const double ratio = share(job_number(job, "stop_error"), job_number(job, "estimated_error"));
  return std::clamp(std::max(fraction, ratio * ratio), 0.0, 1.0);
}

std::string passes_text(const json& job) {
  const double wanted = job_number(job, "passes_wanted");
  return wanted > 0 ? fmt::format("{:.0f}/{:.0f}", job_number(job, "passes_done"), wanted)
                    : fmt::format("{:.0f}", job_number(job, "passes_done"));
}

std::string error_text(const json& job) {
  const double error = job_number(job, "estimated_error");
  return error > 0 ? fmt::format("{:.2g}", error) : "-";
}

/// Columns as wide as their widest cell, two blanks apart.
std::string table(const std::vector<Row>& rows) {
  std::vector<std::size_t> widths;
  for (const Row& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const Row& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i) line += fmt::format("{:<{}}  ", row[i], widths[i]);
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + '\n';
  }
  return text;
}

}  // namespace

std::string job_text(const json& job, std::string_view member) {
  if (!job.is_object()) return {};
  const auto found = job.find(std::string(member));
  return found != job.end() && found->is_string() ? plain(found->get<std::string>()) : std::string();
}

double job_number(const json& job, std::string_view member) {
  if (!job.is_object()) return 0;
  const auto found = job.find(std::string(member));
  return found != job.end() && found->is_number() ? found->get<double>() : 0.0;
}

bool job_has_ended(const json& job) {
  const std::string state = job_text(job, "state");
  return state == "done" || state == "failed" || state == "cancelled";
}

bool is_path_segment(std::string_view text) {
  return !text.empty() && text.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-") == std::string_view::npos;
}

bool is_worker_name(std::string_view text) {
  return !text.empty() && text.size() <= 64 &&
         text.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-") ==
             std::string_view::npos;
}

std::string job_line(const json& job, StatusLine::Style style) {
  const double fraction = fraction_done(job);
  std::string text = style == StatusLine::Style::kBar ? progress_bar(fraction) : std::string();
  text += fmt::format("{:3.0f} %  {} passes", std::floor(100.0 * fraction), passes_text(job));
  const std::string state = job_text(job, "state"), message = job_text(job, "message");
  if (job_has_ended(job)) return fmt::format("{}  {} in {}", text, state, clock_time(job_number(job, "seconds")));
  if (state != "running") return fmt::format("{}  {}{}{}", text, state, message.empty() ? "" : ": ", message);
  if (const double left = job_number(job, "seconds_left"); left > 0) text += fmt::format("  {} left", clock_time(left));
  if (job_number(job, "estimated_error") > 0) text += "  error " + error_text(job);
  text += fmt::format("  {}rays/s", short_number(job_number(job, "rays_per_second")));
  const double workers = job_number(job, "workers");
  return text + fmt::format("  {:.0f} worker{}", workers, workers == 1 ? "" : "s");
}

std::string jobs_table(const json& jobs) {
  if (jobs.empty()) return "no jobs\n";
  std::vector<Row> rows = {{"ID", "NAME", "STATE", "DONE", "PASSES", "ERROR", "WORKERS", "TIME", "LEFT"}};
  for (const json& job : jobs) {
    const double left = job_number(job, "seconds_left");
    rows.push_back({job_text(job, "id"), job_text(job, "name"), job_text(job, "state"),
                    fmt::format("{:.0f} %", std::floor(100.0 * fraction_done(job))), passes_text(job), error_text(job),
                    fmt::format("{:.0f}", job_number(job, "workers")), clock_time(job_number(job, "seconds")),
                    left > 0 && !job_has_ended(job) ? clock_time(left) : "-"});
  }
  return table(rows);
}

std::string workers_table(const json& workers) {
  if (workers.empty()) return "no workers\n";
  std::vector<Row> rows = {{"NAME", "HOST", "PROCESS", "STATE", "JOB", "UNITS", "SUB-PASSES", "HEARD", "MESSAGE"}};
  for (const json& worker : workers) {
    const std::string job = job_text(worker, "job_id");
    rows.push_back(
        {job_text(worker, "name"), job_text(worker, "host"), fmt::format("{:.0f}", job_number(worker, "process")),
         job_text(worker, "state"), job.empty() ? "-" : job, fmt::format("{:.0f}", job_number(worker, "units_held")),
         fmt::format("{:.0f}", job_number(worker, "sub_passes")),
         fmt::format("{:.1f} s ago", job_number(worker, "seconds_since_heard")), job_text(worker, "message")});
  }
  return table(rows);
}

std::string units_table(const json& units) {
  if (units.empty()) return "no units\n";
  std::vector<Row> rows = {{"FIRST", "COUNT", "STATE", "ATTEMPTS", "WORKER", "SECONDS", "SUMS"}};
  for (const json& unit : units) {
    const auto number = [&](std::string_view member) { return fmt::format("{:.0f}", job_number(unit, member)); };
    const std::string worker = job_text(unit, "worker"), hash = job_text(unit, "sums_hash");
    const double seconds = job_number(unit, "seconds");
    rows.push_back({number("first"), number("count"), job_text(unit, "state"), number("attempts"),
                    worker.empty() ? "-" : worker, seconds > 0 ? fmt::format("{:.2f}", seconds) : "-",
                    hash.empty() ? "-" : hash.substr(0, 16)});
  }
  return table(rows);
}

std::string tokens_table(const json& tokens) {
  std::vector<Row> rows = {{"NAME", "ROLE", "CREATED"}};
  for (const json& token : tokens)
    rows.push_back({job_text(token, "name"), job_text(token, "role"), time_text(job_number(token, "created_unix_ms"))});
  return table(rows);
}

std::string job_description(const json& job) {
  const auto number = [&](std::string_view member) { return fmt::format("{:.0f}", job_number(job, member)); };
  std::vector<Row> rows = {
      {"id", job_text(job, "id")},
      {"name", job_text(job, "name")},
      {"state", job_text(job, "state")},
      {"message", job_text(job, "message")},
      {"priority", number("priority")},
      {"algorithm", job_text(job, "algorithm")},
      {"size", fmt::format("{} x {} pixels", number("width"), number("height"))},
      {"progress", job_line(job, StatusLine::Style::kLines)},
      {"rounds", number("rounds")},
      {"error", error_text(job)},
      {"time", clock_time(job_number(job, "seconds"))},
      {"rays", short_number(job_number(job, "rays"))},
      {"photon paths", short_number(job_number(job, "photon_paths"))},
      {"passes/s", fmt::format("{:.3g}", job_number(job, "passes_per_second"))},
      {"units", fmt::format("{} done, {} repeated", number("units_done"), number("units_repeated"))},
      {"received", short_number(job_number(job, "bytes_received")) + "B"},
      {"merging", fmt::format("{:.2f} s", job_number(job, "merge_seconds"))},
      {"image hash", job_text(job, "image_hash")},
      {"scene hash", job_text(job, "scene_hash")},
      {"spec hash", job_text(job, "spec_hash")},
      {"submitted", time_text(job_number(job, "submitted_unix_ms"))},
      {"started", time_text(job_number(job, "started_unix_ms"))},
      {"ended", time_text(job_number(job, "ended_unix_ms"))}};
  for (const json& warning : job.value("warnings", json::array())) {
    if (warning.is_string()) rows.push_back({"warning", plain(warning.get<std::string>())});
  }
  std::erase_if(rows, [](const Row& row) { return row[1].empty(); });
  return table(rows);
}

std::string log_line(const json& entry) {
  return fmt::format("{}  {:<7}  {}  {}\n", time_text(job_number(entry, "unix_ms")), job_text(entry, "level"),
                     job_text(entry, "source"), job_text(entry, "text"));
}

}  // namespace pf
