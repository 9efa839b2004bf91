#include "common/film/pass_order.h"

#include <algorithm>
#include <vector>

#include <gtest/gtest.h>

#include "common/film/film.h"

namespace pf {
namespace {

FilmOptions tiled(int width, int height, int edge) {
  FilmOptions options;
  options.width = width;
  options.height = height;
  options.extra = Extra::kGatherPoints;
  options.part_edge = edge;
  return options;
}

TEST(PassOrder, CountsTheSamplesThatPartsBring) {
  constexpr int kWidth = 37, kHeight = 21;
  for (const int edge : {0, 1, 5, 16, 64}) {
    const PassOrder order(tiled(kWidth, kHeight, edge));
    std::vector<std::uint64_t> samples(kWidth * kHeight);
    const std::uint64_t end = 2 * order.sweep() + order.sweep() / 3 + 1;
    for (std::uint64_t s = 0; s < end; ++s) {
      const ImagePart part = order.part(s);
      ASSERT_LT(part.x0, part.x1);
      ASSERT_LT(part.y0, part.y1);
      for (int y = part.y0; y < part.y1; ++y) {
        for (int x = part.x0; x < part.x1; ++x) {
          std::uint64_t& count = samples[static_cast<std::size_t>(y * kWidth + x)];
          ASSERT_EQ(part.sample, count++) << "samples of a pixel come in order, each once";
        }
      }
      if (s % 7 != 0 && s + 1 != end) continue;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          ASSERT_EQ(order.samples(x, y, s + 1), samples[static_cast<std::size_t>(y * kWidth + x)]) << edge;
        }
      }
      ASSERT_EQ(order.whole_passes(s + 1), *std::min_element(samples.begin(), samples.end()));
    }
  }
}

TEST(PassOrder, EndsWithWholeSweeps) {
  const PassOrder order(tiled(64, 64, 16));
  EXPECT_EQ(order.sub_passes(0), 0u);
  EXPECT_EQ(order.sub_passes(1), order.sweep());
  EXPECT_EQ(order.sub_passes(4), order.sweep());
  EXPECT_EQ(order.sub_passes(5), 2 * order.sweep());
  EXPECT_EQ(order.whole_passes(order.sub_passes(5)), 8u);
  EXPECT_EQ(PassOrder(tiled(64, 64, 0)).sub_passes(5), 5u);
}

TEST(Film, DividesEveryPixelByTheSamplesThatItHas) {
  const FilmOptions options = tiled(32, 16, 16);  // two tiles
  Film film(options);
  Statistics& sums = film.sums();
  // The first tile has four samples, the second two: each of radiance 2 direct and 1 specular.
  for (std::size_t i = 0; i < sums.pixels.size(); ++i) {
    const std::int64_t n = i % 32 < 16 ? 4 : 2;
    sums.pixels[i].direct.fill(n * (std::int64_t{2} << 24));
    sums.extras[i].rgb.fill(n * (std::int64_t{1} << 24));
    sums.extras[i].marks = n;
  }
  sums.sub_passes = 6;
  const LayeredImage image = film.image();
  for (const Layer& layer : image.layers) {
    const float expected = layer.name.empty()         ? 3.0f
                           : layer.name == "direct"   ? 2.0f
                           : layer.name == "specular" ? 1.0f
                                                      : -1.0f;
    for (std::size_t i = 0; expected > 0.0f && i < layer.data.size(); ++i)
      ASSERT_FLOAT_EQ(layer.data[i], expected) << layer.name;
    if (layer.name == "gather_points") {
      EXPECT_EQ(layer.data[0] + layer.data[31], 6.0f);
    }
  }
  EXPECT_EQ(image.layers[2].name, "specular");
  EXPECT_EQ(image.layers.back().name, "gather_points");
  EXPECT_EQ(film.round_end(), 16u) << "a round is whole sweeps, the first two of them, so that the error is looked at "
                                      "when every pixel has as many samples";
}

}  // namespace
}  // namespace pf
