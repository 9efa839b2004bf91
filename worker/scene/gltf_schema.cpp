#include "worker/scene/gltf_schema.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/scene/gltf_extensions.h"

namespace pf::gltf {
namespace {

constexpr double kLargestInt = 2147483647.0;

std::string_view type_name(Type type) {
  switch (type) {
    case Type::kBoolean:
      return "true or false";
    case Type::kInteger:
      return "an integer";
    case Type::kNumber:
      return "a number";
    case Type::kString:
      return "a text";
    case Type::kIndex:
      return "an index";
    case Type::kObject:
      return "an object";
  }
  return "a value";
}

/// Edits (insert, delete, replace) that turn `a` into `b`.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

/// "; did you mean normalTexture?" when a known property is near.
std::string hint(const Schema& schema, std::string_view name) {
  if (name.size() > 64) return "";
  for (const Rule& rule : schema.rules) {
    if (edit_distance(rule.name, name) <= 2) return fmt::format("; did you mean {}?", rule.name);
  }
  return "";
}

class Checker {
 public:
  Checker(Json& document, Report& report) : document_(document), report_(report) {}

  void run() {
    for (const char* list : {"extensionsUsed", "extensionsRequired"}) {
      const auto it = document_.find(list);
      if (it == document_.end() || !it->is_array()) continue;
      std::set<std::string, std::less<>> seen;
      for (const Json& name : *it) {
        if (!name.is_string()) continue;
        if (!seen.insert(name.get<std::string>()).second) {
          report_.warn(child("", std::string_view(list)),
                       fmt::format("{} is listed twice", in_quotes(name.get<std::string>())));
        }
      }
      used_.merge(seen);
    }
    object(document_, document_schema(), false);
  }

 private:
  /// One property, or the object itself, is wrong.
  void fault(bool harmless, const std::string& what) {
    if (harmless) {
      report_.warn(path_, what);
    } else {
      report_.error(path_, what);
    }
  }

  /// Runs `body` with `key` appended to the current JSON pointer.
  template <typename Key, typename Body>
  auto inside(const Key& key, Body body) {
    const std::size_t length = path_.size();
    path_ = child(path_, key);
    const auto result = body();
    path_.resize(length);
    return result;
  }

  /// All checks return false where the value cannot be kept: a harmless one is then erased.
  bool object(Json& value, const Schema& schema, bool harmless);
  bool property(Json& value, const Rule& rule, bool harmless);
  bool list(Json& value, const Rule& rule, bool harmless);
  bool single(Json& value, const Rule& rule, bool harmless);
  bool numeric(Json& value, const Rule& rule, bool harmless);
  bool index(Json& value, const Rule& rule, bool harmless);
  bool text(Json& value, const Rule& rule, bool harmless);
  void extensions(Json& owner, const Schema& schema, bool harmless);
  std::size_t size_of(std::string_view collection);

  Json& document_;
  Report& report_;
  std::string path_;
  std::set<std::string, std::less<>> used_;
  std::unordered_map<std::string_view, std::size_t> sizes_;
};

std::size_t Checker::size_of(std::string_view collection) {
  const auto [it, fresh] = sizes_.try_emplace(collection, 0);
  if (fresh) it->second = collection_size(document_, collection);
  return it->second;
}

bool Checker::object(Json& value, const Schema& schema, bool harmless) {
  if (!value.is_object()) {
    fault(harmless, fmt::format("is not an object; expected a {}", schema.title));
    return false;
  }
  bool complete = true;
  for (const Rule& rule : schema.rules) {
    const bool soft = harmless || rule.harmless;
    const auto it = value.find(rule.name);
    if (it == value.end()) {
      if (!rule.required) continue;
      fault(soft, fmt::format("{} has no property {}", schema.title, in_quotes(rule.name)));
      complete = complete && rule.harmless;
      continue;
    }
    const bool kept = inside(rule.name, [&] { return property(*it, rule, soft); });
    if (!kept && soft) value.erase(it);
    if (!kept && rule.required && !rule.harmless) complete = false;
  }
  for (auto it = value.begin(); it != value.end();) {
    const std::string& key = it.key();
    const bool known =
        std::any_of(schema.rules.begin(), schema.rules.end(), [&](const Rule& r) { return r.name == key; });
    if (known || key == "extras" || key == "extensions") {
      ++it;
    } else if (key == "name") {
      const bool is_text = it->is_string();
      if (!is_text) report_.warn(child(path_, key), "is not a text; the name is ignored");
      it = is_text ? std::next(it) : value.erase(it);
    } else {
      report_.warn(child(path_, key),
                   fmt::format("unknown property of a {} is ignored{}", schema.title, hint(schema, key)));
      it = value.erase(it);
    }
  }
  if (value.contains("extensions")) extensions(value, schema, harmless);
  return complete;
}

void Checker::extensions(Json& owner, const Schema& schema, bool harmless) {
  Json& all = owner["extensions"];
  inside(std::string_view("extensions"), [&] {
    if (!all.is_object()) {
      fault(harmless, "is not an object");
      return false;
    }
    for (auto it = all.begin(); it != all.end(); ++it) {
      const std::string& name = it.key();
      inside(std::string_view(name), [&] {
        const bool supported = is_supported_extension(name) || name == "KHR_texture_basisu";
        if (!used_.contains(name)) {
          report_.warn("/extensionsUsed", fmt::format("{} is used (first at {}) and not listed{}", in_quotes(name),
                                                      path_, supported ? "" : "; it is not supported and is ignored"));
          used_.insert(name);
        }
        if (!supported) return true;
        const auto rule = std::find_if(schema.extensions.begin(), schema.extensions.end(),
                                       [&](const ExtensionRule& r) { return r.name == name; });
        if (rule == schema.extensions.end()) {
          report_.warn(path_, fmt::format("extension has no meaning in a {} and is ignored", schema.title));
          return true;
        }
        return object(*it, *rule->schema, harmless);
      });
      if (report_.failed()) return false;
    }
    return true;
  });
}

bool Checker::property(Json& value, const Rule& rule, bool harmless) {
  if (rule.shape == Shape::kList) return list(value, rule, harmless);
  if (rule.shape == Shape::kOne) return single(value, rule, harmless);
  if (rule.shape == Shape::kListOfMaps) {
    Rule each = rule;
    each.shape = Shape::kMap;
    if (!value.is_array()) {
      fault(harmless, "is not an array");
      return false;
    }
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (!inside(i, [&] { return property(value[i], each, harmless); })) return false;
    }
    return true;
  }
  if (!value.is_object()) {
    fault(harmless, "is not an object");
    return false;
  }
  if (value.empty()) report_.warn(path_, "is empty");
  for (auto it = value.begin(); it != value.end(); ++it) {
    if (!inside(std::string_view(it.key()), [&] { return single(*it, rule, harmless); })) return false;
  }
  return true;
}

bool Checker::list(Json& value, const Rule& rule, bool harmless) {
  if (!value.is_array()) {
    fault(harmless, "is not an array");
    return false;
  }
  if (value.empty()) {
    if (rule.items_min == rule.items_max) {
      fault(harmless, fmt::format("is empty; expected {} elements", rule.items_min));
      return false;
    }
    report_.warn(path_, "is an empty array; expected one element or more, or no array");
    return true;
  }
  if (value.size() < rule.items_min || value.size() > rule.items_max) {
    fault(harmless,
          rule.items_min == rule.items_max
              ? fmt::format("has {} elements; expected {}", value.size(), rule.items_min)
              : fmt::format("has {} elements; expected {} to {}", value.size(), rule.items_min, rule.items_max));
    return false;
  }
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (!inside(i, [&] { return single(value[i], rule, harmless); })) return false;
    if (report_.failed()) return false;
  }
  return true;
}

