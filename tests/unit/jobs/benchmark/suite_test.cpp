#include "jobs/benchmark/suite.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/paths.h"
#include "tests/support/temp_folder.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

constexpr const char* kWhole = R"(
bench_version = 1
name = "all keys"
[run]
seconds = [1, 2.5]
repetitions = 4
first_seed = 7
threads = 2
width = 32
height = 24
shuffle = 5
timeout = 99
time = "cpu"
targets = [0.01, 0.1]
[reference]
type = "path"
set = ["integrator.max_depth=0"]
passes = 8
max_passes = 32
seconds = 3
confidence = 1e-3
[[scene]]
name = "a"
job = "jobs/a.toml"
set = ["scene.lens_radius=0.1"]
width = 16
reference = { type = "sppm", passes = 4 }
[[scene]]
job = "jobs/b.toml"
[[method]]
type = "path"
[[method]]
name = "many"
type = "sppm"
set = ["integrator.alpha=0.5"]
vary = "integrator.photons"
values = ["1000", "5000"]
)";

Result<Suite> parse(const std::string& text, std::vector<std::string>* notes = nullptr) {
  std::vector<std::string> own;
  return parse_suite(text, "s.toml", "/suites", notes == nullptr ? own : *notes);
}
std::string error_of(const std::string& text) {
  const auto suite = parse(text);
  return suite ? "no error" : suite.error().message;
}
std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

TEST(BenchSuite, ReadsEveryKey) {
  const auto suite = parse(kWhole);
  ASSERT_TRUE(suite) << suite.error().message;
  EXPECT_EQ(suite->name, "all keys");
  EXPECT_EQ(suite->seconds, (std::vector<double>{1, 2.5}));
  EXPECT_EQ(suite->repetitions, 4);
  EXPECT_EQ(suite->first_seed, 7u);
  EXPECT_EQ(suite->threads, 2);
  EXPECT_EQ(suite->shuffle, 5u);
  EXPECT_EQ(suite->timeout, 99);
  EXPECT_EQ(suite->time, TimeAxis::kCpu);
  EXPECT_EQ(suite->targets, (std::vector<double>{0.1, 0.01}));
  ASSERT_EQ(suite->scenes.size(), 2u);
  const SceneEntry& a = suite->scenes[0];
  EXPECT_EQ(a.job, fs::path("/suites/jobs/a.toml"));
  EXPECT_EQ(a.width, 16);
  EXPECT_EQ(a.height, 24);  // of [run]
  EXPECT_EQ(a.reference.type, "sppm");
  EXPECT_EQ(a.reference.passes, 4);
  EXPECT_EQ(a.reference.max_passes, 32);  // of [reference]
  EXPECT_EQ(suite->scenes[1].name, "b");
  EXPECT_EQ(suite->scenes[1].reference.type, "path");
  ASSERT_EQ(suite->methods.size(), 3u);
  EXPECT_EQ(suite->methods[0].name, "path");
  EXPECT_EQ(suite->methods[2].name, "many photons=5000");
  EXPECT_EQ(suite->methods[2].set, (std::vector<std::string>{"integrator.alpha=0.5", "integrator.photons=5000"}));
  EXPECT_EQ(suite->runs(), 24u);
}

TEST(BenchSuite, AnUnknownKeyNamesItsPlaceAndTheNearest) {
  const std::string message = error_of(replaced(kWhole, "repetitions", "repetitons"));
  EXPECT_NE(message.find("s.toml:6:1: unknown key 'repetitons' in [run]"), std::string::npos) << message;
  EXPECT_NE(message.find("did you mean 'repetitions'?"), std::string::npos) << message;
  EXPECT_NE(error_of(replaced(kWhole, "[[scene]]\nname", "[[scene]]\nnane")).find("did you mean 'name'?"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kWhole, "passes = 4 }", "pases = 4 }")).find("did you mean 'passes'?"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kWhole, "[reference]", "[referenze]")).find("did you mean 'reference'?"),
            std::string::npos);
}

TEST(BenchSuite, WrongValuesAreErrorsWithAPlace) {
  const auto refused = [](const std::string& what, const std::string& by, const std::string& says) {
    const std::string message = error_of(replaced(kWhole, what, by));
    EXPECT_NE(message.find(says), std::string::npos) << message;
    EXPECT_EQ(message.find("s.toml:"), 0u) << message;
  };
  refused("[1, 2.5]", "[2, 1]", "ascending");
  refused("[1, 2.5]", "[0]", "number from");
  refused("[1, 2.5]", "7", "array");
  refused("seconds = [1, 2.5]\n", "", "budgets");
  refused("seconds = [1, 2.5]", "seconds = [1]\npasses = [1]", "budgets");
  refused("type = \"path\"\n[[method]]", "type = \"pahth\"\n[[method]]", "did you mean 'path'?");
  refused("time = \"cpu\"", "time = \"sun\"", "\"wall\" or \"cpu\"");
  refused("bench_version = 1", "bench_version = 2", "from 1 to 1");
  refused("name = \"a\"", "name = \"b\"", "called");
  refused("values = [\"1000\", \"5000\"]", "", "vary and values");
  refused("job = \"jobs/b.toml\"", "name = \"b\"", "without job");
}

TEST(BenchSuite, APatternWithoutAMatchIsANote) {
  const TempFolder folder;
  std::ofstream(folder / "one two.glb") << "x";
  std::vector<std::string> notes;
  const std::string text = R"(bench_version = 1
name = "x"
[run]
passes = [1, 2]
[[scene]]
job = "t.toml"
gltf = "*.glb"
[[scene]]
job = "t.toml"
gltf = "none/*.glb"
[[method]]
type = "path")";
  const auto suite = parse_suite(text, "s.toml", folder.path(), notes);
  ASSERT_TRUE(suite) << suite.error().message;
  ASSERT_EQ(suite->scenes.size(), 1u);
  EXPECT_EQ(suite->scenes[0].name, "one-two");
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("none/*.glb"), std::string::npos);
}

TEST(BenchSuite, EverySuiteOfTheProjectIsValid) {
  int suites = 0;
  for (const auto& entry : fs::directory_iterator(test::source_dir() / "jobs" / "bench")) {
    if (entry.path().stem() == "any-gltf") continue;  // a job
    std::vector<std::string> notes;
    const auto suite = load_suite(entry.path(), notes);
    // Its scenes lie beside the repository, and may be absent.
    if (!suite && entry.path().stem() == "shared" && notes.size() == 3) continue;
    EXPECT_TRUE(suite) << suite.error().message;
    ++suites;
  }
  EXPECT_GE(suites, 3);
}

TEST(BenchSuite, TheReferenceTextNamesEveryKey) {
  std::ifstream file(test::source_dir() / "jobs" / "benchmark" / "README.md");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  for (const std::string& key : suite_keys()) {
    EXPECT_NE(text.find("`" + key + "`"), std::string::npos) << key;
  }
}

}  // namespace
}  // namespace pf::bench
