#include "worker/scene/gltf_geometry.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "worker/scene/gltf_material.h"
#include "worker/scene/tangents.h"
#include "worker/scene/texture_store.h"

namespace pf::gltf {
namespace {

/// How far a length may be from one before it is reported; 8-bit normals are off by up to 0.014.
constexpr float kUnitTolerance = 0.02f;

/// Square of twice a triangle's area from which float keeps all its digits.
constexpr float kLeastArea2 = 1e-36f;

/// Corners of triangle `k` of a list, strip or fan [glTF 2.0, 3.7.2.1, "Topology types"].
std::array<std::size_t, 3> corners(int mode, std::size_t k) {
  if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) return {k, k + 1 + k % 2, k + 2 - k % 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {k + 1, k + 2, 0};
  return {3 * k, 3 * k + 1, 3 * k + 2};
}

Vec3f xyz(const Vec4f& v) { return {v.x, v.y, v.z}; }

/// Adds `weight` times the morph target's values to `base`.
template <typename V>
Result<void> add_deltas(AccessorReader& accessors, int accessor, float weight, std::vector<V>& base,
                        const std::string& pointer) {
  const auto deltas = accessors.vectors<V>(accessor, pointer);
  if (!deltas) return tl::unexpected(deltas.error());
  for (std::size_t i = 0; i < base.size(); ++i) base[i] += (*deltas)[i] * weight;
  return {};
}

/// One set of JOINTS_n and WEIGHTS_n.
struct Influences {
  std::vector<Vec4f> joints;
  std::vector<Vec4f> weights;
};

Vec3f transform_vector(const Matrix44f& m, const Vec3f& v) {
  Vec3f out;
  m.multDirMatrix(v, out);
  return out;
}

/// Normals go with the cofactors of the upper 3x3, in the direction of the inverse transpose.
Vec3f transform_normal(const Matrix44f& m, const Vec3f& n) {
  const Vec3f r0(m[0][0], m[0][1], m[0][2]);
  const Vec3f r1(m[1][0], m[1][1], m[1][2]);
  const Vec3f r2(m[2][0], m[2][1], m[2][2]);
  const float sign = dot(r0, cross(r1, r2)) < 0.0f ? -1.0f : 1.0f;
  return (cross(r1, r2) * n.x + cross(r2, r0) * n.y + cross(r0, r1) * n.z) * sign;
}

bool finite_vertices(const Mesh& mesh) { return std::all_of(mesh.positions.begin(), mesh.positions.end(), is_finite); }

}  // namespace

Result<std::vector<Mesh>> GeometryReader::read(std::size_t index, const std::vector<double>& weights,
                                               const SkinPose* skin) {
  const tinygltf::Mesh& in = model_.gltf.meshes[index];
  std::vector<Mesh> out;
  for (std::size_t p = 0; p < in.primitives.size(); ++p) {
    const std::string pointer = fmt::format("/meshes/{}/primitives/{}", index, p);
    auto mesh = read_primitive(in.primitives[p], pointer, weights.empty() ? in.weights : weights, skin);
    if (!mesh) return tl::unexpected(mesh.error());
    if (!*mesh) continue;
    (*mesh)->name = in.name.empty() ? fmt::format("mesh {}", index) : in.name;
    out.push_back(std::move(**mesh));
  }
  return out;
}

Result<std::optional<Mesh>> GeometryReader::read_primitive(const tinygltf::Primitive& primitive,
                                                           const std::string& pointer,
                                                           const std::vector<double>& weights, const SkinPose* skin) {
  if (primitive.mode < TINYGLTF_MODE_TRIANGLES) {
    ++points_and_lines_;
    return std::optional<Mesh>();
  }
  if (!primitive.attributes.contains("POSITION")) return std::optional<Mesh>();  // check_meshes has warned
  if (!has_data(primitive)) {
    report_.warn(pointer, "is left out: its buffer has no data");
    return std::optional<Mesh>();
  }
  const auto attributes = Attributes::open(model_, primitive, accessors_, report_, pointer);
  if (!attributes) return tl::unexpected(attributes.error());
  Mesh mesh;
  mesh.material = primitive.material >= 0 ? primitive.material : static_cast<int>(materials_.size()) - 1;
  if (auto r = read_vertices(*attributes, mesh); !r) return tl::unexpected(r.error());
  check_units(mesh, pointer);
  if (auto r = read_triangles(primitive, *attributes, mesh, pointer); !r) return tl::unexpected(r.error());
  if (auto r = apply_morph(primitive, weights, mesh, pointer); !r) return tl::unexpected(r.error());
  if (skin != nullptr) {
    if (auto r = apply_skin(*attributes, *skin, mesh, pointer); !r) return tl::unexpected(r.error());
  }
  if (!finite_vertices(mesh))
    return report_.fail(pointer, "positions leave single precision under morph targets or skin");
  drop_degenerate(mesh);
  repair_normals(mesh);
  repair_colors(mesh, pointer);
  if (mesh.triangles.empty()) return std::optional<Mesh>();
  if (auto r = complete_uv(mesh, pointer); !r) return tl::unexpected(r.error());
  finish_tangents(mesh);
  return std::optional<Mesh>(std::move(mesh));
}

bool GeometryReader::has_data(const tinygltf::Primitive& primitive) const {
  if (primitive.indices >= 0 && !accessors_.has_data(primitive.indices)) return false;
  return std::all_of(primitive.attributes.begin(), primitive.attributes.end(),
                     [&](const auto& attribute) { return accessors_.has_data(attribute.second); });
}

Result<void> GeometryReader::read_vertices(const Attributes& attributes, Mesh& mesh) {
  const auto take = [](auto&& read, auto& into) -> Result<void> {
    if (!read) return tl::unexpected(read.error());
    into = std::move(*read);
    return {};
  };
  if (auto r = take(attributes.vectors<Vec3f>("POSITION"), mesh.positions); !r) return r;
  if (attributes.has("NORMAL")) {
    if (auto r = take(attributes.vectors<Vec3f>("NORMAL"), mesh.normals); !r) return r;
    const Material& material = materials_[static_cast<std::size_t>(mesh.material)];
    const bool mapped = material.normal_texture.present() || material.clearcoat_normal_texture.present();
    if (mapped && attributes.has("TANGENT")) {
      if (auto r = take(attributes.vectors<Vec4f>("TANGENT", 1.0f), mesh.tangents); !r) return r;
    }
  }
  for (std::size_t set = 0; set < mesh.uv.size(); ++set) {
    const std::string name = fmt::format("TEXCOORD_{}", set);
    if (!attributes.has(name)) continue;
    if (auto r = take(attributes.vectors<Vec2f>(name), mesh.uv[set]); !r) return r;
  }
  if (attributes.has("COLOR_0")) return take(attributes.vectors<Vec4f>("COLOR_0", 1.0f), mesh.colors);
  return {};
}

void GeometryReader::check_units(const Mesh& mesh, const std::string& pointer) {
  // As the file has them: morph targets and skins change lengths rightly. audit() looks at tangents.
  const auto odd = [](const Vec3f& n) { return std::abs(length(n) - 1.0f) > kUnitTolerance; };
  if (std::any_of(mesh.normals.begin(), mesh.normals.end(), odd)) {
    report_.warn(pointer, "has normals that are not of unit length; they are normalised");
  }
}

Result<void> GeometryReader::read_triangles(const tinygltf::Primitive& primitive, const Attributes& attributes,
                                            Mesh& mesh, const std::string& pointer) {
  std::vector<std::uint32_t> indices;
  const bool indexed = primitive.indices >= 0;
  int mode = primitive.mode;
  if (attributes.compressed()) {
    indices = attributes.draco().indices();
    mode = TINYGLTF_MODE_TRIANGLES;
  } else if (indexed) {
    auto read = accessors_.integers(primitive.indices, child(pointer, "indices"));
    if (!read) return tl::unexpected(read.error());
    indices = std::move(*read);
  }
  const std::size_t vertices = mesh.positions.size();
  const auto too_large = std::find_if(indices.begin(), indices.end(), [&](std::uint32_t i) { return i >= vertices; });
  if (too_large != indices.end()) {
    return report_.fail(child(pointer, "indices"), fmt::format("index {} at {} is not below the {} vertices",
                                                               *too_large, too_large - indices.begin(), vertices));
  }
  const std::size_t count = indexed ? indices.size() : vertices;
  if (vertices > 0xffffffffu) return report_.fail(pointer, "has more than 2^32 vertices");
  const std::size_t triangles = mode == TINYGLTF_MODE_TRIANGLES ? count / 3 : count < 3 ? 0 : count - 2;
  mesh.triangles.reserve(triangles);
  for (std::size_t k = 0; k < triangles; ++k) {
    const auto c = corners(mode, k);
    const auto at = [&](std::size_t i) { return indexed ? indices[i] : static_cast<std::uint32_t>(i); };
    mesh.triangles.push_back({at(c[0]), at(c[1]), at(c[2])});
  }
  return {};
}

Result<void> GeometryReader::apply_morph(const tinygltf::Primitive& primitive, const std::vector<double>& weights,
                                         Mesh& mesh, const std::string& pointer) {
  for (std::size_t t = 0; t < std::min(primitive.targets.size(), weights.size()); ++t) {
    const auto weight = static_cast<float>(weights[t]);
    if (weight == 0.0f) continue;
    for (const auto& [name, accessor] : primitive.targets[t]) {
      const std::string at = child(fmt::format("{}/targets/{}", pointer, t), name);
      Result<void> done;
      if (name == "POSITION") {
        done = add_deltas(accessors_, accessor, weight, mesh.positions, at);
      } else if (name == "NORMAL" && !mesh.normals.empty()) {
        done = add_deltas(accessors_, accessor, weight, mesh.normals, at);
      } else if (name == "TANGENT" && !mesh.tangents.empty()) {
        done = add_deltas(accessors_, accessor, weight, mesh.tangents, at);
      } else if (name == "COLOR_0" && !mesh.colors.empty()) {
        done = add_deltas(accessors_, accessor, weight, mesh.colors, at);
      }
      for (std::size_t set = 0; set < mesh.uv.size(); ++set) {
        if (name == fmt::format("TEXCOORD_{}", set) && !mesh.uv[set].empty()) {
          done = add_deltas(accessors_, accessor, weight, mesh.uv[set], at);
        }
      }
      if (!done) return done;
    }
  }
  return {};
}

Result<void> GeometryReader::apply_skin(const Attributes& attributes, const SkinPose& skin, Mesh& mesh,
                                        const std::string& pointer) {
  std::vector<Influences> sets;
  for (int n = 0; attributes.has(fmt::format("JOINTS_{}", n)) && attributes.has(fmt::format("WEIGHTS_{}", n)); ++n) {
    auto joints = attributes.vectors<Vec4f>(fmt::format("JOINTS_{}", n));
    if (!joints) return tl::unexpected(joints.error());
    auto weights = attributes.vectors<Vec4f>(fmt::format("WEIGHTS_{}", n));
    if (!weights) return tl::unexpected(weights.error());
    sets.push_back({std::move(*joints), std::move(*weights)});
  }
  if (sets.empty()) {
    report_.warn(pointer, "has no JOINTS_0 and WEIGHTS_0; the skin of its node does not move it");
    return {};
  }
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    Matrix44f blended(0.0f);
    float sum = 0.0f;
    for (const Influences& set : sets) {
      for (int c = 0; c < 4; ++c) {
        const float joint = set.joints[i][c];
        const float weight = set.weights[i][c];
        if (weight < 0.0f) return report_.fail(pointer, fmt::format("vertex {} has a negative joint weight", i));
        if (!(joint >= 0.0f && joint < static_cast<float>(skin.size()))) {
          const std::string what = fmt::format("vertex {} names joint {}; the skin has {}", i, joint, skin.size());
          if (weight > 0.0f) return report_.fail(pointer, what);
          report_.warn(pointer, what + " (its weight is 0)");
          continue;
        }
        if (weight == 0.0f) continue;
        sum += weight;
        blended += skin[static_cast<std::size_t>(joint)] * weight;
      }
    }
    if (!(sum > 0.0f)) {
      report_.warn(pointer, "has vertices whose joint weights are all 0; they follow the skin's first joint");
      blended = skin.front();
      sum = 1.0f;
    }
    if (std::abs(sum - 1.0f) > kUnitTolerance)
      report_.warn(pointer, "has joint weights that do not sum to 1; they are normalised");
    blended *= 1.0f / sum;
    Vec3f moved;
    blended.multVecMatrix(mesh.positions[i], moved);
    mesh.positions[i] = moved;
    if (!mesh.normals.empty()) mesh.normals[i] = transform_normal(blended, mesh.normals[i]);
    if (!mesh.tangents.empty()) {
      const Vec3f t = transform_vector(blended, xyz(mesh.tangents[i]));
      mesh.tangents[i] = Vec4f(t.x, t.y, t.z, mesh.tangents[i].w);
    }
  }
  return {};
}

