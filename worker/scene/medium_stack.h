#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "worker/scene/scene.h"

namespace pf {

/// The refracting volumes that a path is inside of, outermost first. Volumes may overlap, as a liquid and its glass do
/// when modelled with a small overlap: inside, the last one entered counts; when one is left, the others remain.
class MediumStack {
 public:
  MediumStack() = default;
  explicit MediumStack(std::span<const int> materials) {
    for (const int m : materials) push(m);
  }

  /// Index of refraction on the front side of `material` when its surface is met from the front (entering) or from the
  /// back (leaving).
  [[nodiscard]] float eta_outside(const Scene& scene, int material, bool entering) const {
    for (int i = size_ - 1; i >= 0; --i) {
      if (entering || materials_[i] != material) return scene.medium(materials_[i])->ior;
    }
    return 1.0f;
  }
  /// After a refraction through the surface of `material`.
  void cross(int material, bool entering) {
    if (entering) {
      push(material);
    } else {
      remove(material);
    }
  }
  /// Part of the light that is left after `distance` metres [Beer-Lambert]. Between the two surface points: a ray's own
  /// length is short by the offset with which it left its surface.
  [[nodiscard]] Rgb transmittance(const Scene& scene, float distance) const {
    if (size_ == 0) return {1.0f, 1.0f, 1.0f};
    const Rgb& sigma = scene.medium(materials_[size_ - 1])->sigma_a;
    return is_zero(sigma) ? Rgb{1.0f, 1.0f, 1.0f} : exp(sigma * -distance);
  }
  [[nodiscard]] bool empty() const { return size_ == 0; }

 private:
  /// Deeper nesting than any real vessel; what is entered beyond it is ignored, and leaving it finds nothing to remove.
  static constexpr int kCapacity = 6;

  void push(int material) {
    if (size_ < kCapacity) materials_[size_++] = material;
  }
  void remove(int material) {
    for (int i = size_ - 1; i >= 0; --i) {
      if (materials_[i] != material) continue;
      std::copy(materials_.begin() + i + 1, materials_.begin() + size_, materials_.begin() + i);
      --size_;
      return;
    }
  }

  std::array<int, kCapacity> materials_{};
  int size_ = 0;
};

}  // namespace pf
