#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/atomic_file.h"
#include "common/spec/job_spec.h"
#include "tests/support/paths.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

/// Files of bad/: the first line is `# expect: line:column: message` (`// expect:` in JSON, where the line is
/// blanked before parsing, because JSON has no comments).
std::vector<fs::path> bad_files() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(test::source_dir() / "tests/unit/spec/bad")) {
    files.push_back(entry.path());
  }
  std::ranges::sort(files);
  return files;
}

class BadSpec : public testing::TestWithParam<fs::path> {};

TEST_P(BadSpec, IsRefusedWithPlaceReasonAndHint) {
  const bool json = GetParam().extension() == ".json";
  std::string text = read_file(GetParam(), 1 << 20).value_or("");
  const std::string marker = json ? "// expect: " : "# expect: ";
  ASSERT_TRUE(text.starts_with(marker));
  const std::size_t end = text.find('\n');
  ASSERT_NE(end, std::string::npos);
  const std::string expected = "job:" + text.substr(marker.size(), end - marker.size());
  if (json) text.erase(0, end);

  const auto job = json ? parse_job_json(text, "job") : parse_job_toml(text, "job");
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error().message, expected);
  EXPECT_EQ(job.error().kind, ErrorKind::kInvalidSpec);
}

INSTANTIATE_TEST_SUITE_P(Corpus, BadSpec, testing::ValuesIn(bad_files()), [](const auto& test) {
  std::string name = test.param.filename().string();
  std::ranges::replace(name, '.', '_');
  return name;
});

TEST(BadSpecCorpus, IsThere) { EXPECT_GE(bad_files().size(), 90u); }

}  // namespace
}  // namespace pf
