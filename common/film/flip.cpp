#include "common/film/flip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace pf {
namespace {

// Constants of [Andersson20]; symbols as there.
constexpr float kColorExponent = 0.7f;    // q_c
constexpr float kColorKnee = 0.4f;        // p_c, fraction of the largest colour difference
constexpr float kColorKneeValue = 0.95f;  // p_t, the error that the knee maps to
constexpr double kFeatureWidth = 0.082;   // w, degrees: width of the edges and points that are looked for
constexpr float kFeatureExponent = 0.5f;  // q_f

using Plane = std::vector<float>;

struct Size {
  int width = 0;
  int height = 0;
  [[nodiscard]] std::size_t pixels() const { return std::size_t{1} * width * height; }
};

// ---------------------------------------------------------------------------------------------- colour

/// Linear Rec.709 to XYZ with white D65, and back (the inverse, rounded).
[[nodiscard]] Vec3f rgb_to_xyz(const Rgb& c) {
  return {0.412386564f * c.x + 0.357591491f * c.y + 0.180450475f * c.z,
          0.212636821f * c.x + 0.715182981f * c.y + 0.072180198f * c.z,
          0.019330620f * c.x + 0.119197164f * c.y + 0.950372587f * c.z};
}
[[nodiscard]] Rgb xyz_to_rgb(const Vec3f& c) {
  return {3.241003275f * c.x - 1.537398934f * c.y - 0.498615861f * c.z,
          -0.969224334f * c.x + 1.875930071f * c.y + 0.041554224f * c.z,
          0.055639423f * c.x - 0.204011202f * c.y + 1.057148933f * c.z};
}
constexpr std::array<float, 3> kWhite = {0.950428545f, 1.0f, 1.088900371f};

/// CIELab with the chroma scaled by lightness (Hunt effect) [Andersson20, colour pipeline].
[[nodiscard]] Vec3f hunt_adjusted_lab(const Rgb& c) {
  const auto f = [](float t) {
    constexpr float kDelta = 6.0f / 29.0f;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3.0f * kDelta * kDelta) + 4.0f / 29.0f;
  };
  const Vec3f xyz = rgb_to_xyz(c);
  const float fx = f(xyz.x / kWhite[0]);
  const float fy = f(xyz.y / kWhite[1]);
  const float fz = f(xyz.z / kWhite[2]);
  const float lightness = 116.0f * fy - 16.0f;
  return {lightness, 0.01f * lightness * 500.0f * (fx - fy), 0.01f * lightness * 200.0f * (fy - fz)};
}

/// HyAB: city-block in lightness, Euclidean in chroma.
[[nodiscard]] float hyab(const Vec3f& a, const Vec3f& b) {
  const float da = a.y - b.y;
  const float db = a.z - b.z;
  return std::abs(a.x - b.x) + std::sqrt(da * da + db * db);
}

// ---------------------------------------------------------------------------------------------- filters

/// One-dimensional kernel with an odd number of taps, centred.
struct Kernel {
  std::vector<float> taps;
  [[nodiscard]] int radius() const { return static_cast<int>(taps.size() / 2); }
};

/// Borders repeat the outermost pixels.
void filter_rows(const Plane& in, const Kernel& kernel, Size size, Plane& out) {
  const int radius = kernel.radius();
  std::vector<float> padded(size.width + 2 * radius);
  for (int y = 0; y < size.height; ++y) {
    const float* row = in.data() + std::size_t{1} * size.width * y;
    float* sum = out.data() + std::size_t{1} * size.width * y;
    std::fill_n(padded.begin(), radius, row[0]);
    std::copy_n(row, size.width, padded.begin() + radius);
    std::fill_n(padded.begin() + radius + size.width, radius, row[size.width - 1]);
    std::fill_n(sum, size.width, 0.0f);
    for (std::size_t tap = 0; tap < kernel.taps.size(); ++tap) {
      const float weight = kernel.taps[tap];
      const float* from = padded.data() + tap;
      for (int x = 0; x < size.width; ++x) sum[x] += weight * from[x];
    }
  }
}

/// Adds `scale` times the filtered columns to `out`.
void add_filtered_columns(const Plane& in, const Kernel& kernel, float scale, Size size, Plane& out) {
  const int radius = kernel.radius();
  for (int y = 0; y < size.height; ++y) {
    float* sum = out.data() + std::size_t{1} * size.width * y;
    for (int tap = -radius; tap <= radius; ++tap) {
      const float weight = scale * kernel.taps[tap + radius];
      const float* from = in.data() + std::size_t{1} * size.width * std::clamp(y + tap, 0, size.height - 1);
      for (int x = 0; x < size.width; ++x) sum[x] += weight * from[x];
    }
  }
}

