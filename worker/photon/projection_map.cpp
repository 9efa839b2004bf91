#include "worker/photon/projection_map.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "common/math/frame.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

constexpr int kSteps = 4;             ///< points along each edge of a cell at which its bound is measured
constexpr float kBoundMargin = 1.1f;  ///< what may lie between those points, beyond them
constexpr float kSlack = 1e-3f;       ///< rounding, and rays that start a little off their light
constexpr float kCoarseBalls =
    0.12f;  ///< spacing of the balls that the environment's groups see, in the scene's radius
constexpr std::uint64_t kPunctual = std::uint64_t{1} << 40, kEnvironment = std::uint64_t{1} << 41;

/// Calls f(u) for points along the edges of cell (x, y) of `edge` x `edge`.
template <typename F>
void for_each_edge_point(std::uint32_t x, std::uint32_t y, std::uint32_t edge, const F& f) {
  const auto number = [edge](std::uint32_t cell, int step) {
    const float at = static_cast<float>(cell) + static_cast<float>(step) / static_cast<float>(kSteps);
    return std::min(at / static_cast<float>(edge), kOneMinusEpsilon);
  };
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      if (i % kSteps == 0 || j % kSteps == 0) f(Vec2f{number(x, i), number(y, j)});
    }
  }
}

float angle_between(const Vec3f& a, const Vec3f& b) { return 2.0f * std::asin(std::min(1.0f, 0.5f * length(a - b))); }

/// Cone around the directions of a cell.
template <typename Direction>
auto cone_of_cell(std::uint32_t x, std::uint32_t y, std::uint32_t edge, const Direction& direction) {
  std::vector<Vec3f> around;
  Vec3f sum{0, 0, 0};
  for_each_edge_point(x, y, edge, [&](const Vec2f& u) {
    around.push_back(direction(u));
    sum += around.back();
  });
  const Vec3f axis = length2(sum) > 0.0f ? normalize(sum) : around.front();
  float angle = 0.0f;
  for (const Vec3f& d : around) angle = std::max(angle, angle_between(axis, d));
  return std::pair{axis, angle * kBoundMargin + kSlack};
}

}  // namespace

/// Where on the disc outside the scene balls lie, as a picture of kRows x kRows pixels, a word a row: quick to draw in,
/// whatever the number of balls, and never smaller than they are.
class ProjectionMap::DiscPicture {
 public:
  void draw(const Vec3f& center, float radius) {
    const float reach = radius + kSlack;
    for (int row = pixel(center.y - reach); row <= pixel(center.y + reach); ++row) {
      const float low = static_cast<float>(row) / kHalf - 1.0f;
      const float away = std::max({0.0f, low - center.y, center.y - (low + 1.0f / kHalf)});
      const float width = std::sqrt(std::max(0.0f, reach * reach - away * away));
      rows_[static_cast<std::size_t>(row)] |= bits(pixel(center.x - width), pixel(center.x + width));
    }
  }
  /// Whether something is drawn near enough to count as within the circle.
  [[nodiscard]] bool meets(const Bound& circle) const {
    const std::uint64_t across = bits(pixel(circle.center.x - circle.radius), pixel(circle.center.x + circle.radius));
    for (int row = pixel(circle.center.y - circle.radius); row <= pixel(circle.center.y + circle.radius); ++row) {
      if ((rows_[static_cast<std::size_t>(row)] & across) != 0) return true;
    }
    return false;
  }

 private:
  static constexpr int kRows = 64;
  static constexpr float kHalf = 0.5f * kRows;  ///< pixels per unit of the disc's radius

  static int pixel(float x) { return std::clamp(static_cast<int>(std::floor((x + 1.0f) * kHalf)), 0, kRows - 1); }
  static std::uint64_t bits(int first, int last) {
    return (~std::uint64_t{0} >> (kRows - 1 - (last - first))) << first;
  }
  std::array<std::uint64_t, kRows> rows_{};
};

