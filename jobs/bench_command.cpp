#include <algorithm>
#include <ostream>
#include <system_error>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/hash.h"
#include "common/base/status_line.h"
#include "jobs/benchmark/bench.h"
#include "jobs/benchmark/charts.h"
#include "jobs/benchmark/pictures.h"
#include "jobs/benchmark/report.h"
#include "jobs/benchmark/results.h"
#include "jobs/benchmark/worker_runner.h"
#include "jobs/command.h"
#include "jobs/interrupt.h"
#include "jobs/process.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

struct Options {
  bench::BenchRequest request;
  bool json = false, no_charts = false;
};

/// Everything that a reader looks at, from what was measured.
Result<void> write_outputs(const bench::BenchResult& result, const fs::path& out, const fs::path& gnuplot,
                           const std::vector<std::string>& notes) {
  if (auto done = write_file_atomically(out / "results.json", bench::results_json(result).dump(1) + "\n"); !done)
    return done;
  if (auto done = write_file_atomically(out / "results.csv", bench::results_csv(result)); !done) return done;
  if (auto done = write_file_atomically(out / "table.md", bench::results_table(result)); !done) return done;
  if (auto done = bench::write_pictures(result, out / "images"); !done) return done;
  if (!gnuplot.empty()) {
    std::vector<bench::Chart> all, overview;
    for (const bench::SceneResult& scene : result.scenes) {
      const std::vector<bench::Chart> charts = bench::charts_of(result, scene);
      if (!charts.empty()) overview.push_back(charts.front());
      all.insert(all.end(), charts.begin(), charts.end());
    }
    std::error_code code;
    fs::create_directories(out / "charts", code);
    if (auto drawn = bench::draw_charts(gnuplot, all, overview, out / "charts"); !drawn) return drawn;
  }
  return write_file_atomically(out / "report.html", bench::report_html(result, out, notes));
}

Result<bench::BenchResult> run(const Context& context, const Options& options, const fs::path& gnuplot) {
  bench::BenchRequest request = options.request;
  const fs::path worker = context.folder / "photonfarm-worker";
  auto hash = sha256_hex_of_file(worker);
  if (!hash) return fail(ErrorKind::kUnavailable, hash.error().message + "; run photonfarm doctor");
  request.worker = std::move(*hash);
  const SystemClock clock;
  StatusLine line(clock, context.err, context.terminal ? StatusLine::Style::kBar : StatusLine::Style::kLines,
                  context.columns);
  const InterruptGuard interrupt;
  bench::WorkerRunner runner(worker, interrupt.flag());
  const auto show = [&](const bench::BenchProgress& p) {
    if (!line.due()) return;
    const double fraction = static_cast<double>(p.done) / static_cast<double>(std::max<std::size_t>(1, p.total));
    std::string text = line.style() == StatusLine::Style::kBar ? progress_bar(fraction) : std::string();
    text += fmt::format("{}/{} runs  ", p.done, p.total);
    if (p.left >= 0) text += fmt::format("{} left  ", clock_time(p.left));
    line.show(text + p.doing);
  };
  std::vector<std::string> notes;
  auto result = bench::run_bench(request, runner, show, notes);
  if (!result) {
    if (result.error().kind == ErrorKind::kInterrupted) {
      return fail(ErrorKind::kInterrupted,
                  "interrupted; the same command goes on, and --report-only reports what is there");
    }
    return result;
  }
  std::size_t failed = 0;
  for (const bench::SceneResult& scene : result->scenes) {
    for (const bench::MethodResult& method : scene.methods) {
      failed +=
          static_cast<std::size_t>(std::ranges::count_if(method.runs, [](const auto& r) { return !r.error.empty(); }));
    }
  }
  line.finish(fmt::format("{} runs done, {} of them failed; drawing", result->schedule.size(), failed));
  for (const std::string& note : notes) context.err << "note: " << note << '\n';
  if (auto written = write_outputs(*result, request.out, gnuplot, notes); !written)
    return tl::unexpected(written.error());
  return result;
}

}  // namespace

int run_bench_command(const Context& context, const Arguments& arguments) {
  Options options;
  CLI::App app("Runs methods on scenes at growing budgets and charts error against time.", "photonfarm bench");
  app.add_option("SUITE", options.request.suite, "suite file (.toml)")->required();
  app.add_option("--out", options.request.out, "folder of results and report; what it holds is not made again")
      ->required();
  app.add_option("--cache", options.request.cache,
                 "folder of reference images, for several benches; default: in --out");
  app.add_flag("--json", options.json, "print results.json on standard output, and nothing else there");
  app.add_flag("--retry-failed", options.request.retry_failed, "make runs again that failed before");
  app.add_flag("--report-only", options.request.report_only,
               "report what is there; render nothing but missing references");
  app.add_flag("--no-charts", options.no_charts, "do without gnuplot");
  app.footer(
      "Example:\n  photonfarm bench jobs/bench/quick.toml --out build/bench-quick\n"
      "Interrupted or killed, the same command goes on. The suite file: jobs/benchmark/README.md.");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  const fs::path gnuplot = options.no_charts ? fs::path() : find_program("gnuplot", context.search_path);
  Result<bench::BenchResult> result =
      gnuplot.empty() && !options.no_charts
          ? fail(ErrorKind::kUsage, "gnuplot not found; install gnuplot-nox, or give --no-charts")
          : run(context, options, gnuplot);
  if (!result) {
    context.err << fmt::format("photonfarm bench: {}\n", result.error().message);
    return exit_code(result.error().kind);
  }
  if (options.json) {
    context.out << bench::results_json(*result).dump(1) << '\n';
  } else {
    context.out << bench::results_table(*result) << (options.request.out / "report.html").string() << '\n';
  }
  return 0;
}

}  // namespace pf
