// photonfarm verify: is this image what its own metadata says? Renders it again here and compares every
// float.

#include <cstring>
#include <ostream>

#include <fmt/format.h>

#include "build_id.h"
#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/process.h"
#include "jobs/provenance.h"
#include "jobs/remote_jobs.h"
#include "jobs/scratch_folder.h"
#include "jobs/verify_units.h"

namespace pf {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// What differs between two images, a line each; empty: nothing.
std::vector<std::string> differences(const ImageOrigin& given, const ImageOrigin& again) {
  std::vector<std::string> lines;
  if (given.image_hash != again.image_hash)
    lines.push_back(fmt::format("the beauty's SHA-256 is {}; rendered again {}", given.image_hash, again.image_hash));
  if (given.state_chain != again.state_chain)
    lines.push_back(fmt::format("the chain of states is {}; rendered again {}", given.state_chain, again.state_chain));
  if (given.scene_hash != again.scene_hash)
    lines.push_back(fmt::format("the scene's hash is {}; rendered again {}", given.scene_hash, again.scene_hash));
  for (const Layer& layer : given.image.layers) {
    const Layer* other = again.image.find(layer.name);
    if (other == nullptr || other->data.size() != layer.data.size() ||
        std::memcmp(other->data.data(), layer.data.data(), layer.data.size() * sizeof(float)) != 0)
      lines.push_back(fmt::format("layer {} differs", layer.name.empty() ? "beauty" : layer.name));
  }
  return lines;
}

Result<ImageOrigin> render_again(ClientCommand& command, const ImageOrigin& given, const fs::path& folder) {
  const auto job = lay_out_job(given, folder / "scene");
  if (!job) return tl::unexpected(job.error());
  const fs::path worker = command.context().folder / "photonfarm-worker";
  command.note(fmt::format("renders {} again: {} passes", given.spec.job.name, given.spec.stop.passes));
  const auto run =
      run_and_capture(worker, {"render", job->string(), "--out", (folder / "out").string(), "--json"}, kRenderSeconds);
  if (!run) return tl::unexpected(run.error());
  if (run->end.exit_code != 0 || run->end.signal != 0) {
    return fail(
        ErrorKind::kInternal,
        fmt::format("rendering again failed with exit code {}; 'photonfarm render' says why", run->end.exit_code));
  }
  return read_origin(folder / "out" / (given.spec.job.name + ".exr"));
}

int verify_image(ClientCommand& command, const fs::path& file, const std::string& scene, const fs::path& scratch) {
  auto given = read_origin(file);
  if (!given) return command.report(given.error());
  if (given->build_id != kBuildId) {
    return command.report(
        {ErrorKind::kUsage, fmt::format("{}: is of build {}, this is {}; only the same build gives the same bits",
                                        file.string(), given->build_id, kBuildId)});
  }
  const auto scene_found =
      scene.empty() ? fetch_scene(command.client(), *given, scratch / "fetched") : use_scene_folder(*given, scene);
  if (!scene_found) return command.report(scene_found.error());
  const auto again = render_again(command, *given, scratch);
  if (!again) return command.report(again.error());
  const std::vector<std::string> lines = differences(*given, *again);
  if (command.json()) {
    command.print({{"image", file.string()},
                   {"same", lines.empty()},
                   {"differences", lines},
                   {"image_hash", given->image_hash},
                   {"state_chain", given->state_chain},
                   {"passes", given->spec.stop.passes},
                   {"build_id", kBuildId}});
  } else if (lines.empty()) {
    command.context().out << fmt::format(
        "{}: the same. Rendered again from its own spec and scene by the same build, {} passes: every float "
        "of its {} layers\n"
        "and the chain of states at each barrier are equal (image {}).\n",
        file.string(), given->spec.stop.passes, given->image.layers.size(), given->image_hash);
  } else {
    command.context().out << fmt::format("{}: NOT the same\n", file.string());
    for (const std::string& line : lines) command.context().out << "  " << line << '\n';
  }
  return lines.empty() ? 0 : exit_code(ErrorKind::kInternal);
}

}  // namespace

int run_verify_command(const Context& context, const Arguments& arguments) {
  std::string what, scene;
  VerifyUnitsOptions units;
  ClientCommand command(context, "verify",
                        "Checks a result by computing it again on this machine. An image (EXR): renders it "
                        "whole and compares every\n"
                        "float. A job: recomputes randomly chosen work units and compares the hashes of "
                        "their exact sums with those\n"
                        "that the coordinator kept.");
  command.app().add_option("WHAT", what, "an EXR that photonfarm wrote, or a job of the service")->required();
  command.app()
      .add_option("--scene", scene, "folder with the scene's files; default: fetch them from the service")
      ->check(CLI::ExistingDirectory);
  command.app()
      .add_option("--units", units.count, "of a job: how many units to recompute")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command.app().add_option("--seed", units.seed, "of the choice of units; default: another one each time");
  command.examples(
      "  photonfarm verify out/glass-caustic.exr --scene jobs\n  photonfarm verify glass-caustic --units "
      "10\n\n"
      "Exit codes: 0 the same; 5 not the same; 2 of another build.");
  if (const auto code = command.parse(arguments)) return *code;
  const ScratchFolder scratch(context.temporary);
  if (scratch.path().empty())
    return command.report({ErrorKind::kInternal, context.temporary.string() + ": no folder can be made there"});
  std::error_code ignored;
  if (what.ends_with(".exr") || fs::is_regular_file(what, ignored))
    return verify_image(command, what, scene, scratch.path());
  return verify_units(command, what, scene, units, scratch.path());
}

}  // namespace pf
