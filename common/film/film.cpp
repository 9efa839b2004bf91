#include "common/film/film.h"

#include <cmath>
#include <span>

#include <fmt/format.h>

#include "common/base/hash.h"
#include "common/base/parallel.h"

namespace pf {
namespace {

Rgb scaled(const std::array<std::int64_t, 3>& sum, double factor) {
  return {static_cast<float>(static_cast<double>(sum[0]) * factor),
          static_cast<float>(static_cast<double>(sum[1]) * factor),
          static_cast<float>(static_cast<double>(sum[2]) * factor)};
}

void put(std::vector<float>& data, std::size_t pixel, const Rgb& value) {
  for (int c = 0; c < 3; ++c) data[3 * pixel + static_cast<std::size_t>(c)] = value[c];
}

bool has_specular_layer(Extra extra) { return extra != Extra::kNone && extra != Extra::kBias; }

/// Name of the layer of Extra's marks; empty: it has none.
std::string_view marks_layer(Extra extra) {
  switch (extra) {
    case Extra::kGatherPoints:
      return "gather_points";
    case Extra::kCacheRecords:
      return "cache_records";
    default:
      return "";
  }
}

}  // namespace

Film::Film(const FilmOptions& options)
    : options_(options),
      order_(options),
      sums_(options.width * options.hit_points, options.height, true, options.extra != Extra::kNone) {
  state_.resize(options.estimator == Estimator::kPath ? 0 : sums_.pixels.size());
  bias_.resize(options.extra == Extra::kBias ? sums_.pixels.size() : 0);
}

void Film::set_initial_radii(std::vector<ProgressivePixel> state) {
  state_ = std::move(state);
  has_radii_ = true;
}

FlowState Film::closed(std::size_t point, Flow flow) const {
  const FlowState& state = state_[point][flow];
  const PixelSums& sums = sums_.pixels[point];
  const std::uint64_t in_round = sums_.sub_passes - round_begin_;
  if (options_.estimator != Estimator::kShared || in_round == 0) return state;
  return updated(state, sums.photons[flow], sums.flow[flow], in_round, options_.alpha);
}

float Film::closed_bias(std::size_t point, Flow flow) const {
  const std::uint64_t in_round = sums_.sub_passes - round_begin_;
  const std::int64_t found = sums_.extras[point].rgb[flow];
  if (options_.estimator != Estimator::kShared) return static_cast<float>(found);
  if (in_round == 0) return bias_[point][flow];
  // The mean of the biases that every sub-pass had at its own radius is kept as tau, the mean of radiances, is.
  FlowState state = state_[point][flow];
  state.tau = {bias_[point][flow], 0.0f, 0.0f};
  return updated(state, sums_.pixels[point].photons[flow], {found, 0, 0}, in_round, options_.alpha).tau[0];
}

void Film::close_round_at(std::size_t point) {
  for (const Flow flow : {kCaustic, kIndirect}) {
    if (!bias_.empty()) {
      bias_[point][flow] = closed_bias(point, flow);
      sums_.extras[point].rgb[flow] = 0;
    }
    state_[point][flow] = closed(point, flow);
    sums_.pixels[point].photons[flow] = 0;
    sums_.pixels[point].flow[flow] = {};
  }
}

void Film::close_round_if_complete() {
  if (sums_.sub_passes < round_end()) return;
  if (options_.estimator == Estimator::kShared) {
    constexpr std::size_t kGrain = 4096;
    parallel_ranges(state_.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) close_round_at(i);
    });
  }
  // A fast hash of the state, a strong one over the links: about 1 ms a million pixels.
  const std::string state = xxh3_128(std::as_bytes(std::span(state_))).hex();
  do {  // one result may end several rounds of an estimator that has no barrier
    round_begin_ = round_end();
    ++rounds_;
    chain_ = sha256_hex(fmt::format("{} round {} until {} state {}", chain_, rounds_, round_begin_, state));
  } while (sums_.sub_passes >= round_end());
}

