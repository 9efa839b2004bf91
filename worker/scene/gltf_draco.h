#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "worker/scene/gltf_report.h"

namespace draco {
class Mesh;
}

namespace pf::gltf {

/// One primitive decompressed by libdraco [KHR_draco_mesh_compression]. libdraco stays in one translation
/// unit.
class DracoMesh {
 public:
  /// `points` and `indices`: the counts that the glTF accessors declare; a stream with others is refused.
  [[nodiscard]] static Result<DracoMesh> decode(std::span<const std::uint8_t> bytes, std::uint64_t points,
                                                std::uint64_t indices, const Report& report,
                                                const std::string& pointer);
  DracoMesh(DracoMesh&&) noexcept;
  DracoMesh& operator=(DracoMesh&&) noexcept;
  ~DracoMesh();

  /// Three indices for each triangle.
  [[nodiscard]] std::vector<std::uint32_t> indices() const;
  /// Writes `width` floats for each point: the attribute's components times `scale`, `fill` where it has
  /// fewer. An error unless the attribute has `components` of them.
  [[nodiscard]] Result<void> read(int unique_id, std::size_t components, float scale, float fill, float* out,
                                  std::size_t width, const Report& report, const std::string& pointer) const;

 private:
  explicit DracoMesh(std::unique_ptr<draco::Mesh> mesh);
  std::unique_ptr<draco::Mesh> mesh_;
};

}  // namespace pf::gltf
