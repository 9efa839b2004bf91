// What is remembered of a job's way: which units count and who traced them, and how far the image was when.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "common/wire/statistics_codec.h"
#include "coordinator/farm_job.h"

namespace pf {
namespace {

constexpr std::size_t kMaxPoints = 400;
/// Passes between two points grow with the passes done: equal distances on a logarithmic axis.
constexpr double kPointGrowth = 1.05;

std::string hex_of_bytes(std::string_view bytes) {
  std::string text;
  for (const char c : bytes) text += fmt::format("{:02x}", static_cast<unsigned char>(c));
  return text;
}

}  // namespace

void FarmJob::remember(const std::string& worker, const wire::ResultManifest& manifest) {
  CountedResult result;
  result.number = next_result_++;
  result.worker = worker;
  result.seconds = manifest.trace_seconds();
  result.sums_hash = hex_of_bytes(manifest.content());
  for (const wire::Unit& unit : manifest.units()) {
    result.units.push_back({{unit.first_sub_pass(), unit.sub_passes()}, unit.attempt()});
  }
  results_.push_back(std::move(result));
}

void FarmJob::note_point(bool last_of_all) {
  const JobRecord::Figures now = figures();
  if (now.passes == 0) return;
  if (!points_.empty()) {
    const auto last = points_.back().passes;
    if (now.passes <= last) return;
    if (!last_of_all && static_cast<double>(now.passes) < kPointGrowth * static_cast<double>(last)) return;
  }
  record_.estimated_error = film_->estimated_error();
  const bool known = std::isfinite(record_.estimated_error) && record_.estimated_error >= 0;
  points_.push_back(
      {now.seconds, now.passes, now.rounds, now.rays, known ? std::optional(record_.estimated_error) : std::nullopt});
  if (points_.size() <= kMaxPoints) return;
  for (std::size_t i = 1; 2 * i < points_.size(); ++i) points_[i] = points_[2 * i];
  points_.resize((points_.size() + 1) / 2);
}

Result<std::vector<ConvergencePoint>> FarmJob::convergence() const {
  if (film_) return points_;
  return around_.store.convergence(record_.number);
}

Result<UnitPage> FarmJob::units(std::optional<std::uint64_t> after, std::size_t most) const {
  const std::uint64_t from = after ? *after + 1 : 0;
  auto all = around_.store.units(record_.number, from, most + 1);
  if (!all) return tl::unexpected(all.error());
  const auto add = [&](const UnitRange& range, std::string_view state) -> UnitView& {
    UnitView& unit = all->emplace_back();
    unit.first = range.first;
    unit.count = range.count;
    unit.state = state;
    return unit;
  };
  for (const CountedResult& result : results_) {
    for (const auto& [range, attempts] : result.units) {
      if (range.first < from) continue;
      UnitView& unit = add(range, "done");
      unit.attempts = attempts;
      unit.worker = result.worker;
      unit.seconds = result.seconds * static_cast<double>(range.count) / static_cast<double>(result.passes());
      unit.result = result.number;
      unit.sums_hash = result.sums_hash;
    }
  }
  for (const auto& [first, out] : ledger_.out()) {
    if (first < from) continue;
    UnitView& unit = add(out.range, "out");
    unit.attempts = out.attempt;
    unit.worker = out.holder;
  }
  // What nobody has yet is cut when it is given out: one entry for all of it.
  const std::uint64_t end = film_ ? wanted_sub_passes() : 0;
  const std::uint64_t fresh = ledger_.issued_below();
  if (end != kNoEnd && fresh < end && fresh >= from) add({fresh, end - fresh}, "new");
  std::sort(all->begin(), all->end(), [](const UnitView& a, const UnitView& b) { return a.first < b.first; });
  UnitPage page;
  if (all->size() > most) {
    all->resize(most);
    page.after = all->back().first;
  }
  page.units = std::move(*all);
  if (film_ && film_->options().part_edge > 0) {
    for (UnitView& unit : page.units) {
      const ImagePart part = film_->order().part(unit.first);
      unit.part = {part.x0, part.y0, part.x1, part.y1};
    }
  }
  return page;
}

}  // namespace pf
