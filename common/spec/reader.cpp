#include "common/spec/reader.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "common/base/nearest_name.h"
#include "common/spec/assign.h"

namespace pf::spec {
namespace {

constexpr std::int64_t kMaxPixels = std::int64_t{1} << 28;

std::vector<std::string_view> names_of_tables() {
  std::vector<std::string_view> names;
  for (const Table& table : job_tables()) names.push_back(table.name);
  return names;
}

std::vector<std::string_view> keys_of(std::string_view table) {
  std::vector<std::string_view> names;
  for (const Key& key : job_keys()) {
    if (key.table == table) names.push_back(key.name);
  }
  return names;
}

bool is_table(std::string_view name) {
  return std::ranges::find(job_tables(), name, &Table::name) != job_tables().end();
}

/// A key of this name that stands elsewhere: `passes` at the top is `stop.passes`.
std::string same_name_elsewhere(std::string_view name) {
  for (const Key& key : job_keys()) {
    if (key.name == name) return full_name(key);
  }
  return {};
}

/// What `name` in `table` (empty: at the top) should perhaps have been, as the last part of a message.
std::string suggestion(std::string_view table, std::string_view name, std::span<const std::string_view> valid) {
  std::string meant;
  if (const auto near = nearest_name(name, valid)) {
    meant = table.empty() ? std::string(*near) : fmt::format("{}.{}", table, *near);
  } else {
    meant = same_name_elsewhere(name);
  }
  return meant.empty() ? "" : fmt::format("; did you mean '{}'?", meant);
}

tl::unexpected<Error> invalid(std::string_view where, std::string_view what) {
  return fail(ErrorKind::kInvalidSpec, fmt::format("{}: {}", where, what));
}

tl::unexpected<Error> unknown_key(std::string_view where, std::string_view table, std::string_view name,
                                  std::string_view noun = "key") {
  std::vector<std::string_view> valid = keys_of(table);
  if (table.empty()) {
    for (const std::string_view t : names_of_tables()) valid.push_back(t);
  }
  const std::string full = table.empty() ? printable(name) : fmt::format("{}.{}", table, printable(name));
  return invalid(where, fmt::format("unknown {} '{}'; expected one of {}{}", noun, full, fmt::join(valid, ", "),
                                    suggestion(table, name, valid)));
}

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

/// The value of an override. Bare words are strings where a string is wanted.
Result<Value> override_value(const Key& key, std::string_view text) {
  const bool wants_text = std::holds_alternative<TextKind>(key.kind) || std::holds_alternative<ChoiceKind>(key.kind);
  if (wants_text && !text.starts_with('"') && !text.starts_with('\'')) return Value{std::string(text), {}};
  const auto refused = [&] {
    return fail(ErrorKind::kInvalidSpec, fmt::format("{} is not a TOML value; expected {}",
                                                     text.empty() ? "nothing" : printable(text), expectation(key)));
  };
  // One line, so that a value cannot bring further keys with it.
  if (text.find_first_of("\n\r") != std::string_view::npos) return refused();
  const auto document = parse_toml_document(fmt::format("value = {}", text), "");
  if (!document) return refused();
  const auto& members = std::get<Value::Table>(document->data);
  return members.front().value;
}

}  // namespace

Result<void> Reader::read(const Value& document) {
  for (const Member& member : std::get<Value::Table>(document.data)) {
    const std::string place = location(origin_, member.place);
    if (!is_table(member.key)) {
      const Key* key = find_key("", member.key);
      const bool table = std::holds_alternative<Value::Table>(member.value.data);
      if (key == nullptr) return unknown_key(place, "", member.key, table ? "table" : "key");
      if (auto done = set(*key, member.value, location(origin_, member.value.place)); !done) return done;
      continue;
    }
    const auto* members = std::get_if<Value::Table>(&member.value.data);
    if (members == nullptr) {
      return invalid(place, fmt::format("{} is {}; expected a table with keys {}", member.key, describe(member.value),
                                        fmt::join(keys_of(member.key), ", ")));
    }
    tables_[member.key] = member.place;
    if (auto done = read_table(member.key, *members); !done) return done;
  }
  return {};
}

Result<void> Reader::read_table(std::string_view table, const Value::Table& members) {
  for (const Member& member : members) {
    const Key* key = find_key(table, member.key);
    if (key == nullptr) return unknown_key(location(origin_, member.place), table, member.key);
    if (auto done = set(*key, member.value, location(origin_, member.value.place)); !done) return done;
  }
  return {};
}

Result<void> Reader::override_with(std::string_view argument) {
  const std::string where = fmt::format("--set {}", printable(argument, 200));
  const std::size_t equals = argument.find('=');
  if (equals == std::string_view::npos) return invalid(where, "no '='; expected --set table.key=value");
  const std::string_view path = trimmed(argument.substr(0, equals));
  const std::size_t dot = path.find('.');
  const std::string_view table = dot == std::string_view::npos ? "" : path.substr(0, dot);
  const std::string_view name = dot == std::string_view::npos ? path : path.substr(dot + 1);
  if (table.empty() && is_table(name)) {
    return invalid(where, fmt::format("'{}' is a table; expected --set {}.key=value with a key out of {}", name, name,
                                      fmt::join(keys_of(name), ", ")));
  }
  if (!table.empty() && !is_table(table)) {
    const auto tables = names_of_tables();
    return invalid(where, fmt::format("unknown table '{}'; expected one of {}{}", printable(table),
                                      fmt::join(tables, ", "), suggestion("", table, tables)));
  }
  const Key* key = find_key(table, name);
  if (key == nullptr) return unknown_key(where, table, name);
  const auto value = override_value(*key, trimmed(argument.substr(equals + 1)));
  if (!value) return invalid(where, value.error().message);
  return set(*key, *value, where);
}

Result<void> Reader::set(const Key& key, const Value& value, std::string where) {
  if (auto done = assign(spec_, key, value); !done) return invalid(where, done.error().message);
  given_[&key] = std::move(where);
  return {};
}

tl::unexpected<Error> Reader::missing(const Key& key) const {
  const auto table = tables_.find(key.table);
  const Place place = table == tables_.end() ? Place{} : table->second;
  return invalid(location(origin_, place),
                 fmt::format("key '{}' is missing; expected {}", full_name(key), expectation(key)));
}

std::string Reader::where(std::string_view table, std::string_view name) const {
  const auto found = given_.find(find_key(table, name));
  return found == given_.end() ? location(origin_, Place{}) : found->second;
}

Result<JobSpec> Reader::finish() const {
  for (const Key& key : job_keys()) {
    if (key.required && !given_.contains(&key)) return missing(key);
  }
  const std::int64_t pixels = std::int64_t{spec_.image.width} * spec_.image.height;
  if (pixels > kMaxPixels) {
    return invalid(where("image", "height"),
                   fmt::format("image.width times image.height is {}; expected at most {}", pixels, kMaxPixels));
  }
  if (!spec_.scene.environment.empty() && !spec_.scene.environment_radiance.empty()) {
    return invalid(where("scene", "environment_radiance"),
                   "scene.environment and scene.environment_radiance are both given; expected one of them");
  }
  if (spec_.stop.passes == 0 && spec_.stop.seconds == 0 && spec_.stop.error == 0) {
    return invalid(where("stop", "passes"),
                   "the job has no end; expected stop.passes, stop.seconds or stop.error above 0");
  }
  return spec_;
}

}  // namespace pf::spec
