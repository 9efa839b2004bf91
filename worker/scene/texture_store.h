#pragma once

#include <memory>
#include <vector>

#include "common/base/result.h"
#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// All textures of a scene behind OpenImageIO's texture cache (bounded memory), filtered in linear light.
class TextureStore {
 public:
  /// Opens every texture once, so that a broken image is found before rendering. A texture that cannot be read is
  /// an error of kind kInvalidInput naming the file.
  [[nodiscard]] static Result<TextureStore> open(const std::vector<Texture>& textures, std::size_t cache_megabytes = 256);
  TextureStore(TextureStore&&) noexcept;
  TextureStore& operator=(TextureStore&&) noexcept;
  ~TextureStore();

  /// Linear RGBA at uv (already transformed; glTF convention: v=0 is the image's top row), bilinear on the full
  /// resolution (or nearest), wrapped as the sampler says. Missing channels: grey is replicated, alpha is 1. Thread-safe.
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