std::string Film::state_chain() const {
  return sha256_hex(fmt::format("{} sub-passes {} sums {} extras {}", chain_, sums_.sub_passes,
                                xxh3_128(std::as_bytes(std::span(sums_.pixels))).hex(),
                                xxh3_128(std::as_bytes(std::span(sums_.extras))).hex()));
}

std::uint64_t Film::round_end() const {
  // Whole sweeps over the image, so that every pixel has as many samples when the error is looked at.
  const std::uint64_t sweep = order_.sweep();
  return round_begin_ + sweep * round_size(round_begin_ / sweep, options_.round_growth);
}

double Film::samples_of(std::size_t pixel) const {
  const auto width = static_cast<std::size_t>(options_.width);
  return static_cast<double>(
      order_.samples(static_cast<int>(pixel % width), static_cast<int>(pixel / width), sums_.sub_passes));
}

double Film::radiance_factor(const FlowState& state, double samples) const {
  if (options_.estimator != Estimator::kShared) return options_.scale.flow / samples;
  // Radiance evaluation [Hachisuka08 (10)]: tau / (pi R^2 N_emitted); the flux of a path already holds 1 / paths per
  // sub-pass.
  return state.radius2 > 0.0f ? options_.scale.flow / (static_cast<double>(kPi) * state.radius2 * samples) : 0.0;
}

Film::PixelEstimate Film::estimate(std::size_t pixel) const {
  PixelEstimate e;
  const double n = samples_of(pixel);
  if (n == 0.0) return e;
  const auto points = static_cast<std::size_t>(options_.hit_points);
  const PixelSums& first = sums_.pixels[pixel * points];
  const bool progressive = options_.estimator != Estimator::kPath;
  e.direct = scaled(first.direct, options_.scale.radiance / n);
  if (has_specular_layer(options_.extra)) e.specular = scaled(sums_.extras[pixel].rgb, options_.scale.radiance / n);
  double sampled = luminance(e.direct) + luminance(e.specular);  // what the squares are of
  std::array<double, kFlows> deviation{};                        // of the photons' light
  for (std::size_t point = pixel * points; point < (pixel + 1) * points; ++point) {
    const PixelSums& sums = sums_.pixels[point];
    for (const Flow flow : {kCaustic, kIndirect}) {
      const FlowState state = progressive ? closed(point, flow) : FlowState{};
      const double factor = radiance_factor(state, n);
      const bool shared = options_.estimator == Estimator::kShared;
      const Rgb radiance =
          shared ? Rgb{static_cast<float>(state.tau[0] * factor), static_cast<float>(state.tau[1] * factor),
                       static_cast<float>(state.tau[2] * factor)}
                 : scaled(sums.flow[flow], factor);
      const float found = shared ? state.count : static_cast<float>(sums.photons[flow]);
      const double l = luminance(radiance);
      e.flow[flow] += radiance;
      e.photons[flow] += found;
      if (point == pixel * points) e.radius[flow] = std::sqrt(state.radius2);
      if (!progressive) sampled += l;
      // Photons arrive as a Poisson process: N of them leave a relative variance of 1/N. Hit points of a pixel find
      // much the same photons, so their deviations add up.
      else if (found > 0)
        deviation[flow] += l / std::sqrt(static_cast<double>(found));
      if (options_.extra == Extra::kBias) e.bias += closed_bias(point, flow) * factor;
    }
  }
  for (const double d : deviation) e.variance += d * d;
  if (n >= 2)
    e.variance +=
        std::max(0.0, static_cast<double>(first.square) * options_.scale.square / n - sampled * sampled) / (n - 1);
  return e;
}

