#include <fstream>
#include <iterator>
#include <span>

#include <gtest/gtest.h>

#include "common/base/hash.h"
#include "common/film/film.h"
#include "common/film/render_result.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

constexpr int kWidth = 7;
constexpr int kHeight = 5 * kImageRowsAtOnce + 3;  // the last block is a short one, and so is OpenEXR's

/// In the middle of a round, every pixel another one.
Film some_film(Estimator estimator) {
  Film film({kWidth, kHeight, estimator, SumScale::from_scene(2.0, 1e-5, 3.0), 2.0 / 3.0, 0.25});
  std::vector<ProgressivePixel> radii(film.state().size());
  for (ProgressivePixel& p : radii) p[kCaustic].radius2 = p[kIndirect].radius2 = 0.5f;
  film.set_initial_radii(std::move(radii));
  for (std::uint32_t pass = 0; pass < 7; ++pass) {
    Statistics sums(kWidth, kHeight);
    sums.sub_passes = 1;
    for (std::uint32_t i = 0; i < sums.pixels.size(); ++i) {
      sums.pixels[i].direct = {i << 20, i << 21, pass << 22};
      sums.pixels[i].flow[kCaustic] = {i * pass << 12, i << 10, 77};
      sums.pixels[i].photons = {i % 5 * pass, pass};
      sums.features[i].albedo = {static_cast<std::int16_t>(i), 5, 6};
      sums.features[i].add_depth(i + pass);
    }
    EXPECT_TRUE(film.sums().add(sums));
    film.close_round_if_complete();
  }
  EXPECT_NE(film.sub_passes(), film.round_begin());
  return film;
}

TEST(ImageRows, OfAFilmAreTheWholeImageInAnyBlocks) {
  for (const Estimator estimator : {Estimator::kPath, Estimator::kShared, Estimator::kIndependent}) {
    const Film film = some_film(estimator);
    const LayeredImage whole = film.image();
    const ImageRows rows = film.image_rows();
    for (const int step : {1, 4, 1000}) {
      std::vector<std::vector<float>> gathered(whole.layers.size());
      for (int first = 0; first < kHeight; first += step) {
        const std::vector<Layer> block = rows.rows(first, std::min(step, kHeight - first));
        ASSERT_EQ(block.size(), whole.layers.size());
        for (std::size_t i = 0; i < block.size(); ++i) {
          EXPECT_EQ(block[i].name, whole.layers[i].name);
          gathered[i].insert(gathered[i].end(), block[i].data.begin(), block[i].data.end());
        }
      }
      for (std::size_t i = 0; i < gathered.size(); ++i) EXPECT_EQ(gathered[i], whole.layers[i].data) << step;
    }
  }
}

TEST(ImageRows, MakeTheSameFileAsTheWholeImage) {
  const TempFolder folder;
  const Film film = some_film(Estimator::kShared);
  ASSERT_TRUE(write_exr(folder / "whole.exr", film.image()));
  ASSERT_TRUE(write_exr(folder / "rows.exr", film.image_rows()));
  EXPECT_TRUE(bytes_of(folder / "whole.exr") == bytes_of(folder / "rows.exr"));
  const auto read = read_exr(folder / "rows.exr");
  ASSERT_TRUE(read);
  for (const Layer& layer : film.image().layers) {
    ASSERT_NE(read->find(layer.name), nullptr) << layer.name;
    EXPECT_EQ(read->find(layer.name)->data.size(), layer.data.size());
  }
  EXPECT_EQ(read->layers.front().data, film.image().layers.front().data);
}

TEST(ImageRows, AreAskedForOnceAndFromTheTop) {
  const TempFolder folder;
  const Film film = some_film(Estimator::kPath);
  ImageRows rows = film.image_rows();
  int next = 0;
  rows.rows = [&](int first, int count) {
    EXPECT_EQ(first, next);
    next = first + count;
    return film.image_rows().rows(first, count);
  };
  ASSERT_TRUE(write_exr(folder / "a.exr", rows));
  EXPECT_EQ(next, kHeight);
  next = 0;
  ASSERT_TRUE(write_png(folder / "a.png", rows, 0.0f));
  EXPECT_EQ(next, kHeight);
}

TEST(ImageRows, ThatDoNotFitLeaveTheOldFile) {
  const TempFolder folder;
  const Film film = some_film(Estimator::kPath);
  ASSERT_TRUE(write_exr(folder / "a.exr", film.image_rows()));
  ASSERT_TRUE(write_png(folder / "a.png", film.image_rows(), 0.0f));
  const std::string exr = bytes_of(folder / "a.exr");
  const std::string png = bytes_of(folder / "a.png");
  ImageRows rows = film.image_rows();
  // Short, then without layers, each in the second block: the first is written already.
  for (const bool none : {false, true}) {
    rows.rows = [&](int first, int count) {
      std::vector<Layer> block = film.image_rows().rows(first, count);
      if (first > 0) block.front().data.pop_back();
      if (first > 0 && none) block.clear();
      return block;
    };
    EXPECT_EQ(write_exr(folder / "a.exr", rows).error().kind, ErrorKind::kInternal);
    EXPECT_EQ(write_png(folder / "a.png", rows, 0.0f).error().kind, ErrorKind::kInternal);
  }
  EXPECT_TRUE(bytes_of(folder / "a.exr") == exr);
  EXPECT_TRUE(bytes_of(folder / "a.png") == png);
}

TEST(ImageHash, IsThatOfTheBeautysFloats) {
  const TempFolder folder;
  const Film film = some_film(Estimator::kShared);
  ResultLabels labels;
  labels.name = "a";
  RenderResult result;
  ASSERT_TRUE(write_images(film, labels, folder.path(), result));
  EXPECT_EQ(result.image_hash, sha256_hex(std::as_bytes(std::span(film.image().layers.front().data))));
}

}  // namespace
}  // namespace pf
