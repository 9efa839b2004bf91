#include "jobs/benchmark/suite_reader.h"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/base/nearest_name.h"

namespace pf::bench {

using spec::Value;

tl::unexpected<Error> SuiteReader::refuse(spec::Place place, const std::string& is, const std::string& expected) const {
  return fail(ErrorKind::kInvalidSpec,
              fmt::format("{}: {}; expected {}", spec::location(origin_, place), is, expected));
}

Result<void> SuiteReader::table(const Value& value, std::string_view name, const Fields& fields) const {
  const auto* members = std::get_if<Value::Table>(&value.data);
  if (members == nullptr) return refuse(value.place, fmt::format("{} is {}", name, spec::describe(value)), "a table");
  std::vector<std::string_view> names;
  for (const Field& field : fields) names.push_back(field.name);
  for (const spec::Member& member : *members) {
    const auto field = std::ranges::find(fields, member.key, &Field::name);
    if (field == fields.end()) {
      const std::string where = name.empty() ? "at the top of a suite" : fmt::format("in {}", name);
      const auto near = nearest_name(member.key, std::span<const std::string_view>(names));
      return refuse(
          member.place, fmt::format("unknown key '{}' {}", spec::printable(member.key), where),
          fmt::format("one of {}{}", fmt::join(names, ", "), near ? fmt::format("; did you mean '{}'?", *near) : ""));
    }
    if (auto read = field->read(member.value); !read) {
      return fail(read.error().kind, fmt::format("{} (key '{}')", read.error().message, member.key));
    }
  }
  return {};
}

Result<void> SuiteReader::tables(const Value& value, std::string_view name,
                                 const std::function<Result<void>(const Value&)>& read) const {
  const auto* array = std::get_if<Value::Array>(&value.data);
  if (array == nullptr)
    return refuse(value.place, fmt::format("{} is {}", name, spec::describe(value)), "tables [[...]]");
  for (const Value& item : *array) {
    if (auto done = read(item); !done) return done;
  }
  return {};
}

std::function<Result<void>(const Value&)> SuiteReader::text(std::string& to) const {
  return [this, &to](const Value& value) -> Result<void> {
    const auto* string = std::get_if<std::string>(&value.data);
    if (string == nullptr || string->empty()) return refuse(value.place, spec::describe(value), "a string");
    to = *string;
    return {};
  };
}

std::function<Result<void>(const Value&)> SuiteReader::texts(std::vector<std::string>& to) const {
  return [this, &to](const Value& value) -> Result<void> {
    const auto* array = std::get_if<Value::Array>(&value.data);
    if (array == nullptr) return refuse(value.place, spec::describe(value), "an array of strings");
    to.clear();
    for (const Value& item : *array) {
      std::string one;
      if (auto read = text(one)(item); !read) return read;
      to.push_back(std::move(one));
    }
    return {};
  };
}

Result<double> SuiteReader::number(const Value& value, double min, double max) const {
  double read = 0;
  if (const auto* real = std::get_if<double>(&value.data)) {
    read = *real;
  } else if (const auto* integer = std::get_if<std::int64_t>(&value.data)) {
    read = static_cast<double>(*integer);
  } else {
    return refuse(value.place, spec::describe(value), fmt::format("a number from {:g} to {:g}", min, max));
  }
  if (!(read >= min && read <= max)) {
    return refuse(value.place, spec::describe(value), fmt::format("a number from {:g} to {:g}", min, max));
  }
  return read;
}

Result<std::int64_t> SuiteReader::whole(const Value& value, std::int64_t min, std::int64_t max) const {
  const auto* integer = std::get_if<std::int64_t>(&value.data);
  if (integer == nullptr || *integer < min || *integer > max) {
    return refuse(value.place, spec::describe(value), fmt::format("an integer from {} to {}", min, max));
  }
  return *integer;
}

std::function<Result<void>(const Value&)> SuiteReader::boolean(bool& to) const {
  return [this, &to](const Value& value) -> Result<void> {
    const auto* read = std::get_if<bool>(&value.data);
    if (read == nullptr) return refuse(value.place, spec::describe(value), "true or false");
    to = *read;
    return {};
  };
}

std::function<Result<void>(const Value&)> SuiteReader::real(double& to, double min, double max) const {
  return [this, &to, min, max](const Value& value) -> Result<void> {
    const auto read = number(value, min, max);
    if (!read) return tl::unexpected(read.error());
    to = *read;
    return {};
  };
}

namespace {

/// Reads an array whose items `one` reads, each above the one before.
template <typename Number, typename One>
Result<void> read_ascending(const SuiteReader& reader, const Value& value, std::vector<Number>& to, const One& one) {
  const std::string expected = "an array of ascending numbers above 0";
  const auto* array = std::get_if<Value::Array>(&value.data);
  if (array == nullptr || array->empty()) return reader.refuse(value.place, spec::describe(value), expected);
  to.clear();
  for (const Value& item : *array) {
    const Result<Number> read = one(item);
    if (!read) return tl::unexpected(read.error());
    if (!to.empty() && *read <= to.back()) {
      return reader.refuse(item.place, fmt::format("{} after {}", *read, to.back()), expected);
    }
    to.push_back(*read);
  }
  return {};
}

}  // namespace

std::function<Result<void>(const Value&)> SuiteReader::ascending(std::vector<double>& to) const {
  return [this, &to](const Value& value) {
    return read_ascending(*this, value, to, [&](const Value& item) { return number(item, 1e-9, 1e9); });
  };
}

std::function<Result<void>(const Value&)> SuiteReader::ascending(std::vector<std::int64_t>& to) const {
  return [this, &to](const Value& value) {
    return read_ascending(*this, value, to, [&](const Value& item) { return whole(item, 1, 4294967295); });
  };
}

}  // namespace pf::bench
