#include "tests/support/render.h"

#include <algorithm>

#include "worker/integrators/factory.h"
#include "worker/integrators/guided_emission.h"

namespace pf::test {

std::unique_ptr<const Integrator> make_integrator(const Scene& scene, const JobSpec& spec) {
  const Camera& camera = scene.cameras().front();
  EmissionGuide guide;
  if (spec.integrator.guide_emission == Switch::kOn) guide = learn_emission(scene, camera, spec).guide;
  return pf::make_integrator(spec.integrator.type, scene, camera, spec, {}, std::move(guide));
}

Film render(const Integrator& integrator, std::uint64_t passes) {
  Film film(integrator.film_options());
  const std::uint64_t sub_passes = film.order().sub_passes(passes);
  auto radii = integrator.initial_radii();
  if (!radii.empty()) film.set_initial_radii(std::move(radii));
  while (film.sub_passes() < sub_passes) {
    // Only shared radii know rounds: elsewhere the film's round never ends.
    const bool rounds = film.options().estimator == Estimator::kShared;
    const std::uint64_t end = rounds ? std::min(film.round_end(), sub_passes) : sub_passes;
    integrator.run({film.sub_passes(), end - film.sub_passes()}, film.state(), film.sums());
    film.close_round_if_complete();
  }
  return film;
}

Film render(const Scene& scene, const JobSpec& spec, std::uint64_t passes) {
  return render(*make_integrator(scene, spec), passes);
}

std::vector<Rgb> layer_of(const Film& film, std::string_view layer) {
  const LayeredImage image = film.image();
  std::vector<Rgb> pixels;
  for (const Layer& l : image.layers) {
    if (l.name != layer) continue;
    for (std::size_t i = 0; i + 2 < l.data.size(); i += 3) pixels.emplace_back(l.data[i], l.data[i + 1], l.data[i + 2]);
  }
  EXPECT_FALSE(pixels.empty()) << "no layer " << layer;
  return pixels;
}

Renders::Renders(const Scene& scene, const JobSpec& spec, std::uint64_t sub_passes, int runs, std::string_view layer)
    : width_(spec.image.width), height_(spec.image.height) {
  for (int run = 0; run < runs; ++run) {
    JobSpec seeded = spec;
    // Seeds of one test are far from those of another kind of algorithm: no two estimates share random
    // numbers.
    seeded.integrator.seed =
        static_cast<std::uint64_t>(1 + run) + (spec.integrator.type == IntegratorType::kPath ? 1000u : 2000u);
    const Film film = render(scene, seeded, sub_passes);
    EXPECT_EQ(film.sums().faults.not_finite, 0u);
    EXPECT_EQ(film.sums().faults.overflow, 0u);
    images_.push_back(layer_of(film, layer));
  }
}

Estimate Renders::mean() const { return blocks(1, 1).front(); }

Estimate Renders::channel(int c) const {
  std::vector<double> values;
  for (const auto& image : images_) {
    double sum = 0.0;
    for (const Rgb& pixel : image) sum += double{pixel[c]};
    values.push_back(sum / static_cast<double>(image.size()));
  }
  return estimate(values);
}

std::vector<Estimate> Renders::pixels() const { return blocks(width_, height_); }

std::vector<Estimate> Renders::blocks(int columns, int rows) const {
  const auto cells = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  std::vector<std::vector<double>> values(cells);
  for (const auto& image : images_) {
    std::vector<double> sums(cells), counts(cells);
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        const Rgb& pixel =
            image[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
        const auto cell = static_cast<std::size_t>(y * rows / height_) * static_cast<std::size_t>(columns) +
                          static_cast<std::size_t>(x * columns / width_);
        sums[cell] += (double{pixel.x} + double{pixel.y} + double{pixel.z}) / 3.0;
        counts[cell] += 1.0;
      }
    }
    for (std::size_t i = 0; i < cells; ++i) values[i].push_back(sums[i] / counts[i]);
  }
  std::vector<Estimate> estimates;
  for (const auto& v : values) estimates.push_back(estimate(v));
  return estimates;
}

}  // namespace pf::test
