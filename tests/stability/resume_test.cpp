// The real renderer, killed, interrupted, stopped and resumed: whatever happens, the image's bits depend on
// the job alone. Moments are chosen by what the process does to its output folder (inotify), never by
// sleeping.
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "common/film/image.h"
#include "tests/stability/process.h"
#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"

namespace pf::test {
namespace {

namespace fs = std::filesystem;

constexpr double kDeadline = 120.0;  ///< seconds for one run, on a machine that is busy with other tests
constexpr int kPasses = 12;

fs::path worker_program() { return bin_dir() / "photonfarm-worker"; }

/// How a run ended; `json` is standard output, parsed as one document (null when it was empty).
struct Outcome {
  ProcessEnd end;
  std::string out, err;
  nlohmann::json json;
  [[nodiscard]] std::string hash() const { return json.is_object() ? json.value("image_hash", "") : ""; }
  [[nodiscard]] std::uint64_t passes() const { return json.is_object() ? json.value("passes", std::uint64_t{0}) : 0; }
};

class Resume : public testing::Test {
 protected:
  [[nodiscard]] static fs::path job(const std::string& name) { return source_dir() / "jobs" / (name + ".toml"); }
  [[nodiscard]] fs::path out(const std::string& name) const { return folder_ / name; }

  /// A render of one of the example jobs, made small, and what each test adds to it.
  [[nodiscard]] std::vector<std::string> arguments(const std::string& job_name, const fs::path& to,
                                                   const std::vector<std::string>& more = {}) const {
    std::vector<std::string> all = {"render", job(job_name).string(), "--json", "--out", to.string()};
    for (const std::string& set :
         {std::string("image.width=64"), std::string("image.height=64"), std::string("integrator.photons=5000"),
          fmt::format("stop.passes={}", kPasses), std::string("checkpoint.seconds=1000")}) {
      all.insert(all.end(), {"--set", set});
    }
    all.insert(all.end(), more.begin(), more.end());
    if (std::find(more.begin(), more.end(), "--threads") == more.end()) all.insert(all.end(), {"--threads", "2"});
    return all;
  }

