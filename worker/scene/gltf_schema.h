#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string_view>

#include "worker/scene/gltf_report.h"
#include "worker/scene/gltf_source.h"

namespace pf::gltf {

struct Schema;

enum class Type { kBoolean, kInteger, kNumber, kString, kIndex, kObject };
enum class Shape { kOne, kList, kMap, kListOfMaps };

/// What one property of a glTF object may hold.
struct Rule {
  std::string_view name;
  Type type = Type::kObject;
  Shape shape = Shape::kOne;
  bool required = false;
  bool harmless = false;  ///< a fault cannot touch the image: warn and drop the property
  bool above = false;     ///< `min` itself is not allowed
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::size_t items_min = 0, items_max = std::numeric_limits<std::size_t>::max();
  std::string_view collection{};              ///< of kIndex: path of the array that it points into
  const Schema* schema = nullptr;             ///< of kObject
  std::span<const std::string_view> words{};  ///< of kString: what is allowed; empty: anything
  std::span<const int> values{};              ///< of kInteger: what is allowed; empty: anything

  // Modifiers for the tables.
  [[nodiscard]] constexpr Rule must() const {
    Rule r = *this;
    r.required = true;
    return r;
  }
  [[nodiscard]] constexpr Rule soft() const {
    Rule r = *this;
    r.harmless = true;
    return r;
  }
  [[nodiscard]] constexpr Rule list(std::size_t lo = 1,
                                    std::size_t hi = std::numeric_limits<std::size_t>::max()) const {
    Rule r = *this;
    r.shape = Shape::kList;
    r.items_min = lo;
    r.items_max = hi;
    return r;
  }
  [[nodiscard]] constexpr Rule map() const {
    Rule r = *this;
    r.shape = Shape::kMap;
    r.items_min = 1;
    return r;
  }
  [[nodiscard]] constexpr Rule maps() const {
    Rule r = *this;
    r.shape = Shape::kListOfMaps;
    return r;
  }
  [[nodiscard]] constexpr Rule range(double lo, double hi = std::numeric_limits<double>::infinity()) const {
    Rule r = *this;
    r.min = lo;
    r.max = hi;
    return r;
  }
  [[nodiscard]] constexpr Rule more_than(double lo) const {
    Rule r = *this;
    r.min = lo;
    r.above = true;
    return r;
  }
};

/// An extension object that may stand in a given kind of object.
struct ExtensionRule {
  std::string_view name;
  const Schema* schema;
};

struct Schema {
  std::string_view title;  ///< for messages: "material"
  std::span<const Rule> rules;
  std::span<const ExtensionRule> extensions{};
};

/// The glTF 2.0 document with the supported extensions.
[[nodiscard]] const Schema& document_schema();

/// Checks types, ranges, required properties, references, and where extensions stand. Harmless faults are
/// removed from `document` with a warning, and whole-numbered reals become integers, so that afterwards every
/// property has the type that the tables say. Errors go to `report`.
void check_schema(Json& document, Report& report);

/// Size of the array at `path` ("nodes", "extensions/KHR_lights_punctual/lights"), 0 when absent.
[[nodiscard]] std::size_t collection_size(const Json& document, std::string_view path);

}  // namespace pf::gltf
