#include "worker/command_line.h"

#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "build_id.h"
#include "common/base/cli_tree.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/spec/job_spec.h"
#include "worker/plan/plan.h"
#include "worker/progress.h"
#include "worker/recompute.h"
#include "worker/render_job.h"
#include "worker/serve.h"

namespace pf {
namespace {

struct Options {
  std::string job;
  std::vector<std::string> overrides;
  int threads = 0;
  std::string out = "out";
  bool resume = false;
  bool json = false;
  SnapshotPlan snapshots;
  bool processor_time = false;
  // unit
  std::string checkpoint;
  std::vector<std::string> units;
  // serve
  std::string engine, credentials, name, cache = "cache";
  std::uint64_t cache_gib = 8;
};

int report_error(const WorkerContext& context, const Error& error) {
  context.err << "photonfarm: " << error.message << '\n';
  return exit_code(error.kind);
}

int render(const WorkerContext& context, const Options& options) {
  auto spec = load_job(options.job, options.overrides);
  if (!spec) return report_error(context, spec.error());
  const SystemClock clock;
  const auto style = context.terminal ? ProgressReporter::Style::kBar : ProgressReporter::Style::kLines;
  ProgressReporter reporter(clock, context.err, style, context.columns);
  Progress last;
  const RenderRequest request{*spec,           options.out,         options.resume,
                              options.threads, context.interrupted, options.snapshots};
  const ProcessorClock processor;
  const Clock& counted = options.processor_time ? static_cast<const Clock&>(processor) : clock;
  auto result = render_job(request, counted, [&](const Progress& progress) { reporter.update(last = progress); });
  reporter.finish(last);
  if (!result) return report_error(context, result.error());
  for (const std::string& warning : result->warnings) context.err << "warning: " << warning << '\n';
  if (options.json) {
    context.out << result_json(spec->job.name, *result);
  } else {
    context.out << fmt::format("{} passes, {} photon paths in {:.1f} s; estimated relative error {:.2g}\n{}\n{}\n{}\n",
                               result->passes, short_number(static_cast<double>(result->photon_paths)),
                               result->render_seconds, result->error, result->exr.string(), result->png.string(),
                               result->json.string());
  }
  return 0;
}

int show_plan(const WorkerContext& context, const Options& options) {
  auto spec = load_job(options.job, options.overrides);
  if (!spec) return report_error(context, spec.error());
  const SystemClock clock;
  const auto job = plan_job(*spec, clock);
  if (!job) return report_error(context, job.error());
  const PilotTiming timing{job->pilot_seconds};
  for (const std::string& warning : job->scene->warnings()) context.err << "warning: " << warning << '\n';
  if (options.json) {
    context.out << plan_json(*spec, job->facts, job->pilot, job->plan, timing).dump(2) << '\n';
  } else {
    context.out << plan_text(*spec, job->facts, job->pilot, job->plan, timing);
  }
  return 0;
}

int recompute(const WorkerContext& context, const Options& options) {
  auto spec = load_job(options.job, options.overrides);
  if (!spec) return report_error(context, spec.error());
  const auto done = recompute_units({*spec, options.checkpoint, options.units, options.threads}, SystemClock());
  if (!done) return report_error(context, done.error());
  context.out << *done << '\n';
  return 0;
}

int serve(const WorkerContext& context, const Options& options) {
  ServeOptions serving;
  if (!options.credentials.empty()) {
    auto credentials = load_credentials(options.credentials);
    if (!credentials) return report_error(context, credentials.error());
    serving.engine = std::move(*credentials);
  }
  if (!options.engine.empty()) serving.engine.url = options.engine;
  if (!options.name.empty()) serving.engine.name = options.name;
  serving.threads = options.threads;
  serving.cache = options.cache;
  serving.cache_bytes = options.cache_gib << 30;
  serving.interrupted = context.interrupted;
  const Log log;
  const auto served = serve_farm(serving, log);
  return served ? 0 : report_error(context, served.error());
}

void add_serve_options(CLI::App& command, Options& options) {
  command.add_option("--engine", options.engine,
                     "NATS server: nats://HOST:PORT or tls://HOST:PORT; by default the credentials' one");
  command.add_option("--credentials", options.credentials, "file that photonfarm farm init made for this worker");
  command.add_option("--name", options.name, "this worker's name, [A-Za-z0-9_-]; by default the credentials' one");
  command.add_option("--threads", options.threads, "number of threads; 0: all")->check(CLI::Range(0, 1024));
  command.add_option("--cache", options.cache, "folder for scenes; may be shared by the workers of a machine")
      ->capture_default_str();
  command.add_option("--cache-gib", options.cache_gib, "bound of that folder")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command.footer(
      "Example:\n  photonfarm-worker serve --credentials worker-1.toml --threads 1 --cache /var/cache/photonfarm");
}

}  // namespace

int run_worker(const WorkerContext& context, const std::vector<std::string>& arguments) {
  Options options;
  // People meet these commands as `photonfarm render` and `photonfarm plan`, which run this program.
  CLI::App app{"The renderer of photonfarm.", "photonfarm"};
  app.set_version_flag("--version", std::string("photonfarm-worker ") + kBuildId);
  app.require_subcommand(1);
  const auto add_common = [&](CLI::App& command) {
    command.add_option("JOB", options.job, "job file (.toml or .json)")->required();
    command.add_option("--set", options.overrides, "change a key of the job: --set stop.passes=64")
        ->take_all()
        ->allow_extra_args(false);
    command.add_flag("--json", options.json, "one JSON document on standard output, and nothing else there");
  };
  CLI::App& render_command = *app.add_subcommand("render", "render a job on this machine");
  add_common(render_command);
  render_command.add_option("--threads", options.threads, "number of threads; 0: all")->check(CLI::Range(0, 1024));
  render_command.add_option("--out", options.out, "folder for <job name>.exr, .png and .json")->capture_default_str();
  render_command.add_flag("--resume", options.resume, "go on from the checkpoint in --out, to the same bits");
  render_command
      .add_option(
          "--snapshot-seconds", options.snapshots.seconds,
          "also write <job name>.snapshot-<n>.exr as stop.seconds of each of these, ascending, would have left it")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  render_command.add_option("--snapshot-passes", options.snapshots.passes, "the same for stop.passes")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  render_command.add_flag("--processor-time", options.processor_time,
                          "count seconds of processor time: for measuring on a machine that does other work");
  render_command.footer(
      "Examples:\n  photonfarm render jobs/glass-caustic.toml --out out\n"
      "  photonfarm render job.toml --set stop.passes=256 --set integrator.type=\\\"path\\\"\n"
      "  photonfarm render job.toml --resume --set stop.passes=512");
  CLI::App& plan_command = *app.add_subcommand("plan", "say what a scene holds and how it would be rendered");
  add_common(plan_command);
  plan_command.footer("Example:\n  photonfarm plan jobs/glass-caustic.toml");

  CLI::App& unit_command =
      *app.add_subcommand("unit", "trace work units of a farm's job again and print the hashes of their sums");
  add_common(unit_command);
  unit_command
      .add_option("--units", options.units, "units that one result brought: FIRST:COUNT,FIRST:COUNT...; may come again")
      ->required()
      ->take_all()
      ->allow_extra_args(false);
  unit_command.add_option("--checkpoint", options.checkpoint,
                          "the farm's checkpoint of the job: holds the radii of the open round");
  unit_command.add_option("--threads", options.threads, "number of threads; 0: all")->check(CLI::Range(0, 1024));
  unit_command.footer("Example:\n  photonfarm-worker unit job.toml --units 0:4,8:2 --json");

  CLI::App& serve_command = *app.add_subcommand("serve", "trace units of a farm's jobs until told to stop");
  add_serve_options(serve_command, options);

  CLI::App& describe_command = *app.add_subcommand("describe-commands", "")->group("");  // for photonfarm completion

  std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());  // what CLI11 wants
  try {
    app.parse(reversed);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error, context.out, context.err);
    return code == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  if (describe_command.parsed()) {
    context.out << cli_tree(app) << '\n';
    return 0;
  }
  if (unit_command.parsed()) return recompute(context, options);
  if (serve_command.parsed()) return serve(context, options);
  return render_command.parsed() ? render(context, options) : show_plan(context, options);
}

}  // namespace pf