std::vector<ProjectionMap::Bound> ProjectionMap::disc_cells() {
  std::vector<Bound> cells;
  for (std::uint32_t cell = 0; cell < kDiscEdge * kDiscEdge; ++cell) {
    std::vector<Vec3f> around;
    Vec3f sum{0, 0, 0};
    for_each_edge_point(cell % kDiscEdge, cell / kDiscEdge, kDiscEdge, [&](const Vec2f& u) {
      const Vec2f p = sample_disk(u);
      around.push_back({p.x, p.y, 0.0f});
      sum += around.back();
    });
    const Vec3f middle = sum / static_cast<float>(around.size());
    float reach = 0.0f;
    for (const Vec3f& p : around) reach = std::max(reach, length(p - middle));
    cells.push_back({middle, reach * kBoundMargin + kSlack});
  }
  return cells;
}

bool ProjectionMap::View::is_on(const Vec2f& u) const {
  const auto cell_along = [this](float x) {
    return std::min(edge - 1, static_cast<std::uint32_t>(x * static_cast<float>(edge)));
  };
  return std::binary_search(on.begin(), on.end(), cell_along(u.y) * edge + cell_along(u.x));
}

Vec2f ProjectionMap::View::within(const Vec2f& u) const {
  const float scaled = u.x * static_cast<float>(on.size());
  const auto chosen = std::min(on.size() - 1, static_cast<std::size_t>(scaled));
  const std::uint32_t cell = on[chosen];
  const float rest = std::clamp(scaled - static_cast<float>(chosen), 0.0f, kOneMinusEpsilon);
  const float width = 1.0f / static_cast<float>(edge);
  const auto column = cell % edge, row = cell / edge;
  return {std::min((static_cast<float>(column) + rest) * width, kOneMinusEpsilon),
          std::min((static_cast<float>(row) + u.y) * width, kOneMinusEpsilon)};
}

void ProjectionMap::View::set(std::uint32_t cells_along, const std::vector<std::uint8_t>& mask) {
  edge = cells_along;
  for (std::uint32_t cell = 0; cell < mask.size(); ++cell) {
    if (mask[cell] != 0) on.push_back(cell);
  }
}

ProjectionMap::ProjectionMap(const Lights& lights, const Box3f& bounds, std::span<const SurfaceBall> balls,
                             Target target)
    : lights_(lights), area_of_triangle_(lights.triangle_count(), 0) {
  if (lights.empty() || bounds.isEmpty()) return;
  center_ = bounds.center();
  radius_ = 0.5f * length(bounds.size());
  for (std::uint32_t a = 0; a < lights.area_lights().size(); ++a) {
    for (const std::uint32_t triangle : lights.area_lights()[a].triangles()) area_of_triangle_[triangle] = a;
  }
  std::vector<SurfaceBall> wanted;
  for (const SurfaceBall& ball : balls) {
    if (ball.specular || target == Target::kAnySurface) wanted.push_back(ball);
  }
  constexpr std::uint32_t kNumbers = 1u << 24;  // u_pick has 24 bits
  find_views(0, kNumbers - 1, wanted);
  on_share_ = measure_on_share();
}

std::uint64_t ProjectionMap::key(const Lights::EmissionPicked& picked) const {
  if (picked.triangle >= 0) {
    const auto triangle = static_cast<std::uint32_t>(picked.triangle);
    const bool back = dot(picked.emission.direction, lights_.triangle(triangle).ng) < 0.0f;
    return 2 * std::uint64_t{area_of_triangle_[triangle]} + (back ? 1 : 0);
  }
  if (of_environment(picked)) return kEnvironment + group_of(picked.emission.direction);
  return kPunctual + picked.emission.light;
}

bool ProjectionMap::of_environment(const Lights::EmissionPicked& picked) const {
  return picked.triangle < 0 && picked.emission.light - lights_.triangle_count() == lights_.punctual_count();
}

/// Lights follow each other as the number that picks them grows: where both ends pick the same one, all
/// between do.
void ProjectionMap::find_views(std::uint32_t first, std::uint32_t last, std::span<const SurfaceBall> balls) {
  if (views_.size() >= kMostViews) return;
  const auto number = [](std::uint32_t i) { return static_cast<float>(i) * 0x1p-24f; };
  const auto key_at = [&](std::uint32_t i) {
    const auto picked = lights_.emit(number(i), {0.5f, 0.5f}, {0.5f, 0.5f});
    return picked ? key(*picked) : 0;
  };
  if (key_at(first) == key_at(last)) return add_view(number(first), balls);
  if (last - first == 1) {
    add_view(number(first), balls);
    add_view(number(last), balls);
    return;
  }
  const std::uint32_t middle = first + (last - first) / 2;
  find_views(first, middle, balls);
  find_views(middle, last, balls);
}

