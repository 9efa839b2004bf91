// Derivatives against finite differences: the same path with a slightly other start, followed in double precision.

#include "worker/photon/photon_differential.h"

#include <cmath>
#include <functional>
#include <optional>

#include <gtest/gtest.h>

#include "common/math/frame.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

using Vec3d = Imath::V3d;

struct Line {
  Vec3d origin, direction;
};

/// Where the line meets the sphere, the near or the far side.
Vec3d meet_sphere(const Line& l, const Vec3d& centre, double radius, bool near) {
  const Vec3d o = l.origin - centre;
  const double b = o.dot(l.direction);
  const double root = std::sqrt(b * b - o.dot(o) + radius * radius);
  return l.origin + l.direction * (near ? -b - root : -b + root);
}
Vec3d mirrored(const Vec3d& d, const Vec3d& n) { return d - n * (2.0 * d.dot(n)); }
Vec3d refracted(const Vec3d& d, const Vec3d& n, double eta) {  // n against d
  const double c = -d.dot(n);
  return d * eta + n * (eta * c - std::sqrt(1.0 - eta * eta * (1.0 - c * c)));
}

/// The shape of a sphere at a point, normals outwards.
SurfaceShape sphere_shape(const Vec3f& normal, float radius) {
  const Frame frame = Frame::from_normal(normal);
  return {frame.t, frame.b, frame.t * (1.0f / radius), frame.b * (1.0f / radius)};
}

/// Checks the derivatives of a path against those of `follow`, which takes a start to where the path goes on in the
/// end.
void expect_derivatives(const Line& start, const PhotonDifferential& from, const PhotonDifferential& to,
                        const std::function<Line(const Line&)>& follow) {
  const Line end = follow(start);
  EXPECT_LT((end.direction - Vec3d(to.ray_direction())).length(), 1e-5);
  const double step = 1e-5;
  for (std::size_t k = 0; k < PhotonDifferential::kAxes; ++k) {
    const auto moved = [&](double s) {
      return follow(
          {start.origin + Vec3d(from.position(k)) * s, (start.direction + Vec3d(from.direction(k)) * s).normalized()});
    };
    const Line plus = moved(step), minus = moved(-step);
    // Origins are compared across the ray.
    Vec3d position = (plus.origin - minus.origin) / (2.0 * step);
    position -= end.direction * position.dot(end.direction);
    const Vec3d direction = (plus.direction - minus.direction) / (2.0 * step);
    const double size = std::max({1e-3, position.length(), direction.length()});
    EXPECT_LT((position - Vec3d(to.position(k))).length(), 2e-4 * size) << "position " << k;
    EXPECT_LT((direction - Vec3d(to.direction(k))).length(), 2e-4 * size) << "direction " << k;
  }
}

/// An area lamp's path: place and direction both vary.
struct Start {
  Line line;
  PhotonDifferential differential;
};
Start some_start(PathRng& rng) {
  const Vec3f origin = Vec3f(-0.4f, -0.3f, -2.0f) + Vec3f(0.5f * rng.next1(), 0.5f * rng.next1(), 0.0f);
  const Vec3f direction = normalize(Vec3f(0.1f * rng.next1(), 0.1f * rng.next1(), 1.0f));
  return {{Vec3d(origin), Vec3d(direction)},
          PhotonDifferential::emitted(direction, normalize(Vec3f(0.2f, 0.1f, 1.0f)), 4.0f, 0.8f)};
}

TEST(PhotonDifferential, StartsWithTheAreaOfOneOverTheDensity) {
  const Vec3f d = normalize(Vec3f(0.3f, -0.5f, 0.8f));
  const Frame frame = Frame::from_normal(d);
  const PhotonDifferential lamp = PhotonDifferential::emitted(d, d, 4.0f, 0.25f);
  EXPECT_NEAR(std::sqrt(lamp.along(frame.t, frame.b).at_start.determinant()), 0.25f, 1e-6f);
  EXPECT_NEAR(std::sqrt(lamp.along(frame.t, frame.b).quadratic.determinant()), 4.0f, 1e-5f);
  // A lamp seen at an angle is foreshortened.
  const Vec3f tilted = normalize(frame.t + d);
  const PhotonDifferential slant = PhotonDifferential::emitted(d, tilted, 4.0f, 0.25f);
  EXPECT_NEAR(std::sqrt(slant.along(frame.t, frame.b).at_start.determinant()), 0.25f * std::sqrt(0.5f), 1e-6f);
  // A point light's spread grows with the square of the distance.
  PhotonDifferential point = PhotonDifferential::emitted(d, d, kInfinity, 1.0f / (4.0f * kPi));
  point.advance(3.0f);
  EXPECT_NEAR(std::sqrt(point.along(frame.t, frame.b).at_start.determinant()), 36.0f * kPi, 1e-3f);
}

TEST(PhotonDifferential, FollowsASphericalMirror) {
  PathRng rng(1, Stream::kTest, 0, 0);
  const Vec3d centre(0.0, 0.0, 0.0);
  for (int i = 0; i < 50; ++i) {
    for (const bool inside : {false, true}) {
      const Start start = some_start(rng);
      const auto follow = [&](const Line& l) {
        const Vec3d p = meet_sphere(l, centre, 1.0, !inside);
        return Line{p, mirrored(l.direction, (p - centre).normalized())};
      };
      const Line end = follow(start.line);
      PhotonDifferential d = start.differential;
      d.advance(static_cast<float>((end.origin - start.line.origin).length()));
      const Vec3f normal(end.origin);
      // The shading normal may come from either side.
      d.reflect(normal, inside ? -normal : normal, sphere_shape(normal, 1.0f), Vec3f(end.direction));
      expect_derivatives(start.line, start.differential, d, follow);
    }
  }
}

