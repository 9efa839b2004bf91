#pragma once

#include <nlohmann/json.hpp>

#include "common/spec/key_table.h"

namespace pf::spec {

/// The value of `key` in `spec`, in the types of JSON.
[[nodiscard]] inline nlohmann::json json_value(const JobSpec& spec, const Key& key) {
  return std::visit(
      [&](const auto& kind) -> nlohmann::json {
        if constexpr (std::is_same_v<std::decay_t<decltype(kind)>, ChoiceKind>) {
          return kind.names[kind.get(spec)];
        } else {
          return kind.get(spec);
        }
      },
      key.kind);
}

}  // namespace pf::spec
