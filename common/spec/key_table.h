#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/spec/job_spec.h"

namespace pf::spec {

/// The kinds of value that a key can hold. `get` and `set` reach its field in a JobSpec; `set` takes checked
/// values.
struct IntegerKind {
  std::int64_t min, max;
  std::int64_t (*get)(const JobSpec&);
  void (*set)(JobSpec&, std::int64_t);
};

struct RealKind {
  double min, max;
  bool above_min;  ///< the minimum itself is excluded
  double (*get)(const JobSpec&);
  void (*set)(JobSpec&, double);
};

/// No numbers, or exactly `count` of them.
struct RealsKind {
  std::size_t count;
  double min, max;
  const std::vector<double>& (*get)(const JobSpec&);
  void (*set)(JobSpec&, std::vector<double>);
};

enum class TextForm {
  kJobName,  ///< [A-Za-z0-9._-]{1,100}, and neither `.` nor `..`
  kPath,     ///< relative, below the job file's folder; stored in normal form
  kFree      ///< any text without control characters
};

struct TextKind {
  TextForm form;
  std::size_t max_bytes;
  std::span<const std::string_view> extensions;  ///< of a path; upper case is accepted too
  const std::string& (*get)(const JobSpec&);
  void (*set)(JobSpec&, std::string);
};

struct ChoiceKind {
  std::span<const std::string_view> names;  ///< in the order of the enumeration
  std::size_t (*get)(const JobSpec&);
  void (*set)(JobSpec&, std::size_t);
};

struct BooleanKind {
  bool (*get)(const JobSpec&);
  void (*set)(JobSpec&, bool);
};

using Kind = std::variant<IntegerKind, RealKind, RealsKind, TextKind, ChoiceKind, BooleanKind>;

struct Key {
  std::string_view table;  ///< empty: at the top of the file
  std::string_view name;
  bool required;
  bool decides_image;     ///< the pixels of the EXR: part of image_hash_of_spec
  std::string_view unit;  ///< empty: a pure number or text
  std::string_view doc;   ///< one sentence for the reference and the schema
  Kind kind;
};

struct Table {
  std::string_view name;
  std::string_view doc;
};

/// Every key of a job file, in the order of the reference: the only place that knows names, types and ranges.
/// Defaults are those of JobSpec{}.
[[nodiscard]] std::span<const Key> job_keys();
[[nodiscard]] std::span<const Table> job_tables();
[[nodiscard]] std::span<const std::string_view> integrator_names();
[[nodiscard]] std::span<const std::string_view> mode_names();

/// The key `table.name`, or nullptr.
[[nodiscard]] const Key* find_key(std::string_view table, std::string_view name);
/// `table.name`, or the name alone at the top.
[[nodiscard]] std::string full_name(const Key& key);
/// What a key takes, for messages and the reference: `an integer from 1 to 65536 (pixels)`.
[[nodiscard]] std::string expectation(const Key& key);

}  // namespace pf::spec
