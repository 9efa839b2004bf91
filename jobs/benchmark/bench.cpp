#include "jobs/benchmark/bench.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "common/base/status_line.h"
#include "jobs/benchmark/machine.h"
#include "jobs/benchmark/worker_runner.h"

namespace pf::bench {
namespace {

namespace fs = std::filesystem;

/// Keeps other benches out of a folder while it lives.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& folder)
      : fd_(open((folder / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644)) {
    held_ = fd_ >= 0 && flock(fd_, LOCK_EX | LOCK_NB) == 0;
  }
  ~FolderLock() {
    if (fd_ >= 0) close(fd_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  [[nodiscard]] bool held() const { return held_; }

 private:
  int fd_;
  bool held_ = false;
};

constexpr std::uint64_t kMaxPlanBytes = std::uint64_t{1} << 20;

class Bench {
 public:
  Bench(const BenchRequest& request, Runner& runner, const std::function<void(const BenchProgress&)>& progress,
        BenchResult& result)
      : request_(request), runner_(runner), progress_(progress), result_(result) {}

  Result<void> run() {
    auto scenes = prepare_scenes(result_.suite, request_.out);
    if (!scenes) return tl::unexpected(scenes.error());
    auto schedule = make_schedule(result_.suite, *scenes, request_.worker, request_.out);
    if (!schedule) return tl::unexpected(schedule.error());
    schedule_ = std::move(*schedule);
    where_.total = schedule_.size();
    for (Scene& scene : *scenes) {
      SceneResult& to = result_.scenes.emplace_back();
      to.scene = std::move(scene);
      to.methods.resize(result_.suite.methods.size());
    }
    for (SceneResult& scene : result_.scenes) {
      if (auto done = find_reference(scene); !done) return done;
    }
    for (const Run& run : schedule_) {
      if (auto done = make(run); !done) return done;
      ++where_.done;
    }
    return turn_terms_round();
  }
  /// Runs point into it: it must outlive the result.
  [[nodiscard]] std::vector<Run> take_schedule() { return std::move(schedule_); }

 private:
  Result<void> find_reference(SceneResult& scene) {
    const fs::path cache = request_.cache.empty() ? request_.out / "references" : request_.cache;
    const auto show = [&](double seconds, std::uint64_t passes, double noise) {
      where_.doing = fmt::format("reference of {}: {} passes, {}", scene.scene.name, passes, clock_time(seconds));
      if (noise > 0) where_.doing += fmt::format(", noise {:.2g} so far", noise);
      where_.left = -1;
      progress_(where_);
    };
    auto reference =
        ensure_reference(scene.scene, cache, static_cast<int>(last_processors(1024).size()), runner_, show);
    if (!reference) return tl::unexpected(reference.error());
    scene.reference = std::move(*reference);
    return {};
  }

  Result<void> make(const Run& run) {
    SceneResult& scene = result_.scenes[run.scene];
    auto made = obtain(run, scene.scene, scene.reference, result_.suite.methods[run.method].name);
    if (!made) return tl::unexpected(made.error());
    if (!*made) return {};
    seconds_[{run.scene, run.method}] = (*made)->wall_seconds;
    scene.methods[run.method].runs.push_back(std::move(**made));
    return {};
  }

  /// A run that is there already, or is made now, measured; none where only what is there is reported.
  Result<std::optional<RunResult>> obtain(const Run& run, const Scene& scene, const Reference& reference,
                                          const std::string& name) {
    auto known = read_run(run);
    if (known && !known->error.empty() && request_.retry_failed) known.reset();
    if (!known && request_.report_only) return std::nullopt;
    if (!known) {
      auto rendered = render(run, scene, name);
      if (!rendered) return tl::unexpected(rendered.error());
      known = read_run(run);
    }
    if (!known)
      return fail(ErrorKind::kInternal, fmt::format("{}: the run just made cannot be read", run.order.out.string()));
    if (auto measured = measure(*known, reference); !measured) return tl::unexpected(measured.error());
    return known;
  }

  /// A method's plan on a scene, and what it becomes with each term turned round.
  struct TurnedTerms {
    std::size_t scene = 0, method = 0;
    std::vector<Variant> variants;  ///< the first: as planned
  };

  Result<void> turn_terms_round() {
    std::vector<TurnedTerms> all;
    for (std::size_t s = 0; s < result_.scenes.size(); ++s) {
      for (std::size_t m = 0; m < result_.suite.methods.size(); ++m) {
        if (!result_.suite.methods[m].ablate || result_.scenes[s].methods[m].runs.empty()) continue;
        auto variants = plan_variants(result_.scenes[s].scene, result_.suite.methods[m]);
        if (!variants) return tl::unexpected(variants.error());
        if (variants->size() < 2) continue;
        where_.total += variants->size() * result_.scenes[s].methods[m].runs.size();
        all.push_back({s, m, std::move(*variants)});
      }
    }
    for (const TurnedTerms& terms : all) {
      if (auto done = ablate(terms); !done) return done;
    }
    return {};
  }

  /// Nothing for scenes without a plan: their runs say why.
  Result<std::vector<Variant>> plan_variants(const Scene& scene, const MethodEntry& method) {
    const fs::path folder = request_.out / "plans";
    auto set = scene.set;
    set.insert(set.end(), method.set.begin(), method.set.end());
    set.push_back("integrator.type=" + method.type);
    auto identity = identity_of_job(scene.job, set);
    if (!identity) return tl::unexpected(identity.error());
    const fs::path file = folder / (sha256_hex(scene.hash + *identity + request_.worker).substr(0, 20) + ".json");
    auto kept = read_file(file, kMaxPlanBytes);
    if (!kept) {
      if (request_.report_only || !scene.error.empty()) return std::vector<Variant>();
      const auto plan = runner_.plan(scene.job, set);
      if (!plan) {
        if (plan.error().kind == ErrorKind::kInvalidInput) return std::vector<Variant>();
        return tl::unexpected(plan.error());
      }
      std::error_code code;
      fs::create_directories(folder, code);
      if (auto written = write_file_atomically(file, plan->dump()); !written) return tl::unexpected(written.error());
      kept = plan->dump();
    }
    return variants_of(nlohmann::json::parse(*kept, nullptr, false), scene, method, request_.out);
  }

  /// Each seed's variants in turns, so that a drift of the machine hits all alike, at the passes of the seed's own run.
  Result<void> ablate(const TurnedTerms& terms) {
    SceneResult& scene = result_.scenes[terms.scene];
    std::vector<Ablation> found;
    for (const Variant& v : std::span(terms.variants).subspan(1)) {
      Ablation& ablation = found.emplace_back();
      ablation.method = terms.method;
      ablation.algorithm = v.method.type;
      ablation.term = v.term;
      ablation.planned = v.planned;
      ablation.instead = v.instead;
    }
    const std::size_t budget = ablation_budget(result_.suite);
    for (const RunResult& own : scene.methods[terms.method].runs) {
      if (own.error.empty() && budget < own.samples.size()) {
        Suite at_passes = result_.suite;
        at_passes.seconds.clear();
        at_passes.passes = {static_cast<std::int64_t>(own.samples[budget].passes)};
        if (auto done = ablate_seed(terms, at_passes, own.run->seed, found); !done) return done;
      }
      where_.done += terms.variants.size();
    }
    for (Ablation& ablation : found) {
      finish(ablation);
      scene.ablations.push_back(std::move(ablation));
    }
    return {};
  }

  Result<void> ablate_seed(const TurnedTerms& terms, const Suite& suite, std::uint64_t seed,
                           std::vector<Ablation>& found) {
    auto planned = last_image(terms, terms.variants.front(), suite, seed);
    if (!planned) return tl::unexpected(planned.error());
    for (std::size_t v = 1; v < terms.variants.size(); ++v) {
      Ablation& ablation = found[v - 1];
      if (!*planned) {
        ablation.failure = planned->error();
        continue;
      }
      auto other = last_image(terms, terms.variants[v], suite, seed);
      if (!other) return tl::unexpected(other.error());
      if (!*other) {
        ablation.failure = other->error();
        continue;
      }
      add_pair(ablation, **planned, **other);
    }
    return {};
  }

  /// An image's figures, or in words why there are none.
  using Judged = tl::expected<ImageCost, std::string>;

  /// Of a variant's image at the suite's passes.
  Result<Judged> last_image(const TurnedTerms& terms, const Variant& variant, const Suite& suite, std::uint64_t seed) {
    auto run = make_run(suite, variant.scene, variant.method, seed, request_.worker, request_.out);
    if (!run) return tl::unexpected(run.error());
    run->scene = terms.scene;
    run->method = terms.method;
    const std::string how = variant.term.empty() ? "as planned" : variant.term + " turned round";
    auto made = obtain(*run, variant.scene, result_.scenes[terms.scene].reference,
                       fmt::format("{}, {}", result_.suite.methods[terms.method].name, how));
    if (!made) return tl::unexpected(made.error());
    if (!*made) return Judged(tl::unexpect, "not made");
    const RunResult& result = **made;
    if (!result.error.empty()) return Judged(tl::unexpect, result.error);
    const Sample& sample = result.samples.back();
    if (!std::isfinite(sample.rel_mse_trimmed)) return Judged(tl::unexpect, "no error to judge");
    return Judged(ImageCost{sample.rel_mse_trimmed, sample.cpu_seconds});
  }

  Result<void> render(const Run& run, const Scene& scene, const std::string& name) {
    std::error_code code;
    fs::remove_all(run.order.out, code);  // what an interrupted run left
    fs::create_directories(run.order.out, code);
    if (code)
      return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", run.order.out.string(), code.message()));
    const std::string doing = fmt::format("{}, {}, seed {}", scene.name, name, run.seed);
    const auto show = [&](double seconds) {
      where_.doing = fmt::format("{}: {}", doing, clock_time(seconds));
      where_.left = std::max(0.0, seconds_left() - seconds);
      progress_(where_);
    };
    RenderOutcome outcome{{}, scene.error, 0};
    if (scene.error.empty()) {
      auto rendered = runner_.render(run.order, show);
      if (!rendered) return tl::unexpected(rendered.error());
      outcome = std::move(*rendered);
    }
    // The checkpoint and the whole image are of no more use; the snapshots are.
    for (const char* what : {".checkpoint", ".exr", ".png"})
      fs::remove(run.order.out / (kImageName + std::string(what)), code);
    return write_run(run, outcome, result_.suite, scene);
  }

  /// Of this run and all after it, from what runs like them took; the budget, where there was none yet.
  [[nodiscard]] double seconds_left() const {
    double known = 0;
    for (const auto& [of, seconds] : seconds_) known += seconds;
    const double typical = !seconds_.empty()            ? known / static_cast<double>(seconds_.size())
                           : result_.suite.by_seconds() ? 1.2 * result_.suite.seconds.back()
                                                        : 10.0;
    // Terms turned round stop at a smaller budget.
    const Suite& suite = result_.suite;
    const double of_term = suite.by_seconds() ? 1.2 * suite.seconds[ablation_budget(suite)] : typical;
    double left = static_cast<double>(where_.total - std::max(where_.done, schedule_.size())) * of_term;
    for (std::size_t i = where_.done; i < schedule_.size(); ++i) {
      const auto same = seconds_.find({schedule_[i].scene, schedule_[i].method});
      left += same == seconds_.end() ? typical : same->second;
    }
    return left;
  }

  const BenchRequest& request_;
  Runner& runner_;
  const std::function<void(const BenchProgress&)>& progress_;
  BenchResult& result_;
  std::vector<Run> schedule_;
  std::map<std::pair<std::size_t, std::size_t>, double> seconds_;  ///< that runs of this scene and method took
  BenchProgress where_;
};

}  // namespace

Result<BenchResult> run_bench(const BenchRequest& request, Runner& runner,
                              const std::function<void(const BenchProgress&)>& progress,
                              std::vector<std::string>& notes) {
  BenchResult result;
  auto suite = load_suite(request.suite, notes);
  if (!suite) return tl::unexpected(suite.error());
  result.suite = std::move(*suite);
  std::error_code code;
  fs::create_directories(request.out, code);
  const FolderLock lock(request.out);
  if (code || !lock.held()) {
    return fail(ErrorKind::kUsage,
                fmt::format("--out {}: cannot be written, or another bench is using it; expected a folder "
                            "of its own",
                            request.out.string()));
  }
  result.machine = describe_machine(request.worker);
  Bench bench(request, runner, progress, result);
  if (auto done = bench.run(); !done) return tl::unexpected(done.error());
  result.schedule = bench.take_schedule();
  analyse(result);
  return result;
}

}  // namespace pf::bench
