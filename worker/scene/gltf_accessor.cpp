#include "worker/scene/gltf_accessor.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

/// Elements that may be made of each byte of a file. The densest file at hand, 98 spheres that share
/// accessors, needs 18; instancing by shared accessors may need more.
constexpr std::uint64_t kElementsPerByte = 256;
/// What any file may use, however small.
constexpr std::uint64_t kMinBudget = std::uint64_t{1} << 24;

std::string_view type_name(int type) {
  switch (type) {
    case TINYGLTF_TYPE_SCALAR:
      return "SCALAR";
    case TINYGLTF_TYPE_VEC2:
      return "VEC2";
    case TINYGLTF_TYPE_VEC3:
      return "VEC3";
    case TINYGLTF_TYPE_VEC4:
      return "VEC4";
    case TINYGLTF_TYPE_MAT2:
      return "MAT2";
    case TINYGLTF_TYPE_MAT3:
      return "MAT3";
    default:
      return "MAT4";
  }
}

/// Byte offset of component `c` in an element.
std::size_t component_offset(std::string_view type, std::size_t component_size, std::size_t c) {
  if (!type.starts_with("MAT")) return c * component_size;
  const std::size_t rows = type == "MAT2" ? 2 : type == "MAT3" ? 3 : 4;
  const std::size_t column_bytes = (rows * component_size + 3) / 4 * 4;
  return c / rows * column_bytes + c % rows * component_size;
}

}  // namespace

struct AccessorReader::Source {
  const std::uint8_t* data = nullptr;
  std::size_t stride = 0;
  std::size_t count = 0;
};

AccessorReader::AccessorReader(const Model& model, Report& report)
    : model_(model), report_(report), budget_(std::max(kMinBudget, kElementsPerByte * model.bytes)) {}

std::size_t AccessorReader::components(int index) const { return component_count(type_name(accessor(index).type)); }

bool AccessorReader::has_data(int index) const {
  const tinygltf::Accessor& a = accessor(index);
  const auto filled = [&](int view) {
    const int buffer = model_.gltf.bufferViews[static_cast<std::size_t>(view)].buffer;
    return !model_.gltf.buffers[static_cast<std::size_t>(buffer)].data.empty();
  };
  if (a.bufferView >= 0 && !filled(a.bufferView)) return false;
  return !a.sparse.isSparse || (filled(a.sparse.indices.bufferView) && filled(a.sparse.values.bufferView));
}

Result<void> AccessorReader::spend(std::uint64_t elements, const std::string& pointer) {
  if (elements > budget_)
    return report_.fail(pointer, "the file describes far more data than it holds; is it damaged?");
  budget_ -= elements;
  return {};
}

Result<AccessorReader::Source> AccessorReader::source(const tinygltf::Accessor& a, int view_index, std::size_t offset,
                                                      std::size_t count, bool strided,
                                                      const std::string& pointer) const {
  const auto& view = model_.gltf.bufferViews[static_cast<std::size_t>(view_index)];
  const auto& buffer = model_.gltf.buffers[static_cast<std::size_t>(view.buffer)];
  const std::size_t element = element_bytes(static_cast<std::uint64_t>(a.componentType), type_name(a.type));
  const std::size_t stride = strided && view.byteStride > 0 ? view.byteStride : element;
  const std::size_t begin = view.byteOffset + offset;
  const std::size_t last = last_element_bytes(static_cast<std::uint64_t>(a.componentType), type_name(a.type));
  if (begin + stride * (count - 1) + last > buffer.data.size()) {
    return report_.fail(pointer, fmt::format("reads from buffer {}, which has no such data", view.buffer));
  }
  return Source{buffer.data.data() + begin, stride, count};
}

namespace {

template <typename In, typename Out>
Out convert(In value, bool normalize) {
  if constexpr (std::is_integral_v<In> && sizeof(In) < 4 && std::is_floating_point_v<Out>) {
    // [glTF 2.0, 3.11 "Accessor Data Types", normalized integers]
    constexpr Out kScale = Out{1} / static_cast<Out>(std::numeric_limits<In>::max());
    if (normalize) return std::max(static_cast<Out>(value) * kScale, Out{-1});
  }
  return static_cast<Out>(value);
}

template <typename In, typename Out, typename To>
void copy(const std::uint8_t* data, std::size_t stride, std::size_t count, std::string_view type, bool normalize,
          Out* out, std::size_t width, To to) {
  const std::size_t n = std::min(width, component_count(type));
  std::size_t offsets[16];
  for (std::size_t c = 0; c < n; ++c) offsets[c] = component_offset(type, sizeof(In), c);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t c = 0; c < n; ++c) {
      In value;
      std::memcpy(&value, data + i * stride + offsets[c], sizeof value);
      out[to(i) * width + c] = convert<In, Out>(value, normalize);
    }
  }
}

