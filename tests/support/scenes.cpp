#include "tests/support/scenes.h"

#include <cmath>
#include <stdexcept>

#include "common/math/frame.h"

namespace pf::test {

SceneMaker::SceneMaker() = default;

int SceneMaker::material(const Material& m) {
  description.materials.push_back(m);
  return static_cast<int>(description.materials.size()) - 1;
}

int SceneMaker::lambert(const Rgb& albedo) {
  Material m;
  m.base_color = albedo;
  m.metallic = 0.0f;
  m.specular = 0.0f;
  return material(m);
}

int SceneMaker::emitter(const Rgb& radiance, const Rgb& albedo) {
  const int index = lambert(albedo);
  description.materials.back().emission = radiance;
  return index;
}

int SceneMaker::mirror(const Rgb& reflectance) { return metal(reflectance, 0.0f); }

int SceneMaker::metal(const Rgb& f0, float roughness) {
  Material m;
  m.base_color = f0;
  m.metallic = 1.0f;
  m.roughness = roughness;
  return material(m);
}

int SceneMaker::glass(float ior, const Rgb& tint, float roughness) {
  Material m;
  m.base_color = tint;
  m.metallic = 0.0f;
  m.roughness = roughness;
  m.ior = ior;
  m.transmission = 1.0f;
  m.thickness = 1.0f;
  return material(m);
}

int SceneMaker::plastic(const Rgb& albedo, float roughness) {
  Material m;
  m.base_color = albedo;
  m.metallic = 0.0f;
  m.roughness = roughness;
  return material(m);
}

int SceneMaker::add(const Mesh& mesh) {
  MeshInstance instance;
  instance.mesh = static_cast<int>(description.meshes.size());
  description.meshes.push_back(mesh);
  description.instances.push_back(instance);
  return instance.mesh;
}

void SceneMaker::quad(const Vec3f& corner, const Vec3f& a, const Vec3f& b, int material) {
  Mesh mesh;
  mesh.material = material;
  mesh.positions = {corner, corner + a, corner + a + b, corner + b};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  add(mesh);
}

void SceneMaker::box(const Vec3f& low, const Vec3f& high, int material, bool inward) {
  const Vec3f size = high - low;
  const Vec3f x{size.x, 0, 0};
  const Vec3f y{0, size.y, 0};
  const Vec3f z{0, 0, size.z};
  const auto side = [&](const Vec3f& corner, const Vec3f& a, const Vec3f& b) {
    inward ? quad(corner, b, a, material) : quad(corner, a, b, material);
  };
  side(low, y, x);
  side(low, x, z);
  side(low, z, y);
  side(high, -x, -y);
  side(high, -z, -x);
  side(high, -y, -z);
}

void SceneMaker::sphere(const Vec3f& centre, float radius, int material, int rings, bool inward) {
  Mesh mesh;
  mesh.material = material;
  const int columns = 2 * rings;
  for (int i = 0; i <= rings; ++i) {
    const float theta = kPi * static_cast<float>(i) / static_cast<float>(rings);
    for (int j = 0; j <= columns; ++j) {
      const float phi = 2.0f * kPi * static_cast<float>(j) / static_cast<float>(columns);
      const Vec3f n{std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)};
      mesh.positions.push_back(centre + n * radius);
      mesh.normals.push_back(inward ? -n : n);
    }
  }
  const auto index = [&](int i, int j) { return static_cast<std::uint32_t>(i * (columns + 1) + j); };
  const auto triangle = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    inward ? mesh.triangles.push_back({a, c, b}) : mesh.triangles.push_back({a, b, c});
  };
  for (int i = 0; i < rings; ++i) {
    for (int j = 0; j < columns; ++j) {
      if (i > 0) triangle(index(i, j), index(i, j + 1), index(i + 1, j + 1));
      if (i + 1 < rings) triangle(index(i, j), index(i + 1, j + 1), index(i + 1, j));
    }
  }
  add(mesh);
}

void SceneMaker::camera(const Vec3f& eye, const Vec3f& target, float yfov) {
  Camera c;
  c.name = "camera";
  c.yfov = yfov;
  const Vec3f back = normalize(eye - target);
  const Vec3f upwards = std::abs(back.y) > 0.99f ? Vec3f{0, 0, -1} : Vec3f{0, 1, 0};
  const Vec3f right = normalize(cross(upwards, back));
  const Vec3f up = cross(back, right);
  c.camera_to_world =
      Matrix44f(right.x, right.y, right.z, 0, up.x, up.y, up.z, 0, back.x, back.y, back.z, 0, eye.x, eye.y, eye.z, 1);
  description.cameras.push_back(c);
}

