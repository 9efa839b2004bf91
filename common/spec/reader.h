#pragma once

#include <map>
#include <string>
#include <string_view>

#include "common/spec/document.h"
#include "common/spec/key_table.h"

namespace pf::spec {

/// Fills a JobSpec from documents and overrides, later ones winning, with every value checked against the
/// table of keys.
class Reader {
 public:
  /// `origin` stands for the file in messages.
  explicit Reader(std::string_view origin) : origin_(origin) {}

  [[nodiscard]] Result<void> read(const Value& document);
  /// `table.key=value` with a TOML value; a key that takes a string takes it without quotes too.
  [[nodiscard]] Result<void> override_with(std::string_view argument);
  /// The checks that concern several keys, and the spec.
  [[nodiscard]] Result<JobSpec> finish() const;

 private:
  [[nodiscard]] Result<void> read_table(std::string_view table, const Value::Table& members);
  [[nodiscard]] Result<void> set(const Key& key, const Value& value, std::string where);
  [[nodiscard]] tl::unexpected<Error> missing(const Key& key) const;
  /// Where `table.name` was given, or the start of the file.
  [[nodiscard]] std::string where(std::string_view table, std::string_view name) const;

  std::string origin_;
  JobSpec spec_;
  std::map<const Key*, std::string> given_;           ///< where each key was given last
  std::map<std::string, Place, std::less<>> tables_;  ///< where each table begins
};

}  // namespace pf::spec
