// Checkpoint of a film, little-endian:
//   8 bytes   "PFCKPT05"
//   one zstd frame of: u32 length and bytes of identity, u32 length and bytes of attachment, Header (below), 64 bytes
//   of the
//             rounds' chain, then the states, the pixel sums, the features, the extras and the biases, packed
//   64 bytes  SHA-256 of everything before, hexadecimal
// A file that ends early or has any other bit wrong is refused: a checkpoint is whole or not there. Both ways stream:
// beside the film itself no more than a buffer is held.

#include <bit>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <span>
#include <system_error>
#include <type_traits>

#include <fmt/format.h>
#include <zstd.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "common/film/film.h"

namespace pf {
namespace {

static_assert(std::endian::native == std::endian::little);
constexpr std::string_view kMagic = "PFCKPT05";
constexpr std::size_t kDigestBytes = 64;
/// Of identity and attachment: bounds what a damaged length can make us allocate.
constexpr std::uint32_t kMaxTextBytes = 1u << 26;
constexpr std::int64_t kMaxFilmPixels = std::int64_t{1} << 28;

struct Header {
  std::int32_t width, height;
  std::uint32_t estimator;
  std::uint32_t has_radii;
  std::uint32_t extra;
  std::int32_t part_edge, hit_points;
  std::uint32_t unused;
  double radiance, flow, square, depth, alpha, round_growth;
  std::uint64_t round_begin, rounds, sub_passes, photon_paths, photons_stored, rays, not_finite, overflow;
};
static_assert(std::is_trivially_copyable_v<ProgressivePixel> && sizeof(ProgressivePixel) == 44);
static_assert(std::is_trivially_copyable_v<PixelSums> && sizeof(PixelSums) == 88);
static_assert(std::is_trivially_copyable_v<FeatureSums> && sizeof(FeatureSums) == 16);
static_assert(std::is_trivially_copyable_v<ExtraSums> && sizeof(ExtraSums) == 32);

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

class Writer {
 public:
  explicit Writer(const std::filesystem::path& file)
      : file_(std::fopen(file.c_str(), "wb")), context_(ZSTD_createCCtx()), buffer_(ZSTD_CStreamOutSize(), '\0') {
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, 1);
    if (file_) raw(kMagic);
  }
  template <typename T>
  void put(const T* values, std::size_t count) {
    compress({values, count * sizeof(T), 0}, ZSTD_e_continue);
  }
  void put_text(const std::string& text) {
    const auto length = static_cast<std::uint32_t>(text.size());
    put(&length, 1);
    put(text.data(), text.size());
  }
  /// False when anything before went wrong; errno says what.
  [[nodiscard]] bool finish() {
    compress({nullptr, 0, 0}, ZSTD_e_end);
    const std::string digest = hash_.hex();
    raw(digest);
    return file_ && good_ && std::fflush(file_.get()) == 0;
  }

 private:
  void compress(ZSTD_inBuffer in, ZSTD_EndDirective directive) {
    while (good_) {
      ZSTD_outBuffer out{buffer_.data(), buffer_.size(), 0};
      const std::size_t left = ZSTD_compressStream2(context_.get(), &out, &in, directive);
      if (ZSTD_isError(left) != 0U) {
        errno = ENOMEM;
        good_ = false;
        return;
      }
      raw({buffer_.data(), out.pos});
      if (directive == ZSTD_e_end ? left == 0 : in.pos == in.size) return;
    }
  }
  void raw(std::string_view bytes) {
    hash_.update(bytes);
    good_ = good_ && file_ && std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) == bytes.size();
  }

  struct FreeContext {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  File file_;
  std::unique_ptr<ZSTD_CCtx, FreeContext> context_;
  std::string buffer_;
  Sha256 hash_;
  bool good_ = true;
};

/// Reads back what Writer wrote; every take is false when the file is too short or broken.
class Reader {
 public:
  explicit Reader(std::FILE* file) : file_(file), context_(ZSTD_createDCtx()), buffer_(ZSTD_DStreamInSize(), '\0') {}
  template <typename T>
  [[nodiscard]] bool take(T* values, std::size_t count) {
    ZSTD_outBuffer out{values, count * sizeof(T), 0};
    while (out.pos < out.size) {
      if (!decompress(out)) return false;
    }
    return true;
  }
  [[nodiscard]] bool take_text(std::string& text) {
    std::uint32_t length = 0;
    if (!take(&length, 1) || length > kMaxTextBytes) return false;
    text.resize(length);
    return take(text.data(), length);
  }
  /// True when the frame ends here.
  [[nodiscard]] bool at_end() {
    char extra = 0;
    ZSTD_outBuffer out{&extra, 1, 0};
    while (out.pos == 0 && !frame_done_) {
      if (!decompress(out)) return false;
    }
    return out.pos == 0;
  }

 private:
  bool decompress(ZSTD_outBuffer& out) {
    if (frame_done_) return false;
    const std::size_t before = out.pos;
    const std::size_t left = ZSTD_decompressStream(context_.get(), &out, &in_);
    if (ZSTD_isError(left) != 0U) return false;
    frame_done_ = left == 0;
    if (out.pos > before || frame_done_) return true;
    const std::size_t got = std::fread(buffer_.data(), 1, buffer_.size(), file_);
    in_ = {buffer_.data(), got, 0};
    return got > 0;
  }

