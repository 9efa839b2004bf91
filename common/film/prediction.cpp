#include "common/film/prediction.h"

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "common/film/progressive.h"

namespace pf {
namespace {

// The slowest is a little below progressive photon mapping's 1/3: what 256 passes of the peer box showed.
constexpr double kMonteCarlo = 1.0 / 2.0, kSlowest = 0.3;

/// The exponent by which the error falls, from the pilot's last points.
Range slope(const std::vector<PilotPoint>& points) {
  Range b{kSlowest, (kMonteCarlo + kSlowest) / 2, kMonteCarlo};
  const PilotPoint* last = nullptr;
  const PilotPoint* before = nullptr;
  for (const PilotPoint& point : points) {
    if (point.error <= 0) continue;
    before = last;
    last = &point;
  }
  if (before != nullptr && last->passes > before->passes)
    b.likely =
        std::clamp(-std::log(last->error / before->error) / std::log(last->passes / before->passes), b.low, b.high);
  return b;
}

const PilotPoint* last_known_error(const std::vector<PilotPoint>& points) {
  const PilotPoint* last = nullptr;
  for (const PilotPoint& point : points) {
    if (point.error > 0) last = &point;
  }
  return last;
}

/// Seconds of a pass. The first part warms caches up; later ones tell how it goes on.
Range pass_seconds(const std::vector<PilotPoint>& points) {
  Range cost{1e300, 0, 0};
  double before = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double each = points[i].seconds / std::max(1.0, points[i].passes - before);
    before = points[i].passes;
    cost.likely = each;
    if (i == 0 && points.size() > 2) continue;
    cost.low = std::min(cost.low, each);
    cost.high = std::max(cost.high, each);
  }
  constexpr double kNoise = 0.15;  // between two runs of the same on a machine that does other things too
  return {std::min(cost.low, cost.likely) * (1 - kNoise), cost.likely, std::max(cost.high, cost.likely) * (1 + kNoise)};
}

nlohmann::json range_or_null(const Range& range) {
  if (range.likely <= 0) return {};
  return {{"low", range.low}, {"likely", range.likely}, {"high", range.high}};
}

double rounds_until(double passes, double growth) {
  constexpr double kMostPasses = 1e15;  // beyond, it is of no account
  double rounds = 0;
  for (double done = 0; done < std::min(passes, kMostPasses) && rounds < 1e6; ++rounds)
    done += static_cast<double>(round_size(static_cast<std::uint64_t>(done), growth));
  return rounds;
}

}  // namespace

Prediction predict(const PilotRender& pilot, const PredictionRequest& request) {
  const double error = request.error;
  Prediction p;
  const Range b = slope(pilot.points);
  const PilotPoint* known = last_known_error(pilot.points);
  if (error > 0 && known != nullptr) {
    const double ratio = std::max(known->error / error, 1e-3);
    const auto needed = [&](double exponent) {
      return std::max(1.0, std::ceil(known->passes * std::pow(ratio, 1.0 / exponent)));
    };
    // A steeper fall needs fewer passes on the way down, and more on the way back up.
    p.passes_to_error =
        Range{std::min(needed(b.high), needed(b.low)), needed(b.likely), std::max(needed(b.low), needed(b.high))};
  }
  p.passes = request.passes > 0 || !p.passes_to_error ? request.passes : p.passes_to_error->likely;
  if (known != nullptr) {
    const double ratio = known->passes / std::max(1.0, p.passes);
    const auto after = [&](double exponent) { return known->error * std::pow(ratio, exponent); };
    p.error = {std::min(after(b.high), after(b.low)), after(b.likely), std::max(after(b.low), after(b.high))};
  }
  const Range cost = pass_seconds(pilot.points);
  p.seconds = {pilot.setup_seconds + cost.low * p.passes, pilot.setup_seconds + cost.likely * p.passes,
               pilot.setup_seconds + cost.high * p.passes};
  const auto memory = static_cast<double>(pilot.peak_bytes);
  p.memory_bytes = {memory * 0.9, memory, memory * 1.25};
  // A worker sends one result a round, or, where no barrier makes it, one each 4 to 60 seconds; radii go to
  // all of them.
  const double n = request.workers;
  const double rounds = rounds_until(p.passes, request.round_growth);
  const double scene = static_cast<double>(pilot.scene_bytes) * (n + 1);
  const auto bytes = [&](double results, double states) {
    return scene + results * static_cast<double>(pilot.result_bytes) + states * static_cast<double>(pilot.state_bytes);
  };
  if (request.barrier && pilot.state_bytes > 0) {
    const double most = std::min(rounds * n, p.passes);  // early rounds have fewer sub-passes than workers
    p.network_bytes = {bytes(0.5 * most, 0.5 * most), bytes(most, most), bytes(2 * most, 1.5 * most)};
  } else {
    const double seconds = p.seconds.likely / n;
    const auto results = [&](double hold) { return std::clamp(seconds / hold, 1.0, std::max(1.0, p.passes / n)) * n; };
    p.network_bytes = {bytes(results(60), n), bytes(results(15), n), bytes(results(4), n)};
  }
  return p;
}

nlohmann::json prediction_json(const PilotRender& pilot, const Prediction& prediction, int workers) {
  using nlohmann::json;
  json points = json::array();
  for (const PilotPoint& point : pilot.points) {
    points.push_back({{"passes", point.passes},
                      {"seconds", point.seconds},
                      {"estimated_error", point.error > 0 ? json(point.error) : json()}});
  }
  return {{"passes", prediction.passes},
          {"seconds", range_or_null(prediction.seconds)},
          {"memory_bytes", range_or_null(prediction.memory_bytes)},
          {"network_bytes", range_or_null(prediction.network_bytes)},
          {"estimated_error", range_or_null(prediction.error)},
          {"passes_to_error", prediction.passes_to_error ? range_or_null(*prediction.passes_to_error) : json()},
          {"workers", workers},
          {"pilot", std::move(points)}};
}

}  // namespace pf
