#include "worker/scene/lights.h"

namespace pf {
namespace {

/// What emission asks of the area lights of eight lanes.
struct AreaLanes {
  Vec3x8 origin, edge_u, edge_v, normal;
  Float8 extent;
  Int8 paired{};  ///< a parallelogram, not a triangle

  void set(std::size_t lane, const AreaLight& light, bool back) {
    origin.set(lane, light.origin());
    edge_u.set(lane, light.edge_u());
    edge_v.set(lane, light.edge_v());
    normal.set(lane, back ? -light.ng() : light.ng());
    extent[lane] = light.extent();
    paired[lane] = light.triangles().size() == 2 ? -1 : 0;
  }
  /// The same light in all lanes.
  void fill(const AreaLight& light) {
    origin = all(light.origin());
    edge_u = all(light.edge_u());
    edge_v = all(light.edge_v());
    normal = all(light.ng());
    extent = all(light.extent());
    paired = Int8{} - (light.triangles().size() == 2 ? 1 : 0);
  }
};

/// sample_triangle() where a lane's light is one triangle.
Vec2x8 place(const Int8& paired, const Vec2x8& u) {
  const Int8 above = u.y > u.x;
  const Float8 half_x = u.x * 0.5f, half_y = u.y * 0.5f;
  const Float8 x = above ? half_x : u.x - half_y, y = above ? u.y - half_x : half_y;
  return {paired ? u.x : x, paired ? u.y : y};
}

}  // namespace

void Lights::emit(const Float8& u_pick, const Vec2x8& u_position, const Vec2x8& u_direction, bool find_points,
                  EmissionLanes& emissions) const {
  emissions.lanes = 0;
  emissions.triangle.fill(-1);
  unsigned areas = 0;
  std::array<std::uint32_t, kLanes> lights{};
  if (emission_.size() == 1 && area_lights_.size() == 1 && emission_.total() > 0.0) {  // nothing to choose
    return emit_areas(kAllLanes, lights, u_pick, u_position, u_direction, find_points, emissions);
  }
  Float8 u_side{};
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const auto pick = pick_emitter(u_pick[lane]);
    if (!pick) continue;
    if (pick->index < area_lights_.size()) {
      areas |= 1u << lane;
      lights[lane] = static_cast<std::uint32_t>(pick->index);
      u_side[lane] = pick->u;
    } else {
      emissions.set(lane,
                    emit_by(*pick, {u_position.x[lane], u_position.y[lane]}, {u_direction.x[lane], u_direction.y[lane]})
                        .emission);
    }
  }
  if (areas != 0) emit_areas(areas, lights, u_side, u_position, u_direction, find_points, emissions);
}

/// emit_area() in `lanes`.
void Lights::emit_areas(unsigned lanes, const std::array<std::uint32_t, kLanes>& lights, const Float8& u_side,
                        const Vec2x8& u_position, const Vec2x8& u_direction, bool find_points,
                        EmissionLanes& emissions) const {
  AreaLanes areas{};
  Vec3x8 flux{};
  if (area_lights_.size() == 1 && !area_lights_[0].two_sided()) {
    areas.fill(area_lights_[0]);
    flux = all(picked_flux_[0]);
  } else {
    for_each_lane(lanes, [&](std::size_t lane) {
      const AreaLight& light = area_lights_[lights[lane]];
      areas.set(lane, light, light.two_sided() && u_side[lane] >= 0.5f);
      flux.set(lane, picked_flux_[lights[lane]]);
    });
  }
  const Vec2x8 st = place(areas.paired, u_position);
  const Vec3x8 position = areas.origin + areas.edge_u * st.x + areas.edge_v * st.y;
  const Int8 here = mask_of(lanes);
  const Vec3x8 direction = normalize(Frame8::from_normal(areas.normal).to_world(sample_cosine_hemisphere(u_direction)));
  emissions.lanes |= lanes;
  emissions.origin =
      select(here, offset_ray_origin(position, areas.normal, areas.normal, areas.extent), emissions.origin);
  emissions.direction = select(here, direction, emissions.direction);
  emissions.flux = select(here, flux, emissions.flux);
  if (!find_points) return;
  for_each_lane(lanes, [&](std::size_t lane) {
    const AreaLight::Point point = area_lights_[lights[lane]].point_at(st.x[lane], st.y[lane]);
    emissions.triangle[lane] = static_cast<std::int32_t>(point.triangle);
    emissions.barycentric[lane] = point.barycentric;
  });
}

}  // namespace pf
