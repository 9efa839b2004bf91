#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "worker/scene/gltf_report.h"
#include "worker/scene/gltf_source.h"

namespace pf::gltf {

/// What relates one object to another; runs after check_schema, so that types, ranges and indices can be
/// trusted. Errors go to `report`; what cannot touch the image becomes a warning.
void check_document(const Json& document, Report& report);

// The parts of check_document.
void check_asset(const Json& document, Report& report);
void check_buffers(const Json& document, Report& report);  ///< buffer views and accessors stay inside
void check_nodes(const Json& document, Report& report);    ///< a forest; transforms; scenes
void check_skins(const Json& document, Report& report);
void check_cameras_and_lights(const Json& document, Report& report);
void check_images(const Json& document, Report& report);
void check_materials(const Json& document, Report& report);
void check_meshes(const Json& document, Report& report);  ///< attribute formats, counts, morph targets

// Shared by the parts.

/// Elements of a root array; empty when it is absent.
[[nodiscard]] const Json& elements(const Json& document, const char* list);
[[nodiscard]] std::uint64_t unsigned_or(const Json& object, const char* key, std::uint64_t absent);
[[nodiscard]] std::string text_or(const Json& object, const char* key, const char* absent);
/// Bytes of one component (5120 ... 5126), 0 for anything else.
[[nodiscard]] std::size_t component_bytes(std::uint64_t component_type);
/// Bytes of one element of an accessor; matrix columns start at multiples of four [glTF 2.0, 3.6.2.4].
[[nodiscard]] std::size_t element_bytes(std::uint64_t component_type, std::string_view type);
/// Same without the padding after the last column, which the last element of an accessor may lack.
[[nodiscard]] std::size_t last_element_bytes(std::uint64_t component_type, std::string_view type);
[[nodiscard]] std::size_t component_count(std::string_view type);

}  // namespace pf::gltf
