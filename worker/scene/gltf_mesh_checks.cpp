#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "worker/scene/gltf_extensions.h"
#include "worker/scene/gltf_validation.h"

namespace pf::gltf {
namespace {

enum Components : unsigned {  // bits; "n" = normalized
  kI8 = 1,
  kU8 = 2,
  kI16 = 4,
  kU16 = 8,
  kF32 = 16,
  kI8n = 32,
  kU8n = 64,
  kI16n = 128,
  kU16n = 256,
  kOther = 512
};

/// What a vertex attribute may hold [glTF 2.0, 3.7.2.1 and 3.7.2.2; KHR_mesh_quantization].
struct Format {
  std::string_view semantic;
  bool indexed;
  std::string_view types;  ///< space-separated
  unsigned components;     ///< core
  unsigned quantized;      ///< with KHR_mesh_quantization, too
};
constexpr Format kFormats[] = {{"POSITION", false, "VEC3", kF32, kI8 | kU8 | kI16 | kU16 | kI8n | kU8n | kI16n | kU16n},
                               {"NORMAL", false, "VEC3", kF32, kI8n | kI16n},
                               {"TANGENT", false, "VEC4", kF32, kI8n | kI16n},
                               {"TEXCOORD", true, "VEC2", kF32 | kU8n | kU16n, kI8 | kU8 | kI16 | kU16 | kI8n | kI16n},
                               {"COLOR", true, "VEC3 VEC4", kF32 | kU8n | kU16n, 0},
                               {"JOINTS", true, "VEC4", kU8 | kU16, 0},
                               {"WEIGHTS", true, "VEC4", kF32 | kU8n | kU16n, 0}};
constexpr Format kTargetFormats[] = {
    {"POSITION", false, "VEC3", kF32, kI8 | kI16 | kI8n | kI16n},
    {"NORMAL", false, "VEC3", kF32, kI8n | kI16n},
    {"TANGENT", false, "VEC3", kF32, kI8n | kI16n},
    {"TEXCOORD", true, "VEC2", kF32 | kI8n | kI16n | kU8n | kU16n, kI8 | kU8 | kI16 | kU16},
    {"COLOR", true, "VEC3 VEC4", kF32 | kI8n | kI16n | kU8n | kU16n, 0}};

unsigned components_of(const Json& accessor) {
  const bool n = accessor.value("normalized", false);
  switch (unsigned_or(accessor, "componentType", 0)) {
    case 5120:
      return n ? kI8n : kI8;
    case 5121:
      return n ? kU8n : kU8;
    case 5122:
      return n ? kI16n : kI16;
    case 5123:
      return n ? kU16n : kU16;
    case 5126:
      return kF32;
    default:
      return kOther;
  }
}

const Format* find_format(std::span<const Format> formats, std::string_view name) {
  for (const Format& f : formats) {
    if (!f.indexed) {
      if (name == f.semantic) return &f;
      continue;
    }
    if (!name.starts_with(f.semantic) || name.size() < f.semantic.size() + 2 || name[f.semantic.size()] != '_')
      continue;
    const std::string_view digits = name.substr(f.semantic.size() + 1);
    const bool number = std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (number && (digits.size() == 1 || digits[0] != '0')) return &f;
  }
  return nullptr;
}

class PrimitiveChecker {
 public:
  PrimitiveChecker(const Json& document, Report& report)
      : document_(document), report_(report), quantization_(uses_extension(document, "KHR_mesh_quantization")) {}

  void check(const Json& primitive, const std::string& pointer);

 private:
  const Json& accessor(const Json& index) const { return elements(document_, "accessors")[index.get<std::size_t>()]; }
  void check_format(const Json& accessor_json, const Format& format, const std::string& pointer);
  void check_attributes(const Json& primitive, const std::string& pointer);
  void check_continuity(const Json& attributes, const std::string& pointer);
  void check_layout(const Json& attributes, const std::string& pointer);
  void check_indices(const Json& primitive, const std::string& pointer);
  void check_targets(const Json& primitive, const std::string& pointer);
  void check_material(const Json& primitive, const std::string& pointer);

