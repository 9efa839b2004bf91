#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <tiny_gltf.h>

#include "common/base/result.h"
#include "worker/scene/gltf_report.h"
#include "worker/scene/gltf_source.h"

namespace pf::gltf {

/// A checked document in tinygltf's structs, with its buffers in memory.
struct Model {
  tinygltf::Model gltf;     ///< without images, which stay encoded (see `images`), and without animations
  Json images;              ///< the array as it stands in the document
  Json animations;          ///< same; only checked, never played
  std::uint64_t bytes = 0;  ///< of the document and all buffers: what bounds how much may be made of it
};

/// Loads buffers (external files through `folder`, data: URIs, the GLB's BIN chunk) and lets tinygltf read
/// the rest. tinygltf itself opens no file. `container.document` must have passed check_document and is
/// consumed.
[[nodiscard]] Result<Model> make_model(Container container, std::uint64_t document_bytes, const Folder& folder,
                                       Report& report);

// tinygltf::Value is awkward about absent members; these are not.

/// Member of an extension object, or null.
[[nodiscard]] const tinygltf::Value* find(const tinygltf::ExtensionMap& extensions, const std::string& name);
[[nodiscard]] const tinygltf::Value* find(const tinygltf::Value& object, const std::string& name);
[[nodiscard]] int int_or(const tinygltf::Value& object, const std::string& name, int absent);
[[nodiscard]] float number_or(const tinygltf::Value& object, const std::string& name, float absent);

}  // namespace pf::gltf
