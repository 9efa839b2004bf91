#include <bit>
#include <span>

#include "common/base/hash.h"
#include "common/math/philox.h"
#include "tests/simulation/world.h"

namespace pf::test {

FilmOptions pretended_film(const JobSpec& spec) {
  FilmOptions options;
  options.width = spec.image.width;
  options.height = spec.image.height;
  const bool tiles = spec.integrator.type == IntegratorType::kPhotonMap;
  options.estimator = spec.integrator.type == IntegratorType::kPath || tiles ? Estimator::kPath
                      : spec.integrator.mode == ProgressiveMode::kShared     ? Estimator::kShared
                                                                             : Estimator::kIndependent;
  options.scale = SumScale::from_scene(1.0, 1e-3, 2.0);
  options.alpha = spec.integrator.alpha;
  options.round_growth = spec.integrator.round_growth;
  if (tiles) {
    options.extra = Extra::kSpecular;
    options.part_edge = 3;
  }
  return options;
}

std::vector<ProgressivePixel> pretended_radii(const JobSpec& spec) {
  if (pretended_film(spec).estimator == Estimator::kPath) return {};
  std::vector<ProgressivePixel> state(static_cast<std::size_t>(spec.image.width * spec.image.height));
  for (std::size_t i = 0; i < state.size(); ++i) {
    state[i][kCaustic].radius2 = 0.1f + 0.01f * static_cast<float>(i);
    state[i][kIndirect].radius2 = 0.5f + 0.02f * static_cast<float>(i);
    state[i].covered_radius = i % 2 == 0 ? kInfinity : 0.25f;
  }
  return state;
}

void pretend_to_trace(const JobSpec& spec, std::uint64_t first, std::uint64_t count,
                      const std::vector<ProgressivePixel>& state, Statistics& sums) {
  const FilmOptions film = pretended_film(spec);
  const bool path = film.estimator == Estimator::kPath;
  const PassOrder order(film);
  sums.make_room(order.part(first).sample, film.extra);
  for (std::uint64_t s = first; s < first + count; ++s) {
    const ImagePart part = order.part(s);
    for (std::size_t i = 0; i < sums.pixels.size(); ++i) {
      const auto x = static_cast<int>(i) % film.width;
      const auto y = static_cast<int>(i) / film.width;
      if (x < part.x0 || x >= part.x1 || y < part.y0 || y >= part.y1) continue;
      PathRng rng(spec.integrator.seed, Stream::kTest, s, static_cast<std::uint32_t>(i));
      PixelSums& pixel = sums.pixels[i];
      const auto number = [&] { return static_cast<std::int64_t>(rng.next1() * 1e8f); };
      for (auto& c : pixel.direct) c += number();
      pixel.square += number();
      for (const Flow flow : {kCaustic, kIndirect}) {
        // As in the real thing, what is found depends on the round's radius: work done with an old one would show.
        const float radius2 = path ? 1.0f : state[i][flow].radius2;
        pixel.photons[flow] += static_cast<std::uint32_t>(rng.next1() * 40.0f * radius2);
        for (auto& c : pixel.flow[flow]) c += static_cast<std::int64_t>(rng.next1() * 1e8f * radius2);
      }
      if (film.extra != Extra::kNone) sums.extras[i].rgb[0] += number();
      if (part.sample < kFeatureSubPasses) {
        sums.features[i].albedo[0] = static_cast<std::int16_t>(sums.features[i].albedo[0] + 100);
        sums.features[i].add_depth(1000.0 + static_cast<double>(s));
      }
    }
    sums.rays += 100;
    if (!path) sums.photon_paths += static_cast<std::uint64_t>(photon_paths(spec));
  }
  sums.sub_passes += count;
}

std::string hash_of_single_node(const JobSpec& spec) {
  Film film(pretended_film(spec));
  if (auto radii = pretended_radii(spec); !radii.empty()) film.set_initial_radii(std::move(radii));
  while (film.sub_passes() < film.order().sub_passes(static_cast<std::uint64_t>(spec.stop.passes))) {
    pretend_to_trace(spec, film.sub_passes(), 1, film.state(), film.sums());
    film.close_round_if_complete();
  }
  const LayeredImage image = film.image();
  return sha256_hex(std::as_bytes(std::span(image.layers.front().data)));
}

}  // namespace pf::test