void GeometryReader::drop_degenerate(Mesh& mesh) {
  const std::size_t dropped = std::erase_if(mesh.triangles, [&](const std::array<std::uint32_t, 3>& t) {
    const Vec3f& p = mesh.positions[t[0]];
    // The renderer divides by the length of this in single precision.
    const float l2 = length2(cross(mesh.positions[t[1]] - p, mesh.positions[t[2]] - p));
    return !(l2 > kLeastArea2) || !(l2 < 1.0f / kLeastArea2);
  });
  degenerate_ += dropped;
}

void GeometryReader::repair_normals(Mesh& mesh) {
  if (mesh.normals.empty()) return;
  std::vector<Vec3f> geometric;
  for (std::size_t i = 0; i < mesh.normals.size(); ++i) {
    Vec3f& n = mesh.normals[i];
    n = unit_or_zero(n);
    if (!is_zero(n)) continue;
    if (geometric.empty()) {  // area-weighted normals of the triangles around each vertex
      geometric.assign(mesh.normals.size(), Vec3f(0.0f, 0.0f, 0.0f));
      for (const auto& t : mesh.triangles) {
        const Vec3f& p = mesh.positions[t[0]];
        const Vec3f face = cross(mesh.positions[t[1]] - p, mesh.positions[t[2]] - p);
        for (const std::uint32_t v : t) geometric[v] += face;
      }
    }
    n = unit_or_zero(geometric[i]);
    if (is_zero(n)) n = Vec3f(0.0f, 0.0f, 1.0f);
  }
}