TEST(PhotonDifferential, FollowsRefractionThroughAGlassBall) {
  PathRng rng(2, Stream::kTest, 0, 0);
  const Vec3d centre(0.0, 0.0, 0.0);
  for (int i = 0; i < 50; ++i) {
    const Start start = some_start(rng);
    const auto enter = [&](const Line& l) {
      const Vec3d p = meet_sphere(l, centre, 1.0, true);
      return Line{p, refracted(l.direction, p.normalized(), 1.0 / 1.5)};
    };
    const auto leave = [&](const Line& l) {
      const Vec3d p = meet_sphere(l, centre, 1.0, false);
      return Line{p, refracted(l.direction, -p.normalized(), 1.5)};
    };
    const Line within = enter(start.line);
    const Line end = leave(within);
    PhotonDifferential d = start.differential;
    d.advance(static_cast<float>((within.origin - start.line.origin).length()));
    d.refract(Vec3f(within.origin), Vec3f(within.origin), sphere_shape(Vec3f(within.origin), 1.0f), 1.0f, 1.5f,
              Vec3f(within.direction));
    expect_derivatives(start.line, start.differential, d, enter);
    d.advance(static_cast<float>((end.origin - within.origin).length()));
    d.refract(Vec3f(end.origin), Vec3f(end.origin), sphere_shape(Vec3f(end.origin), 1.0f), 1.5f, 1.0f,
              Vec3f(end.direction));
    expect_derivatives(start.line, start.differential, d, [&](const Line& l) { return leave(enter(l)); });
    // And on to a plane across the ray, where it is the footprint.
    d.advance(0.7f);
    expect_derivatives(start.line, start.differential, d, [&](const Line& l) {
      const Line out = leave(enter(l));
      const Vec3d at = end.origin + end.direction * 0.7;
      return Line{
          out.origin + out.direction * ((at - out.origin).dot(end.direction) / out.direction.dot(end.direction)),
          out.direction};
    });
  }
}

TEST(PhotonDifferential, AFlatMirrorLeavesTheSpreadAsItIs) {
  PathRng rng(3, Stream::kTest, 0, 0);
  const Start start = some_start(rng);
  const Vec3f to = start.differential.ray_direction() * Vec3f(1, 1, -1);
  PhotonDifferential exact = start.differential, plain = start.differential;
  exact.advance(2.0f);
  exact.reflect({0, 0, 1}, {0, 0, 1}, {}, to);
  plain.advance(2.0f);
  plain.turn(to);
  for (PhotonDifferential* d : {&exact, &plain}) d->advance(1.5f);
  const Frame frame = Frame::from_normal(to);
  const float area2 = plain.along(frame.t, frame.b).at_start.determinant();
  EXPECT_NEAR(exact.along(frame.t, frame.b).at_start.determinant(), area2, 1e-4f * area2);
}

TEST(PhotonDifferential, ADiffuseBounceAddsTheAreaThatItsDirectionsCover) {
  // From a point light straight down to the floor and straight up: 4 pi h^2, and then that plus pi t^2.
  PhotonDifferential d = PhotonDifferential::emitted({0, 0, -1}, {0, 0, -1}, kInfinity, 1.0f / (4.0f * kPi));
  d.advance(2.0f);
  d.bounce({0, 0, 1}, {0, 0, 1}, kInvPi);
  const auto area = [](const PhotonDifferential& at) {
    return std::sqrt(at.along({1, 0, 0}, {0, 1, 0}).at_start.determinant());
  };
  EXPECT_NEAR(area(d), 16.0f * kPi, 1e-3f);
  d.advance(3.0f);
  EXPECT_NEAR(area(d), 25.0f * kPi, 1e-3f);
  // A slanted departure sees the lit floor foreshortened.
  PhotonDifferential slant = PhotonDifferential::emitted({0, 0, -1}, {0, 0, -1}, kInfinity, 1.0f / (4.0f * kPi));
  slant.advance(2.0f);
  const Vec3f to = normalize(Vec3f(1, 0, 1));
  slant.bounce({0, 0, 1}, to, kInvPi * to.z);
  const Frame frame = Frame::from_normal(to);
  EXPECT_NEAR(std::sqrt(slant.along(frame.t, frame.b).at_start.determinant()), 16.0f * kPi * to.z, 1e-3f);
}

TEST(PhotonDifferential, ARoughLobeAddsItsOwnSpreadToTheMirrored) {
  PathRng rng(4, Stream::kTest, 0, 0);
  for (int i = 0; i < 20; ++i) {
    PhotonDifferential d = some_start(rng).differential;
    d.advance(1.0f);
    const Frame frame = Frame::from_normal(d.ray_direction());
    const PhotonDifferential::Along before = d.along(frame.t, frame.b);
    d.roughen(4.0f);
    const PhotonDifferential::Along after = d.along(frame.t, frame.b);
    EXPECT_NEAR(after.at_start.xx, before.at_start.xx, 1e-4f * before.at_start.xx);
    EXPECT_NEAR(after.at_start.xy, before.at_start.xy, 1e-4f * before.at_start.xx);
    EXPECT_NEAR(after.linear.yy, before.linear.yy, 1e-3f);
    EXPECT_NEAR(after.quadratic.xx, before.quadratic.xx + 0.25f, 1e-4f);
    EXPECT_NEAR(after.quadratic.yy, before.quadratic.yy + 0.25f, 1e-4f);
  }
}

}  // namespace
}  // namespace pf
