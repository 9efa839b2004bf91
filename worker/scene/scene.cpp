#include "worker/scene/scene.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "common/math/offset.h"
#include "common/math/owen_sobol.h"
#include "common/math/sampling.h"
#include "worker/scene/embree_scene.h"

namespace pf {
namespace {

Vec3f interpolate(const Vec3f& a, const Vec3f& b, const Vec3f& c, float b1, float b2) {
  return a * (1.0f - b1 - b2) + b * b1 + c * b2;
}

template <typename T>
T at_corners(const std::vector<T>& values, const std::array<std::uint32_t, 3>& triangle, float b1, float b2) {
  return values[triangle[0]] * (1.0f - b1 - b2) + values[triangle[1]] * b1 + values[triangle[2]] * b2;
}

/// Normal of a triangle; edges are scaled first where their product would underflow.
Vec3f triangle_normal(const Vec3f& p0, const Vec3f& p1, const Vec3f& p2) {
  Vec3f e1 = p1 - p0;
  Vec3f e2 = p2 - p0;
  Vec3f n = cross(e1, e2);
  constexpr float kSafeSquare = 1e-30f;  // far above FLT_MIN, so that the square root keeps its digits
  if (length2(n) < kSafeSquare) {
    const float size =
        std::max({std::abs(e1.x), std::abs(e1.y), std::abs(e1.z), std::abs(e2.x), std::abs(e2.y), std::abs(e2.z)});
    if (size > 0.0f) n = cross(e1 / size, e2 / size);
    if (!(length2(n) > 0.0f)) return {0.0f, 0.0f, 1.0f};
  }
  return normalize(n);
}

Rgb rgb(const Vec4f& v) { return {v.x, v.y, v.z}; }

float roulette_from_ray(const Vec3f& origin, const Vec3f& direction, std::uint32_t placement, std::uint32_t primitive) {
  std::uint32_t h = combine_hash(placement, primitive);
  for (const Vec3f& v : {origin, direction}) {
    for (int axis = 0; axis < 3; ++axis) h = combine_hash(h, std::bit_cast<std::uint32_t>(v[axis]));
  }
  return static_cast<float>(h >> 8) * 0x1p-24f;
}

}  // namespace

Scene::~Scene() = default;

Scene::Triangle Scene::make_triangle(const std::array<Vec3f, 3>& corners) {
  const auto& [p0, p1, p2] = corners;
  return {corners, triangle_normal(p0, p1, p2),
          std::max(max_magnitude(p0), std::max(max_magnitude(p1), max_magnitude(p2)))};
}

SurfacePoint Scene::point_on(const Placement& placed, const Triangles& triangles, const Hit& hit) {
  const Triangle* triangle = &triangles.flat[hit.primitive];
  Triangle in_world;
  if (placed.instanced) {
    const auto& [p0, p1, p2] = triangle->corners;
    const Matrix44f& m = placed.object_to_world;
    in_world = make_triangle({p0 * m, p1 * m, p2 * m});
    if (placed.mirrored) in_world.ng = -in_world.ng;
    triangle = &in_world;
  }
  const Vec3f ng = triangle->ng;
  Vec3f ns = ng;
  if (!triangles.normals.empty()) {
    const auto& [n0, n1, n2] = triangles.normals[hit.primitive];
    Vec3f n = interpolate(n0, n1, n2, hit.b1, hit.b2);
    if (placed.instanced) placed.normal_to_world.multDirMatrix(n, n);
    const float squared = length2(n);
    if (squared > 0.0f) ns = n * (choose(dot(n, ng) < 0.0f, -1.0f, 1.0f) / std::sqrt(squared));
  }
  const auto& [p0, p1, p2] = triangle->corners;
  return {.position = interpolate(p0, p1, p2, hit.b1, hit.b2),
          .ng = ng,
          .ns = ns,
          .t = hit.t,
          .placement = hit.placement,
          .primitive = hit.primitive,
          .b1 = hit.b1,
          .b2 = hit.b2,
          .extent = triangle->extent,
          .material = placed.material};
}

SurfacePoint Scene::surface_point(std::uint32_t placement, std::uint32_t primitive, float b1, float b2) const {
  const Placement& placed = placements_[placement];
  return point_on(placed, triangles_[placed.mesh], {0.0f, b1, b2, placement, primitive});
}

std::optional<SurfacePoint> Scene::intersect(const Ray& ray) const {
  const auto hit = embree_->intersect(ray.origin, ray.direction, ray.t_max);
  if (!hit) return std::nullopt;
  const Placement& placed = placements_[hit->placement];
  return point_on(placed, triangles_[placed.mesh], *hit);
}

bool Scene::meets(const Ray& ray) const { return embree_->intersect(ray.origin, ray.direction, ray.t_max).has_value(); }

bool Scene::occluded(const Ray& ray) const { return embree_->occluded(ray.origin, ray.direction, ray.t_max); }

Vec2f Scene::uv(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref) const {
  const auto& set = mesh.uv[ref.uv_set];
  if (set.empty()) return transform_uv(ref, {0.0f, 0.0f});
  return transform_uv(ref, at_corners(set, mesh.triangles[point.primitive], point.b1, point.b2));
}

Vec4f Scene::texel(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref) const {
  return textures_->lookup(ref.texture, uv(mesh, point, ref));
}

Vec4f Scene::vertex_color(const Mesh& mesh, const SurfacePoint& point) const {
  if (mesh.colors.empty()) return {1.0f, 1.0f, 1.0f, 1.0f};
  return at_corners(mesh.colors, mesh.triangles[point.primitive], point.b1, point.b2);
}

Vec3f Scene::mapped_normal(const Mesh& mesh, const SurfacePoint& point, const TextureRef& ref, float scale) const {
  if (mesh.tangents.empty()) return point.ns;
  const Vec4f interpolated = at_corners(mesh.tangents, mesh.triangles[point.primitive], point.b1, point.b2);
  const Placement& placed = placements_[point.placement];
  Vec3f tangent{interpolated.x, interpolated.y, interpolated.z};
  float handedness = interpolated.w < 0.0f ? -1.0f : 1.0f;
  if (placed.instanced) {
    placed.object_to_world.multDirMatrix(tangent, tangent);
    if (placed.mirrored) handedness = -handedness;
  }
  tangent = tangent - point.ns * dot(tangent, point.ns);
  if (!(length2(tangent) > 0.0f)) return point.ns;
  tangent = normalize(tangent);
  const Vec3f bitangent = cross(point.ns, tangent) * handedness;
  const Vec4f t = texel(mesh, point, ref);
  const Vec3f local{(2.0f * t.x - 1.0f) * scale, (2.0f * t.y - 1.0f) * scale, 2.0f * t.z - 1.0f};
  const Vec3f mapped = tangent * local.x + bitangent * local.y + point.ns * local.z;
  return length2(mapped) > 0.0f ? normalize(mapped) : point.ns;
}

void Scene::apply_textures(const SurfacePoint& point, SurfaceParams& params) const {
  const Mesh& mesh = description_.meshes[placements_[point.placement].mesh];
  const Material& m = description_.materials[point.material];
  const Vec4f color = vertex_color(mesh, point);
  params.base_color = params.base_color * rgb(color);
  if (m.base_color_texture.present()) params.base_color *= rgb(texel(mesh, point, m.base_color_texture));
  if (m.metallic_roughness_texture.present()) {
    const Vec4f t = texel(mesh, point, m.metallic_roughness_texture);
    params.roughness *= t.y;
    params.metallic *= t.z;
  }
  if (m.specular_texture.present()) params.specular *= texel(mesh, point, m.specular_texture).w;
  if (m.specular_color_texture.present()) params.specular_color *= rgb(texel(mesh, point, m.specular_color_texture));
  if (m.transmission_texture.present()) params.transmission *= texel(mesh, point, m.transmission_texture).x;
  if (m.clearcoat_texture.present()) params.clearcoat *= texel(mesh, point, m.clearcoat_texture).x;
  if (m.clearcoat_roughness_texture.present()) {
    params.clearcoat_roughness *= texel(mesh, point, m.clearcoat_roughness_texture).y;
  }
  if (m.sheen_color_texture.present()) params.sheen_color *= rgb(texel(mesh, point, m.sheen_color_texture));
  if (m.sheen_roughness_texture.present()) params.sheen_roughness *= texel(mesh, point, m.sheen_roughness_texture).w;
  if (m.normal_texture.present()) params.ns = mapped_normal(mesh, point, m.normal_texture, m.normal_scale);
  if (m.clearcoat_normal_texture.present()) {
    params.clearcoat_ns = mapped_normal(mesh, point, m.clearcoat_normal_texture, m.clearcoat_normal_scale);
  }
}

SurfaceParams Scene::evaluate(const SurfacePoint& point, float eta_outside) const {
  const MaterialTraits& traits = traits_[point.material];
  SurfaceParams params = traits.constant;
  params.ng = point.ng;
  params.ns = point.ns;
  params.clearcoat_ns = point.ns;
  params.eta_outside = eta_outside;
  if (traits.textured) apply_textures(point, params);
  return params;
}

Rgb Scene::radiance_of(const SurfacePoint& point) const {
  const Material& m = description_.materials[point.material];
  const Mesh& mesh = description_.meshes[placements_[point.placement].mesh];
  if (m.unlit) {
    Rgb base = m.base_color * rgb(vertex_color(mesh, point));
    if (m.base_color_texture.present()) base *= rgb(texel(mesh, point, m.base_color_texture));
    return base;
  }
  return m.emission_texture.present() ? m.emission * rgb(texel(mesh, point, m.emission_texture)) : m.emission;
}

Rgb Scene::emitted(const SurfacePoint& point, const Vec3f& wo) const {
  if (!traits_[point.material].emissive) return {0.0f, 0.0f, 0.0f};
  const Material& m = description_.materials[point.material];
  if (!m.double_sided && !m.unlit && dot(point.ng, wo) <= 0.0f) return {0.0f, 0.0f, 0.0f};
  return radiance_of(point);
}

std::int32_t Scene::emissive_triangle(const SurfacePoint& point) const {
  const std::int32_t first = placements_[point.placement].first_emissive;
  return first < 0 ? -1 : first + static_cast<std::int32_t>(point.primitive);
}

Rgb Scene::emitted_by_triangle(std::uint32_t index, const Vec2f& barycentric) const {
  const EmissiveTriangle& triangle = lights_->triangle(index);
  return radiance_of(surface_point(triangle.geometry, triangle.primitive, barycentric.x, barycentric.y));
}

Rgb Scene::find_emission_ratio(std::uint32_t index, const Vec2f& barycentric) const {
  const EmissiveTriangle& triangle = lights_->triangle(index);
  const int material = description_.meshes[placements_[triangle.geometry].mesh].material;
  if (!traits_[material].emission_varies) return {1.0f, 1.0f, 1.0f};
  const Rgb exact = emitted_by_triangle(index, barycentric);
  Rgb ratio{0.0f, 0.0f, 0.0f};
  for (int c = 0; c < 3; ++c) {
    if (triangle.radiance[c] > 0.0f) ratio[c] = exact[c] / triangle.radiance[c];
  }
  return ratio;
}

std::span<const int> Scene::media_of_emitter(std::uint32_t index) const {
  return media_of_emitters_.empty() ? std::span<const int>{} : std::span<const int>(media_of_emitters_[index]);
}

float Scene::alpha_at(const SurfacePoint& point) const {
  const Material& m = description_.materials[point.material];
  const Mesh& mesh = description_.meshes[placements_[point.placement].mesh];
  float alpha = m.alpha * vertex_color(mesh, point).w;
  if (m.base_color_texture.present()) alpha *= texel(mesh, point, m.base_color_texture).w;
  return alpha;
}

bool Scene::passes_alpha(const SurfacePoint& point, const Vec3f& origin, const Vec3f& direction) const {
  const Material& m = description_.materials[point.material];
  const float alpha = alpha_at(point);
  if (m.alpha_mode == AlphaMode::kMask) return alpha >= m.alpha_cutoff;
  return alpha >= 1.0f || roulette_from_ray(origin, direction, point.placement, point.primitive) < alpha;
}

std::vector<int> Scene::media_around(const Vec3f& position) const {
  std::vector<int> inside;
  if (!any_medium_) return inside;
  // Walk out along an arbitrary direction that no modeller aligns a wall with: a volume left through its back face, and
  // not entered before on this walk, contains the start.
  const Vec3f direction = normalize(Vec3f(0.2672f, 0.8018f, 0.5345f));
  std::vector<int> entered;
  Ray ray{position, direction};
  constexpr int kMaxCrossings = 1000;
  for (int crossing = 0; crossing < kMaxCrossings; ++crossing) {
    const auto point = intersect(ray);
    if (!point) break;
    if (medium(point->material) != nullptr) {
      if (dot(point->ng, direction) < 0.0f) {
        entered.push_back(point->material);
      } else if (const auto it = std::find(entered.begin(), entered.end(), point->material); it != entered.end()) {
        entered.erase(it);
      } else {
        inside.insert(inside.begin(), point->material);
      }
    }
    ray.origin = offset_past(*point, direction);
  }
  return inside;
}

}  // namespace pf
