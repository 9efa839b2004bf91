#pragma once

#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "common/base/status_line.h"

namespace pf {

// Jobs, workers and log entries, as the service gives them in JSON, for people.

/// A member's text or number; empty or 0 when it is absent, null or something else.
[[nodiscard]] std::string job_text(const nlohmann::json& job, std::string_view member);
[[nodiscard]] double job_number(const nlohmann::json& job, std::string_view member);
[[nodiscard]] bool job_has_ended(const nlohmann::json& job);

/// True for what may stand in an address as it is: a-z, 0-9 and -.
[[nodiscard]] bool is_path_segment(std::string_view text);

/// [A-Za-z0-9_-]{1,64}, as the engine has it.
[[nodiscard]] bool is_worker_name(std::string_view text);

/// One line while it runs: `[####................]  25 %  16/64 passes  0:30 left  error 0.05  3.1 Mrays/s  2
/// workers`.
[[nodiscard]] std::string job_line(const nlohmann::json& job, StatusLine::Style style);
[[nodiscard]] std::string jobs_table(const nlohmann::json& jobs);
[[nodiscard]] std::string workers_table(const nlohmann::json& workers);
[[nodiscard]] std::string units_table(const nlohmann::json& units);
[[nodiscard]] std::string tokens_table(const nlohmann::json& tokens);
/// Every figure of one job, a line each.
[[nodiscard]] std::string job_description(const nlohmann::json& job);
/// `2026-01-31 12:00:00  info     coordinator  text`, in UTC.
[[nodiscard]] std::string log_line(const nlohmann::json& entry);

}  // namespace pf
