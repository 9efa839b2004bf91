#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace pf {

/// What one part of a pilot render showed: passes up to `passes`.
struct PilotPoint {
  double passes = 0;   ///< done at its end
  double seconds = 0;  ///< of rendering this part's passes
  double error = 0;    ///< estimated relative error at its end; 0: not known
};

/// What a short render showed, to foretell a long one from.
struct PilotRender {
  std::vector<PilotPoint> points;
  double setup_seconds = 0;        ///< loading, preparing, writing
  std::uint64_t peak_bytes = 0;    ///< of the renderer
  std::uint64_t result_bytes = 0;  ///< of one result on its way to the coordinator
  std::uint64_t state_bytes = 0;   ///< of a round's radii
  std::uint64_t scene_bytes = 0;   ///< of the job's files
};

/// What is asked about.
struct PredictionRequest {
  double passes = 0;  ///< 0: as many as the error aimed at is likely to take
  double error = 0;   ///< estimated relative error aimed at; 0: none
  int workers = 1;
  double round_growth = 0.25;  ///< of rounds with a barrier
  bool barrier = true;         ///< radii are shared by the sub-passes of a round
};

struct Range {
  double low = 0, likely = 0, high = 0;
};

struct Prediction {
  double passes = 0;                     ///< that seconds and bytes are for
  Range seconds;                         ///< on this machine
  Range memory_bytes;                    ///< of one renderer
  Range network_bytes;                   ///< of a farm of `workers`
  Range error;                           ///< after those passes
  std::optional<Range> passes_to_error;  ///< when an error is aimed at and the pilot knows one
};

/// What so many passes will cost. Error falls as a power of the passes:
/// between -1/2 (Monte Carlo) and -0.3 (progressive photon mapping, whose squared error falls as N^(-2/3),
/// and a little); the pilot's own slope gives the likely one, and the two laws the range.
[[nodiscard]] Prediction predict(const PilotRender& pilot, const PredictionRequest& request);

/// {"passes", "seconds": {"low", "likely", "high"}, "memory_bytes", "network_bytes", "estimated_error",
/// "passes_to_error", "workers", "pilot": [{"passes", "seconds", "estimated_error"}]}; what is not known is
/// null.
[[nodiscard]] nlohmann::json prediction_json(const PilotRender& pilot, const Prediction& prediction, int workers);

}  // namespace pf
