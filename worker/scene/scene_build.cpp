#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "common/base/parallel.h"
#include "common/math/offset.h"
#include "common/math/owen_sobol.h"
#include "common/math/philox.h"
#include "common/math/sampling.h"
#include "worker/scene/embree_scene.h"
#include "worker/scene/scene.h"

namespace pf {
namespace {

/// Embree's widest instruction set is fixed, so that hits have the same bits on every machine that can run the job.
constexpr const char* kEmbreeConfig = "isa=avx2,set_affinity=0";

bool is_textured(const Material& m) {
  for (const TextureRef* ref :
       {&m.base_color_texture, &m.metallic_roughness_texture, &m.normal_texture, &m.specular_texture,
        &m.specular_color_texture, &m.transmission_texture, &m.clearcoat_texture, &m.clearcoat_roughness_texture,
        &m.clearcoat_normal_texture, &m.sheen_color_texture, &m.sheen_roughness_texture}) {
    if (ref->present()) return true;
  }
  return false;
}

Medium medium_of(const Material& m) {
  Medium medium;
  medium.ior = m.ior;
  if (std::isfinite(m.attenuation_distance)) {
    for (int c = 0; c < 3; ++c) {
      medium.sigma_a[c] = -std::log(std::max(m.attenuation_color[c], 1e-6f)) / m.attenuation_distance;
    }
  }
  return medium;
}

}  // namespace

Result<std::unique_ptr<const Scene>> Scene::build(SceneDescription description) {
  std::unique_ptr<Scene> scene(new Scene());
  scene->description_ = std::move(description);
  auto textures = TextureStore::open(scene->description_.textures);
  if (!textures) return tl::unexpected(textures.error());
  scene->textures_ = std::make_unique<TextureStore>(std::move(*textures));
  scene->bake_single_placements();
  scene->gather_triangles();
  scene->find_material_traits();
  if (auto built = scene->build_embree(); !built) return tl::unexpected(built.error());

  Environment& environment = scene->description_.environment;
  const auto emissive = [&](const Placement& p) {
    return scene->traits_[scene->description_.meshes[p.mesh].material].emissive;
  };
  const bool lit = environment.present() || !scene->description_.lights.empty() ||
                   std::any_of(scene->placements_.begin(), scene->placements_.end(), emissive);
  if (!lit) {
    environment.radiance = {1.0f, 1.0f, 1.0f};
    scene->description_.warnings.push_back(
        "scene: holds no light; lit by a uniform environment of radiance 1 (set scene.environment to choose another)");
  }
  auto map = EnvironmentMap::load(environment, scene->description_.warnings);
  if (!map) return tl::unexpected(map.error());
  scene->environment_ = std::move(*map);
  scene->find_lights();
  return std::unique_ptr<const Scene>(std::move(scene));
}

void Scene::bake_single_placements() {
  std::vector<int> uses(description_.meshes.size(), 0);
  for (const MeshInstance& instance : description_.instances) ++uses[instance.mesh];
  for (const MeshInstance& instance : description_.instances) {
    Placement placed;
    placed.mesh = instance.mesh;
    placed.material = description_.meshes[instance.mesh].material;
    placed.instanced = uses[instance.mesh] > 1;
    const Matrix44f& m = instance.object_to_world;
    const bool mirrors = m.determinant() < 0.0f;
    const Matrix44f normal_matrix = m.inverse().transposed();
    Mesh& mesh = description_.meshes[instance.mesh];
    triangle_count_ += mesh.triangles.size();
    if (placed.instanced) {
      placed.object_to_world = m;
      placed.normal_to_world = normal_matrix;
      placed.mirrored = mirrors;
    } else {
      for (Vec3f& p : mesh.positions) p = p * m;
      for (Vec3f& n : mesh.normals) {
        normal_matrix.multDirMatrix(n, n);
        if (length2(n) > 0.0f) n = normalize(n);
      }
      for (Vec4f& t : mesh.tangents) {
        Vec3f direction{t.x, t.y, t.z};
        m.multDirMatrix(direction, direction);
        t = {direction.x, direction.y, direction.z, mirrors ? -t.w : t.w};
      }
      if (mirrors) {
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
      }
    }
    placements_.push_back(placed);
  }
}

void Scene::gather_triangles() {
  triangles_.resize(description_.meshes.size());
  parallel_for(triangles_.size(), [&](std::size_t m) {
    const Mesh& mesh = description_.meshes[m];
    Triangles& gathered = triangles_[m];
    const auto corners = [](const std::vector<Vec3f>& values, const std::array<std::uint32_t, 3>& t) {
      return std::array<Vec3f, 3>{values[t[0]], values[t[1]], values[t[2]]};
    };
    gathered.flat.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) gathered.flat.push_back(make_triangle(corners(mesh.positions, t)));
    if (mesh.normals.empty()) return;
    gathered.normals.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) gathered.normals.push_back(corners(mesh.normals, t));
  });
  placed_.reserve(placements_.size());
  for (const Placement& placement : placements_) {
    const Triangles& of = triangles_[static_cast<std::size_t>(placement.mesh)];
    const bool normals = !of.normals.empty() && !placement.instanced;
    placed_.push_back({of.flat.data(), normals ? of.normals.data() : nullptr, placement.material, placement.instanced});
  }
}

