#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/spec/document.h"

namespace pf::bench {

/// Reads tables of a suite strictly: every key is known or an error that names its place and the nearest valid name.
class SuiteReader {
 public:
  explicit SuiteReader(std::string_view origin) : origin_(origin) {}

  struct Field {
    std::string_view name;
    std::function<Result<void>(const spec::Value&)> read;
  };
  using Fields = std::vector<Field>;

  [[nodiscard]] Result<void> table(const spec::Value& value, std::string_view name, const Fields& fields) const;
  /// An array of tables, each handed to `read`.
  [[nodiscard]] Result<void> tables(const spec::Value& value, std::string_view name,
                                    const std::function<Result<void>(const spec::Value&)>& read) const;

  // Readers of single values into a field.
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> text(std::string& to) const;
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> texts(std::vector<std::string>& to) const;
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> boolean(bool& to) const;
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> real(double& to, double min, double max) const;
  /// Ascending, above zero, at least one.
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> ascending(std::vector<double>& to) const;
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> ascending(std::vector<std::int64_t>& to) const;
  template <typename Integer>
  [[nodiscard]] std::function<Result<void>(const spec::Value&)> integer(Integer& to, std::int64_t min,
                                                                        std::int64_t max) const {
    return [this, &to, min, max](const spec::Value& value) -> Result<void> {
      const auto read = whole(value, min, max);
      if (!read) return tl::unexpected(read.error());
      to = static_cast<Integer>(*read);
      return {};
    };
  }

  /// `origin:line:column: is; expected ...`
  [[nodiscard]] tl::unexpected<Error> refuse(spec::Place place, const std::string& is,
                                             const std::string& expected) const;

 private:
  [[nodiscard]] Result<std::int64_t> whole(const spec::Value& value, std::int64_t min, std::int64_t max) const;
  [[nodiscard]] Result<double> number(const spec::Value& value, double min, double max) const;

  std::string origin_;
};

}  // namespace pf::bench
