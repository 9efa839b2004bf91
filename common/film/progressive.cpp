#include "common/film/progressive.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace pf {
namespace {

/// std::lgamma writes a global sign; this one does not.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

}  // namespace

FlowState updated(const FlowState& state, std::uint32_t photons, const std::array<std::int64_t, 3>& flow,
                  std::uint64_t sub_passes, double alpha) {
  if (photons == 0) {
    // Hit points of split paths bring flux that does not steer the radius: it stays, and the radius does too.
    FlowState next = state;
    for (std::size_t c = 0; c < 3; ++c) next.tau[c] = static_cast<float>(state.tau[c] + static_cast<double>(flow[c]));
    return next;
  }
  const double found = photons;
  const std::uint64_t steps = std::min<std::uint64_t>(sub_passes, photons);
  const double share = 1.0 / static_cast<double>(steps);
  double area = 1.0;  // R^2 / R_round^2
  double count = state.count;
  std::array<double, 3> tau{state.tau[0], state.tau[1], state.tau[2]};
  for (std::uint64_t step = 0; step < steps; ++step) {
    const double m = found * share * area;
    const double kept = count + alpha * m;
    const double shrink = kept / (count + m);
    for (std::size_t c = 0; c < 3; ++c) tau[c] = (tau[c] + static_cast<double>(flow[c]) * share * area) * shrink;
    count = kept;
    area *= shrink;
  }
  FlowState next;
  next.radius2 = static_cast<float>(state.radius2 * area);
  next.count = static_cast<float>(count);
  for (std::size_t c = 0; c < 3; ++c) next.tau[c] = static_cast<float>(tau[c]);
  return next;
}

std::uint64_t round_size(std::uint64_t sub_passes_done, double growth) {
  if (growth <= 0) return 1;
  const auto asked = 1 + static_cast<std::uint64_t>(std::floor(static_cast<double>(sub_passes_done) * growth));
  const auto size = std::max<std::uint64_t>(2, asked);
  const std::uint64_t step = std::max<std::uint64_t>(2, std::bit_floor(size) / 2);
  return size / step * step;
}

double independent_radius2_ratio(std::uint64_t index, double alpha) {
  // prod (k - 1 + alpha)/k = Gamma(index + alpha) / (Gamma(alpha) Gamma(index + 1)), the same for any index at any
  // cost.
  if (index == 0) return 1.0;
  const auto n = static_cast<double>(index);
  return std::exp(log_gamma(n + alpha) - log_gamma(alpha) - log_gamma(n + 1.0));
}

}  // namespace pf
