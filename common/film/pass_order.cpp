#include "common/film/pass_order.h"

#include <algorithm>
#include <cmath>

namespace pf {

PassOrder::PassOrder(const FilmOptions& options)
    : width_(options.width), height_(options.height), edge_(options.part_edge) {
  if (edge_ <= 0) return;
  columns_ = static_cast<std::uint64_t>((width_ + edge_ - 1) / edge_);
  rows_ = static_cast<std::uint64_t>((height_ + edge_ - 1) / edge_);
}

ImagePart PassOrder::part(std::uint64_t sub_pass) const {
  if (edge_ <= 0) return {0, 0, width_, height_, sub_pass};
  const std::uint64_t group = sub_pass / kSamplesTogether;
  const std::uint64_t tile = group % parts();
  const int x0 = static_cast<int>(tile % columns_) * edge_;
  const int y0 = static_cast<int>(tile / columns_) * edge_;
  return {x0, y0, std::min(width_, x0 + edge_), std::min(height_, y0 + edge_),
          group / parts() * kSamplesTogether + sub_pass % kSamplesTogether};
}

std::uint64_t PassOrder::sub_passes(std::uint64_t passes) const {
  if (edge_ <= 0) return passes;
  return (passes + kSamplesTogether - 1) / kSamplesTogether * sweep();
}

std::uint64_t PassOrder::samples_of_tile(std::uint64_t tile, std::uint64_t sub_passes) const {
  const std::uint64_t before = tile * kSamplesTogether;
  const std::uint64_t in_sweep = sub_passes % sweep();
  return sub_passes / sweep() * kSamplesTogether +
         (in_sweep > before ? std::min(in_sweep - before, kSamplesTogether) : 0);
}

std::uint64_t PassOrder::samples(int x, int y, std::uint64_t sub_passes) const {
  if (edge_ <= 0) return sub_passes;
  const std::uint64_t tile = static_cast<std::uint64_t>(y / edge_) * columns_ + static_cast<std::uint64_t>(x / edge_);
  return samples_of_tile(tile, sub_passes);
}

std::uint64_t PassOrder::whole_passes(std::uint64_t sub_passes) const {
  return edge_ <= 0 ? sub_passes : samples_of_tile(parts() - 1, sub_passes);
}

int PassOrder::edge_for(int width, int height) {
  constexpr double kParts = 64.0;
  constexpr int kStep = 16;
  const double edge = std::sqrt(static_cast<double>(width) * height / kParts);
  return std::max(kStep, kStep * static_cast<int>(std::ceil(edge / kStep)));
}

}  // namespace pf
