// Dependencies point one way:
//   base <- math <- {spec, film} <- wire <- {worker, coordinator} <- jobs
// read from the #include lines of every source. jobs runs the worker as a process and includes nothing of it.

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using Names = std::set<std::string>;

/// Each folder, and those besides itself from which it may include.
const std::map<std::string, Names>& rules() {
  static const Names kCommon = {"common/base", "common/math", "common/spec", "common/film", "common/wire"};
  static const auto with = [](Names names, const Names& more) {
    names.insert(more.begin(), more.end());
    return names;
  };
  static const std::map<std::string, Names> kRules = {
      {"common/base", {}},
      {"common/math", {"common/base"}},
      {"common/spec", {"common/base", "common/math"}},
      {"common/film", {"common/base", "common/math"}},
      {"common/wire", {"common/base", "common/math", "common/spec", "common/film"}},
      {"worker/bsdf", {"common/base", "common/math"}},
      {"worker/scene", with(kCommon, {"worker/bsdf"})},
      // Its pilot walks paths as the integrators do.
      {"worker/plan", with(kCommon, {"worker/bsdf", "worker/scene", "worker/photon", "worker/integrators"})},
      {"worker/photon", with(kCommon, {"worker/bsdf", "worker/scene"})},
      {"worker/integrators", with(kCommon, {"worker/bsdf", "worker/scene", "worker/photon"})},
      {"worker/opencl",
       with(kCommon, {"worker/bsdf", "worker/scene", "worker/plan", "worker/photon", "worker/integrators"})},
      {"worker/farm", kCommon},
      {"worker", with(kCommon, {"worker/bsdf", "worker/scene", "worker/plan", "worker/photon", "worker/integrators",
                                "worker/opencl", "worker/farm"})},
      {"coordinator", kCommon},
      // photonfarm doctor reads a farm's database.
      {"jobs", with(kCommon, {"coordinator"})},
  };
  return kRules;
}

/// Headers that the build makes.
const Names kGenerated = {"build_id.h", "messages.pb.h"};

/// The folder of the rules that a path belongs to: the longest that fits; empty for none.
std::string folder_of(const std::string& path) {
  std::string best;
  for (const auto& [folder, allowed] : rules()) {
    if (path.starts_with(folder + "/") && folder.size() > best.size()) best = folder;
  }
  return best;
}

/// What is wrong with the includes of one file, as `file:line: ...`.
std::vector<std::string> violations(const std::string& path, const std::string& text) {
  static const std::regex kInclude(R"re(^\s*#\s*include\s*"([^"]+)")re");
  const std::string folder = folder_of(path);
  std::vector<std::string> found;
  if (folder.empty()) return {path + ": stands in a folder without a rule; expected a line in rules() of this test"};
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::smatch match;
    if (!std::regex_search(line, match, kInclude) || kGenerated.contains(match[1])) continue;
    const std::string from = folder_of(match[1]);
    const std::string place = path + ":" + std::to_string(number) + ": ";
    if (from.empty()) {
      found.push_back(place + match[1].str() + " is not named from the project's root");
    } else if (from != folder && !rules().at(folder).contains(from)) {
      found.push_back(place + folder + " may not include " + from + " (" + match[1].str() + ")");
    }
  }
  return found;
}

bool is_source(const fs::path& file) {
  static const Names kExtensions = {".h", ".cpp", ".inl", ".hpp", ".cc"};
  return kExtensions.contains(file.extension().string());
}

TEST(IncludeRule, EverySourceOfTheTreeKeepsIt) {
  const fs::path root = pf::test::source_dir();
  int files = 0;
  for (const char* top : {"common", "worker", "coordinator", "jobs"}) {
    if (!fs::exists(root / top)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      if (!entry.is_regular_file() || !is_source(entry.path())) continue;
      ++files;
      std::ifstream file(entry.path());
      const std::string text{std::istreambuf_iterator<char>(file), {}};
      for (const std::string& violation : violations(fs::relative(entry.path(), root).generic_string(), text)) {
        ADD_FAILURE() << violation;
      }
    }
  }
  EXPECT_GT(files, 30) << "the tree was not found under " << root;
}

TEST(IncludeRule, TheRulesHaveNoCircle) {
  // Folders whose allowed ones are all settled are settled; a circle never is.
  Names settled;
  for (std::size_t round = 0; round < rules().size(); ++round) {
    for (const auto& [folder, allowed] : rules()) {
      const bool ready =
          std::all_of(allowed.begin(), allowed.end(), [&](const std::string& name) { return settled.contains(name); });
      if (ready) settled.insert(folder);
    }
  }
  EXPECT_EQ(settled.size(), rules().size());
}

TEST(IncludeRule, FindsWhatPointsTheWrongWay) {
  const auto count = [](const std::string& path, const std::string& text) { return violations(path, text).size(); };
  EXPECT_EQ(count("worker/worker.cpp", "#include \"coordinator/ledger.h\"\n"), 1U);
  EXPECT_EQ(count("coordinator/ledger.cpp", "#include \"worker/scene/scene.h\"\n"), 1U);
  EXPECT_EQ(count("common/film/film.cpp", "#include \"common/spec/job_spec.h\"\n"), 1U);
  EXPECT_EQ(count("common/math/vec.h", "  #  include \"common/film/film.h\"\n"), 1U);
  EXPECT_EQ(count("worker/bsdf/bsdf.cpp", "#include \"worker/scene/scene.h\"\n"), 1U);
  EXPECT_EQ(count("jobs/render_commands.cpp", "#include \"worker/progress.h\"\n"), 1U);
  EXPECT_EQ(count("worker/progress.cpp", "#include \"progress.h\"\n"), 1U);
  EXPECT_EQ(count("elsewhere/a.cpp", ""), 1U);
}

TEST(IncludeRule, AcceptsWhatPointsTheRightWay) {
  EXPECT_TRUE(violations("worker/plan/plan.cpp",
                         "#include \"worker/plan/plan.h\"\n#include <vector>\n#include \"common/spec/job_spec.h\"\n"
                         "#include \"worker/scene/scene_description.h\"\n// #include \"coordinator/ledger.h\"\n")
                  .empty());
  EXPECT_TRUE(
      violations("jobs/main.cpp", "#include \"build_id.h\"\n#include \"jobs/scenes/generate/mesh.h\"\n").empty());
}

}  // namespace
