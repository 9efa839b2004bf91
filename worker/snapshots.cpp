#include "worker/snapshots.h"

#include <utility>

#include <fmt/format.h>

#include "common/base/memory.h"

namespace pf {

bool Snapshots::reached(std::size_t budget, const Film& film, double next) const {
  if (!plan_.seconds.empty()) return next > plan_.seconds[budget];
  return film.sub_passes() >= film.order().sub_passes(static_cast<std::uint64_t>(plan_.passes[budget]));
}

bool Snapshots::whole(const Film& film) { return film.order().whole_passes(film.sub_passes()) >= 1; }

Result<double> Snapshots::take(const Film& film, double seconds, double next, bool last) {
  if (!whole(film) || next_ >= budgets() || !(last || reached(next_, film, next))) return 0.0;
  const double start = clock_.now();
  const double cpu_start = processor_.now();
  // The end of the render is the last snapshot, unless nothing was added since the one before.
  const bool new_work = taken_.empty() || taken_.back().sub_passes < film.sub_passes();
  while (next_ < budgets() && (last || reached(next_, film, next))) ++next_;
  if (new_work) {
    auto snapshot = write(film, seconds);
    if (!snapshot) return tl::unexpected(snapshot.error());
    taken_.push_back(std::move(*snapshot));
  }
  cpu_spent_ += processor_.now() - cpu_start;
  return clock_.now() - start;
}

Result<RenderSnapshot> Snapshots::write(const Film& film, double seconds) {
  const Statistics& sums = film.sums();
  RenderSnapshot snapshot;
  snapshot.exr = folder_ / fmt::format("{}.snapshot-{}.exr", name_, taken_.size() + 1);
  snapshot.budget = !plan_.seconds.empty() ? plan_.seconds[next_ - 1] : static_cast<double>(plan_.passes[next_ - 1]);
  snapshot.seconds = seconds;
  snapshot.cpu_seconds = processor_.now() - cpu_spent_;
  snapshot.sub_passes = film.sub_passes();
  snapshot.passes = film.order().mean_passes(film.sub_passes());
  snapshot.rounds = film.rounds();
  snapshot.photon_paths = sums.photon_paths;
  snapshot.photons_stored = sums.photons_stored;
  snapshot.rays = sums.rays;
  snapshot.peak_bytes = peak_resident_bytes();
  ImageRows image = film.image_rows();
  const auto all_layers = image.rows;
  image.rows = [&](int first, int count) {
    std::vector<Layer> layers = all_layers(first, count);
    layers.resize(1);  // the beauty: what errors are measured on
    return layers;
  };
  if (auto written = write_exr(snapshot.exr, image); !written) return tl::unexpected(written.error());
  return snapshot;
}

}  // namespace pf
