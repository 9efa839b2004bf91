#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "common/base/result.h"
#include "worker/scene/image_reader.h"

namespace pf {

/// Texels of one image in the encoding of its file, in blocks of 4 x 4, so that the four texels of a bilinear
/// lookup lie in one or two cache lines most of the time.
class TexturePixels {
 public:
  /// Room for an image: in memory, or in an unlinked temporary file that is mapped to memory. Errors:
  /// kInternal.
  [[nodiscard]] static Result<TexturePixels> allocate(const PixelLayout& layout, bool in_memory,
                                                      const std::string& name);
  /// Bytes that an image takes.
  [[nodiscard]] static std::size_t bytes(const PixelLayout& layout);

  void set_row(std::size_t y, std::span<const std::uint8_t> row);
  /// First byte of a texel: layout().channels values of layout().bytes_per_channel bytes.
  [[nodiscard]] const std::uint8_t* texel(std::size_t x, std::size_t y) const { return data_.get() + offset(x, y); }
  [[nodiscard]] const PixelLayout& layout() const { return layout_; }

 private:
  struct Release {
    std::size_t mapped;  ///< bytes of a mapping, or 0 for memory from the heap
    void operator()(std::uint8_t* p) const;
  };

  [[nodiscard]] std::size_t offset(std::size_t x, std::size_t y) const {
    return (((y >> 2) * blocks_per_row_ + (x >> 2)) * 16 + (y & 3) * 4 + (x & 3)) * texel_bytes_;
  }

  PixelLayout layout_;
  std::size_t blocks_per_row_ = 0;
  std::size_t texel_bytes_ = 0;
  std::unique_ptr<std::uint8_t[], Release> data_{nullptr, Release{0}};
};

}  // namespace pf
