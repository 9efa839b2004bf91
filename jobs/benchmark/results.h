#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "jobs/benchmark/analysis.h"

namespace pf::bench {

/// Of results.json and results.csv; see README.md of this folder.
inline constexpr int kResultsVersion = 1;

/// One line for each sample, and one for each run without any.
[[nodiscard]] std::string results_csv(const BenchResult& result);
[[nodiscard]] nlohmann::ordered_json results_json(const BenchResult& result);
/// Markdown: scenes by methods at the last budget; seconds, relMSE, HDR-FLIP.
[[nodiscard]] std::string results_table(const BenchResult& result);

}  // namespace pf::bench