/// A separable filter: `scale` * (columns filtered by `vertical` after rows by `horizontal`).
struct SeparableFilter {
  Kernel horizontal;
  Kernel vertical;
  float scale = 1.0f;
};

/// Taps of `f` at -radius..radius, scaled so that the positive ones sum to 1 and the negative ones to -1.
template <typename F>
[[nodiscard]] Kernel normalized_kernel(int radius, F f) {
  double positive = 0.0;
  double negative = 0.0;
  for (int x = -radius; x <= radius; ++x) (f(x) > 0.0 ? positive : negative) += f(x);
  Kernel kernel;
  for (int x = -radius; x <= radius; ++x) {
    const double value = f(x);
    kernel.taps.push_back(static_cast<float>(value > 0.0 ? value / positive : value < 0.0 ? -value / negative : 0.0));
  }
  return kernel;
}

/// Contrast sensitivity of one opponent channel as a sum of Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b), x in
/// degrees [Andersson20, spatial filtering, and its table of a and b].
struct Sensitivity {
  double a = 0.0;
  double b = 0.0;
};
constexpr std::array<Sensitivity, 1> kAchromatic = {{{1.0, 0.0047}}};
constexpr std::array<Sensitivity, 1> kRedGreen = {{{1.0, 0.0053}}};
constexpr std::array<Sensitivity, 2> kBlueYellow = {{{34.1, 0.04}, {13.5, 0.025}}};
constexpr double kWidestSensitivity = 0.04;  // largest b

/// The two-dimensional filter as a sum of separable ones; all together sum to 1.
[[nodiscard]] std::vector<SeparableFilter> sensitivity_filters(std::span<const Sensitivity> terms, double ppd) {
  using std::numbers::pi;
  const int radius = static_cast<int>(std::ceil(3.0 * std::sqrt(kWidestSensitivity / (2.0 * pi * pi)) * ppd));
  std::vector<SeparableFilter> filters;
  std::vector<double> volumes;
  double total = 0.0;
  for (const auto& [a, b] : terms) {
    const auto gaussian = [b = b, ppd](int x) { return std::exp(-pi * pi * (x / ppd) * (x / ppd) / b); };
    double sum = 0.0;
    for (int x = -radius; x <= radius; ++x) sum += gaussian(x);
    const Kernel kernel = normalized_kernel(radius, gaussian);
    filters.push_back({kernel, kernel, 1.0f});
    volumes.push_back(a * std::sqrt(pi / b) * sum * sum);
    total += volumes.back();
  }
  for (std::size_t i = 0; i < filters.size(); ++i) filters[i].scale = static_cast<float>(volumes[i] / total);
  return filters;
}

/// Everything that depends on the viewing condition alone.
struct Filters {
  std::array<std::vector<SeparableFilter>, 3> opponent;
  Kernel smooth, edge, point;

  explicit Filters(double ppd)
      : opponent{sensitivity_filters(kAchromatic, ppd), sensitivity_filters(kRedGreen, ppd),
                 sensitivity_filters(kBlueYellow, ppd)} {
    const double sigma = 0.5 * kFeatureWidth * ppd;  // [Andersson20, feature pipeline]
    const int radius = static_cast<int>(std::ceil(3.0 * sigma));
    const auto gaussian = [sigma](int x) { return std::exp(-0.5 * (x / sigma) * (x / sigma)); };
    smooth = normalized_kernel(radius, gaussian);
    edge = normalized_kernel(radius, [&](int x) { return -x * gaussian(x); });
    point = normalized_kernel(radius, [&](int x) { return ((x / sigma) * (x / sigma) - 1.0) * gaussian(x); });
  }
};

// ---------------------------------------------------------------------------------------------- the metric

/// What a viewer perceives of one image: filtered colour, and the strength of edges and points.
struct Percept {
  std::vector<Vec3f> lab;
  Plane edge, point;
};

[[nodiscard]] Plane gradient_length(const Plane& luminance, const Kernel& derivative, const Kernel& smooth, Size size) {
  Plane rows(size.pixels());
  Plane horizontal(size.pixels(), 0.0f);
  Plane vertical(size.pixels(), 0.0f);
  filter_rows(luminance, derivative, size, rows);
  add_filtered_columns(rows, smooth, 1.0f, size, horizontal);
  filter_rows(luminance, smooth, size, rows);
  add_filtered_columns(rows, derivative, 1.0f, size, vertical);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i] = std::sqrt(horizontal[i] * horizontal[i] + vertical[i] * vertical[i]);
  }
  return rows;
}

