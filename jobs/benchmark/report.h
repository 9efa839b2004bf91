#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "jobs/benchmark/analysis.h"

namespace pf::bench {

/// One HTML page that needs nothing beside itself: charts and pictures, which lie below `folder` in charts/ and
/// images/, are written into it. Its only script moves the sliders. `notes` and failures stand at its end.
[[nodiscard]] std::string report_html(const BenchResult& bench, const std::filesystem::path& folder,
                                      const std::vector<std::string>& notes);

}  // namespace pf::bench
