#include "common/film/figures.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace pf {
namespace {

TEST(Figures, StandInJsonByTheirNamesInOneOrderAndAreReadBack) {
  SnapshotFigures figures;
  figures.budget = 0.5;
  figures.seconds = 0.25;
  figures.cpu_seconds = 1.5;
  figures.passes = 1;
  figures.rounds = 2;
  figures.photon_paths = 3;
  figures.photons_stored = 4;
  figures.rays = std::uint64_t{1} << 60;
  figures.peak_bytes = 6;
  const auto json = figures_json(figures);
  EXPECT_EQ(json.dump(), R"({"budget":0.5,"seconds":0.25,"cpu_seconds":1.5,"passes":1,"rounds":2,"photon_paths":3,)"
                         R"("photons_stored":4,"rays":1152921504606846976,"peak_bytes":6})");
  EXPECT_EQ(figures_json(snapshot_figures(json)), json);
  EXPECT_EQ(figures_json(static_cast<const WorkFigures&>(figures)).size(), 6u);
}

TEST(Figures, ThatAreNotThereAreNothing) {
  const SnapshotFigures figures = snapshot_figures({{"passes", 7}});
  EXPECT_EQ(figures.passes, 7u);
  EXPECT_EQ(figures.seconds, 0.0);
  EXPECT_EQ(figures.rays, 0u);
}

}  // namespace
}  // namespace pf