  const Json& document_;
  Report& report_;
  bool quantization_;
};

void PrimitiveChecker::check_format(const Json& a, const Format& format, const std::string& pointer) {
  const std::string type = text_or(a, "type", "");
  const unsigned bits = components_of(a);
  if (format.types.find(type) == std::string_view::npos || (bits & (format.components | format.quantized)) == 0) {
    report_.error(pointer, fmt::format("accessor holds {} of componentType {}{}, which {} cannot be", type,
                                       unsigned_or(a, "componentType", 0),
                                       a.value("normalized", false) ? " (normalized)" : "", format.semantic));
  } else if ((bits & format.components) == 0 && !quantization_) {
    report_.warn(pointer, "integer components need KHR_mesh_quantization, which the file does not list");
  }
}

void PrimitiveChecker::check_attributes(const Json& primitive, const std::string& pointer) {
  const Json& attributes = primitive["attributes"];
  const std::string at = child(pointer, "attributes");
  const Json* first = attributes.empty() ? nullptr : &attributes.front();
  const Json* reference = attributes.contains("POSITION") ? &attributes["POSITION"] : first;
  for (const auto& [name, index] : attributes.items()) {
    const Json& a = accessor(index);
    const std::uint64_t n = unsigned_or(a, "count", 0);
    const std::uint64_t count = unsigned_or(accessor(*reference), "count", 0);
    if (n != count) {
      report_.error(child(at, name), fmt::format("has {} values; expected {} as POSITION has", n, count));
    }
    if (name.starts_with("_") && name.size() > 1) {
      if (unsigned_or(a, "componentType", 0) == 5125)
        report_.warn(child(at, name), "attribute of 32-bit integers is ignored");
      continue;
    }
    const Format* format = find_format(kFormats, name);
    if (format == nullptr) {
      report_.warn(child(at, name), "unknown attribute is ignored; custom ones begin with _");
    } else {
      check_format(a, *format, child(at, name));
    }
  }
  if (!attributes.contains("POSITION")) {
    report_.warn(at, "has no POSITION; the primitive is skipped");
  } else if (const Json& a = accessor(attributes["POSITION"]); !a.contains("min") || !a.contains("max")) {
    report_.warn(child(at, "POSITION"), "accessor has no min and max");
  }
  if (attributes.contains("TANGENT") && !attributes.contains("NORMAL")) {
    report_.warn(child(at, "TANGENT"), "is ignored without NORMAL");
  }
  check_continuity(attributes, at);
  check_layout(attributes, at);
}

void PrimitiveChecker::check_continuity(const Json& attributes, const std::string& pointer) {
  std::map<std::string_view, std::set<std::string>> sets;
  for (const auto& [name, index] : attributes.items()) {
    const Format* f = find_format(kFormats, name);
    if (f != nullptr && f->indexed) sets[f->semantic].insert(name);
  }
  for (const auto& [semantic, names] : sets) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (!names.contains(fmt::format("{}_{}", semantic, i))) {
        report_.warn(pointer, fmt::format("{}_{} is missing below a higher set", semantic, i));
        break;
      }
    }
  }
  if (sets["JOINTS"].size() != sets["WEIGHTS"].size()) {
    report_.warn(pointer, fmt::format("has {} JOINTS and {} WEIGHTS; expected as many", sets["JOINTS"].size(),
                                      sets["WEIGHTS"].size()));
  }
  if (sets["TEXCOORD"].size() > 4)
    report_.warn(pointer, "has more than 4 sets of texture coordinates; the others are ignored");
}

