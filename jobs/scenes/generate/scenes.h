#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf::scenes {

/// The bytes of each example scene; what it shows is said in the job file beside it, its numbers in its
/// source file.
[[nodiscard]] std::string make_ball_caustic();
[[nodiscard]] std::string make_cornell_box();
[[nodiscard]] std::string make_glass_caustic();
[[nodiscard]] std::string make_interior();
[[nodiscard]] std::string make_peer_box();
[[nodiscard]] std::string make_pool();
[[nodiscard]] std::string make_ring();
[[nodiscard]] std::string make_white_furnace();

struct Recipe {
  std::string_view name;  ///< file name without ".glb", and name of the job
  std::string (*make)();
};

/// All example scenes, by name.
[[nodiscard]] std::span<const Recipe> recipes();

/// Writes the scenes named in `only` (all when empty) to `folder`, which is made if absent. Same bytes every
/// time. Errors: kUsage for an unknown name, kInternal when a file cannot be written.
[[nodiscard]] Result<void> write_scenes(const std::filesystem::path& folder, const std::vector<std::string>& only = {});

}  // namespace pf::scenes
