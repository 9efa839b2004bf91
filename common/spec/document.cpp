#include "common/spec/document.h"

#include <fmt/format.h>

#include <cmath>

namespace pf::spec {
namespace {

/// Bytes of the UTF-8 sequence at the start of `text`, 0 where it is broken (RFC 3629: no surrogates, no
/// overlong forms).
std::size_t sequence_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return 1;
  const std::size_t length = lead >= 0xc2 && lead <= 0xdf ? 2 : lead >= 0xe0 && lead <= 0xef ? 3 : 4;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
  }
  const bool overlong = (lead == 0xe0 && byte(1) < 0xa0) || (lead == 0xf0 && byte(1) < 0x90);
  const bool surrogate = lead == 0xed && byte(1) > 0x9f;
  const bool beyond = lead == 0xf4 && byte(1) > 0x8f;
  return overlong || surrogate || beyond ? 0 : length;
}

/// C1 controls and the line separators of Unicode end lines or hide text on some terminals.
bool is_invisible(std::string_view sequence) {
  return (sequence.size() == 2 && sequence[0] == '\xc2' && static_cast<unsigned char>(sequence[1]) < 0xa0) ||
         sequence == "\u2028" || sequence == "\u2029";
}

struct DescribeValue {
  std::string operator()(bool value) const { return value ? "the boolean true" : "the boolean false"; }
  std::string operator()(std::int64_t value) const { return fmt::format("the integer {}", value); }
  std::string operator()(double value) const {
    if (!std::isfinite(value)) return fmt::format("{}", value);
    std::string digits = fmt::format("{}", value);
    if (digits.find_first_of(".e") == std::string::npos) digits += ".0";
    return "the real number " + digits;
  }
  std::string operator()(const std::string& value) const { return fmt::format("the string \"{}\"", printable(value)); }
  std::string operator()(const Value::Array&) const { return "an array"; }
  std::string operator()(const Value::Table&) const { return "a table"; }
  std::string operator()(const Value::Other& other) const { return other.what; }
};

}  // namespace

std::string location(std::string_view origin, Place place) {
  return fmt::format("{}:{}:{}", origin, place.line, place.column);
}

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t length = sequence_length(text);
    if (length == 0) return false;
    text.remove_prefix(length);
  }
  return true;
}

std::string printable(std::string_view text, std::size_t max_bytes) {
  std::string shown;
  while (!text.empty()) {
    if (shown.size() >= max_bytes) return shown + "...";
    const std::size_t length = sequence_length(text);
    const std::string_view sequence = text.substr(0, length == 0 ? 1 : length);
    const auto byte = static_cast<unsigned char>(text[0]);
    if (length == 0 || byte < 0x20 || byte == 0x7f || is_invisible(sequence)) {
      for (const char c : sequence) shown += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    } else {
      shown += sequence;
    }
    text.remove_prefix(sequence.size());
  }
  return shown;
}

std::string describe(const Value& value) { return std::visit(DescribeValue{}, value.data); }

}  // namespace pf::spec
