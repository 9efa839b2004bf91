#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/math/offset.h"
#include "common/math/vec.h"
#include "worker/bsdf/bsdf.h"
#include "worker/bsdf/smooth.h"
#include "worker/scene/camera_rays.h"
#include "worker/scene/environment.h"
#include "worker/scene/lights.h"
#include "worker/scene/scene_description.h"
#include "worker/scene/texture_store.h"

namespace pf {

struct Ray {
  Vec3f origin;
  Vec3f direction;  ///< unit, except for shadow segments
  float t_max = kInfinity;
};

/// What a ray met, before textures: enough to shade, and to start again from.
struct SurfacePoint {
  Vec3f position;  ///< interpolated from the triangle's corners (more exact than origin + t * direction)
  Vec3f ng;        ///< unit geometric normal of the front face
  Vec3f ns;        ///< unit interpolated normal on ng's side; ng when the mesh has none
  float t = 0;     ///< distance along the ray
  std::uint32_t placement = 0;
  std::uint32_t primitive = 0;
  float b1 = 0, b2 = 0;  ///< barycentric coordinates of the second and third corner
  float extent = 0;      ///< largest absolute coordinate of the triangle's corners: bounds the error of `position`
  int material = 0;
};

struct RayLanes;
struct SurfaceLanes;

/// Light absorption inside a refracting volume.
struct Medium {
  float ior = 1.0f;
  Rgb sigma_a{0, 0, 0};  ///< 1/m [KHR_materials_volume: -ln(attenuationColor) / attenuationDistance]
};

/// A scene ready to be traced: immutable, shared by all threads. Opaque two-sided surfaces, alpha already decided by
/// Embree's filter (a mask by its cutoff; a blend by a hash of the ray, so that the same ray always sees the same).
class Scene {
 public:
  /// Builds acceleration structure, textures and lights. A scene without any light gets a uniform environment of
  /// radiance 1 and a warning. Errors: kInvalidInput (image that cannot be read), kInternal (Embree).
  [[nodiscard]] static Result<std::unique_ptr<const Scene>> build(SceneDescription description);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  [[nodiscard]] std::optional<SurfacePoint> intersect(const Ray& ray) const;
  /// The same for many rays at once: of rays[i] those of lanes[i]. The triangles of all are fetched from memory
  /// together.
  void intersect(std::span<const RayLanes> rays, std::span<const unsigned> lanes, std::span<SurfaceLanes> points) const;
  /// Whether the ray meets anything, by a closest-hit query without shading: what the bench holds tracing against.
  [[nodiscard]] bool meets(const Ray& ray) const;
  /// True when anything lies on the segment origin + t * direction, t in (0, t_max).
  [[nodiscard]] bool occluded(const Ray& ray) const;

  /// Material parameters at a point. `eta_outside`: index of refraction of the medium around the surface.
  [[nodiscard]] SurfaceParams evaluate(const SurfacePoint& point, float eta_outside) const;
  /// Radiance emitted at a point towards unit direction `wo` (zero behind a one-sided emitter).
  [[nodiscard]] Rgb emitted(const SurfacePoint& point, const Vec3f& wo) const;
  /// Radiance of emissive triangle `index` at barycentrics (b1, b2), front side, textures applied.
  [[nodiscard]] Rgb emitted_by_triangle(std::uint32_t index, const Vec2f& barycentric) const;
  /// Textured radiance of a point of a triangle relative to the mean that Lights works with; 1 when untextured.
  [[nodiscard]] Rgb emission_ratio(std::uint32_t index, const Vec2f& barycentric) const {
    return any_emission_varies_ ? find_emission_ratio(index, barycentric) : Rgb{1.0f, 1.0f, 1.0f};
  }
  [[nodiscard]] bool emission_varies() const { return any_emission_varies_; }  ///< whether any is not 1
  /// Refracting volumes around emissive triangle `index`, outermost first.
  [[nodiscard]] std::span<const int> media_of_emitter(std::uint32_t index) const;
  /// Index for Lights::pdf_w, or -1 where the surface does not emit.
  [[nodiscard]] std::int32_t emissive_triangle(const SurfacePoint& point) const;
  [[nodiscard]] int material_count() const { return static_cast<int>(traits_.size()); }
  /// Albedo of a material that is one untextured Lambert reflector wherever it is met (plain_lambert_albedo), or null.
  [[nodiscard]] const Rgb* plain_lambert(int material) const {
    return traits_[material].plain_lambert ? &traits_[material].lambert_albedo : nullptr;
  }
  /// A material that only mirrors and refracts sharply wherever it is met, or null.
  [[nodiscard]] const SmoothMaterial* smooth_material(int material) const {
    return traits_[material].smooth ? &*traits_[material].smooth : nullptr;
  }
  [[nodiscard]] bool emits(const SurfacePoint& point) const { return traits_[point.material].emissive; }
  /// Medium behind the front face of a material, or null for an opaque or thin-walled one.
  [[nodiscard]] const Medium* medium(int material) const {
    return traits_[material].refracts ? &traits_[material].medium : nullptr;
  }
  [[nodiscard]] bool any_medium() const { return any_medium_; }
  /// Refracting volumes that contain `position`, outermost first (for a camera or lamp under water).
  [[nodiscard]] std::vector<int> media_around(const Vec3f& position) const;

