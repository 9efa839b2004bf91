#include "jobs/benchmark/pictures.h"

#include <openssl/evp.h>

#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/film/flip.h"
#include "common/film/image.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxPicture = std::uint64_t{1} << 26;

Result<void> write_tone_mapped(const fs::path& file, int width, int height, const std::vector<Rgb>& pixels,
                               double exposure) {
  LayeredImage image{width, height, {{"", {"R", "G", "B"}, {}}}, {}};
  for (const Rgb& pixel : pixels) image.layers[0].data.insert(image.layers[0].data.end(), {pixel.x, pixel.y, pixel.z});
  return write_png(file, rows_of(image), static_cast<float>(exposure));
}

}  // namespace

std::string picture_name(const SceneResult& scene, std::size_t method, bool error) {
  return fmt::format("{}-{}{}.png", scene.scene.name, method, error ? "-error" : "");
}
std::string reference_picture_name(const SceneResult& scene) {
  return fmt::format("{}-reference.png", scene.scene.name);
}

const Sample* pictured(const MethodResult& method) {
  for (const RunResult& run : method.runs) {
    if (!run.samples.empty()) return &run.samples.back();
  }
  return nullptr;
}

Result<void> write_pictures(const BenchResult& bench, const fs::path& folder) {
  std::error_code code;
  fs::create_directories(folder, code);
  if (code) return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", folder.string(), code.message()));
  for (const SceneResult& scene : bench.scenes) {
    const Reference& reference = scene.reference;
    const double exposure = scene.scene.exposure;
    if (reference.error.empty()) {
      auto written = write_tone_mapped(folder / reference_picture_name(scene), reference.width, reference.height,
                                       reference.mean, exposure);
      if (!written) return written;
    }
    for (std::size_t m = 0; m < scene.methods.size(); ++m) {
      const Sample* sample = pictured(scene.methods[m]);
      const auto image = sample == nullptr ? fail(ErrorKind::kInvalidInput, "") : read_beauty(sample->exr);
      if (!image) continue;
      auto written = write_tone_mapped(folder / picture_name(scene, m, false), image->width, image->height,
                                       image->pixels, exposure);
      if (!written) return written;
      if (image->pixels.size() != reference.mean.size() || sample->nonfinite_pixels > 0) continue;
      const HdrFlipMap flip = hdr_flip(image->pixels, reference.mean, image->width, image->height);
      written = write_png(folder / picture_name(scene, m, true), image->width, image->height, magma_colors(flip.error));
      if (!written) return written;
    }
  }
  return {};
}

std::string data_uri(const fs::path& file, std::string_view type) {
  const auto bytes = read_file(file, kMaxPicture);
  if (!bytes) return "";
  std::string text(4 * ((bytes->size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes->data()), static_cast<int>(bytes->size()));
  text.resize(static_cast<std::size_t>(length));
  return fmt::format("data:{};base64,{}", type, text);
}

}  // namespace pf::bench
