#include "jobs/scenes/generate/profile.h"

#include <cmath>
#include <numbers>

namespace pf::scenes {
namespace {

Vec2 right_of(const Vec2& tangent) { return Vec2(tangent.y, -tangent.x).normalized(); }

}  // namespace

void Profile::add_sample(const Sample& sample) {
  const bool repeats = !samples_.empty() && (samples_.back().point - sample.point).length() < 1e-9 &&
                       (samples_.back().normal - sample.normal).length() < 1e-6;
  if (!repeats) samples_.push_back(sample);
  pen_ = sample.point;
}

void Profile::add(const Vec2& point, const Vec2& tangent) { add_sample({point, right_of(tangent)}); }

Profile& Profile::line_to(const Vec2& end, int segments) {
  const Vec2 start = pen_;
  for (int i = 0; i <= segments; ++i) {
    const double t = static_cast<double>(i) / segments;
    add(i == segments ? end : start + (end - start) * t, end - start);
  }
  return *this;
}

Profile& Profile::arc(const Vec2& centre, double degrees, int segments) {
  const Vec2 arm = pen_ - centre;
  const double sign = degrees < 0 ? -1.0 : 1.0;
  for (int i = 0; i <= segments; ++i) {
    const double phi = radians(degrees) * i / segments;
    const Vec2 d(arm.x * std::cos(phi) - arm.y * std::sin(phi), arm.x * std::sin(phi) + arm.y * std::cos(phi));
    add(centre + d, Vec2(-d.y, d.x) * sign);
  }
  return *this;
}

Profile& Profile::curve_to(const Vec2& control1, const Vec2& control2, const Vec2& end, int segments) {
  const Vec2 start = pen_;
  for (int i = 0; i <= segments; ++i) {
    const double t = static_cast<double>(i) / segments;
    const double s = 1.0 - t;
    const Vec2 point =
        start * (s * s * s) + control1 * (3 * s * s * t) + control2 * (3 * s * t * t) + end * (t * t * t);
    const Vec2 tangent =
        (control1 - start) * (s * s) + (control2 - control1) * (2 * s * t) + (end - control2) * (t * t);
    add(i == segments ? end : point, tangent);
  }
  return *this;
}

Profile& Profile::parallel_back(std::size_t first, std::size_t last, double thickness) {
  for (std::size_t i = last + 1; i-- > first;) {
    const Sample front = samples_[i];
    add_sample({front.point - front.normal * thickness, -front.normal});
  }
  return *this;
}

Mesh lathe(const Profile& profile, int segments) {
  const auto& samples = profile.samples();
  const auto around = static_cast<std::uint32_t>(segments);
  const auto on_axis = [&](std::size_t i) { return samples[i].point.x < 1e-12; };
  Mesh mesh;
  std::vector<std::uint32_t> first(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    first[i] = static_cast<std::uint32_t>(mesh.positions.size());
    const auto& [p, n] = samples[i];
    for (std::uint32_t j = 0; j < (on_axis(i) ? 1 : around); ++j) {
      const double phi = 2.0 * std::numbers::pi * j / segments;
      const double c = std::cos(phi), s = std::sin(phi);
      if (on_axis(i)) {
        mesh.positions.emplace_back(0.0, p.y, 0.0);
        mesh.normals.emplace_back(0.0, n.y < 0 ? -1.0 : 1.0, 0.0);
      } else {
        mesh.positions.emplace_back(p.x * c, p.y, p.x * s);
        mesh.normals.emplace_back(n.x * c, n.y, n.x * s);
      }
    }
  }
  for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
    const std::size_t k = i + 1;
    if ((samples[i].point - samples[k].point).length() < 1e-9) continue;  // a sharp edge has no width
    for (std::uint32_t j = 0; j < around; ++j) {
      const std::uint32_t next = (j + 1) % around;
      if (!on_axis(i)) mesh.triangles.push_back({first[i] + j, first[k] + (on_axis(k) ? 0 : j), first[i] + next});
      if (!on_axis(k)) {
        mesh.triangles.push_back({first[i] + (on_axis(i) ? 0 : next), first[k] + j, first[k] + next});
      }
    }
  }
  return mesh;
}

Profile liquid_in(const std::vector<Profile::Sample>& inner_wall, double level, double overlap, double rise) {
  std::vector<Profile::Sample> side;
  for (std::size_t i = inner_wall.size(); i-- > 0;) {
    const auto& [point, normal] = inner_wall[i];
    if (point.y > level) break;
    side.push_back({point - normal * overlap, -normal});
  }
  Profile profile(std::move(side));
  const Vec2 contact = profile.pen();
  const double flat = contact.y - rise;
  profile.curve_to(contact - Vec2(0.3 * rise, 0.8 * rise), Vec2(contact.x - 1.2 * rise, flat),
                   Vec2(contact.x - 2.5 * rise, flat), 8);
  profile.line_to(Vec2(0.0, flat));
  return profile;
}

}  // namespace pf::scenes
