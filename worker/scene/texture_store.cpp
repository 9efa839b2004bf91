#include "worker/scene/texture_store.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "common/base/parallel.h"
#include "worker/scene/image_reader.h"
#include "worker/scene/texture_pixels.h"

namespace pf {
namespace {

constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{1} << 31;

/// Inverse of the sRGB transfer function [IEC 61966-2-1].
double srgb_to_linear(double x) { return x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4); }

/// Linear value of every code of an encoding with 8 or 16 bits.
std::vector<float> linear_table(std::size_t codes, ColorSpace space) {
  std::vector<float> table(codes);
  for (std::size_t i = 0; i < codes; ++i) {
    const double x = static_cast<double>(i) / static_cast<double>(codes - 1);
    table[i] = static_cast<float>(space == ColorSpace::kSrgb ? srgb_to_linear(x) : x);
  }
  return table;
}

/// Position along one axis, in texels from the left or top border of the image: in [0, size].
float wrapped(float x, Wrap wrap, std::size_t size) {
  if (!std::isfinite(x)) return 0.0f;
  switch (wrap) {
    case Wrap::kRepeat:
      x -= std::floor(x);
      break;
    case Wrap::kMirror:
      x -= 2.0f * std::floor(0.5f * x);
      if (x > 1.0f) x = 2.0f - x;
      break;
    case Wrap::kClamp:
      break;
  }
  return std::clamp(x, 0.0f, 1.0f) * static_cast<float>(size);
}

/// The two texels beside a position, and the weight of the second. Texel centres lie at i + 0.5.
struct Neighbours {
  std::size_t low = 0, high = 0;
  float weight = 0;
};

Neighbours neighbours(float position, Wrap wrap, std::size_t size) {
  const float shifted = position - 0.5f;
  const float floor = std::floor(shifted);
  const auto low = static_cast<std::ptrdiff_t>(floor);
  const auto last = static_cast<std::ptrdiff_t>(size) - 1;
  // Mirrored images repeat their border texel, so that only repetition reaches across.
  const std::ptrdiff_t before = wrap == Wrap::kRepeat ? last : 0, after = wrap == Wrap::kRepeat ? 0 : last;
  return {static_cast<std::size_t>(low < 0 ? before : std::min(low, last)),
          static_cast<std::size_t>(low + 1 > last ? after : low + 1), shifted - floor};
}

std::size_t nearest(float position, std::size_t size) { return std::min(static_cast<std::size_t>(position), size - 1); }

std::string display_name(const Texture& texture, std::size_t index) {
  if (!texture.file.empty()) return texture.file;
  return texture.name.empty() ? fmt::format("texture {}", index) : texture.name;
}

Result<std::vector<std::uint8_t>> read_file(const std::string& file) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (error) return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file, error.message()));
  if (size > kMaxFileBytes) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: file has {} bytes; at most 2 GiB are read", file, size));
  }
  std::vector<std::uint8_t> bytes(size);
  std::ifstream stream(file, std::ios::binary);
  // A file is read through char, which may alias any bytes.
  if (!stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size))) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: cannot be read", file));
  }
  return bytes;
}

/// Decodes the image of one texture; `left` is what remains of the memory for texels.
Result<TexturePixels> decode(const Texture& texture, const std::string& name, std::atomic<std::int64_t>& left) {
  std::vector<std::uint8_t> from_file;
  if (!texture.file.empty()) {
    auto read = read_file(texture.file);
    if (!read) return tl::unexpected(read.error());
    from_file = std::move(*read);
  } else if (texture.bytes == nullptr) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: texture without an image", name));
  }
  const std::span<const std::uint8_t> encoded = texture.file.empty() ? std::span(*texture.bytes) : std::span(from_file);
  std::optional<TexturePixels> pixels;
  const RowSink sink{[&](const PixelLayout& layout) -> Result<void> {
                       const auto size = static_cast<std::int64_t>(TexturePixels::bytes(layout));
                       auto room = TexturePixels::allocate(layout, left.fetch_sub(size) >= size, name);
                       if (!room) return tl::unexpected(room.error());
                       pixels = std::move(*room);
                       return {};
                     },
                     [&](std::size_t y, std::span<const std::uint8_t> row) { pixels->set_row(y, row); }};
  if (auto decoded = decode_image(encoded, name, sink); !decoded) return tl::unexpected(decoded.error());
  return std::move(*pixels);
}

}  // namespace

struct TextureStore::Impl {
  struct Sampler {
    const TexturePixels* pixels = nullptr;
    Wrap wrap_s = Wrap::kRepeat, wrap_t = Wrap::kRepeat;
    bool nearest = false;
    const float* colour = nullptr;  ///< linear value of a code; alpha is always stored linearly
    const float* alpha = nullptr;
  };

  std::vector<TexturePixels> images;
  std::vector<Sampler> samplers;
  std::vector<float> srgb8, linear8, srgb16, linear16;  ///< 16 bits: only filled when an image has them

  void add_sampler(const Texture& texture, const TexturePixels& pixels);
  [[nodiscard]] static Vec4f texel(const Sampler& sampler, std::size_t x, std::size_t y);
};

