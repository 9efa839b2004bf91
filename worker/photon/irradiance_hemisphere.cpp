#include "worker/photon/irradiance_hemisphere.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace pf {
namespace {

/// Means over blocks of kBlock x kBlock cells.
constexpr std::uint32_t kBlock = 2;

struct Blocks {
  std::uint32_t rings, sectors;
  std::vector<Rgb> radiance;
  std::vector<float> nearness;  ///< mean of 1 / distance

  explicit Blocks(const HemisphereSamples& samples)
      : rings(samples.grid.rings / kBlock),
        sectors(samples.grid.sectors / kBlock),
        radiance(std::size_t{rings} * sectors, Rgb{0, 0, 0}),
        nearness(radiance.size(), 0.0f) {
    constexpr float kPart = 1.0f / static_cast<float>(kBlock * kBlock);
    for (std::uint32_t cell = 0; cell < samples.grid.cells(); ++cell) {
      const std::uint32_t ring = cell / samples.grid.sectors / kBlock, sector = cell % samples.grid.sectors / kBlock;
      const std::size_t block = index(ring, sector);
      radiance[block] += samples.radiance[cell] * kPart;
      nearness[block] += kPart / samples.distance[cell];
    }
  }
  [[nodiscard]] std::size_t index(std::uint32_t ring, std::uint32_t sector) const {
    return std::size_t{ring} * sectors + sector;
  }
};

void add(RgbGradient& gradient, const Rgb& change, const Vec3f& direction) {
  for (int c = 0; c < 3; ++c) gradient[static_cast<std::size_t>(c)] += direction * change[c];
}

Vec3f horizontal(float phi) { return {std::cos(phi), std::sin(phi), 0.0f}; }

/// Light that crosses the walls between blocks as the point moves by a metre. theta is the angle to the
/// normal.
RgbGradient translation_gradient(const Blocks& blocks) {
  const auto rings = static_cast<float>(blocks.rings), sectors = static_cast<float>(blocks.sectors);
  RgbGradient gradient = kNoChange;
  const auto crossing = [&](std::size_t to, std::size_t from) {
    return (blocks.radiance[to] - blocks.radiance[from]) * std::max(blocks.nearness[to], blocks.nearness[from]);
  };
  for (std::uint32_t sector = 0; sector < blocks.sectors; ++sector) {
    const Vec3f middle = horizontal(2.0f * kPi * (static_cast<float>(sector) + 0.5f) / sectors);
    const Vec3f across = horizontal(2.0f * kPi * static_cast<float>(sector) / sectors + 0.5f * kPi);
    const std::uint32_t before = (sector + blocks.sectors - 1) % blocks.sectors;
    for (std::uint32_t ring = 0; ring < blocks.rings; ++ring) {
      const std::size_t here = blocks.index(ring, sector);
      const float sin2 = static_cast<float>(ring) / rings;  // of the wall towards the normal
      const float sin_inner = std::sqrt(sin2), sin_outer = std::sqrt(static_cast<float>(ring + 1) / rings);
      if (ring > 0) {
        const float rate = 2.0f * kPi / sectors * sin_inner * (1.0f - sin2);
        add(gradient, crossing(here, blocks.index(ring - 1, sector)) * rate, middle);
      }
      add(gradient, crossing(here, blocks.index(ring, before)) * (sin_outer - sin_inner), across);
    }
  }
  return gradient;
}

/// Every cell's light changes with its cosine as the normal turns towards it, about the axis at phi + pi/2:
/// by tan(theta) of it [Ward and Heckbert 1992, (2), whose axis points the other way].
RgbGradient rotation_gradient(const Blocks& blocks) {
  const auto rings = static_cast<float>(blocks.rings), sectors = static_cast<float>(blocks.sectors);
  RgbGradient gradient = kNoChange;
  for (std::uint32_t sector = 0; sector < blocks.sectors; ++sector) {
    Rgb sum{0, 0, 0};
    for (std::uint32_t ring = 0; ring < blocks.rings; ++ring) {
      // The mean of tan(theta) over a ring's projected solid angle, s = sin^2(theta): the integral of sqrt(s
      // / (1 - s)) is asin(sqrt(s)) - sqrt(s (1 - s)).
      const auto primitive = [&](std::uint32_t border) {
        const float s = static_cast<float>(border) / rings;
        return std::asin(std::sqrt(s)) - std::sqrt(s * (1.0f - s));
      };
      sum += blocks.radiance[blocks.index(ring, sector)] * ((primitive(ring + 1) - primitive(ring)) * rings);
    }
    add(gradient, sum * (kPi / (rings * sectors)),
        horizontal(2.0f * kPi * (static_cast<float>(sector) + 0.5f) / sectors + 0.5f * kPi));
  }
  return gradient;
}

}  // namespace

HemisphereGrid HemisphereGrid::of_rays(int rays) {
  // rings * sectors = rays and sectors = pi * rings, both rounded to even numbers.
  const auto even = [](double value) {
    return kBlock * static_cast<std::uint32_t>(std::max(1.0, std::round(value / double{kBlock})));
  };
  HemisphereGrid grid;
  grid.rings = even(std::sqrt(double(rays) / double{kPi}));
  grid.sectors = std::max(2 * kBlock, even(double(rays) / grid.rings));
  return grid;
}

Vec3f HemisphereGrid::direction(std::uint32_t cell, const Vec2f& u) const {
  const std::uint32_t ring = cell / sectors, sector = cell % sectors;
  const float sin2 = (static_cast<float>(ring) + u.x) / static_cast<float>(rings);
  const float phi = 2.0f * kPi * (static_cast<float>(sector) + u.y) / static_cast<float>(sectors);
  const float sine = std::sqrt(sin2);
  return {sine * std::cos(phi), sine * std::sin(phi), std::sqrt(std::max(0.0f, 1.0f - sin2))};
}

IrradianceEstimate estimate_irradiance(const HemisphereSamples& samples, const Frame& frame) {
  IrradianceEstimate estimate;
  const auto cells = static_cast<float>(samples.grid.cells());
  float nearness = 0.0f;
  for (std::uint32_t cell = 0; cell < samples.grid.cells(); ++cell) {
    estimate.irradiance += samples.radiance[cell];
    nearness += 1.0f / samples.distance[cell];
  }
  estimate.irradiance *= kPi / cells;
  estimate.harmonic_distance = cells / nearness;
  const Blocks blocks(samples);
  estimate.rotation = rotation_gradient(blocks);
  estimate.translation = translation_gradient(blocks);
  for (RgbGradient* gradient : {&estimate.rotation, &estimate.translation}) {
    for (Vec3f& g : *gradient) g = frame.to_world(g);
  }
  return estimate;
}

}  // namespace pf
