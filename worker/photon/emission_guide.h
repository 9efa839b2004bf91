#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace pf {

/// Where on the lamps, and into which directions, photon paths start that matter: a density over the five numbers in
/// [0, 1) that Lights::emit() takes (which lamp; where on it, two; which way, two). Constant in the cells of a binary
/// tree that halves one number at a time, learned from examples.
///
/// Guiding in the space of random numbers: Guo, Bauszat, Bikker and Eisemann 2018, "Primary Sample Space Path Guiding".
/// Photons guided by what the eye sees: Peter and Pietrek 1998, "Importance Driven Construction of Photon Maps"; Keller
/// and Wald 2000, "Efficient Importance Sampling Techniques for the Photon Map". The density follows the root of the
/// mean squared contribution, which gives the least variance [Vorba and Krivanek 2016, "Adjoint-Driven Russian Roulette
/// and Splitting in Light Transport Simulation"]; part of it stays uniform, so that no photon that was never seen
/// before weighs much: estimates stay unbiased whatever was learned.
class EmissionGuide {
 public:
  static constexpr std::size_t kNumbers = 5;
  using Numbers = std::array<float, kNumbers>;

  /// What became of one path.
  struct Example {
    Numbers u{};
    double weight = 1.0;  ///< 1 / density with which `u` was drawn
    double worth = 0.0;   ///< sum of squared contributions to the image, per unit of the path's weight
  };
  struct Drawn {
    Numbers u{};
    float weight = 1.0f;  ///< 1 / density
  };

  /// Uniform: draw() gives back what it gets.
  EmissionGuide() = default;
  /// Learns from examples that were drawn by densities whose weights they carry. Without any of worth: uniform.
  explicit EmissionGuide(std::vector<Example> examples);

  /// Five uniform numbers in [0, 1) in, five that follow the density out; monotone within a cell.
  [[nodiscard]] Drawn draw(const Numbers& uniform) const;
  [[nodiscard]] bool uniform() const { return nodes_.empty(); }
  [[nodiscard]] std::size_t cells() const { return cells_; }

  /// Part of all paths that start anywhere.
  static constexpr double kUniformShare = 0.2;

 private:
  struct Builder;
  struct Node {
    float lower = 0;          ///< probability of the lower half
    float weight = 0;         ///< of a leaf: 1 / density
    std::uint32_t child = 0;  ///< index of the lower half's node, the upper one's follows; 0: a leaf
    std::uint32_t axis = 0;
  };
  std::vector<Node> nodes_;
  std::size_t cells_ = 1;
};

}  // namespace pf