void ProjectionMap::add_view(float u_pick, std::span<const SurfaceBall> balls) {
  const auto picked = lights_.emit(u_pick, {0.25f, 0.25f}, {0.5f, 0.5f});
  const auto other = lights_.emit(u_pick, {0.75f, 0.75f}, {0.5f, 0.5f});
  if (!picked || !other || views_.contains(key(*picked))) return;
  if (of_environment(*picked)) {
    // The groups are wide themselves: balls may be as well.
    const std::vector<SurfaceBall> coarse = merged_balls(balls, kCoarseBalls * radius_);
    const std::vector<Bound> cells = disc_cells();
    std::vector<View> groups(std::size_t{kTurns} * kHeights);
    parallel_for(groups.size(), [&](std::size_t i) { groups[i] = distant_view(group(i), cells, coarse); });
    for (std::size_t i = 0; i < groups.size(); ++i) views_[kEnvironment + i] = std::move(groups[i]);
  } else if (picked->triangle >= 0) {
    const Box3f box = lights_.area_lights()[area_of_triangle_[static_cast<std::size_t>(picked->triangle)]].box();
    views_[key(*picked)] = near_view(u_pick, box.center(), 0.5f * length(box.size()), balls);
  } else if (length2(picked->emission.origin - other->emission.origin) > 0.0f) {
    views_[key(*picked)] = distant_view({picked->emission.direction, 0.0f}, disc_cells(), balls);
  } else {
    views_[key(*picked)] = near_view(u_pick, picked->emission.origin, 0.0f, balls);
  }
}

ProjectionMap::View ProjectionMap::near_view(float u_pick, const Vec3f& center, float radius,
                                             std::span<const SurfaceBall> balls) const {
  // Directions from any point of the light's ball to any point of the surface's: within a cone around the
  // line of centres.
  struct Cone {
    Vec3f axis;
    float cosine, sine;
  };
  std::vector<Cone> cones;
  bool surrounded = false;
  for (const SurfaceBall& ball : balls) {
    const Vec3f d = ball.center - center;
    const float distance = length(d), reach = ball.radius + radius + kSlack * kSlack * radius_;
    surrounded = surrounded || distance <= reach * (1.0f + kSlack);
    if (surrounded) break;
    const float sine = reach / distance;
    cones.push_back({d / distance, std::sqrt(std::max(0.0f, 1.0f - sine * sine)), sine});
  }
  std::vector<std::uint8_t> mask(std::size_t{kEdge} * kEdge, surrounded ? 1 : 0);
  if (!surrounded) {
    parallel_for(kEdge, [&](std::size_t row) {
      for (std::uint32_t x = 0; x < kEdge; ++x) {
        const auto [axis, angle] = cone_of_cell(x, static_cast<std::uint32_t>(row), kEdge, [&](const Vec2f& u) {
          return lights_.emit(u_pick, {0.5f, 0.5f}, u)->emission.direction;
        });
        const float cosine = std::cos(std::min(angle, kPi)), sine = std::sin(std::min(angle, kPi));
        const bool on = std::any_of(cones.begin(), cones.end(), [&, axis = axis](const Cone& cone) {
          // Angles that sum up to more than a half turn meet everything.
          if (sine * cone.cosine + cosine * cone.sine < 0.0f) return true;
          return dot(cone.axis, axis) >= cosine * cone.cosine - sine * cone.sine;
        });
        mask[row * kEdge + x] = on ? 1 : 0;
      }
    });
  }
  View view;
  view.set(kEdge, mask);
  return view;
}

ProjectionMap::View ProjectionMap::distant_view(const Bound& directions, std::span<const Bound> cells,
                                                std::span<const SurfaceBall> balls) const {
  View view;
  view.distant = true;
  const Frame frame = Frame::from_normal(directions.center);
  view.tangent = frame.t;
  DiscPicture picture;
  for (const SurfaceBall& ball : balls) {
    const Vec3f d = (ball.center - center_) / radius_;
    // The disc's axes turn with the direction: by its angle to the group's axis the first, by at most sqrt(2)
    // times that the second [rad]; together by less than twice.
    picture.draw({dot(d, frame.t), dot(d, frame.b), 0.0f},
                 ball.radius / radius_ + 2.0f * directions.radius * length(d));
  }
  std::vector<std::uint8_t> mask;
  for (const Bound& cell : cells) mask.push_back(picture.meets(cell) ? 1 : 0);
  view.set(kDiscEdge, mask);
  return view;
}

