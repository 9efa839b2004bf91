// A collimated beam through a glass ball onto a plane two radii behind its centre: irradiance in closed form
// along each ray, E(r) / E0 = sum over branches of T(h) h / (r |dr/dh|).
// scenes/analytic/ball_caustic_z2.0.{glb,csv}; Embree's ball has 32,512 facets with interpolated normals,
// which the tolerances below name.

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>

#include <gtest/gtest.h>

#include "tests/support/paths.h"
#include "tests/support/render.h"
#include "tests/support/scenes.h"
#include "worker/photon/photon_tracer.h"
#include "worker/scene/gltf_loader.h"

namespace pf::test {
namespace {

constexpr double kBeam = 3.14159265358979323846;  // E0 of the file [W/m^2]

struct Ring {
  double inner, outer, irradiance;
};

std::filesystem::path folder() { return test::shared_dir() / "scenes/analytic"; }

/// The table: mean irradiance / E0 of each ring, photons that cross two interfaces only.
std::vector<Ring> read_table() {
  std::ifstream in(folder() / "ball_caustic_z2.0.csv");
  std::vector<Ring> rings;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || !std::isdigit(static_cast<unsigned char>(line[0]))) continue;
    std::istringstream row(line);
    std::array<double, 4> v{};
    char comma = 0;
    for (double& x : v) row >> x >> comma;
    rings.push_back({v[0], v[1], v[3]});
  }
  return rings;
}

/// Adds what the table leaves out: light reflected by the outside of the ball at grazing incidence, and light
/// that leaves after one to six reflections inside. By rays, as the table was made; angles are from the
/// beam's axis.
void add_reflections(std::vector<Ring>& rings) {
  constexpr int kRays = 400000;
  const auto land = [&](double place, double direction, double flux) {
    if (std::cos(direction) <= 0.0) return;
    const double r = std::abs(std::sin(place) + std::tan(direction) * (2.0 - std::cos(place)));
    for (Ring& ring : rings) {
      if (r < ring.inner || r >= ring.outer) continue;
      ring.irradiance += flux / (std::numbers::pi * (ring.outer * ring.outer - ring.inner * ring.inner));
    }
  };
  for (int i = 0; i < kRays; ++i) {
    const double h = (i + 0.5) / kRays;
    const double theta_i = std::asin(h);
    const double theta_t = std::asin(h / 1.5);
    const double s = std::sin(theta_i - theta_t) / std::sin(theta_i + theta_t);
    const double p = std::tan(theta_i - theta_t) / std::tan(theta_i + theta_t);
    const double reflected = 0.5 * (s * s + p * p);
    const double flux = 2.0 * std::numbers::pi * h / kRays;
    const double entry = std::numbers::pi - theta_i;
    land(entry, std::numbers::pi - 2.0 * theta_i, flux * reflected);
    for (int k = 1; k <= 6; ++k) {
      const double exit = entry - (k + 1) * (std::numbers::pi - 2.0 * theta_t);
      land(exit, exit - theta_i, flux * (1.0 - reflected) * (1.0 - reflected) * std::pow(reflected, k));
    }
  }
}

class GlassBall : public testing::Test {
 protected:
  void SetUp() override {
    const auto file = folder() / "ball_caustic_z2.0.glb";
    if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is absent";
    auto description = load_gltf({.file = file});
    ASSERT_TRUE(description) << description.error().message;
    // A smaller floor leaves fewer photons beside the ball; the camera stands between ball and floor.
    for (MeshInstance& instance : description->instances) {
      if (description->meshes[static_cast<std::size_t>(instance.mesh)].positions.size() > 100) continue;
      Matrix44f shrink;
      shrink.setScale(Vec3f(0.25f, 1.0f, 0.25f));
      instance.object_to_world = shrink * instance.object_to_world;
    }
    Camera camera = description->cameras.front();
    camera.camera_to_world = Matrix44f(1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, -1.5f, 0, 1);
    camera.orthographic = true;
    camera.xmag = camera.ymag = 1.25f;
    description->cameras = {camera};
    auto scene = Scene::build(std::move(*description));
    ASSERT_TRUE(scene) << scene.error().message;
    scene_ = std::move(*scene);
    rings_ = read_table();
    ASSERT_EQ(rings_.size(), 60u);
  }
  std::unique_ptr<const Scene> scene_;
  std::vector<Ring> rings_;
};

/// The first rings taken together in fours: some hundred photons each.
std::vector<Ring> wide(const std::vector<Ring>& rings) {
  std::vector<Ring> out;
  for (std::size_t i = 0; i + 3 < rings.size(); i += 4) {
    Ring sum{rings[i].inner, rings[i + 3].outer, 0.0};
    for (std::size_t k = i; k < i + 4; ++k) {
      sum.irradiance += rings[k].irradiance * (rings[k].outer * rings[k].outer - rings[k].inner * rings[k].inner);
    }
    sum.irradiance /= sum.outer * sum.outer - sum.inner * sum.inner;
    if (sum.outer <= 1.5) out.push_back(sum);
  }
  return out;
}

