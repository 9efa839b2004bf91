#pragma once

#include <cstdint>

#include "common/film/film_options.h"

namespace pf {

/// What one sub-pass covers: the pixels [x0, x1) x [y0, y1), each with the eye sample of this index.
struct ImagePart {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  std::uint64_t sample = 0;
};

/// Which part of the image a sub-pass covers, so that methods whose single pass is long spread over a farm by image
/// tiles. Sub-passes come in groups of kSamplesTogether samples of one tile, then the next tile: who takes a group
/// makes what the tile's samples share once. With FilmOptions::part_edge 0 a sub-pass covers the whole image.
class PassOrder {
 public:
  static constexpr std::uint64_t kSamplesTogether = 4;

  explicit PassOrder(const FilmOptions& options);
  [[nodiscard]] ImagePart part(std::uint64_t sub_pass) const;
  /// Tiles of the image; 1 without tiles.
  [[nodiscard]] std::uint64_t parts() const { return columns_ * rows_; }
  /// Sub-passes after which the same tile comes again; 1 without tiles.
  [[nodiscard]] std::uint64_t sweep() const { return edge_ <= 0 ? 1 : kSamplesTogether * parts(); }
  /// Sub-passes after which every pixel has at least so many samples, in whole sweeps (0: 0).
  [[nodiscard]] std::uint64_t sub_passes(std::uint64_t passes) const;
  /// Samples of the pixel when the first `sub_passes` are done, whichever part it lies in.
  [[nodiscard]] std::uint64_t samples(int x, int y, std::uint64_t sub_passes) const;
  /// Samples that every pixel has by then.
  [[nodiscard]] std::uint64_t whole_passes(std::uint64_t sub_passes) const;
  /// Samples that a pixel has on average, rounded down: for progress.
  [[nodiscard]] std::uint64_t mean_passes(std::uint64_t sub_passes) const { return sub_passes / parts(); }
  /// Edge of the tiles of an image that is cut into about 64 of them: a multiple of 16.
  [[nodiscard]] static int edge_for(int width, int height);

 private:
  [[nodiscard]] std::uint64_t samples_of_tile(std::uint64_t tile, std::uint64_t sub_passes) const;

  int width_, height_, edge_;
  std::uint64_t columns_ = 1, rows_ = 1;
};

}  // namespace pf
