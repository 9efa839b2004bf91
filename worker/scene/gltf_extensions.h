#pragma once

#include <span>
#include <string_view>

#include "worker/scene/gltf_report.h"
#include "worker/scene/gltf_source.h"

namespace pf::gltf {

/// Extensions that the loader understands.
[[nodiscard]] std::span<const std::string_view> supported_extensions();
[[nodiscard]] bool is_supported_extension(std::string_view name);

/// Refuses a document that requires an extension which is not supported; one warning for each other unknown
/// one. Looks at nothing but the two lists, so that it can run before anything else is trusted.
void check_extensions(const Json& document, Report& report);

/// Is `name` in `extensionsUsed`?
[[nodiscard]] bool uses_extension(const Json& document, std::string_view name);

}  // namespace pf::gltf
