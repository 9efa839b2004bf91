#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// All textures of a scene, decoded by OpenImageIO once and kept in the encoding of their file (8 or 16 bits
/// a channel); texels are made linear by table when they are looked up, then filtered. PNG and JPEG cannot be
/// read tile by tile, so that a cache which drops tiles would decode whole images again and again; and linear
/// light needs twice the bits. Textures that share an image share its pixels. Memory stays bounded: what is
/// beyond the given size lives in an unlinked file in the temporary folder, mapped to memory, which the
/// system may write out.
class TextureStore {
 public:
  /// Decodes every image, so that a broken one is found before rendering. Errors: kInvalidInput naming the
  /// file (or the texture, when it has none): missing, broken, truncated, neither PNG nor JPEG nor WebP,
  /// wider or higher than 16384; kInternal: no room in memory or in the temporary folder.
  [[nodiscard]] static Result<TextureStore> open(const std::vector<Texture>& textures,
                                                 std::size_t cache_megabytes = 256);
  TextureStore(TextureStore&&) noexcept;
  TextureStore& operator=(TextureStore&&) noexcept;
  ~TextureStore();

  /// Linear RGBA at uv (already transformed; glTF convention: v=0 is the image's top row), bilinear on the
  /// full resolution (or nearest), wrapped as the sampler says. Missing channels: grey is replicated, alpha
  /// is 1. Thread-safe.
  [[nodiscard]] Vec4f lookup(int texture, const Vec2f& uv) const;
  [[nodiscard]] bool empty() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  explicit TextureStore(std::unique_ptr<Impl> impl);
};

/// uv' of KHR_texture_transform.
[[nodiscard]] Vec2f transform_uv(const TextureRef& ref, const Vec2f& uv);

}  // namespace pf
