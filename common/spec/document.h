#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/base/result.h"

namespace pf::spec {

/// Line and column of a text, both from 1; columns count code points.
struct Place {
  std::uint32_t line = 1;
  std::uint32_t column = 1;
};

struct Member;

/// What TOML and JSON have in common, with the place of every value: the parsers end here and the checks
/// begin.
struct Value {
  /// What no key takes: null, dates, integers beyond 64 bits. In words, for messages.
  struct Other {
    std::string what;
  };
  using Array = std::vector<Value>;
  using Table = std::vector<Member>;  ///< in the order of the text

  std::variant<bool, std::int64_t, double, std::string, Array, Table, Other> data;
  Place place;
};

struct Member {
  std::string key;
  Place place;
  Value value;
};

/// Values nested deeper are refused: no job needs it, and it bounds every recursion.
inline constexpr int kMaxDepth = 8;
/// Largest job file.
inline constexpr std::uint64_t kMaxSpecBytes = std::uint64_t{1} << 20;

/// Text to the value of its root, always a Table without duplicate keys. Errors: kInvalidSpec,
/// `origin:line:column: what is wrong; what was expected`. Safe on any bytes.
[[nodiscard]] Result<Value> parse_toml_document(std::string_view text, std::string_view origin);
[[nodiscard]] Result<Value> parse_json_document(std::string_view text, std::string_view origin);

/// `origin:line:column`
[[nodiscard]] std::string location(std::string_view origin, Place place);
[[nodiscard]] bool is_utf8(std::string_view text);
/// `text` on one line of valid UTF-8, control characters and broken bytes escaped, cut after `max_bytes`.
[[nodiscard]] std::string printable(std::string_view text, std::size_t max_bytes = 80);
/// What a value is, for messages: `the string "x"`, `the integer 3`, `a table`.
[[nodiscard]] std::string describe(const Value& value);

}  // namespace pf::spec