  struct FreeContext {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
  };
  std::FILE* file_;
  std::unique_ptr<ZSTD_DCtx, FreeContext> context_;
  std::string buffer_;
  ZSTD_inBuffer in_{nullptr, 0, 0};
  bool frame_done_ = false;
};

/// True when the digest at the end is that of the rest. Leaves the file after the magic.
bool is_whole(std::FILE* file) {
  Sha256 hash;
  std::string buffer(std::size_t{1} << 18, '\0');
  std::string tail;  // may be the digest
  std::string start;
  while (true) {
    const std::size_t got = std::fread(buffer.data(), 1, buffer.size(), file);
    if (got == 0) break;
    if (start.empty()) start = buffer.substr(0, std::min(got, kMagic.size()));
    tail.append(buffer.data(), got);
    if (tail.size() > kDigestBytes) {
      hash.update(std::string_view(tail).substr(0, tail.size() - kDigestBytes));
      tail.erase(0, tail.size() - kDigestBytes);
    }
  }
  return start == kMagic && tail == hash.hex() && std::fseek(file, static_cast<long>(kMagic.size()), SEEK_SET) == 0;
}

bool is_sane(const Header& h) {
  return h.width > 0 && h.height > 0 && std::int64_t{h.width} * h.height <= kMaxFilmPixels &&
         h.estimator <= static_cast<std::uint32_t>(Estimator::kIndependent) &&
         h.extra <= static_cast<std::uint32_t>(Extra::kBias) && h.part_edge >= 0 && h.hit_points > 0 &&
         std::int64_t{h.width} * h.height * h.hit_points <= kMaxFilmPixels;
}

}  // namespace

Result<void> Film::save(const std::filesystem::path& file, const std::string& identity,
                        const std::string& attachment) const {
  const Header header{options_.width,
                      options_.height,
                      static_cast<std::uint32_t>(options_.estimator),
                      has_radii_,
                      static_cast<std::uint32_t>(options_.extra),
                      options_.part_edge,
                      options_.hit_points,
                      0,
                      options_.scale.radiance,
                      options_.scale.flow,
                      options_.scale.square,
                      options_.scale.depth,
                      options_.alpha,
                      options_.round_growth,
                      round_begin_,
                      rounds_,
                      sums_.sub_passes,
                      sums_.photon_paths,
                      sums_.photons_stored,
                      sums_.rays,
                      sums_.faults.not_finite,
                      sums_.faults.overflow};
  return write_file_atomically(file, [&](const std::filesystem::path& temporary) -> Result<void> {
    Writer out(temporary);
    out.put_text(identity);
    out.put_text(attachment);
    out.put(&header, 1);
    out.put(chain_.data(), chain_.size());
    out.put(state_.data(), state_.size());
    out.put(sums_.pixels.data(), sums_.pixels.size());
    out.put(sums_.features.data(), sums_.features.size());
    out.put(sums_.extras.data(), sums_.extras.size());
    out.put(bias_.data(), bias_.size());
    if (out.finish()) return {};
    return fail(ErrorKind::kInternal,
                fmt::format("{}: cannot write: {}", file.string(), std::generic_category().message(errno)));
  });
}

Result<Film> Film::load(const std::filesystem::path& file, const std::string& identity, std::string* attachment) {
  const File stream(std::fopen(file.c_str(), "rb"));
  if (!stream)
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: cannot read: {}", file.string(), std::generic_category().message(errno)));
  const auto broken = [&](std::string_view why) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: not a whole checkpoint: {}", file.string(), why));
  };
  if (!is_whole(stream.get())) return broken("checksum differs");
  Reader in(stream.get());
  std::string found;
  std::string attached;
  if (!in.take_text(found)) return broken("identity cut short");
  if (found != identity) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: is of another job, scene or build ({}); expected {}", file.string(), found, identity));
  }
  Header h{};
  if (!in.take_text(attached) || !in.take(&h, 1) || !is_sane(h)) return broken("bad header");
  Film film(FilmOptions{h.width, h.height, static_cast<Estimator>(h.estimator),
                        SumScale{h.radiance, h.flow, h.square, h.depth}, h.alpha, h.round_growth,
                        static_cast<Extra>(h.extra), h.part_edge, h.hit_points});
  if (!in.take(film.chain_.data(), film.chain_.size()) || !in.take(film.state_.data(), film.state_.size()) ||
      !in.take(film.sums_.pixels.data(), film.sums_.pixels.size()) ||
      !in.take(film.sums_.features.data(), film.sums_.features.size()) ||
      !in.take(film.sums_.extras.data(), film.sums_.extras.size()) || !in.take(film.bias_.data(), film.bias_.size()) ||
      !in.at_end()) {
    return broken("payload of another size");
  }
  film.has_radii_ = h.has_radii != 0;
  film.round_begin_ = h.round_begin;
  film.rounds_ = h.rounds;
  film.sums_.sub_passes = h.sub_passes;
  film.sums_.photon_paths = h.photon_paths;
  film.sums_.photons_stored = h.photons_stored;
  film.sums_.rays = h.rays;
  film.sums_.faults = {h.not_finite, h.overflow};
  if (attachment != nullptr) *attachment = std::move(attached);
  return film;
}

}  // namespace pf