void TextureStore::Impl::add_sampler(const Texture& texture, const TexturePixels& pixels) {
  const bool wide = pixels.layout().bytes_per_channel == 2;
  if (wide && srgb16.empty()) {
    srgb16 = linear_table(65536, ColorSpace::kSrgb);
    linear16 = linear_table(65536, ColorSpace::kLinear);
  }
  const std::vector<float>& linear = wide ? linear16 : linear8;
  const std::vector<float>& colour = texture.color_space == ColorSpace::kLinear ? linear : (wide ? srgb16 : srgb8);
  samplers.push_back({&pixels, texture.wrap_s, texture.wrap_t, texture.nearest, colour.data(), linear.data()});
}

Vec4f TextureStore::Impl::texel(const Sampler& sampler, std::size_t x, std::size_t y) {
  const PixelLayout& layout = sampler.pixels->layout();
  const std::uint8_t* bytes = sampler.pixels->texel(x, y);
  const auto code = [&](std::size_t channel) -> std::size_t {
    if (layout.bytes_per_channel == 1) return bytes[channel];
    std::uint16_t value = 0;
    std::memcpy(&value, bytes + 2 * channel, 2);
    return value;
  };
  if (layout.channels < 3) {
    const float grey = sampler.colour[code(0)];
    return {grey, grey, grey, layout.channels == 2 ? sampler.alpha[code(1)] : 1.0f};
  }
  return {sampler.colour[code(0)], sampler.colour[code(1)], sampler.colour[code(2)],
          layout.channels == 4 ? sampler.alpha[code(3)] : 1.0f};
}

TextureStore::TextureStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TextureStore::TextureStore(TextureStore&&) noexcept = default;
TextureStore& TextureStore::operator=(TextureStore&&) noexcept = default;
TextureStore::~TextureStore() = default;

Result<TextureStore> TextureStore::open(const std::vector<Texture>& textures, std::size_t cache_megabytes) {
  // Each image once, however many textures use it.
  std::map<std::pair<std::string, const void*>, std::size_t> image_of_source;
  std::vector<std::size_t> first_texture, image_of_texture;
  for (std::size_t i = 0; i < textures.size(); ++i) {
    const bool from_file = !textures[i].file.empty();
    const auto [entry, added] = image_of_source.try_emplace(
        {textures[i].file, from_file ? nullptr : textures[i].bytes.get()}, first_texture.size());
    if (added) first_texture.push_back(i);
    image_of_texture.push_back(entry->second);
  }

  std::atomic<std::int64_t> left{static_cast<std::int64_t>(cache_megabytes) << 20};
  std::vector<std::optional<Result<TexturePixels>>> decoded(first_texture.size());
  parallel_for(decoded.size(), [&](std::size_t i) {
    const Texture& texture = textures[first_texture[i]];
    decoded[i] = decode(texture, display_name(texture, first_texture[i]), left);
  });

  auto impl = std::make_unique<Impl>();
  impl->srgb8 = linear_table(256, ColorSpace::kSrgb);
  impl->linear8 = linear_table(256, ColorSpace::kLinear);
  impl->images.reserve(decoded.size());
  for (auto& image : decoded) {
    if (!*image) return tl::unexpected(image->error());
    impl->images.push_back(std::move(**image));
  }
  for (std::size_t i = 0; i < textures.size(); ++i) impl->add_sampler(textures[i], impl->images[image_of_texture[i]]);
  return TextureStore(std::move(impl));
}

bool TextureStore::empty() const { return impl_->samplers.empty(); }

Vec4f TextureStore::lookup(int texture, const Vec2f& uv) const {
  const Impl::Sampler& sampler = impl_->samplers[static_cast<std::size_t>(texture)];
  const PixelLayout& layout = sampler.pixels->layout();
  const float x = wrapped(uv.x, sampler.wrap_s, layout.width);
  const float y = wrapped(uv.y, sampler.wrap_t, layout.height);
  if (sampler.nearest) return Impl::texel(sampler, nearest(x, layout.width), nearest(y, layout.height));

  const Neighbours h = neighbours(x, sampler.wrap_s, layout.width);
  const Neighbours v = neighbours(y, sampler.wrap_t, layout.height);
  const Vec4f top =
      Impl::texel(sampler, h.low, v.low) * (1.0f - h.weight) + Impl::texel(sampler, h.high, v.low) * h.weight;
  const Vec4f bottom =
      Impl::texel(sampler, h.low, v.high) * (1.0f - h.weight) + Impl::texel(sampler, h.high, v.high) * h.weight;
  return top * (1.0f - v.weight) + bottom * v.weight;
}

Vec2f transform_uv(const TextureRef& ref, const Vec2f& uv) {
  // KHR_texture_transform: T * R * S, with R = [cos sin; -sin cos] on (u, v), v downwards.
  const Vec2f scaled = uv * ref.scale;
  const float c = std::cos(ref.rotation), s = std::sin(ref.rotation);
  return Vec2f(c * scaled.x + s * scaled.y, -s * scaled.x + c * scaled.y) + ref.offset;
}

}  // namespace pf