  [[nodiscard]] const EnvironmentMap& environment() const { return environment_; }
  [[nodiscard]] const Lights& lights() const { return *lights_; }
  [[nodiscard]] const Box3f& bounds() const { return bounds_; }
  [[nodiscard]] const std::vector<Camera>& cameras() const { return description_.cameras; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return description_.warnings; }
  [[nodiscard]] std::size_t triangle_count() const { return triangle_count_; }
  /// Calls f(corners in the world, material) for every triangle, in a fixed order.
  template <typename F>
  void for_each_triangle(const F& f) const {
    for (const Placement& placed : placements_) {
      for (const Triangle& triangle : triangles_[static_cast<std::size_t>(placed.mesh)].flat) {
        std::array<Vec3f, 3> corners = triangle.corners;
        for (Vec3f& corner : corners) corner = placed.instanced ? corner * placed.object_to_world : corner;
        f(corners, placed.material);
      }
    }
  }

 private:
  struct Embree;
  /// A mesh in the world: baked to world space when it is placed once, an Embree instance otherwise.
  struct Placement {
    int mesh = 0;
    int material = 0;
    bool instanced = false;
    bool mirrored = false;  ///< instance transform with negative determinant
    Matrix44f object_to_world;
    Matrix44f normal_to_world;         ///< inverse transpose
    std::int32_t first_emissive = -1;  ///< index of its first triangle in Lights
  };
  /// What is known of a material before any point of it is met.
  struct MaterialTraits {
    bool emissive = false, textured = false, refracts = false;
    bool emission_varies = false;  ///< over a triangle: textured, or by vertex colours
    bool plain_lambert = false;
    Rgb lambert_albedo{0, 0, 0};  ///< of a plain Lambert reflector
    std::optional<SmoothMaterial> smooth;
    Medium medium;
    SurfaceParams constant;  ///< parameters when nothing is textured
  };

  /// A triangle as placed in its mesh (in the world when the mesh is placed once), and what a hit asks of it.
  struct alignas(64) Triangle {
    std::array<Vec3f, 3> corners;
    Vec3f ng;      ///< unit
    float extent;  ///< largest absolute coordinate of the corners
  };
  /// A mesh's triangles side by side: a hit reads one cache line, and two more of normals, at known places, where
  /// indices and vertices would be a chain of misses (a tenth of photon tracing's time on 200k triangles).
  struct Triangles {
    std::vector<Triangle> flat;
    std::vector<std::array<Vec3f, 3>> normals;  ///< at the corners; empty: flat shading
  };
  /// What a hit asks of a placement.
  struct PlacedTriangles {
    const Triangle* flat;
    const std::array<Vec3f, 3>* normals;  ///< null: flat shading, or instanced
    int material;
    bool instanced;
  };

  Scene() = default;
  void bake_single_placements();
  [[nodiscard]] static Triangle make_triangle(const std::array<Vec3f, 3>& corners);
  void gather_triangles();
  Result<void> build_embree();
  void find_material_traits();
  void find_lights();
  [[nodiscard]] SurfacePoint surface_point(std::uint32_t placement, std::uint32_t primitive, float b1, float b2) const;
  /// The same without looking anything up.
  struct Hit {
    float t, b1, b2;
    std::uint32_t placement, primitive;
  };
  static inline SurfacePoint point_on(const Placement& placed, const Triangles& triangles, const Hit& hit);
  /// point_on() of the lanes that met something; placement, primitive, t, b1 and b2 are there already.
  void find_points(SurfaceLanes& points) const;
  void turn_normals(unsigned lanes, SurfaceLanes& points) const;
  [[nodiscard]] Rgb find_emission_ratio(std::uint32_t index, const Vec2f& barycentric) const;
  [[nodiscard]] Vec2f uv(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref) const;
  [[nodiscard]] Vec4f texel(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref) const;
  [[nodiscard]] Vec3f mapped_normal(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref,
                                    float scale) const;
  [[nodiscard]] Vec4f vertex_color(const Mesh& mesh, const SurfacePoint& point) const;
  void apply_textures(const SurfacePoint& point, SurfaceParams& params) const;
  [[nodiscard]] Rgb radiance_of(const SurfacePoint& point) const;
  [[nodiscard]] float alpha_at(const SurfacePoint& point) const;
  [[nodiscard]] bool passes_alpha(const SurfacePoint& point, const Vec3f& origin, const Vec3f& direction) const;

  SceneDescription description_;
  std::vector<Placement> placements_;
  std::vector<Triangles> triangles_;     ///< per mesh
  std::vector<PlacedTriangles> placed_;  ///< per placement
  std::vector<MaterialTraits> traits_;
  std::vector<std::vector<int>> media_of_emitters_;  ///< empty when the scene has no medium
  std::unique_ptr<TextureStore> textures_;
  EnvironmentMap environment_;
  std::unique_ptr<Lights> lights_;
  std::unique_ptr<Embree> embree_;
  Box3f bounds_;
  std::size_t triangle_count_ = 0;
  bool any_medium_ = false;
  bool any_emission_varies_ = false;
};

/// Where a ray that goes on from `point` towards `direction` starts: moved off the surface to that side.
[[nodiscard]] inline Vec3f offset_past(const SurfacePoint& point, const Vec3f& direction) {
  return offset_ray_origin(point.position, point.ng, direction, point.extent);
}

}  // namespace pf
