#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace pf::test {

/// What a `$ref` of the document leads to; else the schema itself.
inline const nlohmann::json& resolve(const nlohmann::json& document, const nlohmann::json& schema) {
  if (!schema.contains("$ref")) return schema;
  return document.at(nlohmann::json::json_pointer(schema.at("$ref").get<std::string>().substr(1)));
}

/// Where a value is not what a schema of an OpenAPI document asks for, by what our document uses of JSON
/// Schema for answers; empty: it fits.
inline std::string misfit(const nlohmann::json& document, const nlohmann::json& value, const nlohmann::json& given,
                          const std::string& place) {
  using nlohmann::json;
  const json& schema = resolve(document, given);
  if (schema.contains("anyOf")) {
    std::string all;
    for (const json& option : schema.at("anyOf")) {
      const std::string wrong = misfit(document, value, option, place);
      if (wrong.empty()) return {};
      all += wrong + "; ";
    }
    return all;
  }
  if (schema.contains("enum")) {
    for (const json& option : schema.at("enum")) {
      if (option == value) return {};
    }
    return place + " is none of the enumeration";
  }
  const std::string type = schema.value("type", "");
  const bool fits = type == "object"    ? value.is_object()
                    : type == "array"   ? value.is_array()
                    : type == "string"  ? value.is_string()
                    : type == "boolean" ? value.is_boolean()
                    : type == "integer" ? value.is_number_integer()
                    : type == "number"  ? value.is_number()
                    : type == "null"    ? value.is_null()
                                        : true;
  if (!fits) return place + " is no " + type + ": " + value.dump();
  if (value.is_array() && schema.contains("items")) {
    for (const json& item : value) {
      if (auto wrong = misfit(document, item, schema.at("items"), place + "[]"); !wrong.empty()) return wrong;
    }
  }
  if (!value.is_object()) return {};
  for (const json& name : schema.value("required", json::array())) {
    if (!value.contains(name.get<std::string>())) return place + "." + name.get<std::string>() + " is missing";
  }
  for (const auto& [name, member] : value.items()) {
    if (!schema.contains("properties") || !schema.at("properties").contains(name)) {
      if (schema.value("additionalProperties", json(true)) == json(false))
        return place + "." + name + " is not in the document";
      continue;
    }
    if (auto wrong = misfit(document, member, schema.at("properties").at(name), place + "." + name); !wrong.empty())
      return wrong;
  }
  return {};
}

}  // namespace pf::test
