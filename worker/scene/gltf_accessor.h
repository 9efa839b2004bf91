#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"
#include "worker/scene/gltf_model.h"

namespace pf::gltf {

/// Reads the accessors of a checked document: any component type, byte strides, matrices, sparse values,
/// accessors without a buffer view (zeros) [glTF 2.0, 3.6.2].
class AccessorReader {
 public:
  AccessorReader(const Model& model, Report& report);

  /// Elements as a vector type of floats. Normalized integers become [0, 1] or [-1, 1], others their value. A
  /// missing fourth component becomes `fill`. NaN and infinity are errors at `pointer`.
  template <typename V>
  [[nodiscard]] Result<std::vector<V>> vectors(int accessor, const std::string& pointer, float fill = 0.0f) {
    static_assert(std::is_standard_layout_v<V> && sizeof(V) % sizeof(float) == 0);
    constexpr std::size_t kComponents = sizeof(V) / sizeof(float);
    std::vector<V> out;
    if (auto granted = spend(accessor, pointer); !granted) return tl::unexpected(granted.error());
    out.resize(count(accessor));
    float* floats = reinterpret_cast<float*>(out.data());
    if (auto read = read_floats(accessor, floats, kComponents, fill, pointer); !read)
      return tl::unexpected(read.error());
    return out;
  }
  /// Components one after the other, as unsigned integers: indices and joints.
  [[nodiscard]] Result<std::vector<std::uint32_t>> integers(int accessor, const std::string& pointer);
  /// Components one after the other, not normalised, NaN and infinity included: for checks. Draws on no
  /// budget.
  [[nodiscard]] Result<std::vector<double>> raw(int accessor, const std::string& pointer);

  [[nodiscard]] const tinygltf::Accessor& accessor(int index) const {
    return model_.gltf.accessors[static_cast<std::size_t>(index)];
  }
  /// False for what reads from a buffer without bytes: a placeholder, to be filled by someone else.
  [[nodiscard]] bool has_data(int index) const;
  [[nodiscard]] std::size_t count(int index) const { return accessor(index).count; }
  /// Components of one element: 3 for VEC3, 16 for MAT4.
  [[nodiscard]] std::size_t components(int index) const;
  /// Takes `elements` from what may be made of this file: many objects may share one accessor, and accessors
  /// without data cost nothing in the file. An error when the budget is used up.
  [[nodiscard]] Result<void> spend(std::uint64_t elements, const std::string& pointer);

 private:
  struct Source;  // where the bytes of one accessor lie
  [[nodiscard]] Result<void> spend(int accessor, const std::string& pointer) {
    return spend(std::uint64_t{count(accessor)}, pointer);
  }
  [[nodiscard]] Result<Source> source(const tinygltf::Accessor& a, int view, std::size_t offset, std::size_t count,
                                      bool strided, const std::string& pointer) const;
  [[nodiscard]] Result<void> read_floats(int accessor, float* out, std::size_t width, float fill,
                                         const std::string& pointer);
  template <typename Out>
  [[nodiscard]] Result<void> read(int accessor, bool normalize, Out* out, std::size_t width,
                                  const std::string& pointer);

  const Model& model_;
  Report& report_;
  std::uint64_t budget_;
};

}  // namespace pf::gltf
