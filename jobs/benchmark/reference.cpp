#include "jobs/benchmark/reference.h"

#include <algorithm>
#include <array>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "common/film/flip.h"
#include "common/film/image.h"
#include "jobs/benchmark/statistics.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Seeds of the halves, far from those of runs.
constexpr std::array<std::uint64_t, 2> kSeeds = {4000000001, 4000000002};
constexpr std::uint64_t kMaxReferenceText = std::uint64_t{1} << 24;

class Maker {
 public:
  Maker(const Scene& scene, fs::path folder, int threads, Runner& runner, const ReferenceProgress& progress,
        Reference& to)
      : scene_(scene),
        folder_(std::move(folder)),
        threads_(threads),
        runner_(runner),
        progress_(progress),
        reference_(to) {}

  /// Renders on from what is there until the settings are met.
  Result<void> make() {
    const ReferenceSettings& s = scene_.reference;
    const auto most = s.max_passes > 0 ? std::max(s.max_passes, s.passes)
                      : s.seconds > 0  ? INT64_C(4294967295)
                                       : s.passes;
    auto passes = std::max({s.passes, half_passes_[0], half_passes_[1]});
    if (reference_.passes > 0 && enough(most)) return recorded_ ? Result<void>() : join();
    if (reference_.passes > 0) passes = std::min(2 * passes, most);
    for (;; passes = std::min(2 * passes, most)) {
      for (std::size_t half = 0; half < 2; ++half) {
        if (half_passes_[half] == passes) continue;
        if (auto done = render(half, passes); !done) return done;
        half_passes_[half] = passes;
        if (!reference_.error.empty()) return {};
      }
      if (auto joined = join(); !joined || !reference_.error.empty()) return joined;
      if (enough(most)) return {};
    }
  }

  /// Reads what an earlier bench left.
  void read() {
    const auto text = read_file(folder_ / "reference.json", kMaxReferenceText);
    const json stored = text ? json::parse(*text, nullptr, false) : json();
    if (stored.is_object()) {
      reference_.seconds = stored.value("seconds", 0.0);
      half_seconds_ = stored.value("seconds_of_a_half", 0.0);
      reference_.passes = stored.value("passes", std::uint64_t{0});
    }
    for (std::size_t half = 0; half < 2; ++half) {
      const auto figures = read_file(half_folder(half) / fmt::format("{}.json", kImageName), kMaxReferenceText);
      const json document = figures ? json::parse(*figures, nullptr, false) : json();
      half_passes_[half] = document.is_object() ? document.value("passes", std::int64_t{0}) : 0;
    }
    const auto recorded = static_cast<std::int64_t>(reference_.passes);
    reference_.passes = 0;
    if (half_passes_[0] == 0 || half_passes_[0] != half_passes_[1]) return;  // the shorter half has to catch up
    if (!read_halves()) {
      half_passes_ = {};
      reference_.error.clear();
      return;
    }
    reference_.passes = static_cast<std::uint64_t>(half_passes_[0]);
    recorded_ = recorded == half_passes_[0];
  }

 private:
  [[nodiscard]] fs::path half_folder(std::size_t half) const { return folder_ / (half == 0 ? "a" : "b"); }
  [[nodiscard]] bool enough(std::int64_t most) const {
    const ReferenceSettings& s = scene_.reference;
    const auto passes = static_cast<std::int64_t>(reference_.passes);
    if (passes < s.passes) return false;
    return passes >= most || (s.confidence > 0 && reference_.noise <= s.confidence) ||
           (s.seconds > 0 && half_seconds_ >= s.seconds);
  }

  Result<void> render(std::size_t half, std::int64_t passes) {
    const fs::path out = half_folder(half);
    std::error_code code;
    fs::create_directories(out, code);
    if (code) return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", out.string(), code.message()));
    RenderOrder order;
    order.job = scene_.job;
    order.set = scene_.set;
    order.out = out;
    order.threads = threads_;
    order.set.insert(order.set.end(), scene_.reference.set.begin(), scene_.reference.set.end());
    const std::vector<std::string> own = {fmt::format("job.name={}", kImageName),
                                          fmt::format("integrator.type={}", scene_.reference.type),
                                          fmt::format("integrator.seed={}", kSeeds[half]),
                                          fmt::format("stop.passes={}", passes),
                                          "stop.seconds=0",
                                          "checkpoint.seconds=15"};
    order.set.insert(order.set.end(), own.begin(), own.end());
    order.resume = fs::exists(out / fmt::format("{}.checkpoint", kImageName), code);
    const auto tick = [&](double seconds) { progress_(seconds, static_cast<std::uint64_t>(passes), reference_.noise); };
    auto outcome = runner_.render(order, tick);
    if (outcome && order.resume && !outcome->error.empty()) {  // a checkpoint of another build: start anew
      fs::remove_all(out, code);
      fs::create_directories(out, code);
      order.resume = false;
      outcome = runner_.render(order, tick);
    }
    if (!outcome) return tl::unexpected(outcome.error());
    reference_.error = outcome->error;
    if (half == 0) half_seconds_ += outcome->wall_seconds;
    reference_.seconds += outcome->wall_seconds;
    if (reference_.error.empty()) reference_.passes = outcome->figures.value("passes", std::uint64_t{0});
    return {};
  }