/// Interleaving rules that graphics APIs need and that reading byte by byte does not.
void PrimitiveChecker::check_layout(const Json& attributes, const std::string& pointer) {
  std::map<std::uint64_t, std::set<std::size_t>> accessors_of_view;
  for (const auto& [name, index] : attributes.items()) {
    const Json& a = accessor(index);
    if (!a.contains("bufferView")) continue;
    const std::uint64_t view_index = unsigned_or(a, "bufferView", 0);
    const Json& view = elements(document_, "bufferViews")[view_index];
    accessors_of_view[view_index].insert(index.get<std::size_t>());
    const std::uint64_t stride =
        unsigned_or(view, "byteStride", element_bytes(unsigned_or(a, "componentType", 0), text_or(a, "type", "")));
    if (unsigned_or(a, "byteOffset", 0) % 4 != 0 || stride % 4 != 0) {
      report_.warn(child(pointer, name), "vertex attribute is not aligned to 4 bytes");
    }
    if (unsigned_or(view, "target", 34962) != 34962)
      report_.warn(child(pointer, name), "buffer view's target says indices");
  }
  for (const auto& [view, indices] : accessors_of_view) {
    if (indices.size() > 1 && !elements(document_, "bufferViews")[view].contains("byteStride")) {
      report_.warn(pointer, fmt::format("buffer view {} holds several attributes and has no byteStride", view));
    }
  }
}

void PrimitiveChecker::check_indices(const Json& primitive, const std::string& pointer) {
  std::uint64_t count = 0;
  std::string what = "vertices";
  if (primitive.contains("indices")) {
    const Json& a = accessor(primitive["indices"]);
    const std::uint64_t component = unsigned_or(a, "componentType", 0);
    const std::string at = child(pointer, "indices");
    if (text_or(a, "type", "") != "SCALAR" || !(component == 5121 || component == 5123 || component == 5125)) {
      report_.error(at, fmt::format("accessor holds {} of componentType {}; expected SCALAR of unsigned integers",
                                    text_or(a, "type", ""), component));
    }
    if (a.value("normalized", false)) report_.warn(at, "accessor of indices is normalized, which is ignored");
    if (a.contains("bufferView")) {
      const Json& view = elements(document_, "bufferViews")[unsigned_or(a, "bufferView", 0)];
      if (view.contains("byteStride")) report_.warn(at, "buffer view of indices has a byteStride");
      if (unsigned_or(view, "target", 34963) != 34963) report_.warn(at, "buffer view's target says vertex attributes");
    }
    count = unsigned_or(a, "count", 0);
    what = "indices";
  } else if (primitive["attributes"].contains("POSITION")) {
    count = unsigned_or(accessor(primitive["attributes"]["POSITION"]), "count", 0);
  } else {
    return;
  }
  const std::uint64_t mode = unsigned_or(primitive, "mode", 4);
  const bool odd = (mode == 1 && count % 2 != 0) || ((mode == 2 || mode == 3) && count < 2) ||
                   (mode == 4 && count % 3 != 0) || (mode >= 5 && count < 3);
  if (odd) report_.warn(pointer, fmt::format("{} {} do not make whole primitives of mode {}", count, what, mode));
}

void PrimitiveChecker::check_targets(const Json& primitive, const std::string& pointer) {
  if (!primitive.contains("targets")) return;
  const Json& attributes = primitive["attributes"];
  for (std::size_t t = 0; t < primitive["targets"].size(); ++t) {
    const Json& target = primitive["targets"][t];
    const std::string at = fmt::format("{}/targets/{}", pointer, t);
    for (const auto& [name, index] : target.items()) {
      const Format* format = find_format(kTargetFormats, name);
      if (format == nullptr) {
        if (!name.starts_with("_")) report_.warn(child(at, name), "unknown morph target attribute is ignored");
      } else if (!attributes.contains(name)) {
        report_.warn(child(at, name), "has no base attribute and is ignored");
      } else {
        check_format(accessor(index), *format, child(at, name));
      }
      if (attributes.contains(name) &&
          unsigned_or(accessor(index), "count", 0) != unsigned_or(accessor(attributes[name]), "count", 0)) {
        report_.error(child(at, name), "has another count than its base attribute");
      }
    }
  }
}

