#include "worker/snapshots.h"
#include "tests/support/paths.h"

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/film/image.h"
#include "tests/support/temp_folder.h"
#include "worker/render_job.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

/// Renders the Cornell box, tiny; `set` wins over what makes it so.
RenderResult rendered(const fs::path& out, const std::vector<std::string>& set, const SnapshotPlan& snapshots,
                      const Clock& clock) {
  std::vector<std::string> all = {"job.name=image",         "image.width=8",
                                  "image.height=6",         "integrator.photons=2000",
                                  "checkpoint.seconds=1e9", "photon_map.caustic_photons=1000"};
  all.insert(all.end(), set.begin(), set.end());
  RenderRequest request;
  request.spec = load_job(test::source_dir() / "jobs" / "cornell-box.toml", all).value();
  request.out = out;
  request.threads = 1;
  request.snapshots = snapshots;
  const auto result = render_job(request, clock, [](const Progress&) {});
  EXPECT_TRUE(result) << result.error().message;
  return result.value_or(RenderResult{});
}

std::vector<float> beauty(const fs::path& file) {
  const auto image = read_exr(file);
  EXPECT_TRUE(image) << image.error().message;
  return image ? image->find("")->data : std::vector<float>();
}

TEST(Snapshots, HoldTheBitsOfARenderThatStoppedThere) {
  const TempFolder folder;
  const FakeClock clock;
  for (const char* type : {"sppm", "path", "photon_map"}) {
    const std::string integrator = std::string("integrator.type=") + type;
    const RenderResult whole = rendered(folder / "whole", {integrator, "stop.passes=7"}, {{}, {2, 5, 7}}, clock);
    ASSERT_GE(whole.snapshots.size(), 2u);  // passes of photon_map come in fours
    for (const RenderSnapshot& snapshot : whole.snapshots) {
      const auto passes = "stop.passes=" + std::to_string(static_cast<int>(snapshot.budget));
      const RenderResult stopped = rendered(folder / "stopped", {integrator, passes}, {}, clock);
      EXPECT_EQ(beauty(snapshot.exr), beauty(stopped.exr)) << type << ' ' << passes;
      EXPECT_EQ(snapshot.rays, stopped.rays);
      EXPECT_EQ(snapshot.photon_paths, stopped.photon_paths);
    }
  }
}

/// Every look at it takes a second.
class TickingClock final : public Clock {
 public:
  [[nodiscard]] double now() const override { return now_ += 1.0; }

 private:
  mutable double now_ = 0;
};

TEST(Snapshots, ComeBeforeTheirBudgetIsSpentAndTakeNoneOfIt) {
  const TempFolder folder;
  const TickingClock clock;
  const std::vector<std::string> set = {"integrator.type=path", "stop.passes=0", "stop.seconds=200"};
  const RenderResult result = rendered(folder / "out", set, {{50, 100, 200}, {}}, clock);
  ASSERT_EQ(result.snapshots.size(), 3u);
  for (const RenderSnapshot& snapshot : result.snapshots) {
    EXPECT_LE(snapshot.seconds, snapshot.budget);
    EXPECT_GT(snapshot.seconds, 0.7 * snapshot.budget);
  }
  EXPECT_LT(result.snapshots[0].passes, result.snapshots[1].passes);
  const RenderResult plain = rendered(folder / "plain", set, {}, clock);
  // Without snapshots the loop looks at the clock less often; with them it must not stop much earlier than that
  // explains.
  EXPECT_GT(3 * result.passes, plain.passes);
}

TEST(Snapshots, WaitForTheFirstWholePass) {
  const TempFolder folder;
  const TickingClock clock;
  const std::vector<std::string> set = {"integrator.type=photon_map", "stop.passes=0", "stop.seconds=2",
                                        "image.width=200", "image.height=70"};
  const RenderResult result = rendered(folder / "out", set, {{1, 2}, {}}, clock);
  ASSERT_EQ(result.snapshots.size(), 1u);
  EXPECT_GE(result.snapshots[0].passes, 1u);
  const std::vector<float> pixels = beauty(result.snapshots[0].exr);
  // So wide an image sees past the box.
  const RenderResult whole =
      rendered(folder / "whole", {"integrator.type=photon_map", "stop.passes=4", "image.width=200", "image.height=70"},
               {}, clock);
  const std::vector<float> complete = beauty(whole.exr);
  EXPECT_EQ(std::count(pixels.begin(), pixels.end(), 0.0f), std::count(complete.begin(), complete.end(), 0.0f));
  EXPECT_EQ(result.snapshots[0].budget, 2.0);
  EXPECT_GT(result.snapshots[0].seconds, 2.0);
}

}  // namespace
}  // namespace pf
