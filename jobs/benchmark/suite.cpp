#include "jobs/benchmark/suite.h"

#include <glob.h>

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/base/atomic_file.h"
#include "common/base/nearest_name.h"
#include "common/spec/document.h"
#include "common/spec/key_table.h"
#include "jobs/benchmark/suite_reader.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using spec::Value;
using Fields = SuiteReader::Fields;

/// One [[scene]] as it is written: one job file, or patterns of glTF files for a template.
struct SceneTable {
  SceneEntry entry;
  std::string job, gltf;
  Value reference;
  bool has_reference = false;
  spec::Place place;
};

struct MethodTable {
  MethodEntry entry;
  std::string vary;
  std::vector<std::string> values;
};

Fields reference_fields(const SuiteReader& r, ReferenceSettings& to) {
  return {{"type", r.text(to.type)},
          {"set", r.texts(to.set)},
          {"passes", r.integer(to.passes, 1, 4294967295)},
          {"max_passes", r.integer(to.max_passes, 0, 4294967295)},
          {"seconds", r.real(to.seconds, 0, 1e9)},
          {"confidence", r.real(to.confidence, 0, 1)}};
}

Fields scene_fields(const SuiteReader& r, SceneTable& to) {
  return {{"name", r.text(to.entry.name)},
          {"job", r.text(to.job)},
          {"gltf", r.text(to.gltf)},
          {"set", r.texts(to.entry.set)},
          {"width", r.integer(to.entry.width, 1, 65536)},
          {"height", r.integer(to.entry.height, 1, 65536)},
          {"reference", [&to](const Value& value) -> Result<void> {
             to.reference = value;
             to.has_reference = true;
             return {};
           }}};
}

Fields method_fields(const SuiteReader& r, MethodTable& to) {
  return {{"name", r.text(to.entry.name)},        {"type", r.text(to.entry.type)}, {"set", r.texts(to.entry.set)},
          {"ablate", r.boolean(to.entry.ablate)}, {"vary", r.text(to.vary)},       {"values", r.texts(to.values)}};
}

Fields run_fields(const SuiteReader& r, Suite& to, std::string& time, int& width, int& height) {
  return {{"seconds", r.ascending(to.seconds)},
          {"passes", r.ascending(to.passes)},
          {"repetitions", r.integer(to.repetitions, 1, 1000)},
          {"first_seed", r.integer(to.first_seed, 0, 1000000000)},
          {"threads", r.integer(to.threads, 1, 1024)},
          {"width", r.integer(width, 1, 65536)},
          {"height", r.integer(height, 1, 65536)},
          {"shuffle", r.integer(to.shuffle, 0, 1000000000)},
          {"timeout", r.real(to.timeout, 0, 1e9)},
          {"time", r.text(time)},
          {"targets", [&r, &to](const Value& value) -> Result<void> {
             auto read = r.ascending(to.targets)(value);
             std::ranges::reverse(to.targets);
             return read;
           }}};
}

/// Letters that may stand in a file name anywhere; others become '-'.
std::string as_name(std::string text) {
  for (char& c : text) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_';
    if (!plain) c = '-';
  }
  return text;
}

class Parser {
 public:
  Parser(std::string_view origin, fs::path folder, std::vector<std::string>& notes)
      : reader_(origin), folder_(std::move(folder)), notes_(notes) {}

  Result<Suite> parse(const Value& document) {
    std::int64_t version = 0;
    const Fields fields = {
        {"bench_version", reader_.integer(version, 1, 1)},
        {"name", reader_.text(suite_.name)},
        {"run",
         [&](const Value& v) {
           return reader_.table(v, "[run]", run_fields(reader_, suite_, time_, width_, height_));
         }},
        {"reference",
         [&](const Value& v) { return reader_.table(v, "[reference]", reference_fields(reader_, reference_)); }},
        {"scene",
         [&](const Value& v) { return reader_.tables(v, "scene", [&](const Value& t) { return read_scene(t); }); }},
        {"method",
         [&](const Value& v) { return reader_.tables(v, "method", [&](const Value& t) { return read_method(t); }); }}};
    if (auto read = reader_.table(document, "", fields); !read) return tl::unexpected(read.error());
    if (version != 1) return reader_.refuse({}, "bench_version is missing", "bench_version = 1");
    return finish();
  }

 private:
  Result<void> read_scene(const Value& value) {
    SceneTable table;
    table.place = value.place;
    if (auto read = reader_.table(value, "[[scene]]", scene_fields(reader_, table)); !read) return read;
    if (table.job.empty()) return reader_.refuse(value.place, "a [[scene]] without job", "job = \"FILE.toml\"");
    table.entry.job = folder_ / table.job;
    scenes_.push_back(std::move(table));
    return {};
  }

  Result<void> read_method(const Value& value) {
    MethodTable table;
    if (auto read = reader_.table(value, "[[method]]", method_fields(reader_, table)); !read) return read;
    MethodEntry& entry = table.entry;
    const auto names = spec::integrator_names();
    if (std::ranges::find(names, entry.type) == names.end()) {
      const auto near = nearest_name(entry.type, names);
      return reader_.refuse(
          value.place, fmt::format("type of a [[method]] is \"{}\"", spec::printable(entry.type)),
          fmt::format("one of {}{}", fmt::join(names, ", "), near ? fmt::format("; did you mean '{}'?", *near) : ""));
    }
    if (entry.name.empty()) entry.name = entry.type;
    if (table.vary.empty() != table.values.empty()) {
      return reader_.refuse(value.place, "a [[method]] with only one of vary and values",
                            "vary = \"table.key\" and values = [\"...\"]");
    }
    if (table.vary.empty()) suite_.methods.push_back(entry);
    for (const std::string& v : table.values) {
      MethodEntry one = entry;
      one.name = fmt::format("{} {}={}", entry.name, table.vary.substr(table.vary.rfind('.') + 1), v);
      one.set.push_back(fmt::format("{}={}", table.vary, v));
      suite_.methods.push_back(std::move(one));
    }
    return {};
  }

