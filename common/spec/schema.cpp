#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "common/spec/json_value.h"
#include "common/spec/key_table.h"

namespace pf {
namespace {

using nlohmann::ordered_json;
using namespace spec;

/// Paths as assign.cpp accepts them, but for `..` in the middle, which a regular expression cannot follow.
std::string path_pattern(const TextKind& kind, bool may_be_empty) {
  std::string extensions;
  for (const std::string_view extension : kind.extensions) {
    if (!extensions.empty()) extensions += '|';
    for (const char c : extension.substr(1)) {
      extensions += fmt::format("[{}{}]", c, static_cast<char>(c - 'a' + 'A'));
    }
  }
  return fmt::format("^{}(?!/|\\.\\./)[^\\u0000-\\u001f\\u007f]+\\.({}){}$", may_be_empty ? "(" : "", extensions,
                     may_be_empty ? ")?" : "");
}

struct DescribeKind {
  const Key& key;

  ordered_json operator()(const IntegerKind& kind) const {
    return {{"type", "integer"}, {"minimum", kind.min}, {"maximum", kind.max}};
  }
  ordered_json operator()(const RealKind& kind) const {
    return {{"type", "number"}, {kind.above_min ? "exclusiveMinimum" : "minimum", kind.min}, {"maximum", kind.max}};
  }
  ordered_json operator()(const RealsKind& kind) const {
    const ordered_json item = {{"type", "number"}, {"minimum", kind.min}, {"maximum", kind.max}};
    ordered_json numbers = {{"type", "array"}, {"items", item}};
    numbers["anyOf"] = {{{"maxItems", 0}}, {{"minItems", kind.count}, {"maxItems", kind.count}}};
    return numbers;
  }
  ordered_json operator()(const TextKind& kind) const {
    ordered_json text = {{"type", "string"}, {"maxLength", kind.max_bytes}};
    switch (kind.form) {
      case TextForm::kJobName:
        text["pattern"] = "^(?!\\.{1,2}$)[A-Za-z0-9._-]+$";
        break;
      case TextForm::kPath:
        text["pattern"] = path_pattern(kind, !key.required);
        break;
      case TextForm::kFree:
        text["pattern"] = "^[^\\u0000-\\u001f\\u007f]*$";
        break;
    }
    return text;
  }
  ordered_json operator()(const ChoiceKind& kind) const {
    return {{"type", "string"}, {"enum", std::vector<std::string>(kind.names.begin(), kind.names.end())}};
  }
  ordered_json operator()(const BooleanKind&) const { return {{"type", "boolean"}}; }
};

ordered_json describe_key(const Key& key) {
  ordered_json schema = std::visit(DescribeKind{key}, key.kind);
  schema["description"] = key.unit.empty() ? std::string(key.doc) : fmt::format("{} Unit: {}.", key.doc, key.unit);
  if (!key.required) schema["default"] = json_value(JobSpec{}, key);
  return schema;
}

ordered_json empty_object() {
  return {{"type", "object"}, {"additionalProperties", false}, {"properties", ordered_json::object()}};
}

std::string default_text(const Key& key) {
  return key.required ? "required" : fmt::format("`{}`", json_value(JobSpec{}, key).dump());
}

std::string rows(std::string_view table) {
  std::string text = "| key | takes | default | meaning |\n| --- | --- | --- | --- |\n";
  for (const Key& key : job_keys()) {
    if (key.table != table) continue;
    text += fmt::format("| `{}` | {} | {} | {} |\n", key.name, expectation(key), default_text(key), key.doc);
  }
  return text;
}

}  // namespace

std::string job_json_schema() {
  ordered_json schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"}, {"title", "photonfarm job"}};
  schema.update(empty_object());
  for (const Table& table : job_tables()) {
    ordered_json& entry = schema["properties"][std::string(table.name)];
    entry = empty_object();
    entry["description"] = table.doc;
  }
  for (const Key& key : job_keys()) {
    const bool top = key.table.empty();
    ordered_json& table = top ? schema : schema["properties"][std::string(key.table)];
    table["properties"][std::string(key.name)] = describe_key(key);
    if (!key.required) continue;
    table["required"].push_back(key.name);
    ordered_json& tables = schema["required"];
    if (!top && std::find(tables.begin(), tables.end(), key.table) == tables.end()) tables.push_back(key.table);
  }
  return schema.dump(2) + "\n";
}

std::string job_spec_reference() {
  std::string text = fmt::format(
      R"(# The job file

Generated from the table of keys in `common/spec/key_table.cpp`, which the parser and the JSON Schema use
too; a test fails when this page is out of date.

A job file is TOML 1.0, or the same model as JSON in a file that ends in `.json`, of at most 1 MiB. Unknown
keys, wrong types and values out of range are errors that name line and column. A whole number may stand
where a number is wanted; `64.0` may not stand for an integer. `--set table.key=value` on the command line
takes the same keys, and wins over the file; strings need no quotes there.

```toml
spec_version = 1
[job]
name = "glass-caustic"
[scene]
file = "scenes/glass-caustic.gltf"
[image]
width = 640
height = 480
[integrator]
type = "sppm"
photons = 500000
[stop]
passes = 64
```

At the top:

{})",
      rows(""));
  for (const Table& table : job_tables()) {
    text += fmt::format("\n## [{}]\n\n{}\n\n{}", table.name, table.doc, rows(table.name));
  }
  std::vector<std::string> ignored;
  for (const Key& key : job_keys()) {
    if (!key.decides_image) ignored.push_back(fmt::format("`{}`", full_name(key)));
  }
  text += fmt::format(
      R"(
## Identity

Equal jobs have equal canonical JSON: all keys, sorted, defaults filled in. The hash of a spec is the
SHA-256 of that text without what cannot change the image at a given number of sub-passes: {}.
)",
      fmt::join(ignored, ", "));
  return text;
}

}  // namespace pf