template <typename Out, typename To>
void copy_any(int component_type, const std::uint8_t* data, std::size_t stride, std::size_t count,
              std::string_view type, bool normalize, Out* out, std::size_t width, To to) {
  switch (component_type) {
    case 5120:
      return copy<std::int8_t>(data, stride, count, type, normalize, out, width, to);
    case 5121:
      return copy<std::uint8_t>(data, stride, count, type, normalize, out, width, to);
    case 5122:
      return copy<std::int16_t>(data, stride, count, type, normalize, out, width, to);
    case 5123:
      return copy<std::uint16_t>(data, stride, count, type, normalize, out, width, to);
    case 5125:
      return copy<std::uint32_t>(data, stride, count, type, normalize, out, width, to);
    default:
      break;
  }
  if constexpr (std::is_floating_point_v<Out>) copy<float>(data, stride, count, type, normalize, out, width, to);
}

}  // namespace

template <typename Out>
Result<void> AccessorReader::read(int index, bool normalize, Out* out, std::size_t width, const std::string& pointer) {
  const tinygltf::Accessor& a = accessor(index);
  const std::string_view type = type_name(a.type);
  if (a.bufferView >= 0) {
    const auto s = source(a, a.bufferView, a.byteOffset, a.count, true, pointer);
    if (!s) return tl::unexpected(s.error());
    copy_any(a.componentType, s->data, s->stride, s->count, type, normalize, out, width,
             [](std::size_t i) { return i; });
  }
  if (!a.sparse.isSparse) return {};
  const auto count = static_cast<std::size_t>(a.sparse.count);
  tinygltf::Accessor scalar;
  scalar.type = TINYGLTF_TYPE_SCALAR;
  scalar.componentType = a.sparse.indices.componentType;
  const auto where = source(scalar, a.sparse.indices.bufferView, static_cast<std::size_t>(a.sparse.indices.byteOffset),
                            count, false, pointer);
  const auto what = source(a, a.sparse.values.bufferView, static_cast<std::size_t>(a.sparse.values.byteOffset), count,
                           false, pointer);
  if (!where) return tl::unexpected(where.error());
  if (!what) return tl::unexpected(what.error());
  std::vector<std::uint32_t> targets(count);
  copy_any(scalar.componentType, where->data, where->stride, count, "SCALAR", false, targets.data(), 1,
           [](std::size_t i) { return i; });
  for (std::size_t i = 0; i < count; ++i) {
    if (targets[i] >= a.count) {
      return report_.fail(
          pointer, fmt::format("sparse index {} of accessor {} is not below its count {}", targets[i], index, a.count));
    }
    if (i > 0 && targets[i] <= targets[i - 1]) {
      report_.warn(pointer, fmt::format("sparse indices of accessor {} do not increase", index));
    }
  }
  copy_any(a.componentType, what->data, what->stride, count, type, normalize, out, width,
           [&](std::size_t i) { return targets[i]; });
  return {};
}

Result<void> AccessorReader::read_floats(int index, float* out, std::size_t width, float fill,
                                         const std::string& pointer) {
  const tinygltf::Accessor& a = accessor(index);
  const std::size_t n = std::min(width, components(index));
  for (std::size_t i = 0; i < a.count; ++i) {
    for (std::size_t c = 0; c < width; ++c) out[i * width + c] = c < n ? 0.0f : fill;
  }
  if (auto done = read(index, a.normalized, out, width, pointer); !done) return done;
  for (std::size_t i = 0; i < a.count * width; ++i) {
    if (!std::isfinite(out[i])) {
      return report_.fail(pointer, fmt::format("value {} of accessor {} is not finite", i / width, index));
    }
  }
  return {};
}

Result<std::vector<std::uint32_t>> AccessorReader::integers(int index, const std::string& pointer) {
  if (auto granted = spend(index, pointer); !granted) return tl::unexpected(granted.error());
  const std::size_t width = components(index);
  std::vector<std::uint32_t> out(count(index) * width);
  if (auto done = read(index, false, out.data(), width, pointer); !done) return tl::unexpected(done.error());
  return out;
}

Result<std::vector<double>> AccessorReader::raw(int index, const std::string& pointer) {
  const std::size_t width = components(index);
  std::vector<double> out(count(index) * width);
  if (auto done = read(index, false, out.data(), width, pointer); !done) return tl::unexpected(done.error());
  return out;
}

}  // namespace pf::gltf