  Result<Suite> finish() {
    if (suite_.name.empty()) return reader_.refuse({}, "name is missing", "name = \"...\"");
    if (suite_.seconds.empty() == suite_.passes.empty()) {
      return reader_.refuse({}, "[run] has no budgets, or two kinds", "one of seconds = [...] and passes = [...]");
    }
    if (!time_.empty() && time_ != "wall" && time_ != "cpu") {
      return reader_.refuse({}, fmt::format("run.time is \"{}\"", time_), "\"wall\" or \"cpu\"");
    }
    if (time_ == "cpu") suite_.time = TimeAxis::kCpu;
    for (SceneTable& table : scenes_) {
      if (auto added = add_scene(table); !added) return tl::unexpected(added.error());
    }
    if (suite_.scenes.empty()) return reader_.refuse({}, "no scenes", "at least one [[scene]]");
    if (suite_.methods.empty()) return reader_.refuse({}, "no methods", "at least one [[method]]");
    if (auto same = twice(suite_.scenes); !same.empty()) {
      return reader_.refuse({}, fmt::format("two scenes are called '{}'", same), "different names");
    }
    if (auto same = twice(suite_.methods); !same.empty()) {
      return reader_.refuse({}, fmt::format("two methods are called '{}'", same), "different names");
    }
    return std::move(suite_);
  }

  Result<void> add_scene(SceneTable& table) {
    SceneEntry& entry = table.entry;
    if (entry.width == 0) entry.width = width_;
    if (entry.height == 0) entry.height = height_;
    entry.reference = reference_;
    if (table.has_reference) {
      auto read = reader_.table(table.reference, "reference of [[scene]]", reference_fields(reader_, entry.reference));
      if (!read) return read;
    }
    if (table.gltf.empty()) {
      if (entry.name.empty()) entry.name = as_name(entry.job.stem().string());
      suite_.scenes.push_back(entry);
      return {};
    }
    glob_t found{};
    // NOLINTNEXTLINE(concurrency-mt-unsafe): no other thread changes the locale
    const int code = glob((folder_ / table.gltf).c_str(), GLOB_BRACE, nullptr, &found);
    for (std::size_t i = 0; code == 0 && i < found.gl_pathc; ++i) {
      SceneEntry one = entry;
      one.gltf = found.gl_pathv[i];
      one.name = unused_name(one.gltf);
      suite_.scenes.push_back(std::move(one));
    }
    globfree(&found);
    if (code != 0) notes_.push_back(fmt::format("no file matches {}", table.gltf));
    return {};
  }

  std::string unused_name(const fs::path& gltf) const {
    std::string name = as_name(gltf.stem().string());
    const auto used = [&](const std::string& n) {
      return std::ranges::any_of(suite_.scenes, [&](const SceneEntry& s) { return s.name == n; });
    };
    if (used(name)) name = as_name(gltf.parent_path().filename().string()) + "-" + name;
    const std::string base = name;
    for (int i = 2; used(name); ++i) name = fmt::format("{}-{}", base, i);
    return name;
  }

  template <typename Entry>
  static std::string twice(const std::vector<Entry>& entries) {
    std::set<std::string> seen;
    for (const Entry& entry : entries) {
      if (!seen.insert(entry.name).second) return entry.name;
    }
    return {};
  }

  SuiteReader reader_;
  fs::path folder_;
  std::vector<std::string>& notes_;
  Suite suite_;
  ReferenceSettings reference_;
  std::vector<SceneTable> scenes_;
  std::string time_;
  int width_ = 0, height_ = 0;
};

}  // namespace

Result<Suite> parse_suite(std::string_view text, std::string_view origin, const fs::path& folder,
                          std::vector<std::string>& notes) {
  auto document = spec::parse_toml_document(text, origin);
  if (!document) return tl::unexpected(document.error());
  return Parser(origin, folder, notes).parse(*document);
}

Result<Suite> load_suite(const fs::path& file, std::vector<std::string>& notes) {
  auto text = read_file(file, spec::kMaxSpecBytes, ErrorKind::kInvalidSpec);
  if (!text) return tl::unexpected(text.error());
  return parse_suite(*text, file.string(), file.parent_path(), notes);
}

std::vector<std::string> suite_keys() {
  const SuiteReader reader("");
  Suite suite;
  SceneTable scene;
  MethodTable method;
  std::string time;
  int width = 0, height = 0;
  std::vector<std::string> keys = {"bench_version", "name"};
  const auto add = [&](std::string_view table, const Fields& fields) {
    for (const auto& field : fields) keys.push_back(fmt::format("{}.{}", table, field.name));
  };
  add("run", run_fields(reader, suite, time, width, height));
  add("reference", reference_fields(reader, scene.entry.reference));
  add("scene", scene_fields(reader, scene));
  add("method", method_fields(reader, method));
  return keys;
}

}  // namespace pf::bench