Result<void> Scene::build_embree() {
  embree_ = std::make_unique<Embree>();
  embree_->device.reset(rtcNewDevice(kEmbreeConfig));
  if (!embree_->device) return fail(ErrorKind::kInternal, "Embree: no device; this program needs a CPU with AVX2");
  RTCDevice device = embree_->device.get();

  const auto make_triangles = [&](const Mesh& mesh) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // The last vertex is read as sixteen bytes: std::vector's storage may end there, so Embree gets its own copy.
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3f),
                                             mesh.positions.size());
    if (vertices != nullptr) std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<Vec3f*>(vertices));
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               sizeof(mesh.triangles[0]), mesh.triangles.size());
    if (description_.materials[mesh.material].alpha_mode != AlphaMode::kOpaque) {
      rtcSetGeometryUserData(geometry, this);
      rtcSetGeometryIntersectFilterFunction(geometry, Embree::alpha_filter);
      rtcSetGeometryOccludedFilterFunction(geometry, Embree::alpha_filter);
    }
    rtcCommitGeometry(geometry);
    return geometry;
  };

  embree_->top.reset(rtcNewScene(device));
  rtcSetSceneFlags(embree_->top.get(), RTC_SCENE_FLAG_ROBUST);
  std::map<int, RTCScene> scene_of_mesh;
  for (std::size_t i = 0; i < placements_.size(); ++i) {
    const Placement& placed = placements_[i];
    const Mesh& mesh = description_.meshes[placed.mesh];
    RTCGeometry geometry = nullptr;
    if (!placed.instanced) {
      geometry = make_triangles(mesh);
    } else {
      RTCScene& mesh_scene = scene_of_mesh[placed.mesh];
      if (mesh_scene == nullptr) {
        embree_->mesh_scenes.emplace_back(rtcNewScene(device));
        mesh_scene = embree_->mesh_scenes.back().get();
        rtcSetSceneFlags(mesh_scene, RTC_SCENE_FLAG_ROBUST);
        RTCGeometry triangles = make_triangles(mesh);
        rtcAttachGeometry(mesh_scene, triangles);
        rtcReleaseGeometry(triangles);
        rtcCommitScene(mesh_scene);
      }
      geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
      rtcSetGeometryInstancedScene(geometry, mesh_scene);
      rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, placed.object_to_world.getValue());
      rtcCommitGeometry(geometry);
    }
    rtcAttachGeometryByID(embree_->top.get(), geometry, static_cast<unsigned>(i));
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(embree_->top.get());
  for (Mesh& mesh : description_.meshes) {  // both live on in triangles_, and the positions in Embree
    mesh.positions = {};
    mesh.normals = {};
  }
  if (const RTCError error = rtcGetDeviceError(device); error != RTC_ERROR_NONE) {
    return fail(ErrorKind::kInternal, fmt::format("Embree: building the scene failed with error {}{}", int(error),
                                                  error == RTC_ERROR_OUT_OF_MEMORY ? " (out of memory)" : ""));
  }
  RTCBounds bounds{};
  rtcGetSceneBounds(embree_->top.get(), &bounds);
  const bool any = !placements_.empty() && bounds.lower_x <= bounds.upper_x;
  bounds_ =
      any ? Box3f({bounds.lower_x, bounds.lower_y, bounds.lower_z}, {bounds.upper_x, bounds.upper_y, bounds.upper_z})
          : Box3f({-1, -1, -1}, {1, 1, 1});
  return {};
}

void Scene::find_material_traits() {
  std::vector<bool> colored(description_.materials.size(), false);
  for (const Mesh& mesh : description_.meshes) {
    if (!mesh.colors.empty()) colored[mesh.material] = true;
  }
  for (std::size_t i = 0; i < description_.materials.size(); ++i) {
    const Material& m = description_.materials[i];
    MaterialTraits traits;
    traits.emissive = !is_zero(m.emission) || (m.unlit && !is_zero(m.base_color));
    traits.textured = is_textured(m) || colored[i];
    traits.refracts = m.transmission > 0.0f && m.thickness > 0.0f && m.metallic < 1.0f && !m.unlit;
    traits.medium = medium_of(m);
    any_medium_ = any_medium_ || traits.refracts;
    SurfaceParams& p = traits.constant;
    p.base_color = m.base_color;
    p.metallic = m.metallic;
    p.roughness = m.roughness;
    p.ior = m.ior;
    p.specular = m.specular;
    p.specular_color = m.specular_color;
    p.transmission = m.transmission;
    p.thin_walled = !traits.refracts;
    p.clearcoat = m.clearcoat;
    p.clearcoat_roughness = m.clearcoat_roughness;
    p.sheen_color = m.sheen_color;
    p.sheen_roughness = m.sheen_roughness;
    p.scatters = !m.unlit;
    if (const auto albedo = plain_lambert_albedo(p); albedo && !traits.textured) {
      traits.plain_lambert = true;
      traits.lambert_albedo = *albedo;
    }
    if (!traits.textured) traits.smooth = SmoothMaterial::of(p);
    traits_.push_back(traits);
  }
}