bool Checker::single(Json& value, const Rule& rule, bool harmless) {
  switch (rule.type) {
    case Type::kObject:
      return object(value, *rule.schema, harmless);
    case Type::kBoolean:
      if (value.is_boolean()) return true;
      break;
    case Type::kString:
      if (value.is_string()) return text(value, rule, harmless);
      break;
    case Type::kNumber:
    case Type::kInteger:
      if (value.is_number()) return numeric(value, rule, harmless);
      break;
    case Type::kIndex:
      if (value.is_number()) return index(value, rule, harmless);
      break;
  }
  fault(harmless, fmt::format("is not {}", type_name(rule.type)));
  return false;
}

bool Checker::text(Json& value, const Rule& rule, bool harmless) {
  const auto& got = value.get_ref<const std::string&>();
  if (rule.words.empty() || std::find(rule.words.begin(), rule.words.end(), got) != rule.words.end()) return true;
  fault(harmless, fmt::format("is {}; expected {}", in_quotes(got), fmt::join(rule.words, ", ")));
  return false;
}

bool Checker::numeric(Json& value, const Rule& rule, bool harmless) {
  const double number = value.get<double>();
  if (rule.type == Type::kInteger) {
    // 1.0 is a valid way to write 1.
    if (std::floor(number) != number || std::abs(number) > 0x1p53) {
      fault(harmless, fmt::format("is {}; expected an integer", number));
      return false;
    }
    if (value.is_number_float()) value = static_cast<std::int64_t>(number);
    if (!rule.values.empty()) {
      if (std::find(rule.values.begin(), rule.values.end(), number) != rule.values.end()) return true;
      fault(harmless, fmt::format("is {}; expected {}", number, fmt::join(rule.values, ", ")));
      return false;
    }
  } else if (std::abs(number) > static_cast<double>(std::numeric_limits<float>::max())) {
    fault(harmless, fmt::format("is {}; expected a single-precision number", number));
    return false;
  }
  if (number >= rule.min && number <= rule.max && !(rule.above && number == rule.min)) return true;
  const std::string expected = std::isinf(rule.max)
                                   ? fmt::format("{} {}", rule.above ? "more than" : "at least", rule.min)
                                   : fmt::format("{} to {}", rule.min, rule.max);
  fault(harmless, fmt::format("is {}; expected {}", number, expected));
  return false;
}

bool Checker::index(Json& value, const Rule& rule, bool harmless) {
  const double number = value.get<double>();
  const std::size_t size = size_of(rule.collection);
  if (std::floor(number) == number && number >= 0 && number < static_cast<double>(size) && number <= kLargestInt) {
    if (value.is_number_float()) value = static_cast<std::int64_t>(number);
    return true;
  }
  fault(harmless,
        fmt::format("is {}; expected an index into {}, which has {} elements", number, rule.collection, size));
  return false;
}

}  // namespace

std::size_t collection_size(const Json& document, std::string_view path) {
  const Json* at = &document;
  while (true) {
    const std::size_t slash = path.find('/');
    if (!at->is_object()) return 0;
    const auto it = at->find(path.substr(0, slash));
    if (it == at->end()) return 0;
    at = &*it;
    if (slash == std::string_view::npos) break;
    path.remove_prefix(slash + 1);
  }
  return at->is_array() ? at->size() : 0;
}

void check_schema(Json& document, Report& report) { Checker(document, report).run(); }

}  // namespace pf::gltf
