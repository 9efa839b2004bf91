#include "worker/scene/gltf_draco.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <utility>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wpedantic"
#include <draco/compression/decode.h>
#include <draco/mesh/mesh.h>
#pragma GCC diagnostic pop
#include <fmt/format.h>

namespace pf::gltf {

DracoMesh::DracoMesh(std::unique_ptr<draco::Mesh> mesh) : mesh_(std::move(mesh)) {}
DracoMesh::DracoMesh(DracoMesh&&) noexcept = default;
DracoMesh& DracoMesh::operator=(DracoMesh&&) noexcept = default;
DracoMesh::~DracoMesh() = default;

Result<DracoMesh> DracoMesh::decode(std::span<const std::uint8_t> bytes, std::uint64_t points, std::uint64_t indices,
                                    const Report& report, const std::string& pointer) {
  std::unique_ptr<draco::Mesh> mesh;
  try {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    draco::Decoder decoder;
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok()) {
      return report.fail(pointer,
                         fmt::format("Draco data do not decode: {}", in_quotes(decoded.status().error_msg_string())));
    }
    mesh = std::move(decoded).value();
  } catch (const std::exception& e) {
    return report.fail(pointer, fmt::format("Draco data do not decode: {}", e.what()));
  }
  const std::uint64_t corners = std::uint64_t{mesh->num_faces()} * 3;
  if (mesh->num_points() != points || corners != indices) {
    return report.fail(pointer, fmt::format("Draco data hold {} vertices and {} indices; the accessors say {} and {}",
                                            mesh->num_points(), corners, points, indices));
  }
  return DracoMesh(std::move(mesh));
}

std::vector<std::uint32_t> DracoMesh::indices() const {
  std::vector<std::uint32_t> out;
  out.reserve(std::size_t{mesh_->num_faces()} * 3);
  for (draco::FaceIndex f(0); f < mesh_->num_faces(); ++f) {
    for (const auto& point : mesh_->face(f)) out.push_back(point.value());
  }
  return out;
}

Result<void> DracoMesh::read(int unique_id, std::size_t components, float scale, float fill, float* out,
                             std::size_t width, const Report& report, const std::string& pointer) const {
  const draco::PointAttribute* a =
      unique_id < 0 ? nullptr : mesh_->GetAttributeByUniqueId(static_cast<std::uint32_t>(unique_id));
  if (a == nullptr || a->buffer() == nullptr) {
    return report.fail(pointer, fmt::format("Draco data have no attribute {}", unique_id));
  }
  const auto count = static_cast<std::size_t>(a->num_components());
  if (count != components || count > 4) {
    return report.fail(pointer, fmt::format("Draco attribute {} has {} components; the accessor says {}", unique_id,
                                            count, components));
  }
  if (static_cast<std::uint64_t>(a->byte_stride()) * a->size() > a->buffer()->data_size()) {
    return report.fail(pointer, fmt::format("Draco attribute {} is cut off", unique_id));
  }
  // libdraco normalises integers itself where its own flag says so.
  const float factor = a->normalized() ? 1.0f : scale;
  for (draco::PointIndex p(0); p < mesh_->num_points(); ++p) {
    const draco::AttributeValueIndex value = a->mapped_index(p);
    std::array<float, 4> v{};
    if (value.value() >= a->size() || !a->ConvertValue<float>(value, static_cast<std::int8_t>(count), v.data())) {
      return report.fail(pointer, fmt::format("Draco attribute {} has no value for vertex {}", unique_id, p.value()));
    }
    for (std::size_t c = 0; c < width; ++c) {
      const float x = c < count ? v[c] * factor : fill;
      if (!std::isfinite(x)) return report.fail(pointer, fmt::format("value {} is not finite", p.value()));
      out[p.value() * width + c] = x;
    }
  }
  return {};
}

}  // namespace pf::gltf
