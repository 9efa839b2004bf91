#include "worker/scene/gltf_extensions.h"

#include <algorithm>
#include <cctype>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace pf::gltf {
namespace {

constexpr std::string_view kSupported[] = {
    "EXT_mesh_gpu_instancing",    "EXT_texture_webp",        "KHR_draco_mesh_compression",
    "KHR_lights_punctual",        "KHR_materials_clearcoat", "KHR_materials_emissive_strength",
    "KHR_materials_ior",          "KHR_materials_sheen",     "KHR_materials_specular",
    "KHR_materials_transmission", "KHR_materials_unlit",     "KHR_materials_volume",
    "KHR_mesh_quantization",      "KHR_texture_transform"};

/// Names in one of the two lists; anything that is not a text is left to check_schema.
std::set<std::string> names(const Json& document, const char* list) {
  std::set<std::string> out;
  const auto it = document.find(list);
  if (it == document.end() || !it->is_array()) return out;
  for (const Json& name : *it) {
    if (name.is_string()) out.insert(name.get<std::string>());
  }
  return out;
}

/// "KHR_name": an upper-case vendor prefix, an underscore, a name [glTF extension registry, "Naming"].
bool is_well_named(std::string_view name) {
  const std::size_t end = name.find('_');
  if (end == std::string_view::npos || end == 0 || end + 1 == name.size()) return false;
  const bool prefix = std::all_of(name.begin(), name.begin() + static_cast<std::ptrdiff_t>(end),
                                  [](unsigned char c) { return std::isupper(c) != 0 || std::isdigit(c) != 0; });
  return prefix &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; });
}

}  // namespace

std::span<const std::string_view> supported_extensions() { return kSupported; }

bool is_supported_extension(std::string_view name) {
  return std::find(std::begin(kSupported), std::end(kSupported), name) != std::end(kSupported);
}

bool uses_extension(const Json& document, std::string_view name) {
  return names(document, "extensionsUsed").contains(std::string(name));
}

void check_extensions(const Json& document, Report& report) {
  const std::set<std::string> used = names(document, "extensionsUsed");
  for (const std::string& name : names(document, "extensionsRequired")) {
    if (!is_supported_extension(name)) {
      report.error("/extensionsRequired", fmt::format("extension {} is required and not supported; supported are {}",
                                                      in_quotes(name), fmt::join(kSupported, ", ")));
      return;
    }
    if (!used.contains(name)) {
      report.warn("/extensionsRequired", fmt::format("extension {} is missing from extensionsUsed", in_quotes(name)));
    }
  }
  for (const std::string& name : used) {
    if (is_supported_extension(name)) continue;
    const char* odd = is_well_named(name) ? "" : " (and its name is not of the form PREFIX_name)";
    report.warn("/extensionsUsed", fmt::format("extension {} is not supported and is ignored{}", in_quotes(name), odd));
  }
}

}  // namespace pf::gltf
