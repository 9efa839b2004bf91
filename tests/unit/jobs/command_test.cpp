#include "jobs/command.h"

#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <nlohmann/json.hpp>

#include "build_id.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

/// A folder of its own for each test, with a script in the place of photonfarm-worker.
class PhotonfarmCommand : public testing::Test {
 protected:
  void worker(const std::string& script) const {
    std::ofstream(folder_ / "photonfarm-worker") << "#!/bin/sh\n" << script << '\n';
    fs::permissions(folder_ / "photonfarm-worker", fs::perms::owner_all);
  }
  int run(const Arguments& arguments) {
    const Context context{folder_, "/usr/bin:/bin", folder_ / "state", folder_, out_, err_};
    return run_photonfarm(context, arguments);
  }
  [[nodiscard]] std::string read(const std::string& name) const { return bytes_of(folder_ / name); }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
  std::ostringstream out_, err_;
};

TEST_F(PhotonfarmCommand, HelpListsEveryCommandWithAnExample) {
  EXPECT_EQ(run({"--help"}), 0);
  for (const Command& command : commands()) {
    EXPECT_NE(out_.str().find(command.summary), std::string::npos);
    EXPECT_NE(out_.str().find(command.example), std::string::npos);
  }
  EXPECT_TRUE(err_.str().empty());
}

TEST_F(PhotonfarmCommand, HelpNamesNoCommandThatDoesNotExist) {
  EXPECT_EQ(run({"--help"}), 0);
  EXPECT_EQ(out_.str().find("atlas"), std::string::npos);
}

TEST_F(PhotonfarmCommand, VersionNamesTheBuild) {
  EXPECT_EQ(run({"--version"}), 0);
  EXPECT_NE(out_.str().find(kBuildId), std::string::npos);
}

TEST_F(PhotonfarmCommand, NoCommandIsAUsageErrorWithHelp) {
  EXPECT_EQ(run({}), 2);
  EXPECT_NE(err_.str().find("Usage:"), std::string::npos);
  EXPECT_TRUE(out_.str().empty());
}

TEST_F(PhotonfarmCommand, AMistypedCommandGetsTheNearestName) {
  EXPECT_EQ(run({"rendr", "job.toml"}), 2);
  EXPECT_EQ(err_.str(), "photonfarm: unknown command 'rendr'; did you mean 'render'?; see photonfarm --help\n");
}

TEST_F(PhotonfarmCommand, AMistypedOptionGetsTheNearestName) {
  EXPECT_EQ(run({"doctor", "--jsn"}), 2);
  EXPECT_EQ(err_.str(),
            "photonfarm doctor: unknown option '--jsn'; did you mean '--json'?; see photonfarm doctor --help\n");
}

TEST_F(PhotonfarmCommand, AMissingArgumentIsAUsageError) {
  EXPECT_EQ(run({"compare", "a.exr"}), 2);
  EXPECT_NE(err_.str().find("REFERENCE"), std::string::npos) << err_.str();
}

TEST_F(PhotonfarmCommand, EveryOwnCommandHasHelpWithExamples) {
  for (const char* name : {"compare", "doctor"}) {
    out_.str("");
    EXPECT_EQ(run({name, "--help"}), 0);
    EXPECT_NE(out_.str().find("Examples:"), std::string::npos) << name;
  }
}

TEST_F(PhotonfarmCommand, ComparePassesOnWhatIsWrongWithAnImage) {
  EXPECT_EQ(run({"compare", (folder_ / "a.exr").string(), (folder_ / "b.exr").string()}), 3);
  EXPECT_NE(err_.str().find("a.exr"), std::string::npos);
  EXPECT_TRUE(out_.str().empty());
}

TEST_F(PhotonfarmCommand, RenderAndPlanGiveTheWorkerTheSameArguments) {
  worker("cd \"$(dirname \"$0\")\"; for a in \"$@\"; do echo \"<$a>\"; done > arguments; exit 3");
  EXPECT_EQ(run({"render", "my job.toml", "--set", "stop.passes=4", "--help"}), 3);
  EXPECT_EQ(read("arguments"), "<render>\n<my job.toml>\n<--set>\n<stop.passes=4>\n<--help>\n");
  EXPECT_EQ(run({"plan", "job.toml", "--json"}), 3);
  EXPECT_EQ(read("arguments"), "<plan>\n<job.toml>\n<--json>\n");
}

TEST_F(PhotonfarmCommand, AMissingWorkerIsUnavailable) {
  EXPECT_EQ(run({"render", "job.toml"}), 4);
  EXPECT_NE(err_.str().find("photonfarm-worker: cannot be started"), std::string::npos) << err_.str();
}

TEST_F(PhotonfarmCommand, AWorkerKilledByASignalIsReported) {
  worker("kill -SEGV $$");
  EXPECT_EQ(run({"render", "job.toml"}), 5);
  EXPECT_NE(err_.str().find("photonfarm-worker was killed by signal 11 (Segmentation fault)"), std::string::npos)
      << err_.str();
}

TEST_F(PhotonfarmCommand, AWorkerThatIsInterruptedGives130) {
  worker("kill -INT $$");
  EXPECT_EQ(run({"render", "job.toml"}), 130);
}

TEST_F(PhotonfarmCommand, PassesASignalOnToTheWorker) {
  // $PPID is this test's process: it gets the signal, and must hand it to the script, which then exits by
  // itself.
  worker("trap 'exit 42' TERM; kill -TERM $PPID; i=0; while [ $i -lt 100 ]; do sleep 0.1; i=$((i+1)); done");
  EXPECT_EQ(run({"render", "job.toml"}), 42);
}

TEST_F(PhotonfarmCommand, DoctorPrintsJsonAndNothingElse) {
  worker("[ \"$1\" = --version ] && echo 'photonfarm-worker " + std::string(kBuildId) + "'");
  const int code = run({"doctor", "--json"});
  const nlohmann::json report = nlohmann::json::parse(out_.str());
  EXPECT_EQ(code, report["ok"] == true ? 0 : 5);
  EXPECT_EQ(report["checks"].size(), 8U);
  EXPECT_EQ(report["checks"][1]["name"], "worker");
  EXPECT_EQ(report["checks"][1]["health"], "ok");
}

TEST_F(PhotonfarmCommand, DoctorWithoutAWorkerFailsWithAHint) {
  EXPECT_EQ(run({"doctor"}), 5);
  EXPECT_NE(out_.str().find("build or install photonfarm-worker"), std::string::npos);
  EXPECT_NE(out_.str().find("This machine cannot render yet."), std::string::npos);
}

}  // namespace
}  // namespace pf
