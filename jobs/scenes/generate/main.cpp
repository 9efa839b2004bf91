// photonfarm-make-scenes: writes the example scenes in jobs/scenes, which are generated and free of anyone's
// licence.

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "jobs/scenes/generate/scenes.h"

int main(int argc, char** argv) {
  std::string folder;
  std::vector<std::string> only;
  CLI::App app("Writes photonfarm's example scenes as .glb files; the same bytes on every run.",
               "photonfarm-make-scenes");
  app.add_option("OUT_DIR", folder, "folder to write to; made if absent")->required();
  app.add_option("--only", only, "name of a scene to write; may be repeated; default: all")->allow_extra_args(false);
  try {
    app.parse(argc, argv);
    if (const auto done = pf::scenes::write_scenes(folder, only); !done) {
      fmt::print(stderr, "photonfarm-make-scenes: {}\n", done.error().message);
      return pf::exit_code(done.error().kind);
    }
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    fmt::print(stderr, "photonfarm-make-scenes: {}\n", error.what());
    return pf::exit_code(pf::ErrorKind::kInternal);
  }
  return 0;
}
