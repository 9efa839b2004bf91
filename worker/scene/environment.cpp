#include "worker/scene/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "common/math/sampling.h"
#include "worker/scene/image_reader.h"

namespace pf {
namespace {

constexpr float kUniformPdf = 0.25f * kInvPi;
/// Larger values cannot be radiance, and their sums would overflow.
constexpr float kLargestRadiance = 1e18f;

bool usable(float value) { return value >= 0.0f && value <= kLargestRadiance; }  // false for NaN

/// Scales the map and zeroes what is no radiance; returns how many pixels were not.
std::size_t scale_and_clean(std::vector<Rgb>& pixels, const Rgb& scale) {
  std::size_t cleaned = 0;
  for (Rgb& pixel : pixels) {
    pixel *= scale;
    if (usable(pixel.x) && usable(pixel.y) && usable(pixel.z)) continue;
    pixel = Rgb(usable(pixel.x) ? pixel.x : 0.0f, usable(pixel.y) ? pixel.y : 0.0f, usable(pixel.z) ? pixel.z : 0.0f);
    ++cleaned;
  }
  return cleaned;
}

std::size_t cell(float x, std::size_t count) {
  const float scaled = x * static_cast<float>(count);
  return scaled > 0.0f ? std::min(static_cast<std::size_t>(scaled), count - 1) : 0;
}

}  // namespace

Result<EnvironmentMap> EnvironmentMap::load(const Environment& e, std::vector<std::string>& warnings) {
  EnvironmentMap result;
  if (e.file.empty()) {
    result.constant_ = e.radiance;
    result.total_ = e.radiance * (4.0f * kPi);
    return result;
  }
  auto map = read_radiance_map(e.file);
  if (!map) return tl::unexpected(map.error());
  result.width_ = map->width;
  result.height_ = map->height;
  result.pixels_ = std::move(map->pixels);
  if (const std::size_t cleaned = scale_and_clean(result.pixels_, e.radiance); cleaned > 0) {
    warnings.push_back(fmt::format("{}: {} of {} pixels hold negative, infinite or NaN values; these are taken as 0",
                                   e.file, cleaned, result.pixels_.size()));
  }
  result.prepare();
  if (!result.present()) warnings.push_back(fmt::format("{}: the environment map is black", e.file));
  return result;
}

void EnvironmentMap::prepare() {
  // Row y covers cosines between its borders: solid angle of a pixel = 2 pi / width * (cos above - cos
  // below), and cos theta = 1 - 2 sin^2(theta/2), which keeps its digits near the pole.
  row_borders_.resize(height_ + 1);
  for (std::size_t y = 0; y <= height_; ++y) {
    const double s = std::sin(0.5 * std::numbers::pi * static_cast<double>(y) / static_cast<double>(height_));
    row_borders_[y] = s * s;
  }
  std::vector<float> weights(pixels_.size());
  Imath::V3d total(0.0);
  for (std::size_t y = 0; y < height_; ++y) {
    const double solid_angle =
        4.0 * std::numbers::pi / static_cast<double>(width_) * (row_borders_[y + 1] - row_borders_[y]);
    Imath::V3d row(0.0);
    for (std::size_t i = y * width_; i < (y + 1) * width_; ++i) {
      row += Imath::V3d(pixels_[i]);
      weights[i] = static_cast<float>(static_cast<double>(luminance(pixels_[i])) * solid_angle);
    }
    total += row * solid_angle;
  }
  total_ = Rgb(total);
  distribution_ = Distribution2D(width_, height_, weights);
  inverse_luminance_ = distribution_.total() > 0.0 ? static_cast<float>(1.0 / distribution_.total()) : 0.0f;
}

bool EnvironmentMap::present() const { return max_component(total_) > 0.0f; }

Rgb EnvironmentMap::total() const { return total_; }

EnvironmentMap::Pixel EnvironmentMap::pixel_at(const Vec3f& d) const {
  const float theta = std::atan2(std::sqrt(d.x * d.x + d.z * d.z), d.y);
  const float u = 0.5f + std::atan2(d.x, -d.z) * (0.5f * kInvPi);
  return {cell(u, width_), cell(theta * kInvPi, height_)};
}

Vec3f EnvironmentMap::direction_in(const Pixel& p, const Vec2f& u) const {
  const double s2 = row_borders_[p.y] + static_cast<double>(u.y) * (row_borders_[p.y + 1] - row_borders_[p.y]);
  const float sin_theta = static_cast<float>(2.0 * std::sqrt(std::max(0.0, s2 * (1.0 - s2))));
  const float phi = 2.0f * kPi * ((static_cast<float>(p.x) + u.x) / static_cast<float>(width_) - 0.5f);
  return {sin_theta * std::sin(phi), static_cast<float>(1.0 - 2.0 * s2), -sin_theta * std::cos(phi)};
}

Rgb EnvironmentMap::radiance(const Vec3f& d) const { return pixels_.empty() ? constant_ : pixels_[index(pixel_at(d))]; }

float EnvironmentMap::pdf_w(const Vec3f& d) const {
  if (!present()) return 0.0f;
  return pixels_.empty() ? kUniformPdf : pdf_of(pixels_[index(pixel_at(d))]);
}

EnvironmentMap::Sample EnvironmentMap::sample(const Vec2f& u) const {
  if (pixels_.empty()) return {sample_sphere(u), constant_, present() ? kUniformPdf : 0.0f};
  const auto pick = distribution_.sample(u);
  if (!pick) return {sample_sphere(u), Rgb(0.0f), 0.0f};
  Pixel pixel{pick->x, pick->y};
  Vec3f direction = direction_in(pixel, pick->u);
  // Close to a border, rounding may have carried the direction over it: evaluation must see the same pixel.
  constexpr float kMargin = 0.01f;
  if (std::min(pick->u.x, pick->u.y) < kMargin || std::max(pick->u.x, pick->u.y) > 1.0f - kMargin) {
    const Pixel met = pixel_at(direction);
    if (pdf_of(pixels_[index(met)]) > 0.0f) {
      pixel = met;
    } else {
      direction = direction_in(pixel, Vec2f(0.5f, 0.5f));  // the neighbour is black
    }
  }
  const Rgb& radiance = pixels_[index(pixel)];
  return {direction, radiance, pdf_of(radiance)};
}

}  // namespace pf
