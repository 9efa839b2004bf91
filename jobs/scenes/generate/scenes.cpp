#include "jobs/scenes/generate/scenes.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <system_error>

#include <fmt/format.h>

namespace pf::scenes {
namespace {

constexpr std::array<Recipe, 8> kRecipes{{{"ball-caustic", make_ball_caustic},
                                          {"cornell-box", make_cornell_box},
                                          {"glass-caustic", make_glass_caustic},
                                          {"interior", make_interior},
                                          {"peer-box", make_peer_box},
                                          {"pool", make_pool},
                                          {"ring", make_ring},
                                          {"white-furnace", make_white_furnace}}};

std::string known_names() {
  std::string names;
  for (const Recipe& recipe : kRecipes) names += fmt::format("{}{}", names.empty() ? "" : ", ", recipe.name);
  return names;
}

}  // namespace

std::span<const Recipe> recipes() { return kRecipes; }

Result<void> write_scenes(const std::filesystem::path& folder, const std::vector<std::string>& only) {
  for (const std::string& name : only) {
    if (std::ranges::none_of(kRecipes, [&](const Recipe& recipe) { return recipe.name == name; })) {
      return fail(ErrorKind::kUsage,
                  fmt::format("--only: no scene is named '{}'; expected one of {}", name, known_names()));
    }
  }
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
    return fail(ErrorKind::kInternal, fmt::format("{}: cannot make the folder: {}", folder.string(), error.message()));
  for (const Recipe& recipe : kRecipes) {
    if (!only.empty() && std::ranges::find(only, recipe.name) == only.end()) continue;
    const std::filesystem::path file = folder / fmt::format("{}.glb", recipe.name);
    const std::string bytes = recipe.make();
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.close();
    if (!out)
      return fail(ErrorKind::kInternal, fmt::format("{}: cannot write the scene; is the disk full?", file.string()));
  }
  return {};
}

}  // namespace pf::scenes
