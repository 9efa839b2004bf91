#pragma once

#include <array>
#include <cstdint>

#include "common/film/statistics.h"

namespace pf {

/// Progressive state of one flow at one pixel [Hachisuka and Jensen 2009, section 3]: shared by all hit points of the
/// pixel.
struct FlowState {
  float radius2 = 0;           ///< R^2 [m^2]
  float count = 0;             ///< N, photons kept so far
  std::array<float, 3> tau{};  ///< flux in the disc of radius R, in steps of SumScale::flow
};

struct ProgressivePixel {
  std::array<FlowState, kFlows> flow;
  float covered_radius =
      0;  ///< discs up to this radius [m] lie whole on the surface; what wider ones cover is measured

  [[nodiscard]] FlowState& operator[](std::size_t f) { return flow[f]; }
  [[nodiscard]] const FlowState& operator[](std::size_t f) const { return flow[f]; }
};

/// One round's update [Hachisuka08 (5)-(9)] as if its sub-passes had come one after the other, in V = min(S, M) virtual
/// steps: step i finds m = (M/V) R_i^2/R_round^2 photons, because the steps before it have already shrunk the disc.
/// `photons`, `flow`: what the round's `sub_passes` found within the radius at the round's start. rounds of any size
/// give the same mean, variance and radius (tests/stability). alpha in (0, 1].
[[nodiscard]] FlowState updated(const FlowState& state, std::uint32_t photons, const std::array<std::int64_t, 3>& flow,
                                std::uint64_t sub_passes, double alpha);

/// Sub-passes of the round that starts after `sub_passes_done` = n: 1 + floor(growth n), at least 2, less what is over
/// a multiple of 2, from 8 on of 4, from 16 on of 8 and so on: workers share such a round without waiting for the last
/// odd one. Always 1 without growth.
[[nodiscard]] std::uint64_t round_size(std::uint64_t sub_passes_done, double growth);

/// Squared radius of sub-pass `index` relative to that of sub-pass 0 [Knaus and Zwicker 2011, (20)]:
/// product over k = 1..index of (k - 1 + alpha) / k.
[[nodiscard]] double independent_radius2_ratio(std::uint64_t index, double alpha);

}  // namespace pf
