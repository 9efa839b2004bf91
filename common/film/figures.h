#pragma once

#include <cstdint>

#include <nlohmann/json_fwd.hpp>

namespace pf {

/// What an image took.
struct WorkFigures {
  std::uint64_t passes = 0, rounds = 0, photon_paths = 0, photons_stored = 0, rays = 0;
  std::uint64_t peak_bytes = 0;  ///< of the process
};

/// What an image that was written at a budget took.
struct SnapshotFigures : WorkFigures {
  double budget = 0;       ///< the largest that asked for it: seconds or passes
  double seconds = 0;      ///< as stop.seconds counts, loading included, other snapshots left out
  double cpu_seconds = 0;  ///< of the whole process, other snapshots left out
};

/// By the names of the fields, in their order; a snapshot's budget and seconds first.
[[nodiscard]] nlohmann::ordered_json figures_json(const WorkFigures& figures);
[[nodiscard]] nlohmann::ordered_json figures_json(const SnapshotFigures& figures);
/// Reads them back; what is not there is 0. Throws nlohmann::json::exception for a value that is no number.
[[nodiscard]] SnapshotFigures snapshot_figures(const nlohmann::json& object);

}  // namespace pf