/// `image` has channels in [0, 1].
[[nodiscard]] Percept perceive(std::span<const Rgb> image, const Filters& filters, Size size) {
  // Opponent space YCxCz, linear in XYZ, without the constant factors and offsets, on which no filter here
  // depends.
  std::array<Plane, 3> opponent;
  for (Plane& plane : opponent) plane.resize(size.pixels());
  for (std::size_t i = 0; i < image.size(); ++i) {
    const Vec3f xyz = rgb_to_xyz(image[i]);
    opponent[0][i] = xyz.y;
    opponent[1][i] = xyz.x / kWhite[0] - xyz.y;
    opponent[2][i] = xyz.y - xyz.z / kWhite[2];
  }
  Percept percept;
  percept.edge = gradient_length(opponent[0], filters.edge, filters.smooth, size);
  percept.point = gradient_length(opponent[0], filters.point, filters.smooth, size);
  Plane rows(size.pixels());
  for (std::size_t channel = 0; channel < 3; ++channel) {
    Plane filtered(size.pixels(), 0.0f);
    for (const SeparableFilter& filter : filters.opponent[channel]) {
      filter_rows(opponent[channel], filter.horizontal, size, rows);
      add_filtered_columns(rows, filter.vertical, filter.scale, size, filtered);
    }
    opponent[channel] = std::move(filtered);
  }
  percept.lab.resize(size.pixels());
  for (std::size_t i = 0; i < percept.lab.size(); ++i) {
    const float y = opponent[0][i];
    const Rgb c = xyz_to_rgb({(opponent[1][i] + y) * kWhite[0], y, (y - opponent[2][i]) * kWhite[2]});
    percept.lab[i] =
        hunt_adjusted_lab({std::clamp(c.x, 0.0f, 1.0f), std::clamp(c.y, 0.0f, 1.0f), std::clamp(c.z, 0.0f, 1.0f)});
  }
  return percept;
}

/// Colour difference mapped to [0, 1]: steep up to the knee, flat beyond [Andersson20, redistribution of
/// errors].
[[nodiscard]] float color_error(const Vec3f& a, const Vec3f& b, float largest) {
  const float difference = std::pow(hyab(a, b), kColorExponent);
  const float knee = kColorKnee * largest;
  if (difference < knee) return kColorKneeValue / knee * difference;
  return kColorKneeValue + (difference - knee) / (largest - knee) * (1.0f - kColorKneeValue);
}

[[nodiscard]] Plane flip_error(const Percept& a, const Percept& b) {
  const float largest = std::pow(hyab(hunt_adjusted_lab({0, 1, 0}), hunt_adjusted_lab({0, 0, 1})), kColorExponent);
  Plane error(a.lab.size());
  for (std::size_t i = 0; i < error.size(); ++i) {
    const float color = color_error(a.lab[i], b.lab[i], largest);
    const float change = std::max(std::abs(a.edge[i] - b.edge[i]), std::abs(a.point[i] - b.point[i]));
    const float feature = std::pow(change / std::numbers::sqrt2_v<float>, kFeatureExponent);
    error[i] = std::clamp(std::pow(color, 1.0f - feature), 0.0f, 1.0f);  // [Andersson20, final difference]
  }
  return error;
}

[[nodiscard]] double mean_of(const Plane& plane) {
  double sum = 0.0;
  for (const float value : plane) sum += value;
  return plane.empty() ? 0.0 : sum / static_cast<double>(plane.size());
}

// ---------------------------------------------------------------------------------------------- exposures

/// Narkowicz's fit of the ACES curve without its pre-exposure, (ax^2 + bx) / (cx^2 + dx + e) [Andersson21].
constexpr float kAcesA = 0.6f * 0.6f * 2.51f, kAcesB = 0.6f * 0.03f;
constexpr float kAcesC = 0.6f * 0.6f * 2.43f, kAcesD = 0.6f * 0.59f, kAcesE = 0.14f;
constexpr float kAlmostWhite = 0.85f;  // t of [Andersson21]: what the ends of the exposure range map to

[[nodiscard]] float aces(float x) {
  x = std::clamp(x, 0.0f, 1e4f);  // the curve is beyond 1 there; its squares must not overflow
  return std::min((kAcesA * x * x + kAcesB * x) / (kAcesC * x * x + kAcesD * x + kAcesE), 1.0f);
}

/// The exposed value that the curve maps to kAlmostWhite: the larger root of the quadratic equation.
[[nodiscard]] float almost_white_input() {
  const float a = kAcesA - kAlmostWhite * kAcesC;
  const float b = kAcesB - kAlmostWhite * kAcesD;
  const float c = -kAlmostWhite * kAcesE;
  const float half = -0.5f * b / a;
  return half + std::sqrt(half * half - c / a);
}

