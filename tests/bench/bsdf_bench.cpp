// Nanoseconds for building a BSDF, and for building and sampling it, as a photon's bounce does; and for
// eval() alone, as a gathered photon does.
#include <benchmark/benchmark.h>

#include <vector>

#include "common/math/sampling.h"
#include "worker/bsdf/bsdf.h"

namespace {

using namespace pf;

SurfaceParams lambert() {
  SurfaceParams p;
  p.base_color = {0.7f, 0.5f, 0.3f};
  p.specular = 0.0f;
  return p;
}
SurfaceParams plastic() {
  SurfaceParams p = lambert();
  p.specular = 1.0f;
  p.roughness = 0.4f;
  return p;
}
SurfaceParams glass() {
  SurfaceParams p;
  p.roughness = 0.0f;
  p.transmission = 1.0f;
  p.thin_walled = false;
  return p;
}
SurfaceParams metal() {
  SurfaceParams p;
  p.metallic = 1.0f;
  p.roughness = 0.3f;
  return p;
}
SurfaceParams full() {
  SurfaceParams p = plastic();
  p.metallic = 0.2f;
  p.transmission = 0.4f;
  p.thin_walled = false;
  p.clearcoat = 1.0f;
  p.clearcoat_roughness = 0.2f;
  p.sheen_color = {0.3f, 0.3f, 0.3f};
  p.sheen_roughness = 0.5f;
  return p;
}

/// 256 directions and random numbers, so that nothing can be computed once.
struct Inputs {
  std::vector<Vec3f> wo, wi;
  std::vector<Vec2f> u;
  Inputs() {
    for (int i = 0; i < 256; ++i) {
      const auto x = static_cast<float>(i) + 0.5f;
      const Vec2f v(x / 256.0f, x * 0.618034f - static_cast<float>(static_cast<int>(x * 0.618034f)));
      u.push_back(v);
      wo.push_back(sample_cosine_hemisphere(v));
      wi.push_back(sample_cosine_hemisphere({v.y, v.x}));
    }
  }
};

void construct(benchmark::State& state, SurfaceParams (*make)()) {
  const Inputs in;
  const SurfaceParams p = make();
  unsigned i = 0;
  for (auto _ : state) {
    const Bsdf bsdf(p, in.wo[i++ & 255]);
    benchmark::DoNotOptimize(&bsdf);
  }
}

void bounce(benchmark::State& state, SurfaceParams (*make)()) {
  const Inputs in;
  const SurfaceParams p = make();
  unsigned i = 0;
  for (auto _ : state) {
    const unsigned k = i++ & 255;
    const Bsdf bsdf(p, in.wo[k]);
    auto s = bsdf.sample(in.wo[k], in.u[255 - k].y, in.u[255 - k], Transport::kFlux);
    benchmark::DoNotOptimize(s);
  }
}

void gather(benchmark::State& state, SurfaceParams (*make)()) {
  const Inputs in;
  const Bsdf bsdf(make(), in.wo[100]);
  unsigned i = 0;
  for (auto _ : state) {
    Rgb f = bsdf.eval(in.wo[100], in.wi[i++ & 255], Transport::kRadiance, Portion::kGather);
    benchmark::DoNotOptimize(f);
  }
}

BENCHMARK_CAPTURE(construct, lambert, lambert);
BENCHMARK_CAPTURE(construct, full, full);
BENCHMARK_CAPTURE(bounce, lambert, lambert);
BENCHMARK_CAPTURE(bounce, plastic, plastic);
BENCHMARK_CAPTURE(bounce, glass, glass);
BENCHMARK_CAPTURE(bounce, metal, metal);
BENCHMARK_CAPTURE(bounce, full, full);
BENCHMARK_CAPTURE(gather, lambert, lambert);
BENCHMARK_CAPTURE(gather, plastic, plastic);
BENCHMARK_CAPTURE(gather, full, full);

}  // namespace
