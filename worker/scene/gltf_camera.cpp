#include "worker/scene/gltf_camera.h"

#include <cmath>
#include <utility>
#include <vector>

namespace pf::gltf {
namespace {

Matrix44f rigid(const Vec3f& x, const Vec3f& y, const Vec3f& z, const Vec3f& origin) {
  return {x.x, x.y, x.z, 0, y.x, y.y, y.z, 0, z.x, z.y, z.z, 0, origin.x, origin.y, origin.z, 1};
}

std::optional<Vec3f> unit(const Vec3f& v) {
  const float l = length(v);
  if (!(l > 0.0f) || !std::isfinite(l)) return std::nullopt;
  return v * (1.0f / l);
}

}  // namespace

std::optional<Camera> read_camera(const tinygltf::Camera& in, std::string name, const Matrix44f& m,
                                  const std::string& pointer, Report& report) {
  // z and y as they stand, x follows: a mirrored node must not mirror the image.
  const auto z = unit(Vec3f(m[2][0], m[2][1], m[2][2]));
  const Vec3f up(m[1][0], m[1][1], m[1][2]);
  const auto y = z ? unit(up - *z * dot(up, *z)) : std::nullopt;
  if (!y) {
    report.warn(pointer, "camera is left out: its transform has no direction");
    return std::nullopt;
  }
  Camera out;
  out.name = std::move(name);
  out.camera_to_world = rigid(cross(*y, *z), *y, *z, Vec3f(m[3][0], m[3][1], m[3][2]));
  out.orthographic = in.type == "orthographic";
  if (out.orthographic) {
    out.xmag = std::abs(static_cast<float>(in.orthographic.xmag));
    out.ymag = std::abs(static_cast<float>(in.orthographic.ymag));
    out.aspect_ratio = out.xmag / out.ymag;
  } else {
    out.yfov = static_cast<float>(in.perspective.yfov);
    out.aspect_ratio = static_cast<float>(in.perspective.aspectRatio);
  }
  return out;
}

Camera framed_camera(const Box3f& bounds) {
  const bool empty = bounds.isEmpty();
  const Vec3f center = empty ? Vec3f(0.0f, 0.0f, 0.0f) : (bounds.min + bounds.max) * 0.5f;
  const float diagonal = empty ? 2.0f : length(bounds.max - bounds.min);
  const float radius = std::isfinite(diagonal) && diagonal > 0.0f ? 0.5f * diagonal : 1.0f;
  Camera out;
  out.name = "framed";
  out.yfov = 50.0f * kPi / 180.0f;
  out.aspect_ratio = 1.0f;  // a square around the scene's sphere fits any image
  const Vec3f z = normalize(Vec3f(0.0f, 0.25f, 1.0f));
  const Vec3f x(1.0f, 0.0f, 0.0f);
  const float distance = 1.02f * radius / std::sin(0.5f * out.yfov);
  out.camera_to_world = rigid(x, cross(z, x), z, center + z * distance);
  out.focus_distance = distance;
  return out;
}

Box3f bounds_of(const SceneDescription& scene) {
  std::vector<Box3f> boxes(scene.meshes.size());
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    for (const auto& t : scene.meshes[i].triangles) {
      for (const std::uint32_t v : t) boxes[i].extendBy(scene.meshes[i].positions[v]);
    }
  }
  Box3f out;
  for (const MeshInstance& instance : scene.instances) {
    const Box3f& box = boxes[static_cast<std::size_t>(instance.mesh)];
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3f p((corner & 1) != 0 ? box.max.x : box.min.x, (corner & 2) != 0 ? box.max.y : box.min.y,
                    (corner & 4) != 0 ? box.max.z : box.min.z);
      out.extendBy(p * instance.object_to_world);
    }
  }
  return out;
}

}  // namespace pf::gltf
