#pragma once

#include <cstddef>
#include <string>

#include "jobs/benchmark/analysis.h"

namespace pf::bench {

/// A table of what method `judged` of type "auto" costs against the best of the others, as HTML.
[[nodiscard]] std::string planner_html(const BenchResult& bench, std::size_t judged);

/// A table of the terms that were turned round against the plan, as HTML; empty where there is none.
[[nodiscard]] std::string ablations_html(const BenchResult& bench);

}  // namespace pf::bench
