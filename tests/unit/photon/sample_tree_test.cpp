#include "worker/photon/sample_tree.h"

#include <algorithm>
#include <vector>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "common/math/frame.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

Vec3f point_in(PathRng& rng, float size) { return Vec3f(rng.next1(), rng.next1(), rng.next1()) * size; }

/// Samples on floors, walls and at random, far from the origin, some with wide footprints, some seen from both sides.
std::vector<SplatSample> some_samples(std::size_t count, std::uint32_t seed, const Vec3f& offset) {
  PathRng rng(seed, Stream::kTest, 0, 0);
  std::vector<SplatSample> samples(count);
  for (std::size_t i = 0; i < count; ++i) {
    SplatSample& s = samples[i];
    s.position = point_in(rng, 2.0f);
    s.ng = sample_sphere(rng.next2());
    if (i % 3 == 0) s.position.y = 0.0f, s.ng = {0, 1, 0};
    if (i % 7 == 0) s.position.x = 0.5f, s.ng = {1, 0, 0};
    s.position += offset;
    s.ns = normalize(s.ng + sample_sphere(rng.next2()) * 0.2f);
    s.least_radius = i % 500 == 0 ? 0.2f : 0.002f * rng.next1();
    s.both_sides = i % 41 == 0;
    s.id = static_cast<std::uint32_t>(i);
  }
  return samples;
}

/// Cones, cylinders and ellipses with a focus; long and short, wide and narrow; with and without surfaces at their
/// ends.
RayKernel some_ray(PathRng& rng, const Vec3f& offset) {
  const Vec3f direction = rng.next1() < 0.1f ? Vec3f(0, -1, 0) : sample_sphere(rng.next2());
  const Frame frame = Frame::from_normal(direction);
  const float width = 0.8f * rng.next1() * rng.next1();
  Spread at_start, linear, quadratic;
  for (int k = 0; k < 3; ++k) {
    const Vec2f p = (rng.next2() - Vec2f(0.5f)) * width, d = (rng.next2() - Vec2f(0.5f)) * width;
    at_start += Spread{p.x * p.x, p.x * p.y, p.y * p.y};
    linear += Spread{2 * p.x * d.x, p.x * d.y + p.y * d.x, 2 * p.y * d.y};
    quadratic += Spread{d.x * d.x, d.x * d.y, d.y * d.y};
  }
  const Vec3f origin = point_in(rng, 2.4f) - Vec3f(0.2f) + offset;
  const float length = 3.0f * rng.next1();
  const auto plane = [&](const Vec3f& at, float side) {
    if (rng.next1() < 0.3f) return RayKernel::Plane{};
    const Vec3f tilted = normalize(direction * side + sample_sphere(rng.next2()) * 0.9f);
    return RayKernel::Plane{tilted, dot(tilted, at)};
  };
  const RayKernel::Plane start = plane(origin, 1.0f);
  const RayKernel::Plane end = plane(origin + direction * length, -1.0f);
  return RayKernel(origin, direction, length, frame.t, frame.b, at_start, linear, quadratic, start, end);
}

TEST(SampleTree, FindsExactlyWhatBruteForceFinds) {
  std::size_t found_in_all = 0;
  for (const std::size_t count :
       {std::size_t{0}, std::size_t{1}, std::size_t{7}, std::size_t{100}, std::size_t{20000}}) {
    for (const Vec3f& offset : {Vec3f(0.0f), Vec3f(-300.0f, 40.0f, 1000.0f)}) {
      const SampleTree tree(some_samples(count, 5, offset));
      ASSERT_EQ(tree.samples().size(), count);
      PathRng rng(9, Stream::kTest, 1, 0);
      for (int i = 0; i < 400; ++i) {
        const RayKernel ray = some_ray(rng, offset);
        std::vector<std::size_t> found, expected;
        tree.for_each(ray, [&](std::size_t index, const RayKernel::Meeting&) { found.push_back(index); });
        for (std::size_t k = 0; k < count; ++k) {
          if (ray.meet(tree.samples()[k])) expected.push_back(k);
        }
        ASSERT_EQ(found, expected) << count << " ray " << i;
        found_in_all += found.size();
      }
    }
  }
  EXPECT_GT(found_in_all, 10000u);
}

TEST(SampleTree, CutsIntoBranchesThatTogetherFindTheSame) {
  const SampleTree tree(some_samples(20000, 6, Vec3f(0.0f)));
  ASSERT_GT(tree.branches(), 1u);
  PathRng rng(10, Stream::kTest, 1, 0);
  for (int i = 0; i < 100; ++i) {
    const RayKernel ray = some_ray(rng, Vec3f(0.0f));
    std::vector<std::size_t> whole, parts;
    tree.for_each(ray, [&](std::size_t index, const RayKernel::Meeting&) { whole.push_back(index); });
    for (std::size_t b = 0; b < tree.branches(); ++b) {
      tree.for_each_in_branch(b, ray, [&](std::size_t index, const RayKernel::Meeting&) { parts.push_back(index); });
    }
    ASSERT_EQ(whole, parts);
  }
}

TEST(SampleTree, HasOneOrderOnAnyNumberOfThreads) {
  const auto order_on = [](int threads) {
    const tbb::global_control allowed(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    std::vector<std::uint32_t> ids;
    tbb::task_arena(threads).execute([&] {
      const SampleTree tree(some_samples(50000, 7, Vec3f(0.0f)));
      for (const SplatSample& s : tree.samples()) ids.push_back(s.id);
    });
    return ids;
  };
  const auto one = order_on(1);
  for (const int threads : {2, 5}) EXPECT_EQ(order_on(threads), one);
}

TEST(SampleTree, WalksPastSamplesThatFaceAway) {
  // Two sheets of samples back to back: directions save about half of what a ray that crosses them would test.
  std::vector<SplatSample> samples(20000);
  PathRng rng(8, Stream::kTest, 0, 0);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].position = {rng.next1(), 0.0f, rng.next1()};
    samples[i].ng = samples[i].ns = i % 2 == 0 ? Vec3f(0, 1, 0) : Vec3f(0, -1, 0);
    samples[i].id = static_cast<std::uint32_t>(i);
  }
  const SampleTree tree(std::move(samples));
  const Spread wide{1.0f, 0.0f, 1.0f};
  const RayKernel ray({0.5f, 1.0f, 0.5f}, {0, -1, 0}, 1.0f, {1, 0, 0}, {0, 0, 1}, wide, {}, {}, {}, {{0, 1, 0}, 0.0f});
  std::size_t branches = 0, met = 0;
  tree.for_each_branch(ray, [&](std::size_t) { ++branches; });
  tree.for_each(ray, [&](std::size_t, const RayKernel::Meeting&) { ++met; });
  EXPECT_EQ(met, 10000u);
  EXPECT_LE(branches, tree.branches() * 6 / 10);
}

}  // namespace
}  // namespace pf
