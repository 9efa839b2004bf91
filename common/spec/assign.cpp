#include "common/spec/assign.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "common/base/nearest_name.h"

namespace pf::spec {
namespace {

/// Whole numbers may stand for reals, but not the other way round.
std::optional<double> as_real(const Value& value) {
  if (const auto* real = std::get_if<double>(&value.data)) return *real == 0.0 ? 0.0 : *real;  // no negative zero
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) return static_cast<double>(*integer);
  return std::nullopt;
}

bool in_range(double value, double min, double max) { return value >= min && value <= max; }  // false for NaN

bool has_control_character(std::string_view text) {
  return std::ranges::any_of(text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

bool is_job_name(std::string_view text) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' ||
           c == '-';
  };
  return !text.empty() && std::ranges::all_of(text, allowed) && text != "." && text != "..";
}

std::string lower_case(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

class Assigner {
 public:
  Assigner(JobSpec& spec, const Key& key, const Value& value) : spec_(spec), key_(key), value_(value) {}

  Result<void> operator()(const IntegerKind& kind) const {
    const auto* integer = std::get_if<std::int64_t>(&value_.data);
    if (integer == nullptr) {
      const auto* real = std::get_if<double>(&value_.data);
      const bool whole = real != nullptr && std::trunc(*real) == *real && std::abs(*real) < 1e15;
      return refuse(describe(value_), whole ? fmt::format("write {:.0f}", *real) : "");
    }
    if (*integer < kind.min || *integer > kind.max) return refuse(fmt::format("{}", *integer));
    kind.set(spec_, *integer);
    return {};
  }

  Result<void> operator()(const RealKind& kind) const {
    const auto real = as_real(value_);
    if (!real) return refuse(describe(value_));
    if (!in_range(*real, kind.min, kind.max) || (kind.above_min && *real == kind.min)) {
      return refuse(fmt::format("{}", *real));
    }
    kind.set(spec_, *real);
    return {};
  }

  Result<void> operator()(const RealsKind& kind) const {
    const auto* array = std::get_if<Value::Array>(&value_.data);
    if (array == nullptr) return refuse(describe(value_));
    if (!array->empty() && array->size() != kind.count) return refuse(fmt::format("an array of {}", array->size()));
    std::vector<double> numbers;
    for (const Value& item : *array) {
      const auto real = as_real(item);
      if (!real) return refuse(fmt::format("an array with {}", describe(item)));
      if (!in_range(*real, kind.min, kind.max)) return refuse(fmt::format("an array with {}", *real));
      numbers.push_back(*real);
    }
    kind.set(spec_, std::move(numbers));
    return {};
  }

  Result<void> operator()(const TextKind& kind) const {
    const auto* text = std::get_if<std::string>(&value_.data);
    if (text == nullptr) return refuse(describe(value_));
    if (text->size() > kind.max_bytes) return refuse(fmt::format("a string of {} bytes", text->size()));
    // Overrides come from the command line, which may hold any bytes.
    if (has_control_character(*text) || !is_utf8(*text)) return refuse(quoted(*text));
    if (kind.form == TextForm::kPath) return assign_path(kind, *text);
    if (kind.form == TextForm::kJobName && !is_job_name(*text)) return refuse(quoted(*text));
    kind.set(spec_, *text);
    return {};
  }

  Result<void> operator()(const ChoiceKind& kind) const {
    const auto* text = std::get_if<std::string>(&value_.data);
    if (text == nullptr) return refuse(describe(value_));
    const auto found = std::ranges::find(kind.names, *text);
    if (found == kind.names.end()) {
      const auto near = nearest_name(*text, kind.names);
      return refuse(quoted(*text), near ? fmt::format("did you mean '{}'?", *near) : "");
    }
    kind.set(spec_, static_cast<std::size_t>(found - kind.names.begin()));
    return {};
  }

  Result<void> operator()(const BooleanKind& kind) const {
    const auto* boolean = std::get_if<bool>(&value_.data);
    if (boolean == nullptr) return refuse(describe(value_));
    kind.set(spec_, *boolean);
    return {};
  }

 private:
  static std::string quoted(std::string_view text) { return fmt::format("\"{}\"", printable(text)); }

  Result<void> assign_path(const TextKind& kind, const std::string& text) const {
    if (text.empty() && !key_.required) {
      kind.set(spec_, text);
      return {};
    }
    const std::filesystem::path normal = std::filesystem::path(text).lexically_normal();
    if (normal.is_absolute()) return refuse(fmt::format("the absolute path {}", quoted(text)));
    if (!normal.empty() && *normal.begin() == "..") {
      return refuse(fmt::format("{}, which leaves the job file's folder", quoted(text)));
    }
    if (std::ranges::find(kind.extensions, lower_case(normal.extension().string())) == kind.extensions.end()) {
      return refuse(quoted(text));
    }
    kind.set(spec_, normal.generic_string());
    return {};
  }

  [[nodiscard]] Result<void> refuse(std::string_view is, std::string_view hint = "") const {
    std::string message = fmt::format("{} is {}; expected {}", full_name(key_), is, expectation(key_));
    if (!hint.empty()) message += fmt::format("; {}", hint);
    return fail(ErrorKind::kInvalidSpec, std::move(message));
  }

  JobSpec& spec_;
  const Key& key_;
  const Value& value_;
};

}  // namespace

Result<void> assign(JobSpec& spec, const Key& key, const Value& value) {
  return std::visit(Assigner(spec, key, value), key.kind);
}

}  // namespace pf::spec
