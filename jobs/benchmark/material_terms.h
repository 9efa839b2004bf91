#pragma once

#include <filesystem>
#include <string_view>

#include "common/base/result.h"

namespace pf::bench {

/// Whether a term of a plan is one of materials alone, so that no key of a job turns it: "textures", "normal maps",
/// "alpha", "rough lobes", "absorption".
[[nodiscard]] bool is_material_term(std::string_view term);

/// Rewrites the materials of a .gltf or .glb file so that a term of theirs has nothing left to do: textures go but for
/// normal maps, cut-outs become solid, rough lobes mirrors (Lambert stays), media clear. Errors: kInvalidInput when the
/// file is neither kind, kInternal when it cannot be written.
[[nodiscard]] Result<void> leave_out_of_materials(std::string_view term, const std::filesystem::path& gltf);

}  // namespace pf::bench
