// photonfarm estimate: a few sub-passes of the job, here or on a farm, and what they say about all of it.

#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/status_line.h"
#include "common/film/prediction.h"
#include "common/wire/bundle.h"
#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/process.h"
#include "jobs/scratch_folder.h"
#include "jobs/submission.h"

namespace pf {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

struct EstimateOptions {
  std::string job;
  std::vector<std::string> overrides;
  double error = 0, passes = 0, seconds = 10;
  int workers = 1, threads = 0;
};

/// Runs the renderer and reads the JSON that it prints.
Result<json> ask_renderer(const Context& context, const Arguments& arguments) {
  constexpr double kPatience = 86400;
  const auto run = run_and_capture(context.folder / "photonfarm-worker", arguments, kPatience);
  if (!run) return tl::unexpected(run.error());
  json document = json::parse(run->output, nullptr, false);
  if (run->end.exit_code == 0 && document.is_object()) return document;
  return fail(run->end.exit_code == 3 ? ErrorKind::kInvalidInput : ErrorKind::kInternal,
              fmt::format("the renderer ended with exit code {}; 'photonfarm render {}' says why", run->end.exit_code,
                          arguments[1]));
}

/// Renders 1, 2, 4 ... passes, each going on from the one before, until the time is used up.
Result<PilotRender> run_pilot(const Context& context, const EstimateOptions& options, const JobSpec& spec,
                              const fs::path& scratch) {
  PilotRender pilot;
  const SystemClock clock;
  const double end = clock.now() + options.seconds;
  const std::string threads = std::to_string(options.threads);
  double used = 0;
  for (std::int64_t passes = 2; pilot.points.size() < 16; passes *= 2) {
    Arguments arguments = {"render", options.job, "--out", scratch.string(), "--threads", threads, "--json"};
    for (const std::string& override : options.overrides) arguments.insert(arguments.end(), {"--set", override});
    // Time and error must not end the pilot. Its error is noise alone: what is known of the bias after a few
    // passes is less than its own noise.
    arguments.insert(arguments.end(), {"--set", fmt::format("stop.passes={}", passes), "--set", "stop.seconds=0",
                                       "--set", "stop.error=0"});
    arguments.insert(arguments.end(), {"--set", "integrator.error_estimate=false"});
    if (!pilot.points.empty()) arguments.emplace_back("--resume");
    const auto figures = ask_renderer(context, arguments);
    if (!figures) return tl::unexpected(figures.error());
    const json& seconds = figures->at("seconds");
    pilot.points.push_back(
        {job_number(*figures, "passes"), job_number(seconds, "render"), job_number(*figures, "estimated_error")});
    if (pilot.points.size() == 1)
      pilot.setup_seconds = job_number(seconds, "load") + job_number(seconds, "prepare") + job_number(seconds, "write");
    pilot.peak_bytes = std::max(pilot.peak_bytes, static_cast<std::uint64_t>(job_number(*figures, "peak_bytes")));
    used = job_number(seconds, "render") + pilot.setup_seconds;
    // The next part costs about twice as much as this one.
    const bool enough = pilot.points.size() >= 3 && clock.now() + 2 * used > end;
    if (enough || (spec.stop.passes > 0 && passes * 2 > std::max<std::int64_t>(spec.stop.passes, 8))) break;
  }
  Arguments unit = {"unit", options.job, "--threads", threads, "--units", "0:1"};
  for (const std::string& override : options.overrides) unit.insert(unit.end(), {"--set", override});
  const auto packed = ask_renderer(context, unit);
  if (!packed) return tl::unexpected(packed.error());
  pilot.state_bytes = static_cast<std::uint64_t>(job_number(*packed, "state_bytes"));
  pilot.result_bytes = static_cast<std::uint64_t>(job_number(packed->at("results").at(0), "bytes"));
  const auto files = hashed_files_of_job(spec);
  if (!files) return tl::unexpected(files.error());
  for (const auto& [path, id] : *files) pilot.scene_bytes += id.bytes;
  return pilot;
}

/// A line for each figure of a prediction_json that is known.
std::string text_of(const json& prediction, std::string_view where, double error) {
  const auto bytes = [](double value) { return short_number(value) + "B"; };
  const auto row = [&](std::string_view name, const char* key, const auto& form) {
    const json range = prediction.value(key, json());
    if (!range.is_object()) return std::string();
    return fmt::format("  {:<22}{:>12}   ({} to {})\n", name, form(job_number(range, "likely")),
                       form(job_number(range, "low")), form(job_number(range, "high")));
  };
  const double workers = job_number(prediction, "workers");
  std::string text = fmt::format("{:.0f} passes:\n", job_number(prediction, "passes"));
  text += row(fmt::format("time {}", where), "seconds", [](double s) { return clock_time(s); });
  text += row("memory of a renderer", "memory_bytes", bytes);
  text += row(fmt::format("network, {:.0f} worker{}", workers, workers == 1 ? "" : "s"), "network_bytes", bytes);
  text += row("estimated error", "estimated_error", [](double value) { return fmt::format("{:.3g}", value); });
  text += row(fmt::format("passes to error {:.3g}", error), "passes_to_error",
              [](double value) { return fmt::format("{:.0f}", value); });
  return text;
}

/// The job itself is the pilot: it runs on the farm until the pilot's time is over.
int estimate_on_farm(ClientCommand& command, const EstimateOptions& options, const JobSpec& spec) {
  const auto files = hash_files(spec);
  if (!files) return command.report(files.error());
  auto job = submit_job(command.client(), spec, *files, fmt::format("/v1/estimates?seconds={}", options.seconds));
  if (!job) return command.report(job.error());
  const std::string id = job_text(*job, "id");
  if (const int code = command.watch(*job); code != 0) return code;
  std::string path = fmt::format("/v1/jobs/{}/estimate?", id);
  if (options.passes > 0) path += fmt::format("passes={}&", options.passes);
  if (options.error > 0) path += fmt::format("error={}&", options.error);
  path.pop_back();
  const auto estimate = command.client().ask({.path = path}, true);
  if (!estimate) return command.report(estimate.error());
  command.note(fmt::format("the pilot is the job, stopped early; 'photonfarm extend {} --seconds {}' has it go on", id,
                           spec.stop.seconds));
  if (command.json()) return command.print(*estimate);
  const double workers = job_number(*estimate, "workers");
  command.context().out << text_of(*estimate, fmt::format("on {:.0f} worker{}", workers, workers == 1 ? "" : "s"),
                                   options.error > 0 ? options.error : spec.stop.error);
  return 0;
}

int estimate_here(ClientCommand& command, const EstimateOptions& options, const JobSpec& spec) {
  const ScratchFolder scratch(command.context().temporary);
  if (scratch.path().empty())
    return command.report(
        {ErrorKind::kInternal, command.context().temporary.string() + ": no folder can be made there"});
  const auto pilot = run_pilot(command.context(), options, spec, scratch.path());
  if (!pilot) return command.report(pilot.error());
  const double error = options.error > 0 ? options.error : spec.stop.error;
  PredictionRequest request{.passes = options.passes,
                            .error = error,
                            .workers = options.workers,
                            .round_growth = spec.integrator.round_growth,
                            .barrier = spec.integrator.mode == ProgressiveMode::kShared};
  const bool error_known = std::ranges::any_of(pilot->points, [](const PilotPoint& point) { return point.error > 0; });
  if (request.passes <= 0 && !(error > 0 && error_known)) request.passes = static_cast<double>(spec.stop.passes);
  if (request.passes <= 0 && !(error > 0 && error_known))
    return command.report(
        {ErrorKind::kUsage, "neither passes nor a known error bound this job; expected --passes or --error"});
  const json prediction = prediction_json(*pilot, predict(*pilot, request), options.workers);
  if (command.json()) return command.print(prediction);
  command.context().out << text_of(prediction, "on this machine", error);
  return 0;
}

}  // namespace