std::size_t ProjectionMap::group_of(const Vec3f& direction) {
  const float height = 0.5f - 0.5f * direction.y, turn = 0.5f + std::atan2(direction.x, direction.z) * (0.5f * kInvPi);
  const int row = std::clamp(static_cast<int>(height * kHeights), 0, kHeights - 1);
  const int column = std::clamp(static_cast<int>(turn * kTurns), 0, kTurns - 1);
  return static_cast<std::size_t>(row) * kTurns + static_cast<std::size_t>(column);
}

ProjectionMap::Bound ProjectionMap::group(std::size_t index) {
  const std::size_t at_row = index / kTurns, at_column = index % kTurns;
  const auto row = static_cast<float>(at_row), column = static_cast<float>(at_column);
  const auto [axis, angle] = cone_of_cell(0, 0, 1, [&](const Vec2f& u) {
    const float y = 1.0f - 2.0f * (row + u.x) / kHeights;
    const float phi = 2.0f * kPi * ((column + u.y) / kTurns - 0.5f);
    const float r = std::sqrt(std::max(0.0f, 1.0f - y * y));
    return Vec3f{r * std::sin(phi), y, r * std::cos(phi)};
  });
  return {axis, angle};
}

void ProjectionMap::place(Lights::EmissionPicked& picked, const View& view, const Vec2f& u_position) const {
  const Vec3f& d = picked.emission.direction;
  const Vec3f t = normalize(view.tangent - d * dot(view.tangent, d));
  const Vec3f b = cross(d, t);
  const Vec2f disc = sample_disk(u_position);
  const float outside = dot(picked.emission.origin - center_, d);
  picked.emission.origin = center_ + d * outside + (t * disc.x + b * disc.y) * radius_;
}

std::optional<Lights::EmissionPicked> ProjectionMap::emit(float u_pick, const Vec2f& u_position,
                                                          const Vec2f& u_direction) const {
  const auto any = lights_.emit(u_pick, u_position, u_direction);
  if (!any) return std::nullopt;
  Lights::EmissionPicked picked = *any;
  const auto it = views_.find(key(picked));
  if (it == views_.end()) return picked;
  const View& view = it->second;
  if (view.on.empty()) return std::nullopt;
  if (view.distant) {
    place(picked, view, view.within(u_position));
  } else if (const auto again = lights_.emit(u_pick, u_position, view.within(u_direction))) {
    picked = *again;
  }
  picked.emission.flux *= static_cast<float>(view.share());
  return picked;
}

std::optional<ProjectionMap::Probe> ProjectionMap::probe(float u_pick, const Vec2f& u_position,
                                                         const Vec2f& u_direction) const {
  const auto picked = lights_.emit(u_pick, u_position, u_direction);
  if (!picked) return std::nullopt;
  Probe probe{*picked, true};
  const auto it = views_.find(key(*picked));
  if (it == views_.end()) return probe;
  if (it->second.distant) place(probe.picked, it->second, u_position);
  probe.on = it->second.is_on(it->second.distant ? u_position : u_direction);
  return probe;
}

/// By an even spread of the numbers of emission: the environment's groups are not alike.
double ProjectionMap::measure_on_share() const {
  constexpr int kAlong = 16;
  double share = 0.0;
  int rays = 0;
  for (int i = 0; i < kAlong * kAlong * kAlong; ++i) {
    const auto number = [](int k) { return (static_cast<float>(k) + 0.5f) / kAlong; };
    const auto picked =
        lights_.emit(number(i % kAlong), {0.5f, 0.5f}, {number(i / kAlong % kAlong), number(i / (kAlong * kAlong))});
    if (!picked) continue;
    const auto it = views_.find(key(*picked));
    share += it == views_.end() ? 1.0 : it->second.share();
    ++rays;
  }
  return rays == 0 ? 1.0 : share / rays;
}

}  // namespace pf