[[nodiscard]] std::vector<Rgb> tone_mapped(std::span<const Rgb> image, float stops) {
  const float scale = std::exp2(stops);
  std::vector<Rgb> mapped;
  mapped.reserve(image.size());
  for (const Rgb& c : image) mapped.emplace_back(aces(c.x * scale), aces(c.y * scale), aces(c.z * scale));
  return mapped;
}

void set_exposures(std::span<const Rgb> reference, HdrFlipMap& map) {
  std::vector<float> luminances;
  luminances.reserve(reference.size());
  for (const Rgb& c : reference) {
    luminances.push_back(luminance({std::max(c.x, 0.0f), std::max(c.y, 0.0f), std::max(c.z, 0.0f)}));
  }
  std::ranges::sort(luminances);
  const float median = luminances[luminances.size() / 2];  // of two in the middle the larger, as the authors do
  // A reference that is mostly black would need no end of stops; the authors' implementation has the same
  // floor.
  constexpr float kFloor = std::numeric_limits<float>::epsilon();
  const float white = almost_white_input();
  map.start_exposure = std::log2(white / std::max(luminances.back(), kFloor));
  map.stop_exposure = std::log2(white / std::max(median, kFloor));
  map.exposures = std::max(2, static_cast<int>(std::ceil(map.stop_exposure - map.start_exposure)));
}

}  // namespace

FlipMap ldr_flip(std::span<const Rgb> image, std::span<const Rgb> reference, int width, int height,
                 float pixels_per_degree) {
  const Filters filters(pixels_per_degree);
  const auto clamped = [](std::span<const Rgb> in) {
    std::vector<Rgb> out(in.begin(), in.end());
    for (Rgb& c : out) {
      c = {std::clamp(c.x, 0.0f, 1.0f), std::clamp(c.y, 0.0f, 1.0f), std::clamp(c.z, 0.0f, 1.0f)};
    }
    return out;
  };
  const Size size{width, height};
  FlipMap map;
  map.error = flip_error(perceive(clamped(image), filters, size), perceive(clamped(reference), filters, size));
  map.mean = mean_of(map.error);
  return map;
}

HdrFlipMap hdr_flip(std::span<const Rgb> image, std::span<const Rgb> reference, int width, int height,
                    float pixels_per_degree) {
  HdrFlipMap map;
  map.error.assign(image.size(), 0.0f);
  if (image.empty()) return map;
  set_exposures(reference, map);
  const Filters filters(pixels_per_degree);
  const Size size{width, height};
  const float step = (map.stop_exposure - map.start_exposure) / static_cast<float>(map.exposures - 1);
  for (int i = 0; i < map.exposures; ++i) {
    if (i > 0 && step == 0.0f) break;  // the same exposure again
    const float stops = map.start_exposure + static_cast<float>(i) * step;
    const Plane error = flip_error(perceive(tone_mapped(image, stops), filters, size),
                                   perceive(tone_mapped(reference, stops), filters, size));
    for (std::size_t p = 0; p < error.size(); ++p) map.error[p] = std::max(map.error[p], error[p]);
  }
  map.mean = mean_of(map.error);
  return map;
}

std::vector<std::uint8_t> magma_colors(std::span<const float> error) {
  // Matt Zucker's polynomials (CC0, shadertoy.com/view/WlfXRN) fitted to matplotlib's magma (CC0).
  static constexpr std::array<std::array<float, 7>, 3> kMagma = {{
      {-0.002136485f, 0.251660541f, 8.353717279f, -27.668733086f, 52.176139812f, -50.768525365f, 18.655705066f},
      {-0.000749655f, 0.677523244f, -3.577719515f, 14.264730781f, -27.943606072f, 29.046582821f, -11.489773520f},
      {-0.005386128f, 2.494026599f, 0.314467903f, -13.649213188f, 12.944169442f, 4.234152994f, -5.601961509f},
  }};
  std::vector<std::uint8_t> colors;
  colors.reserve(3 * error.size());
  for (const float value : error) {
    const float t = std::isnan(value) ? 1.0f : std::clamp(value, 0.0f, 1.0f);
    for (const auto& polynomial : kMagma) {
      float sum = 0.0f;
      for (std::size_t i = polynomial.size(); i-- > 0;) sum = sum * t + polynomial[i];
      colors.push_back(static_cast<std::uint8_t>(std::lround(255.0f * std::clamp(sum, 0.0f, 1.0f))));
    }
  }
  return colors;
}

}  // namespace pf