void Scene::find_lights() {
  std::vector<EmissiveTriangle> emitters;
  for (std::size_t i = 0; i < placements_.size(); ++i) {
    Placement& placed = placements_[i];
    const Mesh& mesh = description_.meshes[placed.mesh];
    const Material& m = description_.materials[mesh.material];
    if (!traits_[mesh.material].emissive) continue;
    placed.first_emissive = static_cast<std::int32_t>(emitters.size());
    bool& varies = traits_[mesh.material].emission_varies;
    varies =
        varies || (m.unlit ? m.base_color_texture.present() || !mesh.colors.empty() : m.emission_texture.present());
    any_emission_varies_ = any_emission_varies_ || varies;
    for (std::uint32_t primitive = 0; primitive < mesh.triangles.size(); ++primitive) {
      EmissiveTriangle emitter;
      emitter.radiance = {0.0f, 0.0f, 0.0f};
      emitter.p0 = surface_point(static_cast<std::uint32_t>(i), primitive, 0.0f, 0.0f).position;
      emitter.p1 = surface_point(static_cast<std::uint32_t>(i), primitive, 1.0f, 0.0f).position;
      emitter.p2 = surface_point(static_cast<std::uint32_t>(i), primitive, 0.0f, 1.0f).position;
      const SurfacePoint centre = surface_point(static_cast<std::uint32_t>(i), primitive, 1.0f / 3.0f, 1.0f / 3.0f);
      emitter.ng = centre.ng;
      emitter.geometry = static_cast<std::uint32_t>(i);
      emitter.primitive = primitive;
      emitter.two_sided = m.double_sided || m.unlit;
      if (varies) {
        constexpr int kProbes = 16;  // of the texture; only the choice of lights depends on them
        for (int s = 0; s < kProbes; ++s) {
          const Vec2f b =
              sample_triangle({(static_cast<float>(s) + 0.5f) / kProbes, to_unit_float(reverse_bits(s) | 0x8u)});
          emitter.radiance += radiance_of(surface_point(static_cast<std::uint32_t>(i), primitive, b.x, b.y)) / kProbes;
        }
        // A texel that no probe met still can be chosen.
        constexpr float kFloor = 1e-2f;
        emitter.radiance += (m.unlit ? m.base_color : m.emission) * kFloor;
      } else {
        emitter.radiance = radiance_of(centre);
      }
      emitters.push_back(emitter);
    }
  }
  if (any_medium_) {
    for (const EmissiveTriangle& e : emitters) {
      const Vec3f centre = (e.p0 + e.p1 + e.p2) / 3.0f;
      const float extent = std::max(max_magnitude(e.p0), std::max(max_magnitude(e.p1), max_magnitude(e.p2)));
      media_of_emitters_.push_back(media_around(offset_ray_origin(centre, e.ng, e.ng, extent)));
    }
  }
  lights_ = std::make_unique<Lights>(std::move(emitters), description_.lights, &environment_, bounds_);
}

bool Scene::Embree::occluded(const Vec3f& origin, const Vec3f& direction, float t_max) const {
  RTCRay ray{origin.x, origin.y, origin.z, 0.0f, direction.x, direction.y, direction.z, 0.0f, t_max, ~0u, 0, 0};
  embree_occluded(top.get(), ray);
  return ray.tfar < 0.0f;
}

void Scene::Embree::alpha_filter(const RTCFilterFunctionNArguments* args) {
  const auto& scene = *static_cast<const Scene*>(args->geometryUserPtr);
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] != -1) continue;
    const unsigned instance = RTCHitN_instID(args->hit, args->N, i, 0);
    const unsigned placement = instance == RTC_INVALID_GEOMETRY_ID ? RTCHitN_geomID(args->hit, args->N, i) : instance;
    const SurfacePoint point = scene.surface_point(placement, RTCHitN_primID(args->hit, args->N, i),
                                                   RTCHitN_u(args->hit, args->N, i), RTCHitN_v(args->hit, args->N, i));
    const Vec3f origin{RTCRayN_org_x(args->ray, args->N, i), RTCRayN_org_y(args->ray, args->N, i),
                       RTCRayN_org_z(args->ray, args->N, i)};
    const Vec3f direction{RTCRayN_dir_x(args->ray, args->N, i), RTCRayN_dir_y(args->ray, args->N, i),
                          RTCRayN_dir_z(args->ray, args->N, i)};
    if (!scene.passes_alpha(point, origin, direction)) args->valid[i] = 0;
  }
}

}  // namespace pf
