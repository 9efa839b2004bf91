#include "common/film/film.h"

#include <cmath>

namespace pf {
namespace {

Rgb scaled(const std::array<std::int64_t, 3>& sum, double factor) {
  return {static_cast<float>(static_cast<double>(sum[0]) * factor), static_cast<float>(static_cast<double>(sum[1]) * factor),
          static_cast<float>(static_cast<double>(sum[2]) * factor)};
}

void put(std::vector<float>& data, std::size_t pixel, const Rgb& value) {
  for (int c = 0; c < 3; ++c) data[3 * pixel + static_cast<std::size_t>(c)] = value[c];
}

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
    : options_(options), order_(options), sums_(options.width, options.height, true, options.extra != Extra::kNone) {
  state_.resize(options.estimator == Estimator::kPath ? 0 : sums_.pixels.size());
}

void Film::set_initial_radii(std::vector<ProgressivePixel> state) {
  state_ = std::move(state);
  has_radii_ = true;
}

FlowState Film::closed(std::size_t pixel, Flow flow) const {
  const FlowState& state = state_[pixel][flow];
  const PixelSums& sums = sums_.pixels[pixel];
  const std::uint64_t in_round = sums_.sub_passes - round_begin_;
  if (options_.estimator != Estimator::kShared || in_round == 0) return state;
  return updated(state, sums.photons[flow], sums.flow[flow], in_round, options_.alpha);
}

void Film::close_round_if_complete() {
  if (sums_.sub_passes < round_end()) return;
  for (std::size_t i = 0; options_.estimator == Estimator::kShared && i < state_.size(); ++i) {
    for (const Flow flow : {kCaustic, kIndirect}) {
      state_[i][flow] = closed(i, flow);
      sums_.pixels[i].photons[flow] = 0;
      sums_.pixels[i].flow[flow] = {};
    }
  }
  do {  // one result may end several rounds of an estimator that has no barrier
    round_begin_ = round_end();
    ++rounds_;
  } while (sums_.sub_passes >= round_end());
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

Rgb Film::flow_radiance(std::size_t pixel, Flow flow, const FlowState& state) const {
  const double n = samples_of(pixel);
  if (n == 0.0) return {0.0f, 0.0f, 0.0f};
  if (options_.estimator != Estimator::kShared) return scaled(sums_.pixels[pixel].flow[flow], options_.scale.flow / n);
  if (state.radius2 <= 0.0f) return {0.0f, 0.0f, 0.0f};
  // Radiance evaluation [Hachisuka08 (10)]: tau / (pi R^2 N_emitted); the flux of a path already holds 1 / paths per sub-pass.
  const double factor = options_.scale.flow / (static_cast<double>(kPi) * state.radius2 * n);
  return {static_cast<float>(state.tau[0] * factor), static_cast<float>(state.tau[1] * factor),
          static_cast<float>(state.tau[2] * factor)};
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
  const bool progressive = options_.estimator != Estimator::kPath;
  const bool extra = options_.extra != Extra::kNone;
  for (std::size_t i = 0; i < count && sums_.sub_passes > 0; ++i) {
    const std::size_t pixel = begin + i;
    const PixelSums& sums = sums_.pixels[pixel];
    std::array<Rgb, kFlows> flows;
    for (const Flow flow : {kCaustic, kIndirect}) {
      const FlowState state = progressive ? closed(pixel, flow) : FlowState{};
      flows[flow] = flow_radiance(pixel, flow, state);
      const bool shared = options_.estimator == Estimator::kShared;
      photons.data[2 * i + flow] = shared ? state.count : static_cast<float>(sums.photons[flow]);
      radius.data[2 * i + flow] = std::sqrt(state.radius2);
    }
    const double n = std::max(samples_of(pixel), 1.0);
    const Rgb direct_radiance = scaled(sums.direct, options_.scale.radiance / n);
    Rgb all = direct_radiance + flows[kCaustic] + flows[kIndirect];
    if (extra) {
      const Rgb specular_radiance = scaled(sums_.extras[pixel].specular, options_.scale.radiance / n);
      put(specular.data, i, specular_radiance);
      marks.data[i] = static_cast<float>(sums_.extras[pixel].marks);
      all += specular_radiance;
    }
    put(direct.data, i, direct_radiance);
    put(caustics.data, i, flows[kCaustic]);
    put(indirect.data, i, flows[kIndirect]);
    put(beauty.data, i, all);
    const FeatureSums& met = sums_.features[pixel];
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
  if (extra) {
    all.insert(all.begin() + 2, std::move(specular));
    if (!marks.name.empty()) all.push_back(std::move(marks));
  }
  return all;
}

LayeredImage Film::image() const { return {options_.width, options_.height, layers(0, options_.height), {}}; }

ImageRows Film::image_rows() const {
  return {options_.width, options_.height, [this](int first, int count) { return layers(first, count); }, {}};
}

double Film::estimated_error() const {
  if (order_.whole_passes(sums_.sub_passes) < 2) return kInfinity;
  constexpr double kBlack = 0.01;  // of relMSE: mean of (x - r)^2 / (r^2 + 0.01)
  double sum = 0.0;
  for (std::size_t i = 0; i < sums_.pixels.size(); ++i) {
    const PixelSums& p = sums_.pixels[i];
    const double n = samples_of(i);
    double mean = luminance(scaled(p.direct, options_.scale.radiance / n));
    if (options_.extra != Extra::kNone) mean += luminance(scaled(sums_.extras[i].specular, options_.scale.radiance / n));
    double total = mean;
    double path_part = mean;
    double variance = 0.0;
    for (const Flow flow : {kCaustic, kIndirect}) {
      const FlowState state = options_.estimator == Estimator::kPath ? FlowState{} : closed(i, flow);
      const double l = luminance(flow_radiance(i, flow, state));
      const double found = options_.estimator == Estimator::kShared ? static_cast<double>(state.count) : static_cast<double>(p.photons[flow]);
      total += l;
      if (options_.estimator == Estimator::kPath) path_part += l;
      // Photons arrive as a Poisson process: N of them leave a relative variance of 1/N.
      else if (found > 0) variance += l * l / found;
    }
    variance += std::max(0.0, static_cast<double>(p.square) * options_.scale.square / n - path_part * path_part) / (n - 1);
    sum += variance / (total * total + kBlack);
  }
  return std::sqrt(sum / static_cast<double>(sums_.pixels.size()));
}

}  // namespace pf
