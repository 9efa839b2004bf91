#include "worker/integrators/eye_allocation.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "worker/integrators/eye_paths.h"

namespace pf {
namespace {

/// Pilot samples of a pixel. Two tell one difference, and nine pixels side by side nine.
constexpr std::size_t kPilotSamples = 2;
/// The pilot's sequence of points: no job counts its sub-passes that far.
constexpr std::uint64_t kPilotSequence = std::uint64_t{1} << 63;
/// Radiances below this share of the image's mean do not count as dark: an error there is small beside the image.
constexpr double kDarkShare = 0.1;

/// Adds up what an eye sample sees without photons.
struct DirectSink {
  const Scene& scene;
  int light_samples;
  TileFigures& figures;
  Rgb sum{0.0f, 0.0f, 0.0f};

  void ray() { ++figures.rays; }
  void escape(const EyeWalk& walk) { sum += environment_seen(scene, walk); }
  void emitter(const SurfacePoint& point, const Vec3f& wo, const EyeWalk& walk) {
    sum += emission_seen(scene, point, wo, walk);
  }
  void first_hit(const Vertex&, float) {}
  void direct(const Vertex& vertex, float u_pick, const Vec2f& u, float p_follow, const EyeWalk& walk) {
    sum += walk.beta *
           direct_light(scene, vertex, walk.media, u_pick, u, Portion::kFollow, p_follow, light_samples, figures.rays);
  }
  void gather(const Vertex&, const Rgb&, const Vec2f&, const EyeWalk&) {}
};

/// What the pilot found at a pixel: mean luminance and the variance of that mean, and the rays it took.
struct PilotPixel {
  double mean = 0;
  double variance = 0;
  double rays = 0;
};

std::vector<PilotPixel> pilot(const Scene& scene, const Eye& eye, int max_depth, int light_samples) {
  std::vector<PilotPixel> pixels(static_cast<std::size_t>(eye.width()) * static_cast<std::size_t>(eye.height()));
  const EyePaths paths(scene, eye, max_depth);
  Statistics figures;
  for_each_pixel(eye.width(), eye.height(), figures, [&](int x, int y, TileFigures& sheet) {
    std::array<double, kPilotSamples> seen{};
    const std::uint64_t rays_before = sheet.rays;
    for (std::size_t i = 0; i < kPilotSamples; ++i) {
      DirectSink sink{scene, light_samples, sheet};
      paths.follow(x, y, kPilotSequence + i, sink);
      if (is_finite(sink.sum)) seen[i] = double{luminance(sink.sum)};
    }
    const double half = 0.5 * (seen[0] - seen[1]);
    pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(eye.width()) + static_cast<std::size_t>(x)] = {
        0.5 * (seen[0] + seen[1]), half * half, static_cast<double>(sheet.rays - rays_before)};
  });
  return pixels;
}

/// What more samples at a pixel would bring and cost.
struct Worth {
  float deviation = 0;  ///< of a sample, over the radiance of the pixel and the root of its rays
  float rays = 0;       ///< of a sample
};

/// From the pixel and its neighbours: two samples alone say little, and a neighbour's edge is not the pixel's own.
std::vector<Worth> worths(const std::vector<PilotPixel>& pixels, int width, int height) {
  constexpr double kOwnWeight = 2.0;  // of the pixel; 1 of each neighbour
  double total = 0.0;
  for (const PilotPixel& p : pixels) total += p.mean;
  const double dark = kDarkShare * total / static_cast<double>(pixels.size());
  if (!(dark > 0.0)) return std::vector<Worth>(pixels.size());
  const auto index = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  };
  std::vector<Worth> all(pixels.size());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double weights = 0.0, variance = 0.0, rays = 0.0;
      for (int v = std::max(0, y - 1); v <= std::min(height - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(width - 1, x + 1); ++u) {
          const PilotPixel& p = pixels[index(u, v)];
          const double weight = u == x && v == y ? kOwnWeight : 1.0;
          weights += weight;
          variance += weight * p.variance / (p.mean * p.mean + dark * dark);
          rays += weight * p.rays;
        }
      }
      rays /= weights * kPilotSamples;
      all[index(x, y)] = {static_cast<float>(std::sqrt(variance / (weights * rays))), static_cast<float>(rays)};
    }
  }
  return all;
}

int samples_for(const Worth& worth, double scale) {
  return static_cast<int>(
      std::clamp(std::floor(double{worth.deviation} * scale), 1.0, double{EyeAllocation::kMostSamples}));
}

/// Rays of the samples beyond the first of each pixel.
double extra_rays(const std::vector<Worth>& pixels, double scale) {
  double sum = 0.0;
  for (const Worth& worth : pixels) sum += double{worth.rays} * (samples_for(worth, scale) - 1);
  return sum;
}

}  // namespace

EyeAllocation::EyeAllocation(const Scene& scene, const Eye& eye, int max_depth, int light_samples) {
  const std::vector<Worth> pixels = worths(pilot(scene, eye, max_depth, light_samples), eye.width(), eye.height());
  double rays = 0.0;
  for (const Worth& worth : pixels) rays += double{worth.rays};
  // The largest scale that the budget allows; where nothing varies any will do.
  double low = 0.0, high = double{1 << 20};
  constexpr int kHalvings = 40;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (extra_rays(pixels, middle) <= kExtraShare * rays ? low : high) = middle;
  }
  samples_.reserve(pixels.size());
  for (const Worth& worth : pixels) samples_.push_back(static_cast<std::uint8_t>(samples_for(worth, low)));
}

}  // namespace pf