TEST_F(GlassBall, PhotonsLandInTheRingsOfTheClosedForm) {
  add_reflections(rings_);
  const std::vector<Ring> rings = wide(rings_);
  const PhotonTracer tracer(*scene_, {11, 60000, 32});
  std::vector<std::vector<double>> found(rings.size());
  for (std::uint64_t sub_pass = 0; sub_pass < 12; ++sub_pass) {
    const PhotonBatch batch = tracer.trace(sub_pass);
    const Photons& photons = batch.flows[kCaustic];
    std::vector<double> flux(rings.size());
    for (const Photon& photon : photons) {
      if (photon.position.y > -1.99f) continue;
      const double r = std::hypot(double{photon.position.x}, double{photon.position.z});
      for (std::size_t k = 0; k < rings.size(); ++k) {
        if (r >= rings[k].inner && r < rings[k].outer) flux[k] += double{photon.flux.x} * tracer.flux_unit();
      }
    }
    for (std::size_t k = 0; k < rings.size(); ++k) found[k].push_back(flux[k]);
  }
  std::vector<Estimate> measured;
  std::vector<double> expected;
  for (std::size_t k = 0; k < rings.size(); ++k) {
    measured.push_back(estimate(found[k]));
    expected.push_back(kBeam * rings[k].irradiance * std::numbers::pi *
                       (rings[k].outer * rings[k].outer - rings[k].inner * rings[k].inner));
  }
  constexpr double kFacets = 0.01;
  EXPECT_TRUE(all_agree(measured, expected, kFacets));
}

TEST_F(GlassBall, TransmitsTheFluxOfTheClosedForm) {
  // 0.8354 of the beam crosses two interfaces (0.8404 by polarisation); most of that lands within r < 1.5.
  double two_interfaces = 0.0;
  for (const Ring& ring : rings_)
    two_interfaces += ring.irradiance * (ring.outer * ring.outer - ring.inner * ring.inner);
  EXPECT_GT(two_interfaces, 0.80);
  EXPECT_LT(two_interfaces, 0.8354);
  add_reflections(rings_);
  double expected = 0.0;
  for (const Ring& ring : rings_) {
    if (ring.outer <= 1.5)
      expected += kBeam * ring.irradiance * std::numbers::pi * (ring.outer * ring.outer - ring.inner * ring.inner);
  }
  const PhotonTracer tracer(*scene_, {12, 60000, 32});
  std::vector<double> totals;
  for (std::uint64_t sub_pass = 0; sub_pass < 12; ++sub_pass) {
    const PhotonBatch batch = tracer.trace(sub_pass);
    const Photons& photons = batch.flows[kCaustic];
    double sum = 0.0;
    for (const Photon& photon : photons) {
      if (photon.position.y < -1.99f && std::hypot(photon.position.x, photon.position.z) < 1.5f)
        sum += double{photon.flux.x} * tracer.flux_unit();
    }
    totals.push_back(sum);
  }
  EXPECT_TRUE(agrees(estimate(totals), expected, 0.003 * expected));
}

TEST_F(GlassBall, SppmShowsTheProfileOfTheClosedForm) {
  add_reflections(rings_);
  constexpr int kSize = 50;  // pixels of 5 cm: as the table's wide rings
  for (const ProgressiveMode mode : {ProgressiveMode::kShared, ProgressiveMode::kIndependent}) {
    JobSpec spec = job(kSize, kSize, IntegratorType::kSppm, 30000);
    spec.integrator.mode = mode;
    const std::vector<Estimate> pixels = Renders(*scene_, spec, 4, 8, "caustics").pixels();
    // Mean over the pixels of wide rings, and of the closed form over the same pixels.
    const auto irradiance_at = [&](double r) {
      for (const Ring& ring : rings_) {
        if (r < ring.outer) return ring.irradiance;
      }
      return 0.0;
    };
    constexpr int kRings = 5;
    std::array<double, kRings> measured{}, expected{}, error{}, count{};
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        const auto metres = [](double p) { return 2.5 * p / kSize - 1.25; };
        const auto ring = static_cast<std::size_t>(std::hypot(metres(x + 0.5), metres(y + 0.5)) / 0.2);
        if (ring >= kRings) continue;
        double mean = 0.0;
        constexpr int kSub = 8;
        for (int i = 0; i < kSub * kSub; ++i) {
          mean += irradiance_at(std::hypot(metres(x + (i % kSub + 0.5) / kSub), metres(y + (i / kSub + 0.5) / kSub))) /
                  (kSub * kSub);
        }
        const Estimate& e = pixels[static_cast<std::size_t>(y * kSize + x)];
        measured[ring] += e.mean;
        error[ring] += e.error * e.error;
        expected[ring] += 0.5 * kBeam / std::numbers::pi * mean;
        count[ring] += 1.0;
      }
    }
    std::vector<Estimate> rings;
    for (std::size_t k = 0; k < kRings; ++k) {
      // Neighbouring pixels share photons: their errors add up as if they were one.
      rings.push_back({measured[k] / count[k], std::sqrt(error[k] / count[k]), 8});
    }
    std::vector<double> closed;
    for (std::size_t k = 0; k < kRings; ++k) closed.push_back(expected[k] / count[k]);
    constexpr double kBlur = 0.03;  // discs as wide as a pixel, on a profile that falls by half within two
    EXPECT_TRUE(all_agree(rings, closed, kBlur)) << to_string(mode);
  }
}

}  // namespace
}  // namespace pf::test