void GeometryReader::repair_colors(Mesh& mesh, const std::string& pointer) {
  for (Vec4f& c : mesh.colors) {
    for (int i = 0; i < 4; ++i) {
      if (c[i] >= 0.0f && c[i] <= 1.0f) continue;
      report_.warn(pointer, "has vertex colours outside 0 to 1; they are clamped");
      c[i] = std::clamp(c[i], 0.0f, 1.0f);
    }
  }
}

Result<void> GeometryReader::complete_uv(Mesh& mesh, const std::string& pointer) {
  Material material = materials_[static_cast<std::size_t>(mesh.material)];
  for (const TextureRef* ref : texture_refs(material)) {
    if (!ref->present()) continue;
    if (ref->uv_set >= kMaxUvSets) {
      return report_.fail(pointer, fmt::format("its material reads TEXCOORD_{}; at most {} sets are supported",
                                               ref->uv_set, kMaxUvSets));
    }
    auto& set = mesh.uv[static_cast<std::size_t>(ref->uv_set)];
    if (set.empty()) set.assign(mesh.positions.size(), Vec2f(0.0f, 0.0f));  // check_meshes has warned
  }
  return {};
}

void GeometryReader::finish_tangents(Mesh& mesh) {
  const Material& material = materials_[static_cast<std::size_t>(mesh.material)];
  const TextureRef& map =
      material.normal_texture.present() ? material.normal_texture : material.clearcoat_normal_texture;
  if (!map.present()) return;
  if (mesh.tangents.empty()) {
    if (mesh.normals.empty()) make_flat(mesh);
    std::vector<Vec2f> uv = mesh.uv[static_cast<std::size_t>(map.uv_set)];
    for (Vec2f& x : uv) {
      x = transform_uv(map, x);
      if (!std::isfinite(x.x) || !std::isfinite(x.y)) x = Vec2f(0.0f, 0.0f);  // overflow of KHR_texture_transform
    }
    generate_tangents(mesh, uv);
    return;
  }
  for (std::size_t i = 0; i < mesh.tangents.size(); ++i) {
    Vec4f& t = mesh.tangents[i];
    const Vec3f direction = unit_or_zero(xyz(t));
    t = is_zero(direction) ? any_tangent(mesh.normals[i])
                           : Vec4f(direction.x, direction.y, direction.z, t.w < 0.0f ? -1.0f : 1.0f);
  }
}

void GeometryReader::report_counts() {
  if (points_and_lines_ > 0) {
    report_.warn("/meshes", fmt::format("{} primitives of points or lines are left out: only surfaces are rendered",
                                        points_and_lines_));
  }
  if (degenerate_ > 0) report_.warn("/meshes", fmt::format("{} triangles without area are left out", degenerate_));
  points_and_lines_ = degenerate_ = 0;
}

}  // namespace pf::gltf