std::vector<Vec3f> SceneMaker::disc(const Vec3f& centre, const Vec3f& normal, float radius, int material,
                                    int segments) {
  const Frame frame = Frame::from_normal(normal);
  Mesh mesh;
  mesh.material = material;
  std::vector<Vec3f> corners;
  for (int i = 0; i < segments; ++i) {
    const float phi = 2.0f * kPi * static_cast<float>(i) / static_cast<float>(segments);
    corners.push_back(centre + frame.t * (radius * std::cos(phi)) + frame.b * (radius * std::sin(phi)));
  }
  mesh.positions = corners;
  mesh.positions.push_back(centre);
  const auto count = static_cast<std::uint32_t>(segments);
  for (std::uint32_t i = 0; i < count; ++i) mesh.triangles.push_back({count, i, (i + 1) % count});
  add(mesh);
  return corners;
}

void SceneMaker::orthographic_camera(const Vec3f& eye, const Vec3f& target, float half_width, float half_height) {
  camera(eye, target, 1.0f);
  Camera& c = description.cameras.back();
  c.orthographic = true;
  c.xmag = half_width;
  c.ymag = half_height;
}

void SceneMaker::point_light(const Vec3f& position, float intensity) {
  PunctualLight light;
  light.position = position;
  light.intensity = {intensity, intensity, intensity};
  description.lights.push_back(light);
}

void SceneMaker::directional_light(const Vec3f& direction, float irradiance) {
  PunctualLight light;
  light.kind = PunctualKind::kDirectional;
  light.direction = normalize(direction);
  light.intensity = {irradiance, irradiance, irradiance};
  description.lights.push_back(light);
}

void SceneMaker::spot_light(const Vec3f& position, const Vec3f& direction, float intensity, float cos_inner,
                            float cos_outer) {
  point_light(position, intensity);
  PunctualLight& light = description.lights.back();
  light.kind = PunctualKind::kSpot;
  light.direction = normalize(direction);
  light.cos_inner = cos_inner;
  light.cos_outer = cos_outer;
}

std::unique_ptr<const Scene> SceneMaker::build() const {
  auto scene = Scene::build(description);
  if (!scene) throw std::runtime_error(scene.error().message);
  return std::move(*scene);
}

namespace {
SceneMaker room() {
  SceneMaker maker;
  const int white = maker.lambert({0.73f, 0.73f, 0.73f});
  const int red = maker.lambert({0.63f, 0.065f, 0.05f});
  const int green = maker.lambert({0.14f, 0.45f, 0.091f});
  const int light = maker.emitter({16, 16, 16});
  maker.quad({-0.5f, 0, -0.5f}, {0, 0, 1}, {1, 0, 0}, white);
  maker.quad({-0.5f, 1, -0.5f}, {1, 0, 0}, {0, 0, 1}, white);
  maker.quad({-0.5f, 0, -0.5f}, {1, 0, 0}, {0, 1, 0}, white);
  maker.quad({-0.5f, 0, -0.5f}, {0, 1, 0}, {0, 0, 1}, red);
  maker.quad({0.5f, 0, -0.5f}, {0, 0, 1}, {0, 1, 0}, green);
  maker.quad({-0.125f, 0.998f, -0.125f}, {0.25f, 0, 0}, {0, 0, 0.25f}, light);
  maker.camera({0, 0.5f, 1.9f}, {0, 0.5f, 0}, 39.0f * kPi / 180.0f);
  return maker;
}
}  // namespace

SceneMaker peer_box(int rings) {
  SceneMaker maker = room();
  maker.sphere({-0.22f, 0.20f, -0.18f}, 0.20f, maker.mirror(), rings);
  maker.sphere({0.22f, 0.18f, 0.12f}, 0.18f, maker.glass(1.5f), rings);
  return maker;
}

SceneMaker diffuse_box() {
  SceneMaker maker = room();
  maker.box({-0.3f, 0.0f, -0.3f}, {0.05f, 0.45f, 0.05f}, maker.lambert({0.73f, 0.73f, 0.73f}));
  return maker;
}

SceneMaker bare_floor() {
  SceneMaker maker;
  maker.quad({-2, 0, 2}, {4, 0, 0}, {0, 0, -4}, maker.lambert({0.5f, 0.5f, 0.5f}));
  maker.camera({0, 4, 0.01f}, {0, 0, 0}, 0.9f);
  return maker;
}

SceneMaker furnace_box() {
  SceneMaker maker;
  maker.box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}, maker.emitter({1, 1, 1}, {0.5f, 0.5f, 0.5f}), true);
  maker.camera({0.2f, 0.1f, 0.15f}, {-0.5f, -0.5f, -0.5f}, 1.6f);
  return maker;
}

SceneMaker corner_room() {
  SceneMaker maker;
  maker.box({-1, -1, -1}, {1, 1, 1}, maker.lambert({0.6f, 0.6f, 0.6f}), true);
  maker.point_light({0.5f, 0.4f, 0.5f}, 3.0f);
  maker.camera({0.6f, 0, 0.6f}, {-1, 0, -1}, 0.6f);
  return maker;
}

JobSpec job(int width, int height, IntegratorType type, std::int64_t photons) {
  JobSpec spec;
  spec.job.name = "test";
  spec.image.width = width;
  spec.image.height = height;
  spec.integrator.type = type;
  spec.integrator.photons = photons;
  return spec;
}

}  // namespace pf::test