  bool read_halves() {
    const auto a = read_beauty(half_folder(0) / fmt::format("{}.exr", kImageName));
    const auto b = read_beauty(half_folder(1) / fmt::format("{}.exr", kImageName));
    if (!a || !b || a->width != b->width || a->height != b->height) {
      reference_.error = !a ? a.error().message : !b ? b.error().message : "halves of different sizes";
      return false;
    }
    reference_.error.clear();
    reference_.width = a->width;
    reference_.height = a->height;
    Halves halves = join_halves(a->pixels, b->pixels);
    reference_.mean = std::move(halves.mean);
    reference_.variance = std::move(halves.variance);
    reference_.noise = halves.noise;
    reference_.flip_between_halves = hdr_flip(a->pixels, b->pixels, a->width, a->height).mean;
    return true;
  }

  Result<void> join() {
    if (!read_halves()) return {};
    const json stored = {{"scene", scene_.name},          {"scene_hash", scene_.hash},
                         {"type", reference_.type},       {"passes", reference_.passes},
                         {"seconds", reference_.seconds}, {"seconds_of_a_half", half_seconds_},
                         {"noise", reference_.noise},     {"flip_between_halves", reference_.flip_between_halves}};
    LayeredImage image{reference_.width, reference_.height, {{"", {"R", "G", "B"}, {}}}, {}};
    for (const Rgb& pixel : reference_.mean)
      image.layers[0].data.insert(image.layers[0].data.end(), {pixel.x, pixel.y, pixel.z});
    if (auto written = write_exr(folder_ / "reference.exr", image); !written) return written;
    return write_file_atomically(folder_ / "reference.json", stored.dump(2) + "\n");
  }

  const Scene& scene_;
  fs::path folder_;
  int threads_;
  Runner& runner_;
  const ReferenceProgress& progress_;
  Reference& reference_;
  double half_seconds_ = 0;
  bool recorded_ = false;                      ///< reference.json and .exr are of the halves as they are
  std::array<std::int64_t, 2> half_passes_{};  ///< that the image of each half has
};

}  // namespace

std::string Reference::key() const { return fmt::format("{}-{}", id, passes); }

Result<Beauty> read_beauty(const fs::path& file) {
  auto image = read_exr(file);
  if (!image) return tl::unexpected(image.error());
  const Layer* beauty = image->find("");
  if (beauty == nullptr) return fail(ErrorKind::kInvalidInput, fmt::format("{}: no channels R, G, B", file.string()));
  auto pixels = rgb_pixels(*beauty);
  if (!pixels) return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.string(), pixels.error().message));
  return Beauty{image->width, image->height, std::move(*pixels)};
}

Result<Reference> ensure_reference(const Scene& scene, const fs::path& cache, int threads, Runner& runner,
                                   const ReferenceProgress& progress) {
  Reference reference;
  reference.type = scene.reference.type;
  reference.biased = reference.type != "path";
  reference.error = scene.error;
  if (!scene.error.empty()) return reference;
  std::vector<std::string> set = scene.set;
  set.insert(set.end(), scene.reference.set.begin(), scene.reference.set.end());
  set.insert(set.end(), {fmt::format("integrator.type={}", reference.type), "integrator.seed=0"});
  const auto spec = load_job(scene.job, set);
  if (!spec) return tl::unexpected(spec.error());
  reference.id = sha256_hex(fmt::format("{} {}", scene.hash, image_hash_of_spec(*spec))).substr(0, 20);
  Maker maker(scene, cache / reference.id, threads, runner, progress, reference);
  maker.read();
  if (auto made = maker.make(); !made) return tl::unexpected(made.error());
  return reference;
}

}  // namespace pf::bench
