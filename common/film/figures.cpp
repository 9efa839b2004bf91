#include "common/film/figures.h"

#include <nlohmann/json.hpp>

namespace pf {
namespace {

template <typename Struct, typename Value>
struct Named {
  const char* name;
  Value Struct::*field;
};

constexpr Named<SnapshotFigures, double> kSpent[] = {{"budget", &SnapshotFigures::budget},
                                                     {"seconds", &SnapshotFigures::seconds},
                                                     {"cpu_seconds", &SnapshotFigures::cpu_seconds}};
constexpr Named<WorkFigures, std::uint64_t> kCounts[] = {{"passes", &WorkFigures::passes},
                                                         {"rounds", &WorkFigures::rounds},
                                                         {"photon_paths", &WorkFigures::photon_paths},
                                                         {"photons_stored", &WorkFigures::photons_stored},
                                                         {"rays", &WorkFigures::rays},
                                                         {"peak_bytes", &WorkFigures::peak_bytes}};

}  // namespace

nlohmann::ordered_json figures_json(const WorkFigures& figures) {
  nlohmann::ordered_json json;
  for (const auto& [name, field] : kCounts) json[name] = figures.*field;
  return json;
}

nlohmann::ordered_json figures_json(const SnapshotFigures& figures) {
  nlohmann::ordered_json json;
  for (const auto& [name, field] : kSpent) json[name] = figures.*field;
  json.update(figures_json(static_cast<const WorkFigures&>(figures)));
  return json;
}

SnapshotFigures snapshot_figures(const nlohmann::json& object) {
  SnapshotFigures figures;
  for (const auto& [name, field] : kSpent) figures.*field = object.value(name, 0.0);
  for (const auto& [name, field] : kCounts) figures.*field = object.value(name, std::uint64_t{0});
  return figures;
}

}  // namespace pf