std::vector<Layer> Film::layers(int first_row, int rows) const {
  const auto width = static_cast<std::size_t>(options_.width);
  const std::size_t begin = width * static_cast<std::size_t>(first_row);
  const std::size_t count = width * static_cast<std::size_t>(rows);
  const auto layer = [&](std::string name, std::vector<std::string> channels) {
    Layer l{std::move(name), std::move(channels), {}};
    l.data.resize(count * l.channels.size());
    return l;
  };
  Layer beauty = layer("", {"R", "G", "B"});
  Layer direct = layer("direct", {"R", "G", "B"});
  Layer caustics = layer("caustics", {"R", "G", "B"});
  Layer indirect = layer("indirect", {"R", "G", "B"});
  Layer albedo = layer("albedo", {"R", "G", "B"});
  Layer normal = layer("normal", {"X", "Y", "Z"});
  Layer depth = layer("depth", {"Z"});
  Layer photons = layer("photons", {"caustic", "indirect"});
  Layer radius = layer("radius", {"caustic", "indirect"});
  Layer specular = layer("specular", {"R", "G", "B"});
  Layer marks = layer(std::string(marks_layer(options_.extra)), {"Y"});
  Layer error = layer("error", {"noise", "bias"});
  const bool progressive = options_.estimator != Estimator::kPath;
  for (std::size_t i = 0; i < count && sums_.sub_passes > 0; ++i) {
    const std::size_t pixel = begin + i;
    const PixelEstimate e = estimate(pixel);
    for (const Flow flow : {kCaustic, kIndirect}) {
      photons.data[2 * i + flow] = e.photons[flow];
      radius.data[2 * i + flow] = e.radius[flow];
    }
    put(direct.data, i, e.direct);
    put(specular.data, i, e.specular);
    put(caustics.data, i, e.flow[kCaustic]);
    put(indirect.data, i, e.flow[kIndirect]);
    put(beauty.data, i, e.all());
    error.data[2 * i] = static_cast<float>(std::sqrt(e.variance));
    error.data[2 * i + 1] = static_cast<float>(e.bias);
    if (!marks.name.empty()) marks.data[i] = static_cast<float>(sums_.extras[pixel].marks);
    const FeatureSums& met = sums_.features[pixel * static_cast<std::size_t>(options_.hit_points)];
    const double feature = met.samples() > 0 ? 1.0 / met.samples() : 0.0;
    for (std::size_t c = 0; c < 3; ++c) {
      albedo.data[3 * i + c] = static_cast<float>(met.albedo[c] * SumScale::kUnit * feature);
      normal.data[3 * i + c] = static_cast<float>(met.normal[c] * SumScale::kUnit * feature);
    }
    depth.data[i] = static_cast<float>(met.depth() * options_.scale.depth * feature);
  }
  std::vector<Layer> all = {std::move(beauty), std::move(direct), std::move(caustics), std::move(indirect),
                            std::move(albedo), std::move(normal), std::move(depth)};
  if (progressive) {
    all.push_back(std::move(photons));
    all.push_back(std::move(radius));
  }
  if (has_specular_layer(options_.extra)) all.insert(all.begin() + 2, std::move(specular));
  if (!marks.name.empty()) all.push_back(std::move(marks));
  if (options_.extra == Extra::kBias) all.push_back(std::move(error));
  return all;
}

LayeredImage Film::image() const { return {options_.width, options_.height, layers(0, options_.height), {}}; }

ImageRows Film::image_rows() const {
  return {options_.width, options_.height, [this](int first, int count) { return layers(first, count); }, {}};
}

double Film::estimated_error() const {
  if (order_.whole_passes(sums_.sub_passes) < 2) return kInfinity;
  constexpr double kBlack = 0.01;  // of relMSE: mean of (x - r)^2 / (r^2 + 0.01)
  // The bias is found from the same photons: 6 d^2/R^2 - 3 has a mean square of 3 over a disc, so its noise triples the
  // variance.
  constexpr double kBiasVariance = 3.0;
  double noise = 0.0, bias = 0.0;
  const auto pixels = static_cast<std::size_t>(options_.width) * static_cast<std::size_t>(options_.height);
  for (std::size_t i = 0; i < pixels; ++i) {
    const PixelEstimate e = estimate(i);
    const double l = luminance(e.all());
    noise += e.variance / (l * l + kBlack);
    if (options_.extra == Extra::kBias) bias += (e.bias * e.bias - kBiasVariance * e.variance) / (l * l + kBlack);
  }
  // Over many pixels what was taken off for the bias's noise is right; where it is more than what was found, there is
  // no bias.
  return std::sqrt((noise + std::max(0.0, bias)) / static_cast<double>(pixels));
}

}  // namespace pf