/// UV sets that a material reads, from every texture reference in it.
void collect_uv_sets(const Json& value, std::set<std::uint64_t>& sets) {
  if (!value.is_object()) return;
  if (value.contains("index")) {
    const auto extensions = value.find("extensions");
    const std::uint64_t own = unsigned_or(value, "texCoord", 0);
    const bool moved = extensions != value.end() && extensions->contains("KHR_texture_transform");
    sets.insert(moved ? unsigned_or((*extensions)["KHR_texture_transform"], "texCoord", own) : own);
  }
  for (const auto& [key, inner] : value.items()) {
    if (key != "extras") collect_uv_sets(inner, sets);
  }
}

void PrimitiveChecker::check_material(const Json& primitive, const std::string& pointer) {
  if (!primitive.contains("material") || unsigned_or(primitive, "mode", 4) < 4) return;
  const Json& material = elements(document_, "materials")[unsigned_or(primitive, "material", 0)];
  std::set<std::uint64_t> sets;
  collect_uv_sets(material, sets);
  for (const std::uint64_t set : sets) {
    const std::string name = fmt::format("TEXCOORD_{}", set);
    if (!primitive["attributes"].contains(name)) {
      report_.warn(pointer, fmt::format("material {} reads {}, which the primitive does not have; (0, 0) is taken",
                                        unsigned_or(primitive, "material", 0), name));
    }
  }
}

void PrimitiveChecker::check(const Json& primitive, const std::string& pointer) {
  check_attributes(primitive, pointer);
  check_indices(primitive, pointer);
  check_targets(primitive, pointer);
  check_material(primitive, pointer);
}

/// What a buffer view holds should be one kind of thing.
void check_usage(const Json& document, Report& report) {
  std::map<std::uint64_t, std::set<std::string_view>> usage;
  const auto use = [&](const Json& index, std::string_view kind) {
    const Json& a = elements(document, "accessors")[index.get<std::size_t>()];
    if (a.contains("bufferView")) usage[unsigned_or(a, "bufferView", 0)].insert(kind);
  };
  for (const Json& mesh : elements(document, "meshes")) {
    for (const Json& primitive : mesh["primitives"]) {
      if (primitive.contains("indices")) use(primitive["indices"], "indices");
      for (const auto& [name, index] : primitive["attributes"].items()) use(index, "vertex attributes");
    }
  }
  for (const Json& skin : elements(document, "skins")) {
    if (skin.contains("inverseBindMatrices")) use(skin["inverseBindMatrices"], "inverse bind matrices");
  }
  for (const Json& image : elements(document, "images")) {
    if (image.contains("bufferView")) usage[unsigned_or(image, "bufferView", 0)].insert("an image");
  }
  for (const auto& [view, kinds] : usage) {
    if (kinds.size() > 1)
      report.warn(child("/bufferViews", view),
                  fmt::format("is used for {}; expected one use", fmt::join(kinds, " and ")));
  }
}

}  // namespace

void check_meshes(const Json& document, Report& report) {
  PrimitiveChecker checker(document, report);
  check_usage(document, report);
  const Json& meshes = elements(document, "meshes");
  for (std::size_t m = 0; m < meshes.size() && !report.failed(); ++m) {
    const std::string pointer = child("/meshes", m);
    const Json& primitives = meshes[m]["primitives"];
    std::set<std::size_t> targets;
    for (std::size_t p = 0; p < primitives.size(); ++p) {
      checker.check(primitives[p], fmt::format("{}/primitives/{}", pointer, p));
      targets.insert(primitives[p].contains("targets") ? primitives[p]["targets"].size() : 0);
    }
    if (targets.size() > 1)
      report.error(pointer, "primitives have different numbers of morph targets; expected one number");
    const std::size_t weights = meshes[m].contains("weights") ? meshes[m]["weights"].size() : 0;
    if (weights > 0 && targets.size() == 1 && weights != *targets.begin()) {
      report.error(child(pointer, "weights"),
                   fmt::format("has {} values; the mesh has {} morph targets", weights, *targets.begin()));
    }
  }
}

}  // namespace pf::gltf
