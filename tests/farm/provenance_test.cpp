// An image says how it came to be, and the same command finds out whether that is true: real farm, real
// renderer.

#include <fcntl.h>

#include <cstring>
#include <set>
#include <sstream>

#include <fmt/format.h>

#include "common/film/image.h"
#include "jobs/command.h"
#include "tests/farm/farm_fixture.h"
#include "tests/support/paths.h"

namespace pf::farm_test {
namespace {

namespace fs = std::filesystem;

class Provenance : public FarmFaults {
 protected:
  int run(const Arguments& arguments) {
    out_.str("");
    err_.str("");
    const Context context{test::bin_dir(), "/usr/bin:/bin", state_, folder_.path(), out_, err_};
    return run_photonfarm(context, arguments);
  }
  [[nodiscard]] fs::path out() const { return folder_.path() / "out"; }
  [[nodiscard]] fs::path image(const std::string& name) const { return out() / (name + ".exr"); }
  /// A job that is done, and its image.
  std::string done(const TestJob& job) {
    const std::string id = submit(job);
    EXPECT_TRUE(wait_until([&] { return has_ended(id); })) << show(id).dump(2);
    EXPECT_EQ(run({"download", id, "--out", out().string()}), 0) << err_.str();
    return id;
  }
  std::ostringstream out_, err_;
};

std::string metadata(const fs::path& exr, const char* key) {
  const auto image = read_exr(exr);
  EXPECT_TRUE(image) << image.error().message;
  const auto found = image ? image->metadata.find(key) : decltype(image->metadata.begin()){};
  return image && found != image->metadata.end() ? found->second : "absent";
}

TEST_F(Provenance, AFarmsImageIsVerifiedAndRenderedAgain) {
  start_farm(2);
  TestJob job;
  job.passes = 10;
  job.photons = 5000;
  static_cast<void>(done(job));
  // The chain of states is that of one machine.
  ASSERT_FALSE(hash_of_single_node(job).empty());
  EXPECT_EQ(metadata(image("box"), "state_chain"),
            metadata(folder_.path() / "single" / "box" / "box.exr", "state_chain"));
  EXPECT_EQ(metadata(image("box"), "files"), metadata(folder_.path() / "single" / "box" / "box.exr", "files"));

  EXPECT_EQ(run({"verify", image("box").string(), "--json"}), 0) << out_.str() << err_.str();
  EXPECT_TRUE(nlohmann::json::parse(out_.str()).value("same", false)) << out_.str();

  // Rendered again from the image alone.
  EXPECT_EQ(run({"submit", "--from", image("box").string(), "--wait", "--out", (folder_.path() / "again").string()}), 0)
      << err_.str();
  EXPECT_EQ(metadata(folder_.path() / "again" / "box.exr", "state_chain"), metadata(image("box"), "state_chain"));

  // One float of one layer is another.
  auto forged = read_exr(image("box"));
  ASSERT_TRUE(forged);
  forged->layers.back().data[7] += 1.0f;
  ASSERT_TRUE(write_exr(image("forged"), *forged));
  EXPECT_EQ(run({"verify", image("forged").string()}), 5) << out_.str() << err_.str();
  EXPECT_NE(out_.str().find("NOT the same"), std::string::npos) << out_.str();
  forged->metadata["build_id"] = "another";
  ASSERT_TRUE(write_exr(image("forged"), *forged));
  EXPECT_EQ(run({"verify", image("forged").string()}), 2) << out_.str();
}

TEST_F(Provenance, UnitsAreComputedAgainAndComparedWithWhatTheCoordinatorKept) {
  start_farm(2);
  TestJob job;
  job.type = "path";
  job.passes = 24;
  const std::string id = done(job);
  ASSERT_EQ(run({"verify", id, "--units", "100", "--seed", "1", "--json"}), 0) << out_.str() << err_.str();
  auto verdict = nlohmann::json::parse(out_.str());
  EXPECT_GT(verdict.value("same", 0), 0) << out_.str();
  EXPECT_EQ(verdict.value("same", 0), verdict.value("known", -1)) << "without shared radii every unit can be";
  job.type = "sppm";
  job.passes = 10;
  job.photons = 5000;
  const std::string shared = done(job);
  ASSERT_EQ(run({"verify", shared, "--units", "100", "--json"}), 0) << out_.str() << err_.str();
  verdict = nlohmann::json::parse(out_.str());
  EXPECT_GT(verdict.value("same", 0), 0) << "the first round's";
  EXPECT_EQ(verdict.value("different", -1), 0) << out_.str();
}

TEST_F(Provenance, TheCoordinatorWritesItsStateFolderAlone) {
  start_farm(1);
  TestJob job;
  job.passes = 400;
  job.photons = 2000;
  job.checkpoint_seconds = 0.1;
  const std::string id = submit(job);
  wait_for_passes(id, 2);
  const fs::path fds = fmt::format("/proc/{}/fd", coordinator_->pid());
  std::set<fs::path> inherited;  // what the test's own caller left open, ctest its log
  for (const auto& fd : fs::directory_iterator("/proc/self/fd")) {
    std::error_code closed;
    inherited.insert(fs::read_symlink(fd.path(), closed));
  }
  int seen = 0;
  for (int look = 0; look < 50; ++look) {
    std::error_code error;
    for (const auto& fd : fs::directory_iterator(fds, error)) {
      const fs::path target = fs::read_symlink(fd.path(), error);
      const std::string info = read_file(fds.parent_path() / "fdinfo" / fd.path().filename(), 4096).value_or("");
      const std::size_t flags = info.find("flags:");
      if (error || flags == std::string::npos || !target.string().starts_with('/') ||
          fs::is_character_file(target, error) || inherited.contains(target))
        continue;
      if ((std::stoul(info.substr(flags + 6), nullptr, 8) & O_ACCMODE) == O_RDONLY) continue;
      const bool is_log = target.string().ends_with(".log");  // its standard error
      EXPECT_TRUE(is_log || target.string().starts_with(fs::canonical(state_).string())) << target;
      ++seen;
    }
    wait_readable(-1, in(0.01));
  }
  EXPECT_GT(seen, 0);
  cancel(id);
}

TEST_F(Provenance, AnEstimateNamesItsRanges) {
  const std::string job = (test::source_dir() / "jobs" / "peer-box.toml").string();
  ASSERT_EQ(run({"estimate", job, "--set", "image.width=32", "--set", "image.height=32", "--set",
                 "integrator.photons=2000", "--seconds", "1", "--error", "0.05", "--workers", "4", "--json"}),
            0)
      << err_.str();
  const auto document = nlohmann::json::parse(out_.str());
  for (const char* what : {"seconds", "memory_bytes", "network_bytes", "passes_to_error"}) {
    const auto& range = document[what];
    EXPECT_GT(range["low"].get<double>(), 0) << what;
    EXPECT_LE(range["low"], range["likely"]) << what;
    EXPECT_LE(range["likely"], range["high"]) << what;
  }
  EXPECT_EQ(run({"estimate", "absent.toml"}), 2);
  EXPECT_EQ(run({"estimate", job, "--farm", "--workers", "4"}), 2) << "the farm's own workers are meant";
}

TEST_F(Provenance, AnEstimateIsMadeOnTheFarmByTheJobItself) {
  start_farm(2);
  const std::string job = (test::source_dir() / "jobs" / "peer-box.toml").string();
  const Arguments arguments = {"estimate", job,
                               "--set",    "image.width=32",
                               "--set",    "image.height=32",
                               "--set",    "integrator.photons=20000",
                               "--set",    "stop.passes=100000",
                               "--farm",   "--seconds",
                               "4",        "--json"};
  ASSERT_EQ(run(arguments), 0) << err_.str();
  const auto document = nlohmann::json::parse(out_.str());
  EXPECT_EQ(document["passes"], 100000);
  EXPECT_EQ(document["workers"], 2);
  for (const char* what : {"seconds", "memory_bytes", "network_bytes"}) {
    EXPECT_GT(document[what]["low"].get<double>(), 0) << document.dump(2);
    EXPECT_LE(document[what]["likely"], document[what]["high"]) << what;
  }
  EXPECT_GT(document["seconds"]["likely"].get<double>(), 4);
  EXPECT_NE(err_.str().find(fmt::format("photonfarm extend {}", document["job"].get<std::string>())), std::string::npos)
      << err_.str();
}

}  // namespace
}  // namespace pf::farm_test
