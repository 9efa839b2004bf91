#include "worker/scene/gltf_validation.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <vector>

#include <fmt/format.h>

namespace pf::gltf {
namespace {

struct Version {
  int major = 0, minor = 0;
  bool valid = false;
};

Version parse_version(std::string_view text) {
  Version v;
  const std::size_t dot = text.find('.');
  const auto digits = [](std::string_view s) {
    return !s.empty() && s.size() < 6 &&
           std::all_of(s.begin(), s.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
  };
  if (dot == std::string_view::npos || !digits(text.substr(0, dot)) || !digits(text.substr(dot + 1))) return v;
  v.major = std::stoi(std::string(text.substr(0, dot)));
  v.minor = std::stoi(std::string(text.substr(dot + 1)));
  v.valid = true;
  return v;
}

/// Does [offset, offset + bytes) lie in the view? The error names what does not fit.
void check_fits(const Json& document, std::uint64_t view, std::uint64_t offset, std::uint64_t bytes,
                const std::string& pointer, Report& report) {
  const std::uint64_t length = unsigned_or(elements(document, "bufferViews")[view], "byteLength", 0);
  if (offset + bytes > length) {
    report.error(pointer,
                 fmt::format("needs {} bytes at offset {}; buffer view {} has {}", bytes, offset, view, length));
  }
}

void check_sparse(const Json& document, const Json& accessor, const std::string& pointer, Report& report) {
  const Json& sparse = accessor["sparse"];
  const std::uint64_t count = unsigned_or(sparse, "count", 0);
  if (count > unsigned_or(accessor, "count", 0)) {
    report.error(child(pointer, "sparse/count"), fmt::format("is {}; expected at most the accessor's count", count));
    return;
  }
  const std::uint64_t component_type = unsigned_or(accessor, "componentType", 0);
  const std::string type = text_or(accessor, "type", "");
  const Json& indices = sparse["indices"];
  const Json& values = sparse["values"];
  check_fits(document, unsigned_or(indices, "bufferView", 0), unsigned_or(indices, "byteOffset", 0),
             count * component_bytes(unsigned_or(indices, "componentType", 0)), pointer + "/sparse/indices", report);
  check_fits(document, unsigned_or(values, "bufferView", 0), unsigned_or(values, "byteOffset", 0),
             (count - 1) * element_bytes(component_type, type) + last_element_bytes(component_type, type),
             pointer + "/sparse/values", report);
  for (const Json* part : {&indices, &values}) {
    const Json& view = elements(document, "bufferViews")[unsigned_or(*part, "bufferView", 0)];
    if (view.contains("byteStride"))
      report.warn(pointer + "/sparse", "its buffer view has a byteStride, which is ignored");
  }
}

void check_accessor(const Json& document, const Json& accessor, const std::string& pointer, Report& report) {
  const std::uint64_t component_type = unsigned_or(accessor, "componentType", 0);
  const std::string type = text_or(accessor, "type", "");
  const std::uint64_t element = element_bytes(component_type, type);
  const std::uint64_t offset = unsigned_or(accessor, "byteOffset", 0);
  const bool integer = component_type != 5126 && component_type != 5125;
  if (accessor.value("normalized", false) && !integer) {
    report.warn(pointer, "is normalized though its components are not 8-bit or 16-bit integers");
  }
  for (const char* bound : {"min", "max"}) {
    if (accessor.contains(bound) && accessor[bound].size() != component_count(type)) {
      report.warn(child(pointer, bound),
                  fmt::format("has {} values; expected {}", accessor[bound].size(), component_count(type)));
    }
  }
  if (accessor.contains("sparse")) check_sparse(document, accessor, pointer, report);
  if (!accessor.contains("bufferView")) {
    if (accessor.contains("byteOffset"))
      report.warn(child(pointer, "byteOffset"), "has no meaning without a bufferView");
    return;
  }
  const std::uint64_t view_index = unsigned_or(accessor, "bufferView", 0);
  const Json& view = elements(document, "bufferViews")[view_index];
  const std::uint64_t stride = unsigned_or(view, "byteStride", element);
  if (stride < element) {
    report.error(pointer,
                 fmt::format("byteStride {} of its buffer view is less than an element's {} bytes", stride, element));
    return;
  }
  check_fits(document, view_index, offset,
             stride * (unsigned_or(accessor, "count", 1) - 1) + last_element_bytes(component_type, type), pointer,
             report);
  // Data are read byte by byte, so that this cannot touch the image.
  const std::size_t component = component_bytes(component_type);
  if (offset % component != 0 || (offset + unsigned_or(view, "byteOffset", 0)) % component != 0 ||
      stride % component != 0) {
    report.warn(pointer, fmt::format("is not aligned to its components of {} bytes", component));
  }
}

void check_buffer_view(const Json& document, const Json& view, const std::string& pointer, Report& report) {
  const std::uint64_t offset = unsigned_or(view, "byteOffset", 0);
  const std::uint64_t length = unsigned_or(view, "byteLength", 0);
  const std::uint64_t buffer = unsigned_or(view, "buffer", 0);
  const std::uint64_t available = unsigned_or(elements(document, "buffers")[buffer], "byteLength", 0);
  if (offset + length > available) {
    report.error(pointer,
                 fmt::format("needs {} bytes at offset {}; buffer {} has {}", length, offset, buffer, available));
  }
  if (!view.contains("byteStride")) return;
  const std::uint64_t stride = unsigned_or(view, "byteStride", 0);
  if (stride % 4 != 0)
    report.error(child(pointer, "byteStride"), fmt::format("is {}; expected a multiple of 4", stride));
  if (stride > length) report.warn(child(pointer, "byteStride"), "is larger than the buffer view");
  if (unsigned_or(view, "target", 34962) != 34962) {
    report.warn(child(pointer, "byteStride"), "belongs only to vertex attributes; target says that these are indices");
  }
}

}  // namespace

const Json& elements(const Json& document, const char* list) {
  static const Json kNone = Json::array();
  const auto it = document.find(list);
  return it == document.end() ? kNone : *it;
}

std::uint64_t unsigned_or(const Json& object, const char* key, std::uint64_t absent) {
  const auto it = object.find(key);
  return it == object.end() || !it->is_number() ? absent : it->get<std::uint64_t>();
}

std::string text_or(const Json& object, const char* key, const char* absent) {
  const auto it = object.find(key);
  return it == object.end() || !it->is_string() ? absent : it->get<std::string>();
}

std::size_t component_bytes(std::uint64_t component_type) {
  switch (component_type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

std::size_t component_count(std::string_view type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "VEC4" || type == "MAT2") return 4;
  if (type == "MAT3") return 9;
  if (type == "MAT4") return 16;
  return 0;
}

std::size_t element_bytes(std::uint64_t component_type, std::string_view type) {
  const std::size_t component = component_bytes(component_type);
  if (!type.starts_with("MAT")) return component * component_count(type);
  const std::size_t columns = type == "MAT2" ? 2 : type == "MAT3" ? 3 : 4;
  return columns * ((columns * component + 3) / 4 * 4);
}

std::size_t last_element_bytes(std::uint64_t component_type, std::string_view type) {
  if (!type.starts_with("MAT")) return element_bytes(component_type, type);
  const std::size_t column = component_bytes(component_type) * (type == "MAT2" ? 2 : type == "MAT3" ? 3 : 4);
  return element_bytes(component_type, type) - ((column + 3) / 4 * 4 - column);
}

void check_asset(const Json& document, Report& report) {
  const Json& asset = document["asset"];
  const std::string text = text_or(asset, "version", "");
  const Version version = parse_version(text);
  if (!version.valid) {
    report.error("/asset/version", fmt::format("is {}; expected \"2.0\"", in_quotes(text)));
  } else if (version.major != 2) {
    report.error("/asset/version", fmt::format("is {}; only glTF 2.0 can be read", in_quotes(text)));
  } else if (version.minor != 0) {
    report.warn("/asset/version", fmt::format("is {}; the file is read as glTF 2.0", in_quotes(text)));
  }
  if (!asset.contains("minVersion")) return;
  const std::string least = text_or(asset, "minVersion", "");
  const Version needed = parse_version(least);
  if (!needed.valid) {
    report.error("/asset/minVersion", fmt::format("is {}; expected \"2.0\"", in_quotes(least)));
  } else if (needed.major != 2 || needed.minor > 0) {
    report.error("/asset/minVersion", fmt::format("is {}; only glTF 2.0 can be read", in_quotes(least)));
  }
}

void check_buffers(const Json& document, Report& report) {
  const Json& views = elements(document, "bufferViews");
  for (std::size_t i = 0; i < views.size(); ++i)
    check_buffer_view(document, views[i], child("/bufferViews", i), report);
  const Json& accessors = elements(document, "accessors");
  for (std::size_t i = 0; i < accessors.size(); ++i) {
    check_accessor(document, accessors[i], child("/accessors", i), report);
  }
}

void check_cameras_and_lights(const Json& document, Report& report) {
  const Json& cameras = elements(document, "cameras");
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const std::string pointer = child("/cameras", i);
    const std::string type = text_or(cameras[i], "type", "");
    if (!cameras[i].contains(type)) {
      report.error(pointer, fmt::format("camera of type {} has no property {}", in_quotes(type), in_quotes(type)));
      continue;
    }
    if (cameras[i].contains("perspective") && cameras[i].contains("orthographic")) {
      report.warn(pointer, fmt::format("has two projections; {} counts", type));
    }
    const Json& view = cameras[i][type];
    const std::string at = child(pointer, type);
    if (view.contains("zfar") && view.contains("znear") && view["zfar"].get<double>() <= view["znear"].get<double>()) {
      report.warn(child(at, "zfar"), "is not larger than znear");
    }
    if (type == "perspective") {
      if (view["yfov"].get<double>() >= 3.14159265)
        report.error(child(at, "yfov"), "is not smaller than pi; expected radians");
      continue;
    }
    for (const char* mag : {"xmag", "ymag"}) {
      const double extent = view[mag].get<double>();
      if (extent == 0) report.error(child(at, mag), "is 0; expected a length");
      if (extent < 0) report.warn(child(at, mag), "is negative; its magnitude is taken");
    }
  }
  const auto extensions = document.find("extensions");
  if (extensions == document.end() || !extensions->contains("KHR_lights_punctual")) return;
  const Json& lights = (*extensions)["KHR_lights_punctual"]["lights"];
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const std::string pointer = child("/extensions/KHR_lights_punctual/lights", i);
    if (text_or(lights[i], "type", "") != "spot") continue;
    if (!lights[i].contains("spot")) {
      report.error(pointer, "light of type spot has no property \"spot\"");
      continue;
    }
    const double inner = lights[i]["spot"].value("innerConeAngle", 0.0);
    const double outer = lights[i]["spot"].value("outerConeAngle", 0.7853981633974483);
    if (inner >= outer || outer > 1.5707964) {
      report.error(child(pointer, "spot"),
                   fmt::format("cone angles are {} and {}; expected 0 <= inner < outer <= pi/2", inner, outer));
    }
  }
}

void check_images(const Json& document, Report& report) {
  const Json& images = elements(document, "images");
  const Json& textures = elements(document, "textures");
  for (std::size_t i = 0; i < textures.size(); ++i) {
    const std::uint64_t source = unsigned_or(textures[i], "source", 0);
    if (textures[i].contains("source") && source >= images.size()) {
      report.warn(child("/textures", i) + "/source",
                  fmt::format("is {}; expected an index into images, which has {} elements", source, images.size()));
    }
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::string pointer = child("/images", i);
    const bool uri = images[i].contains("uri");
    const bool view = images[i].contains("bufferView");
    if (uri == view) {
      report.warn(pointer, uri ? "has both uri and bufferView; uri counts" : "has neither uri nor bufferView");
    }
    if (view && !images[i].contains("mimeType")) report.warn(pointer, "has a bufferView and no mimeType");
    if (view && elements(document, "bufferViews")[unsigned_or(images[i], "bufferView", 0)].contains("byteStride")) {
      report.warn(pointer, "its buffer view has a byteStride, which is ignored");
    }
  }
}

void check_materials(const Json& document, Report& report) {
  const Json& materials = elements(document, "materials");
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const std::string pointer = child("/materials", i);
    const Json& material = materials[i];
    if (material.contains("emissiveFactor")) {
      for (const Json& x : material["emissiveFactor"]) {
        if (x.get<double>() <= 1) continue;
        report.warn(child(pointer, "emissiveFactor"),
                    "is above 1 and taken as it is; KHR_materials_emissive_strength is for that");
        break;
      }
    }
    if (!material.contains("extensions") || !material["extensions"].contains("KHR_materials_ior")) continue;
    const double ior = material["extensions"]["KHR_materials_ior"].value("ior", 1.5);
    if (ior > 0 && ior < 1) {
      report.error(pointer + "/extensions/KHR_materials_ior/ior", fmt::format("is {}; expected 0, or 1 or more", ior));
    }
  }
}

void check_document(const Json& document, Report& report) {
  check_asset(document, report);
  check_buffers(document, report);
  if (report.failed()) return;
  check_nodes(document, report);
  check_skins(document, report);
  check_cameras_and_lights(document, report);
  check_images(document, report);
  check_materials(document, report);
  check_meshes(document, report);
}

}  // namespace pf::gltf
