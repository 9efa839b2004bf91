#include "jobs/benchmark/material_terms.h"

#include <cstring>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// glTF 2.0, 4.4: a header of magic, version and length, then chunks of length, kind and data; the first holds JSON.
constexpr std::size_t kGlbHeader = 12, kChunkHeader = 8;
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 32;

void drop_textures(json& object) {
  for (auto it = object.begin(); it != object.end();) {
    if (it.key().ends_with("Texture") && it.key() != "normalTexture") {
      it = object.erase(it);
      continue;
    }
    if (it->is_object()) drop_textures(*it);
    ++it;
  }
}

json* extension(json& material, const char* name) {
  const auto all = material.find("extensions");
  if (all == material.end() || !all->is_object()) return nullptr;
  const auto found = all->find(name);
  return found == all->end() || !found->is_object() ? nullptr : &*found;
}

void sharpen(json& material) {
  json& base = material["pbrMetallicRoughness"];
  if (!base.is_object()) base = json::object();
  const json* specular = extension(material, "KHR_materials_specular");
  const bool lambert =
      specular != nullptr && specular->value("specularFactor", 1.0) == 0 && base.value("metallicFactor", 1.0) == 0;
  if (lambert) return;
  base["roughnessFactor"] = 0;
  base.erase("metallicRoughnessTexture");
}

struct MaterialTerm {
  std::string_view name;
  void (*leave_out)(json& material);
};

constexpr MaterialTerm kTerms[] = {
    {"textures", drop_textures},
    {"normal maps", [](json& material) { material.erase("normalTexture"); }},
    {"alpha", [](json& material) { material.erase("alphaMode"); }},
    {"rough lobes", sharpen},
    {"absorption",
     [](json& material) {
       if (json* volume = extension(material, "KHR_materials_volume")) volume->erase("attenuationColor");
     }},
};

const MaterialTerm* term_of(std::string_view name) {
  for (const MaterialTerm& term : kTerms) {
    if (term.name == name) return &term;
  }
  return nullptr;
}

std::uint32_t number_at(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);  // both are little-endian
  return value;
}

void put(std::string& bytes, std::size_t at, std::size_t value) {
  const auto narrow = static_cast<std::uint32_t>(value);
  std::memcpy(bytes.data() + at, &narrow, sizeof narrow);
}

}  // namespace

bool is_material_term(std::string_view term) { return term_of(term) != nullptr; }

Result<void> leave_out_of_materials(std::string_view term, const fs::path& gltf) {
  auto read = read_file(gltf, kMaxBytes);
  if (!read) return tl::unexpected(read.error());
  std::string bytes = std::move(*read);
  const bool binary = bytes.starts_with("glTF") && bytes.size() >= kGlbHeader + kChunkHeader;
  const std::size_t begin = binary ? kGlbHeader + kChunkHeader : 0;
  const std::size_t length = binary ? number_at(bytes, kGlbHeader) : bytes.size();
  json document = length <= bytes.size() - begin ? json::parse(bytes.substr(begin, length), nullptr, false) : json();
  const MaterialTerm* how = term_of(term);
  if (!document.is_object() || how == nullptr) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: no glTF to leave '{}' out of", gltf.string(), term));
  }
  for (json& material : document["materials"]) {
    if (material.is_object()) how->leave_out(material);
  }
  std::string text = document.dump(-1, ' ', false, json::error_handler_t::replace);
  if (binary) {
    text.append((4 - text.size() % 4) % 4, ' ');  // chunks start at multiples of four
    bytes.replace(begin, length, text);
    put(bytes, kGlbHeader, text.size());
    put(bytes, 8, bytes.size());
  } else {
    bytes = std::move(text);
  }
  return write_file_atomically(gltf, bytes);
}

}  // namespace pf::bench
