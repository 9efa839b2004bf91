#pragma once

#include <array>

namespace pf {

/// Directional albedo of a lobe over (cosine, roughness), bilinear in (sqrt(cosine), roughness), with its
/// hemispherical mean. The mean is that of the interpolated function, not of the true one, so that a layering
/// which divides by it neither gains nor loses energy by the table's error.
class AlbedoTable {
 public:
  static constexpr int kCosines = 32;
  static constexpr int kRoughnesses = 21;
  /// The grid's nodes.
  [[nodiscard]] static float cosine(int column);
  [[nodiscard]] static float roughness(int row);

  /// Sets one node; the mean needs finish().
  void set(int column, int row, float value) { rows_[row][column] = value; }
  void finish();

  /// Albedo seen from `cosine` >= 0; roughness in [0,1].
  [[nodiscard]] float at(float cosine, float roughness) const;
  /// Integral of 2 cosine at(cosine) over cosine in [0,1].
  [[nodiscard]] float mean(float roughness) const;

 private:
  std::array<std::array<float, kCosines>, kRoughnesses> rows_{};
  std::array<float, kRoughnesses> mean_{};
};

/// Directional albedo of a single-scattering GGX lobe with Schlick's Fresnel: E = F0 at_f0 + F90 at_f90.
/// Computed once (about 10 ms) when the first layered material asks; constant afterwards.
struct GgxAlbedo {
  AlbedoTable f0, f90;
  [[nodiscard]] static const GgxAlbedo& get();
};

/// Directional albedo of the sheen lobe (charlie.h) of white colour; roughness is glTF's sheenRoughness. May
/// exceed 1 at the horizon for narrow lobes.
[[nodiscard]] const AlbedoTable& sheen_albedo();

}  // namespace pf
