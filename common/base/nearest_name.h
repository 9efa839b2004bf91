#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace pf {

/// The valid name that a reader most likely meant by `name`, for hints in error messages; empty if none is
/// near. Distance is the number of letters inserted, removed, replaced or swapped with their neighbour
/// (optimal string alignment), where case and `-` against `_` count nothing. The first of equally near names
/// wins.
[[nodiscard]] std::optional<std::string_view> nearest_name(std::string_view name,
                                                           std::span<const std::string_view> valid);
[[nodiscard]] std::optional<std::string_view> nearest_name(std::string_view name, std::span<const std::string> valid);

}  // namespace pf
