#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "common/base/atomic_file.h"
#include "common/spec/job_spec.h"
#include "common/spec/key_table.h"
#include "tests/support/paths.h"

namespace pf {
namespace {

using nlohmann::json;

/// The part of JSON Schema that job_json_schema uses; empty if `value` is valid, else where it is not.
std::string violation(const json& schema, const json& value, const std::string& at) {
  const std::string type = schema.at("type");
  if (type == "object") {
    if (!value.is_object()) return at + " is no object";
    for (const auto& name : schema.value("required", json::array())) {
      if (!value.contains(name)) return at + " lacks " + name.get<std::string>();
    }
    for (const auto& [name, member] : value.items()) {
      if (!schema["properties"].contains(name)) return at + " has unknown " + name;
      const std::string inner = violation(schema["properties"][name], member, at + "/" + name);
      if (!inner.empty()) return inner;
    }
  } else if (type == "array") {
    if (!value.is_array() || (!value.empty() && value.size() != schema["anyOf"][1]["minItems"])) return at;
    for (const json& item : value) {
      if (!violation(schema["items"], item, at).empty()) return at;
    }
  } else if (type == "boolean") {
    if (!value.is_boolean()) return at;
  } else if (type == "string") {
    if (!value.is_string()) return at;
    const std::string text = value;
    if (schema.contains("enum")) {
      const auto& names = schema["enum"];
      return std::find(names.begin(), names.end(), value) == names.end() ? at : "";
    }
    if (text.size() > schema["maxLength"]) return at;
    if (!std::regex_search(text, std::regex(schema["pattern"].get<std::string>()))) return at;
  } else {
    if (type == "integer" ? !value.is_number_integer() : !value.is_number()) return at;
    if (value > schema["maximum"]) return at;
    if (schema.contains("minimum") ? value < schema["minimum"] : value <= schema["exclusiveMinimum"]) return at;
  }
  return "";
}

json example() {
  return json::parse(
      R"({"spec_version": 1, "job": {"name": "glass-caustic"}, "scene": {"file": "a/glass.gltf"},
                         "image": {"width": 640}, "integrator": {"type": "sppm", "alpha": 0.5}})");
}

TEST(JobSchema, AcceptsWhatTheParserAccepts) {
  const json schema = json::parse(job_json_schema());
  EXPECT_EQ(violation(schema, example(), ""), "");
  const auto job = parse_job_json(example().dump(), "job.json");
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_EQ(violation(schema, json::parse(canonical_json(*job)), ""), "");
}

TEST(JobSchema, RefusesWhatTheParserRefuses) {
  const json schema = json::parse(job_json_schema());
  for (const auto& [pointer, value] : std::vector<std::pair<std::string, json>>{{"/image/heigth", 1},
                                                                                {"/image/width", 0},
                                                                                {"/image/width", 1.5},
                                                                                {"/integrator/alpha", 0},
                                                                                {"/integrator/type", "spm"},
                                                                                {"/job/name", "a b"},
                                                                                {"/job/name", ".."},
                                                                                {"/scene/file", "/a.gltf"},
                                                                                {"/scene/file", "../a.gltf"},
                                                                                {"/scene/file", "a.obj"},
                                                                                {"/scene/file", ""},
                                                                                {"/scene/environment", "a.png"},
                                                                                {"/scene/environment_radiance", {1, 1}},
                                                                                {"/stop/passes", -1},
                                                                                {"/spec_version", 2}}) {
    json changed = example();
    changed[json::json_pointer(pointer)] = value;
    EXPECT_NE(violation(schema, changed, ""), "") << pointer << value;
    EXPECT_FALSE(parse_job_json(changed.dump(), "job.json")) << pointer << value;
  }
  EXPECT_NE(violation(schema, json::object(), ""), "");
}

TEST(JobSchema, DescribesEveryKeyWithItsDefault) {
  const json schema = json::parse(job_json_schema());
  EXPECT_EQ(schema["additionalProperties"], false);
  EXPECT_EQ(schema["required"], json({"job", "scene"}));
  JobSpec spec;
  spec.job.name = "n";
  spec.scene.file = "f.glb";
  const json defaults = json::parse(canonical_json(spec));
  for (const spec::Key& key : spec::job_keys()) {
    json properties = schema["properties"];
    json table = defaults;
    if (!key.table.empty()) {
      EXPECT_EQ(properties[std::string(key.table)]["additionalProperties"], false);
      properties = properties[std::string(key.table)]["properties"];
      table = table[std::string(key.table)];
    }
    const json& entry = properties[std::string(key.name)];
    EXPECT_FALSE(entry["description"].get<std::string>().empty());
    if (!key.required) {
      EXPECT_EQ(entry["default"], table[std::string(key.name)]) << full_name(key);
    }
  }
}

TEST(KeyTable, NamesEachKeyOnceInKnownTables) {
  std::set<std::string> tables = {""}, names;
  for (const spec::Table& table : spec::job_tables()) tables.insert(std::string(table.name));
  for (const spec::Key& key : spec::job_keys()) {
    EXPECT_TRUE(names.insert(full_name(key)).second) << full_name(key);
    EXPECT_TRUE(tables.contains(std::string(key.table))) << full_name(key);
    EXPECT_TRUE(key.doc.ends_with('.')) << full_name(key);
  }
}

// To renew the page: PHOTONFARM_WRITE_REFERENCE=1 pf_spec_tests --gtest_filter='SpecReference.*'
TEST(SpecReference, OnDiskIsWhatTheTableSays) {
  const auto page = test::source_dir() / "jobs/SPEC.md";
  if (std::getenv("PHOTONFARM_WRITE_REFERENCE") != nullptr) {
    ASSERT_TRUE(write_file_atomically(page, job_spec_reference()));
  }
  EXPECT_EQ(read_file(page, 1 << 20).value_or("absent"), job_spec_reference())
      << "run this test with PHOTONFARM_WRITE_REFERENCE=1 to renew jobs/SPEC.md";
}

TEST(SpecReference, ShowsAJobThatParses) {
  const std::string page = job_spec_reference();
  const std::size_t start = page.find("```toml\n") + 8;
  const auto job = parse_job_toml(page.substr(start, page.find("```", start) - start), "SPEC.md");
  EXPECT_TRUE(job) << job.error().message;
}

}  // namespace
}  // namespace pf