int run_estimate_command(const Context& context, const Arguments& arguments) {
  EstimateOptions options;
  bool on_farm = false;
  ClientCommand command(
      context, "estimate",
      "Renders a few sub-passes of a job, on this machine or on a farm, and predicts, each with a range, "
      "what all of it "
      "costs:\n"
      "time, memory, bytes on a farm's network, and the passes to an error (noise alone: bias shows too late "
      "for a pilot).");
  CLI::App& app = command.app();
  app.add_option("JOB", options.job, "job file (.toml or .json)")->required();
  app.add_option("--set", options.overrides, "change a key of the job: --set stop.passes=64")
      ->take_all()
      ->allow_extra_args(false);
  app.add_option("--error", options.error, "the estimated relative error to aim at; default: stop.error")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--passes", options.passes,
                 "predict for so many passes; default: what the error needs, else stop.passes")
      ->check(CLI::Range(0.0, 1e12));
  CLI::Option* workers =
      app.add_option("--workers", options.workers, "workers of the farm whose network is asked about")
          ->capture_default_str()
          ->check(CLI::Range(1, 100000));
  CLI::Option* threads =
      app.add_option("--threads", options.threads, "number of threads; 0: all")->check(CLI::Range(0, 1024));
  app.add_option("--seconds", options.seconds, "for the pilot, about")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 86400.0));
  app.add_flag("--farm", on_farm,
               "the pilot runs on the farm, with its workers: the job is submitted and stops after --seconds")
      ->excludes(workers)
      ->excludes(threads);
  command.examples(
      "  photonfarm estimate jobs/glass-caustic.toml --error 0.02\n"
      "  photonfarm estimate job.toml --passes 4096 --workers 16 --json\n"
      "  photonfarm estimate job.toml --farm --seconds 30");
  if (const std::optional<int> code = command.parse(arguments)) return *code;
  const auto spec = load_job(options.job, options.overrides);
  if (!spec) return command.report(spec.error());
  return on_farm ? estimate_on_farm(command, options, *spec) : estimate_here(command, options, *spec);
}

}  // namespace pf
