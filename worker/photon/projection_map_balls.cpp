#include <algorithm>
#include <cmath>

#include "worker/photon/projection_map.h"

namespace pf {
namespace {

constexpr float kBallSlack = 1e-3f;  ///< rounding

}  // namespace

SurfaceBalls::SurfaceBalls(const Box3f& bounds) : bounds_(bounds) {
  const Vec3f size = bounds.size();
  size_ = std::max({size.x, size.y, size.z}) / kResolution;
}

void SurfaceBalls::add(const std::array<Vec3f, 3>& corners, bool specular) {
  // Cut the longest side in two until all are short.
  std::vector<std::array<Vec3f, 3>> left{corners};
  while (!left.empty()) {
    const std::array<Vec3f, 3> t = left.back();
    left.pop_back();
    std::size_t longest = 0;
    const auto side2 = [&](std::size_t i) { return length2(t[(i + 1) % 3] - t[i]); };
    for (std::size_t i = 1; i < 3; ++i) {
      if (side2(i) > side2(longest)) longest = i;
    }
    const Vec3f &a = t[longest], &b = t[(longest + 1) % 3], &c = t[(longest + 2) % 3];
    if (!(side2(longest) > size_ * size_) || !(size_ > 0.0f)) {
      add_piece(t, specular);
      continue;
    }
    const Vec3f middle = (a + b) * 0.5f;
    left.push_back({a, middle, c});
    left.push_back({middle, b, c});
  }
}

void SurfaceBalls::add_piece(const std::array<Vec3f, 3>& corners, bool specular) {
  const Vec3f middle = (corners[0] + corners[1] + corners[2]) * (1.0f / 3.0f) - bounds_.min;
  std::array<int, 4> cell{0, 0, 0, specular ? 1 : 0};
  for (int axis = 0; axis < 3 && size_ > 0.0f; ++axis) {
    cell[static_cast<std::size_t>(axis)] = static_cast<int>(std::floor(middle[axis] / size_));
  }
  Box3f& box = pieces_[cell];
  for (const Vec3f& corner : corners) box.extendBy(corner);
}

std::vector<SurfaceBall> SurfaceBalls::balls() const {
  std::vector<SurfaceBall> balls;
  for (const auto& [cell, box] : pieces_) {
    balls.push_back({box.center(), 0.5f * length(box.size()) * (1.0f + kBallSlack), cell[3] != 0});
  }
  return balls;
}

std::vector<SurfaceBall> merged_balls(std::span<const SurfaceBall> balls, float edge) {
  std::map<std::array<int, 3>, std::vector<const SurfaceBall*>> cells;
  for (const SurfaceBall& ball : balls) {
    const auto cell = [&](int axis) {
      return edge > 0.0f ? static_cast<int>(std::floor(ball.center[axis] / edge)) : 0;
    };
    cells[{cell(0), cell(1), cell(2)}].push_back(&ball);
  }
  std::vector<SurfaceBall> all;
  for (const auto& [cell, members] : cells) {
    Box3f box;
    for (const SurfaceBall* member : members) box.extendBy(member->center);
    SurfaceBall& ball = all.emplace_back(SurfaceBall{box.center(), 0.0f, false});
    for (const SurfaceBall* member : members)
      ball.radius =
          std::max(ball.radius, (length(member->center - ball.center) + member->radius) * (1.0f + kBallSlack));
  }
  return all;
}

}  // namespace pf
