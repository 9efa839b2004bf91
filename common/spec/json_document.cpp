#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/spec/document.h"

namespace pf::spec {
namespace {

using Json = nlohmann::json;

/// Reads characters and counts them: nlohmann's event interface does not say where in the text it is.
class CountingIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  CountingIterator(const char* at, std::size_t* count) : at_(at), count_(count) {}
  reference operator*() const { return *at_; }
  CountingIterator& operator++() {
    ++at_;
    ++*count_;
    return *this;
  }
  CountingIterator operator++(int) {
    CountingIterator before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const CountingIterator& a, const CountingIterator& b) { return a.at_ == b.at_; }

 private:
  const char* at_;
  std::size_t* count_;
};

/// Line and column of an offset. Offsets grow as the parser does, so that a whole text is counted once.
class PlaceFinder {
 public:
  explicit PlaceFinder(std::string_view text) : text_(text) {}

  Place at(std::size_t offset) {
    if (offset < counted_) {
      counted_ = 0;
      place_ = {};
    }
    for (; counted_ < offset && counted_ < text_.size(); ++counted_) {
      const char c = text_[counted_];
      if (c == '\n') {
        place_ = {place_.line + 1, 1};
      } else if ((static_cast<unsigned char>(c) & 0xc0) != 0x80) {
        ++place_.column;
      }
    }
    return place_;
  }

 private:
  std::string_view text_;
  std::size_t counted_ = 0;
  Place place_;
};

/// Builds the Value from nlohmann's events; stops at the first error.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  Builder(std::string_view text, std::string_view origin, const std::size_t& consumed)
      : text_(text), origin_(origin), consumed_(consumed), places_(text) {}

  bool null() override { return add({Value::Other{"null"}, places_.at(word_start())}); }
  bool boolean(bool value) override { return add({value, places_.at(word_start())}); }
  bool number_integer(std::int64_t value) override { return add({value, places_.at(word_start())}); }
  bool number_unsigned(std::uint64_t value) override {
    const Place place = places_.at(word_start());
    if (value <= INT64_MAX) return add({static_cast<std::int64_t>(value), place});
    return add({Value::Other{fmt::format("the integer {}", value)}, place});
  }
  bool number_float(double value, const std::string&) override { return add({value, places_.at(word_start())}); }
  bool string(std::string& value) override {
    const Place place = places_.at(string_start());
    return add({std::move(value), place});
  }
  bool binary(Json::binary_t&) override { return false; }  // no such thing in text

  bool start_object(std::size_t) override { return open(Value::Table{}); }
  bool start_array(std::size_t) override { return open(Value::Array{}); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }

  bool key(std::string& name) override {
    Open& table = open_.back();
    table.key = {name, places_.at(string_start()), {}};
    if (table.keys.insert(std::move(name)).second) return true;
    return refuse(table.key.place, fmt::format("key '{}' is given twice; expected it once", printable(table.key.key)));
  }

  bool parse_error(std::size_t position, const std::string&, const Json::exception& error) override {
    const Place place = places_.at(position > 0 ? position - 1 : 0);
    // `[json.exception.parse_error.101] parse error at line 1, column 2: what`: the place is ours.
    std::string_view what = error.what();
    const std::size_t column = what.find(", column ");
    const std::size_t colon = column == std::string_view::npos ? what.find("] ") : what.find(": ", column);
    if (colon != std::string_view::npos) what.remove_prefix(colon + 2);
    const std::size_t expected = what.rfind("; expected ");
    const std::string_view hint = expected == std::string_view::npos ? "; expected valid JSON" : what.substr(expected);
    // `; last read: '...'` repeats the text before the place, sometimes several lines of it.
    const std::string_view problem = what.substr(0, std::min(what.find("; last read: "), expected));
    return refuse(place, printable(problem, 200) + printable(hint, 200));
  }

  [[nodiscard]] Result<Value> result() && {
    if (!error_.message.empty()) return tl::unexpected(std::move(error_));
    return std::move(root_);
  }

 private:
  struct Open {
    Value value;
    Member key;                  ///< of the member that comes next
    std::set<std::string> keys;  ///< of an object so far
  };

  bool refuse(Place place, std::string what) {
    error_ = {ErrorKind::kInvalidSpec, fmt::format("{}: {}", location(origin_, place), what)};
    return false;
  }

  bool open(Value::Table table) { return open_value({std::move(table), places_.at(consumed_ - 1)}); }
  bool open(Value::Array array) { return open_value({std::move(array), places_.at(consumed_ - 1)}); }
  bool open_value(Value value) {
    if (open_.size() > static_cast<std::size_t>(kMaxDepth)) {
      return refuse(value.place, fmt::format("values are nested too deeply; expected at most {} levels", kMaxDepth));
    }
    open_.push_back({std::move(value), {}, {}});
    return true;
  }

  bool close() {
    Value value = std::move(open_.back().value);
    open_.pop_back();
    return add(std::move(value));
  }

  bool add(Value value) {
    if (open_.empty()) {
      root_ = std::move(value);
      return true;
    }
    Open& parent = open_.back();
    if (auto* table = std::get_if<Value::Table>(&parent.value.data)) {
      parent.key.value = std::move(value);
      table->push_back(std::move(parent.key));
    } else {
      std::get<Value::Array>(parent.value.data).push_back(std::move(value));
    }
    return true;
  }

  /// Start of the number or literal that was read last. After a number the parser is one character ahead.
  [[nodiscard]] std::size_t word_start() const {
    constexpr std::string_view kWord = "0123456789+-.eEtrufalsn";
    const auto in_word = [&](std::size_t i) { return kWord.find(text_[i]) != std::string_view::npos; };
    std::size_t start = consumed_;
    if (start > 0 && !in_word(start - 1)) --start;
    while (start > 0 && in_word(start - 1)) --start;
    return start;
  }

  /// Start of the string that was read last: its quote is the nearest one that no backslash escapes.
  [[nodiscard]] std::size_t string_start() const {
    std::size_t start = consumed_ - 1;
    while (start > 0) {
      --start;
      if (text_[start] != '"') continue;
      std::size_t slashes = 0;
      while (slashes < start && text_[start - 1 - slashes] == '\\') ++slashes;
      if (slashes % 2 == 0) break;
    }
    return start;
  }

  std::string_view text_;
  std::string_view origin_;
  const std::size_t& consumed_;
  PlaceFinder places_;
  std::vector<Open> open_;
  Value root_;
  Error error_;
};

}  // namespace

Result<Value> parse_json_document(std::string_view text, std::string_view origin) {
  std::size_t consumed = 0;
  Builder builder(text, origin, consumed);
  const CountingIterator begin(text.data(), &consumed), end(text.data() + text.size(), &consumed);
  const bool parsed = Json::sax_parse(begin, end, &builder);
  auto root = std::move(builder).result();
  if (parsed && root && !std::holds_alternative<Value::Table>(root->data)) {
    return fail(ErrorKind::kInvalidSpec, fmt::format("{}: the document is {}; expected an object",
                                                     location(origin, root->place), describe(*root)));
  }
  return root;
}

}  // namespace pf::spec
