// Checkpoint of a film, little-endian, packed:
//   8 bytes   "PFCKPT01"
//   u32       length of identity, then its bytes
//   Header    see below
//   u64       bytes of the payload before compression
//   u64       bytes of the compressed payload, then those: zstd of the states, then the pixel sums
//   u64       XXH3-64 of everything before
// A file that ends early or has any other bit wrong is refused: a checkpoint is whole or not there.

#include <bit>
#include <cstring>
#include <type_traits>

#include <fmt/format.h>
#include <zstd.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "common/film/film.h"

namespace pf {
namespace {

static_assert(std::endian::native == std::endian::little);
constexpr std::string_view kMagic = "PFCKPT01";
/// Larger than any film of 2^28 pixels; bounds what a damaged length can make us allocate.
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 36;

struct Header {
  std::int32_t width, height;
  std::uint32_t estimator;
  std::uint32_t has_radii;
  double radiance, flow, square, depth, alpha, round_growth;
  std::uint64_t round_begin, rounds, sub_passes, photon_paths, photons_stored, rays, not_finite, overflow;
};
static_assert(std::is_trivially_copyable_v<ProgressivePixel> && sizeof(ProgressivePixel) == 44);
static_assert(std::is_trivially_copyable_v<PixelSums> && sizeof(PixelSums) == 120);

template <typename T>
void append(std::string& out, const T* values, std::size_t count) {
  out.append(reinterpret_cast<const char*>(values), count * sizeof(T));
}

/// Takes values off the front of a text; false when it is too short.
struct Reader {
  std::string_view rest;
  template <typename T>
  bool take(T* values, std::size_t count) {
    if (rest.size() / sizeof(T) < count) return false;
    std::memcpy(values, rest.data(), count * sizeof(T));
    rest.remove_prefix(count * sizeof(T));
    return true;
  }
};

}  // namespace

Result<void> Film::save(const std::filesystem::path& file, const std::string& identity) const {
  std::string out(kMagic);
  const auto length = static_cast<std::uint32_t>(identity.size());
  append(out, &length, 1);
  out += identity;
  const Header header{options_.width, options_.height, static_cast<std::uint32_t>(options_.estimator), has_radii_,
                      options_.scale.radiance, options_.scale.flow, options_.scale.square, options_.scale.depth,
                      options_.alpha, options_.round_growth, round_begin_, rounds_, sums_.sub_passes,
                      sums_.photon_paths, sums_.photons_stored, sums_.rays, sums_.faults.not_finite,
                      sums_.faults.overflow};
  append(out, &header, 1);
  std::string payload;
  append(payload, state_.data(), state_.size());
  append(payload, sums_.pixels.data(), sums_.pixels.size());
  std::string packed(ZSTD_compressBound(payload.size()), '\0');
  const std::size_t bytes = ZSTD_compress(packed.data(), packed.size(), payload.data(), payload.size(), 1);
  if (ZSTD_isError(bytes) != 0U) return fail(ErrorKind::kInternal, fmt::format("{}: zstd: {}", file.string(), ZSTD_getErrorName(bytes)));
  const std::uint64_t sizes[2] = {payload.size(), bytes};
  append(out, sizes, 2);
  out.append(packed.data(), bytes);
  const std::uint64_t check = xxh3_64(std::string_view(out));
  append(out, &check, 1);
  return write_file_atomically(file, std::string_view(out));
}

Result<Film> Film::load(const std::filesystem::path& file, const std::string& identity) {
  auto text = read_file(file, kMaxBytes);
  if (!text) return tl::unexpected(text.error());
  const auto broken = [&](std::string_view why) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: not a whole checkpoint: {}", file.string(), why));
  };
  std::uint64_t check = 0;
  if (text->size() < kMagic.size() + sizeof(check) || !std::string_view(*text).starts_with(kMagic)) return broken("no header");
  const std::string_view body(text->data(), text->size() - sizeof(check));
  std::memcpy(&check, text->data() + body.size(), sizeof(check));
  if (check != xxh3_64(body)) return broken("checksum differs");
  Reader reader{body.substr(kMagic.size())};
  std::uint32_t length = 0;
  if (!reader.take(&length, 1) || reader.rest.size() < length) return broken("identity cut short");
  if (reader.rest.substr(0, length) != identity) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: is of another job, scene or build ({}); expected {}", file.string(),
                            reader.rest.substr(0, length), identity));
  }
  reader.rest.remove_prefix(length);
  Header h{};
  std::uint64_t sizes[2] = {0, 0};
  if (!reader.take(&h, 1) || !reader.take(sizes, 2) || reader.rest.size() != sizes[1] || sizes[0] > kMaxBytes) {
    return broken("sizes disagree");
  }
  if (h.width <= 0 || h.height <= 0 || h.estimator > static_cast<std::uint32_t>(Estimator::kIndependent)) return broken("bad header");
  FilmOptions options{h.width, h.height, static_cast<Estimator>(h.estimator),
                      SumScale{h.radiance, h.flow, h.square, h.depth}, h.alpha, h.round_growth};
  const std::uint64_t pixels = static_cast<std::uint64_t>(h.width) * static_cast<std::uint64_t>(h.height);
  const std::uint64_t states = options.estimator == Estimator::kPath ? 0 : pixels;
  if (sizes[0] != states * sizeof(ProgressivePixel) + pixels * sizeof(PixelSums)) return broken("sizes disagree");
  std::string payload(sizes[0], '\0');
  const std::size_t bytes = ZSTD_decompress(payload.data(), payload.size(), reader.rest.data(), reader.rest.size());
  if (ZSTD_isError(bytes) != 0U || bytes != payload.size()) return broken("payload does not decompress");
  Film film(options);
  Reader fields{payload};
  if (!fields.take(film.state_.data(), film.state_.size()) ||
      !fields.take(film.sums_.pixels.data(), film.sums_.pixels.size())) {
    return broken("payload too short");
  }
  film.has_radii_ = h.has_radii != 0;
  film.round_begin_ = h.round_begin;
  film.rounds_ = h.rounds;
  film.sums_.sub_passes = h.sub_passes;
  film.sums_.photon_paths = h.photon_paths;
  film.sums_.photons_stored = h.photons_stored;
  film.sums_.rays = h.rays;
  film.sums_.faults = {h.not_finite, h.overflow};
  return film;
}

}  // namespace pf