  Outcome finish(Process& process) {
    Outcome run;
    run.end = process.wait(kDeadline);
    run.out = bytes_of(process.stdout_file());
    run.err = bytes_of(process.stderr_file());
    if (!run.out.empty()) {
      run.json = nlohmann::json::parse(run.out, nullptr, false);
      EXPECT_FALSE(run.json.is_discarded()) << "standard output is not one JSON document: " << run.out;
    }
    return run;
  }
  Outcome run(const std::vector<std::string>& arguments, std::uint64_t max_file_bytes = 0) {
    Process process(worker_program(), arguments, folder_, max_file_bytes);
    return finish(process);
  }
  /// A run that must succeed.
  Outcome render(const std::string& job_name, const fs::path& to, const std::vector<std::string>& more = {}) {
    Outcome r = run(arguments(job_name, to, more));
    EXPECT_EQ(r.end, ProcessEnd::exited(0)) << r.err;
    EXPECT_EQ(r.hash().size(), 64u) << r.out;
    return r;
  }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
};

/// The same job in every way in which statistics are kept.
const std::vector<std::vector<std::string>> kModes = {
    {"--set", "integrator.type=\"sppm\"", "--set", "integrator.mode=\"shared\""},
    {"--set", "integrator.type=\"sppm\"", "--set", "integrator.mode=\"independent\""},
    {"--set", "integrator.type=\"path\""}};

std::vector<std::string> operator+(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

std::vector<std::string> passes(std::uint64_t count) { return {"--set", fmt::format("stop.passes={}", count)}; }

TEST_F(Resume, OneHashWhateverTheThreads) {
  const auto expect_one_hash = [&](const std::string& job_name, const std::vector<std::string>& more) {
    const std::string one = render(job_name, out("a"), more + std::vector<std::string>{"--threads", "1"}).hash();
    for (const char* threads : {"2", "5"}) {
      EXPECT_EQ(render(job_name, out("a"), more + std::vector<std::string>{"--threads", threads}).hash(), one)
          << job_name << ", threads " << threads;
    }
  };
  expect_one_hash("cornell-box", {});
  for (const auto& mode : kModes) expect_one_hash("peer-box", mode);
}

TEST_F(Resume, OtherSeedsGiveOtherImages) {
  EXPECT_NE(render("peer-box", out("a")).hash(), render("peer-box", out("a"), {"--set", "integrator.seed=2"}).hash());
}

TEST_F(Resume, KilledAtAnyMomentItGoesOnToTheSameBits) {
  std::mt19937 random(20240607);
  for (const auto& mode : kModes) {
    const std::vector<std::string> all = mode + std::vector<std::string>{"--set", "checkpoint.seconds=0"};
    const Outcome undisturbed = render("peer-box", out("whole"), all);
    for (int attempt = 0; attempt < 2; ++attempt) {
      const fs::path to = out(fmt::format("killed{}", attempt));
      fs::remove_all(to);
      fs::create_directories(to);
      bool resume = false;
      Outcome last;
      for (int life = 0; life < 5; ++life) {
        // The last life is left alone; those before end at the n-th file made or put in place.
        FolderWatch watch(to);
        Process process(worker_program(),
                        arguments("peer-box", to, resume ? all + std::vector<std::string>{"--resume"} : all), folder_);
        if (life < 4) {
          const int events = std::uniform_int_distribution<int>(1, 7)(random);
          for (int e = 0; e < events && process.running(); ++e) {
            if (!watch.wait_for_any(process, kDeadline)) break;
          }
          process.signal(SIGKILL);
        }
        last = finish(process);
        ASSERT_TRUE(last.end == ProcessEnd::exited(0) || last.end == ProcessEnd::killed(SIGKILL)) << last.err;
        if (last.end == ProcessEnd::exited(0)) break;
        resume = fs::exists(to / "peer-box.checkpoint");
      }
      EXPECT_EQ(last.hash(), undisturbed.hash()) << mode.back();
      EXPECT_EQ(last.json["photon_paths"], undisturbed.json["photon_paths"]);
      EXPECT_EQ(last.json["rounds"], undisturbed.json["rounds"]);
    }
  }
}

TEST_F(Resume, InterruptedItLeavesACheckpointThatGoesOnToTheSameBits) {
  for (const int signal : {SIGINT, SIGTERM}) {
    const fs::path to = out(fmt::format("interrupted{}", signal));
    FolderWatch watch(folder_);
    Process process(worker_program(), arguments("peer-box", to, passes(1000000)), folder_);
    while (!fs::exists(to)) ASSERT_TRUE(watch.wait_for_any(process, kDeadline)) << bytes_of(process.stderr_file());
    process.signal(signal);
    const Outcome stopped = finish(process);
    EXPECT_EQ(stopped.end, ProcessEnd::exited(130)) << stopped.err;
    EXPECT_TRUE(stopped.out.empty());
    EXPECT_TRUE(fs::exists(to / "peer-box.checkpoint"));
    EXPECT_FALSE(fs::exists(to / "peer-box.exr"));
    EXPECT_NE(stopped.err.find("--resume"), std::string::npos) << stopped.err;
    std::uint64_t done = 0;
    const std::size_t at = stopped.err.find("interrupted after ");
    ASSERT_NE(at, std::string::npos) << stopped.err;
    std::istringstream(stopped.err.substr(at + std::string("interrupted after ").size())) >> done;
    ASSERT_GT(done, 0u);

    const Outcome resumed = render("peer-box", to, passes(done + 5) + std::vector<std::string>{"--resume"});
    const Outcome whole = render("peer-box", out("whole"), passes(done + 5));
    EXPECT_EQ(resumed.passes(), done + 5);
    EXPECT_EQ(resumed.hash(), whole.hash());
  }
}

TEST_F(Resume, AnExtendedJobEqualsOneLongRun) {
  for (const auto& mode : kModes) {
    const Outcome whole = render("peer-box", out("whole"), mode + passes(17));
    // 5 and 8 lie inside rounds, which stay open.
    render("peer-box", out("extended"), mode + passes(5));
    render("peer-box", out("extended"), mode + passes(8) + std::vector<std::string>{"--resume", "--threads", "1"});
    const Outcome extended =
        render("peer-box", out("extended"), mode + passes(17) + std::vector<std::string>{"--resume"});
    EXPECT_EQ(extended.hash(), whole.hash()) << mode.back();
    EXPECT_EQ(extended.json["rounds"], whole.json["rounds"]);
    EXPECT_EQ(extended.json["rays"], whole.json["rays"]);
  }
}

TEST_F(Resume, AStopByTimeFallsOnABorder) {
  for (const auto& mode : kModes) {
    const Outcome timed = render("peer-box", out("timed"),
                                 mode + std::vector<std::string>{"--set", "stop.passes=0", "--set", "stop.seconds=1"});
    ASSERT_GT(timed.passes(), 0u);
    EXPECT_EQ(render("peer-box", out("counted"), mode + passes(timed.passes())).hash(), timed.hash()) << mode.back();
  }
}

TEST_F(Resume, AStopByErrorFallsOnABorder) {
  const Outcome stopped = render("peer-box", out("error"), {"--set", "stop.passes=10000", "--set", "stop.error=0.3"});
  ASSERT_LT(stopped.passes(), 10000u);
  EXPECT_LE(stopped.json["estimated_error"].get<double>(), 0.3);
  EXPECT_EQ(render("peer-box", out("counted"), passes(stopped.passes())).hash(), stopped.hash());
}

TEST_F(Resume, ACheckpointOfAnotherJobIsRefused) {
  render("peer-box", out("a"), passes(2));
  const std::vector<std::vector<std::string>> others = {{"--set", "integrator.seed=2"}, {"--set", "image.width=32"}};
  for (const auto& other : others) {
    const Outcome r = run(arguments("peer-box", out("a"), other + std::vector<std::string>{"--resume"}));
    EXPECT_EQ(r.end, ProcessEnd::exited(3)) << r.err;
    EXPECT_NE(r.err.find("another job"), std::string::npos) << r.err;
  }
}

TEST_F(Resume, ADamagedCheckpointIsRefused) {
  render("peer-box", out("a"), passes(2));
  const fs::path file = out("a") / "peer-box.checkpoint";
  std::string bytes = bytes_of(file);
  std::mt19937 random(7);
  for (int i = 0; i < 3; ++i) {
    std::string damaged = bytes;
    const std::size_t at = std::uniform_int_distribution<std::size_t>(0, bytes.size() - 1)(random);
    if (i % 2 == 0) {
      damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    } else {
      damaged.resize(at);
    }
    std::ofstream(file, std::ios::binary).write(damaged.data(), static_cast<std::streamsize>(damaged.size()));
    const Outcome r = run(arguments("peer-box", out("a"), {"--resume"}));
    EXPECT_EQ(r.end, ProcessEnd::exited(3)) << r.err;
    EXPECT_NE(r.err.find("not a whole checkpoint"), std::string::npos) << r.err;
  }
}

TEST_F(Resume, WithoutACheckpointItSaysSo) {
  const Outcome r = run(arguments("peer-box", out("empty"), {"--resume"}));
  EXPECT_EQ(r.end, ProcessEnd::exited(3)) << r.err;
  EXPECT_NE(r.err.find("start without --resume"), std::string::npos) << r.err;
  EXPECT_TRUE(r.out.empty());
}

using ExitCodes = Resume;

/// A job file in the test's own folder.
void write_job(const fs::path& file, const std::string& scene, const std::string& more = "") {
  std::ofstream(file) << "spec_version = 1\n[job]\nname = \"test\"\n[scene]\nfile = \"" << scene << "\"\n" << more;
}

TEST_F(ExitCodes, BadJobsAreTwo) {
  write_job(folder_ / "bad.toml", "scene.glb", "[image]\nwidth = \"wide\"\n");
  for (const fs::path& file : {folder_ / "bad.toml", folder_ / "missing.toml"}) {
    const Outcome r = run({"render", file.string(), "--json", "--out", out("a").string()});
    EXPECT_EQ(r.end, ProcessEnd::exited(2)) << file << r.err;
    EXPECT_NE(r.err.find(file.filename().string()), std::string::npos) << r.err;
    EXPECT_TRUE(r.out.empty());
  }
  EXPECT_EQ(run({"render"}).end, ProcessEnd::exited(2));
  EXPECT_EQ(run({"rendr"}).end, ProcessEnd::exited(2));
  EXPECT_EQ(run(arguments("peer-box", out("a"), {"--set", "image.widht=3"})).end, ProcessEnd::exited(2));
}

TEST_F(ExitCodes, BadScenesAreThree) {
  std::ofstream(folder_ / "broken.gltf")
      << R"({"asset":{"version":"2.0"},"nodes":[{"mesh":5}],"scenes":[{"nodes":[0]}]})";
  std::ofstream(folder_ / "text.glb") << "this is no scene";
  for (const std::string scene : {"missing.glb", "broken.gltf", "text.glb"}) {
    write_job(folder_ / "job.toml", scene);
    for (const char* command : {"render", "plan"}) {
      const Outcome r = run({command, (folder_ / "job.toml").string(), "--json"});
      EXPECT_EQ(r.end, ProcessEnd::exited(3)) << command << ' ' << scene << ": " << r.err;
      EXPECT_NE(r.err.find(scene), std::string::npos) << r.err;
      EXPECT_TRUE(r.out.empty());
    }
  }
  const Outcome camera = run(arguments("peer-box", out("a"), {"--set", "scene.camera=\"nobody\""}));
  EXPECT_EQ(camera.end, ProcessEnd::exited(3)) << camera.err;
}

TEST_F(ExitCodes, AnOutputFolderThatCannotBeMadeIsTwo) {
  std::ofstream(folder_ / "file") << "in the way";
  for (const fs::path& to : {folder_ / "file", folder_ / "file" / "below"}) {
    const Outcome r = run(arguments("peer-box", to));
    EXPECT_EQ(r.end, ProcessEnd::exited(2)) << r.err;
    EXPECT_NE(r.err.find("--out"), std::string::npos) << r.err;
  }
}

TEST_F(ExitCodes, JsonIsOneDocumentAndStandsBesideTheImage) {
  const Outcome r = render("cornell-box", out("a"), passes(2));
  EXPECT_TRUE(r.json.is_object());
  EXPECT_EQ(nlohmann::json::parse(bytes_of(out("a") / "cornell-box.json")), r.json);
  EXPECT_TRUE(read_exr(out("a") / "cornell-box.exr").has_value());
  const Outcome plan = run({"plan", job("cornell-box").string(), "--json"});
  EXPECT_EQ(plan.end, ProcessEnd::exited(0)) << plan.err;
  EXPECT_TRUE(plan.json.is_object());
}

TEST_F(ExitCodes, AFullDiskIsFiveAndLeavesTheOldFiles) {
  const fs::path to = out("a");
  render("peer-box", to, passes(2));
  const std::vector<std::string> names = {"peer-box.exr", "peer-box.png", "peer-box.json", "peer-box.checkpoint"};
  std::vector<std::string> old;
  for (const std::string& name : names) old.push_back(bytes_of(to / name));
  // The limit lets ever more files through before one does not fit.
  for (const std::string first : {"peer-box.exr", "peer-box.checkpoint"}) {
    const auto limit = static_cast<std::uint64_t>(fs::file_size(to / first)) / 2;
    const Outcome r =
        run(arguments("peer-box", to, passes(3) + std::vector<std::string>{"--set", "checkpoint.seconds=0"}), limit);
    EXPECT_EQ(r.end, ProcessEnd::exited(5)) << r.err;
    EXPECT_TRUE(r.out.empty()) << r.out;
    EXPECT_NE(r.err.find("File too large"), std::string::npos) << r.err;
    EXPECT_NE(r.err.find(to.string()), std::string::npos) << r.err;
  }
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(bytes_of(to / names[i]) == old[i], true) << names[i];
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(to)) {
    ++files;
    EXPECT_FALSE(entry.path().filename().string().starts_with('.')) << entry.path() << " is left over";
  }
  EXPECT_EQ(files, names.size());
  // And with room again it goes on from the old checkpoint.
  const Outcome resumed = render("peer-box", to, passes(3) + std::vector<std::string>{"--resume"});
  EXPECT_EQ(resumed.hash(), render("peer-box", out("b"), passes(3)).hash());
}

TEST_F(ExitCodes, AnImageThatDoesNotFitIsFiveAndLeavesTheOldOne) {
  const fs::path to = out("a");
  render("peer-box", to, passes(2));
  const std::string old = bytes_of(to / "peer-box.exr");
  // The checkpoint is not written before the image, so the image is the first that does not fit.
  const Outcome r = run(arguments("peer-box", to, passes(3)), old.size() / 2);
  EXPECT_EQ(r.end, ProcessEnd::exited(5)) << r.err;
  EXPECT_NE(r.err.find("peer-box.exr"), std::string::npos) << r.err;
  EXPECT_TRUE(bytes_of(to / "peer-box.exr") == old);
}

}  // namespace
}  // namespace pf::test
