#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

#include "common/spec/document.h"

// Compiled in here alone, without exceptions, and with a small bound on recursion (see kMaxDepth).
#define TOML_HEADER_ONLY 1
#define TOML_EXCEPTIONS 0
#define TOML_ENABLE_FORMATTERS 0
#define TOML_MAX_NESTED_VALUES 8
#include <toml++/toml.h>

namespace pf::spec {
namespace {

static_assert(TOML_MAX_NESTED_VALUES == kMaxDepth);

/// Dots outside strings and comments that a job file may hold; one needs about twenty.
constexpr int kMaxDots = 500;

Place to_place(toml::source_position position) {
  return {std::max<std::uint32_t>(position.line, 1), std::max<std::uint32_t>(position.column, 1)};
}

bool is_ascii(char c) { return static_cast<unsigned char>(c) < 0x80; }

/// Steps over the string at the start of `text`, which begins with a quote; up to the end where it is not
/// closed, and up to the character where toml++ must not come (see find_hazard).
struct StringEnd {
  std::size_t length;
  bool hazard;
};
StringEnd find_string_end(std::string_view text) {
  const char quote = text[0];
  const std::string_view triple = quote == '"' ? "\"\"\"" : "'''";
  const bool multiline = text.starts_with(triple);
  std::size_t i = multiline ? 3 : 1;
  while (i < text.size()) {
    if (text[i] == '\\' && quote == '"') {
      const std::size_t next = multiline ? text.find_first_not_of(" \t\r\n", i + 1) : std::string_view::npos;
      if (next != std::string_view::npos && !is_ascii(text[next])) return {next, true};
      i += 2;
    } else if (multiline && text.substr(i).starts_with(triple)) {
      i += 3;
      for (int extra = 0; extra < 2 && i < text.size() && text[i] == quote; ++extra)
        ++i;  // `""""` ends with a quote
      return {i, false};
    } else if (!multiline && (text[i] == quote || text[i] == '\n' || text[i] == '\r')) {
      return {i + 1, false};
    } else {
      ++i;
    }
  }
  return {text.size(), false};
}

Place advanced(Place place, std::string_view text) {
  for (const char c : text) {
    if (c == '\n') {
      place = {place.line + 1, 1};
    } else if ((static_cast<unsigned char>(c) & 0xc0) != 0x80) {
      ++place.column;
    }
  }
  return place;
}

struct Hazard {
  Place place;
  std::string_view what;
};

/// The first place that toml++ 3.3 could not be trusted with.
/// - It bounds the nesting of values but not of dotted keys: `a.a.a.a = 1` makes a table for each dot,
/// searched one by
///   one while parsing and freed recursively, so that a megabyte of them takes minutes and then the stack.
/// - is_non_ascii_horizontal_whitespace() runs into undefined behaviour for most characters beyond ASCII. It
/// meets
///   them outside strings and comments, where TOML forbids them, and after the line-ending backslash of a
///   multi-line string, where it does not.
std::optional<Hazard> find_hazard(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  Place place;
  int dots = 0;
  std::size_t i = text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0;
  while (i < text.size()) {
    std::size_t step = 1;
    if (text[i] == '"' || text[i] == '\'') {
      const StringEnd end = find_string_end(text.substr(i));
      step = end.length;
      if (end.hazard) {
        return Hazard{
            advanced(place, text.substr(i, step)),
            "a character beyond ASCII follows a line-ending backslash; expected it on the line before"};
      }
    } else if (text[i] == '#') {
      step = std::min(text.find_first_of("\n\r\v\f", i), text.size()) - i;
    } else if (!is_ascii(text[i])) {
      return Hazard{place, "a character beyond ASCII outside strings and comments; expected valid TOML 1.0"};
    } else if (text[i] == '.' && ++dots > kMaxDots) {
      return Hazard{place, "too many dotted keys; expected keys of the form table.key"};
    }
    place = advanced(place, text.substr(i, step));
    i += step;
  }
  return std::nullopt;
}

class Converter {
 public:
  explicit Converter(std::string_view origin) : origin_(origin) {}

  Result<Value> convert(const toml::node& node, int depth) const {
    const Place place = to_place(node.source().begin);
    if (depth > kMaxDepth) {
      return fail(ErrorKind::kInvalidSpec,
                  fmt::format("{}: values are nested too deeply; expected at most {} levels",
                              location(origin_, place), kMaxDepth));
    }
    if (const auto* table = node.as_table()) return convert_table(*table, place, depth);
    if (const auto* array = node.as_array()) return convert_array(*array, place, depth);
    if (const auto* text = node.as_string()) return Value{text->get(), place};
    if (const auto* integer = node.as_integer()) return Value{integer->get(), place};
    if (const auto* real = node.as_floating_point()) return Value{real->get(), place};
    if (const auto* boolean = node.as_boolean()) return Value{boolean->get(), place};
    return Value{Value::Other{"a date or time"}, place};
  }

 private:
  Result<Value> convert_table(const toml::table& table, Place place, int depth) const {
    Value::Table members;
    for (const auto& [key, node] : table) {
      auto value = convert(node, depth + 1);
      if (!value) return value;
      members.push_back({std::string(key.str()), to_place(key.source().begin), std::move(*value)});
    }
    // toml++ sorts by name; the first error to report is the first of the file.
    std::ranges::sort(members, {}, [](const Member& m) { return std::tuple(m.place.line, m.place.column); });
    return Value{std::move(members), place};
  }

  Result<Value> convert_array(const toml::array& array, Place place, int depth) const {
    Value::Array items;
    for (const toml::node& node : array) {
      auto value = convert(node, depth + 1);
      if (!value) return value;
      items.push_back(std::move(*value));
    }
    return Value{std::move(items), place};
  }

  std::string_view origin_;
};

}  // namespace

Result<Value> parse_toml_document(std::string_view text, std::string_view origin) {
  if (const auto hazard = find_hazard(text)) {
    return fail(ErrorKind::kInvalidSpec,
                fmt::format("{}: {}", location(origin, hazard->place), hazard->what));
  }
  const toml::parse_result parsed = toml::parse(text);
  if (!parsed) {
    const toml::parse_error& error = parsed.error();
    std::string_view what = error.description();
    what = what.substr(0, what.find(" (TOML_MAX_NESTED_VALUES)"));
    std::string message = printable(what, 300);
    if (message.starts_with('E')) message[0] = 'e';  // Error, Encountered
    return fail(ErrorKind::kInvalidSpec,
                fmt::format("{}: {}; expected valid TOML 1.0",
                            location(origin, to_place(error.source().begin)), message));
  }
  return Converter(origin).convert(parsed.table(), 0);
}

}  // namespace pf::spec
