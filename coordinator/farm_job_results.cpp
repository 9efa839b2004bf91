// How results come into a job's film: manifest, chunks, merge. A result counts whole or not at all, and every sub-pass
// once.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "common/wire/limits.h"
#include "common/wire/statistics_codec.h"
#include "coordinator/farm_job.h"

namespace pf {
namespace {

std::vector<UnitRange> ranges_of(const wire::ResultManifest& manifest) {
  std::vector<UnitRange> ranges;
  for (const wire::Unit& unit : manifest.units()) ranges.push_back({unit.first_sub_pass(), unit.sub_passes()});
  return ranges;
}

std::uint64_t sub_passes_of(const wire::ResultManifest& manifest) {
  std::uint64_t sum = 0;
  for (const wire::Unit& unit : manifest.units()) sum += unit.sub_passes();
  return sum;
}

wire::ResultReply reply_to(const wire::ResultManifest& manifest, wire::ResultReply::Verdict verdict,
                           const std::string& reason) {
  wire::ResultReply reply;
  reply.set_job_id(manifest.job_id());
  reply.set_result_id(manifest.result_id());
  reply.set_verdict(verdict);
  reply.set_reason(reason.substr(0, kMaxTextBytes));
  return reply;
}

wire::ResultReply ask_for(ResultIntake& intake) {
  wire::ResultReply reply = reply_to(intake.manifest(), wire::ResultReply::WANTED, "");
  for (const std::uint32_t index : intake.ask()) reply.add_missing(index);
  return reply;
}

/// Names the units of a result, for comparing a second one of the same with the first.
std::string name_of_units(const std::vector<UnitRange>& ranges) {
  std::string name;
  for (const UnitRange& r : ranges) name += fmt::format("{}+{} ", r.first, r.count);
  return name;
}

}  // namespace

bool FarmJob::is_wanted(const wire::ResultManifest& manifest, std::string& why_not) const {
  if (manifest.kind() == wire::Task::PREPARE) {
    why_not = "the scene has been prepared already";
    return preparing_.has_value();
  }
  if (!film_ || record_.state == JobState::kFinishing) {
    why_not = "the job takes no results now";
    return false;
  }
  if (shares_radii() && manifest.round_begin() != film_->round_begin()) {
    why_not = "its round is over";
    return false;
  }
  for (const UnitRange& range : ranges_of(manifest)) {
    if (ledger_.is_out(range)) continue;
    why_not = fmt::format("sub-passes {} to {} count already or are cut otherwise now", range.first, range.end());
    if (!ledger_.is_free(range) || range.end() > limit()) return false;
  }
  return true;
}

bool FarmJob::figures_are_plausible(const wire::ResultManifest& manifest) const {
  if (!std::isfinite(manifest.trace_seconds()) || manifest.trace_seconds() < 0) return false;
  if (manifest.kind() == wire::Task::PREPARE) return true;
  const JobSpec& spec = record_.spec;
  const std::uint64_t passes = sub_passes_of(manifest), paths = manifest.photon_paths();
  if (film_->options().estimator != Estimator::kPath)
    return passes > 0 && paths % passes == 0 && may_trace(spec, paths / passes);
  // Methods whose radiance is a plain mean trace none in a sub-pass, or as many as the others, or those of their maps
  // before the first.
  const auto in_a_pass = static_cast<std::uint64_t>(photon_paths(spec));
  return paths <= std::max(passes * in_a_pass, in_a_pass + static_cast<std::uint64_t>(spec.photon_map.caustic_photons));
}

void FarmJob::compare_with_first(const std::string& worker, const wire::ResultManifest& manifest) {
  const auto first = first_results_.find(name_of_units(ranges_of(manifest)));
  if (first == first_results_.end() || first->second.content == manifest.content()) return;
  const std::string text = fmt::format(
      "{} and {} returned different sums for the same units ({}): one of them computes wrongly; "
      "the first was kept",
      first->second.worker, worker, first->first);
  log("error", "coordinator", text);
  record_.warnings.push_back(text);
  ++around_.metrics.alarms;
}

Answer FarmJob::refuse(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why) {
  log("debug", "coordinator", fmt::format("a result of {} is refused: {}", worker, why));
  compare_with_first(worker, manifest);
  repeat_units_of(worker, manifest, why);
  return {reply_to(manifest, wire::ResultReply::REFUSED, why), {}};
}

void FarmJob::repeat_units_of(const std::string& worker, const wire::ResultManifest& manifest, const std::string& why) {
  if (manifest.kind() == wire::Task::PREPARE) {
    if (preparing_ && !repeat_preparing_) repeat_prepare();
    return;
  }
  // Whole or not at all: its units that do not count yet are traced again.
  for (const UnitRange& range : ranges_of(manifest)) {
    UnitLedger::Out* unit = ledger_.find(range.first);
    if (unit != nullptr && unit->range == range && (unit->holder == worker || unit->holder.empty()))
      repeat_unit(*unit, why);
  }
}

Answer FarmJob::on_manifest(const std::string& worker, std::uint64_t incarnation,
                            const wire::ResultManifest& manifest) {
  if (ended() || record_.state == JobState::kPaused) {
    return {reply_to(manifest, wire::ResultReply::REFUSED, fmt::format("the job is {}", to_string(record_.state))), {}};
  }
  if (record_.state == JobState::kWaiting) return {};  // the worker asks again
  if (manifest.build_id() != around_.build_id) {
    // No quarantine: a farm that was brought up to date meets results of the build before.
    const std::string why =
        fmt::format("it is of build {}, the coordinator of {}", manifest.build_id(), around_.build_id);
    repeat_units_of(worker, manifest, why);
    return {reply_to(manifest, wire::ResultReply::REFUSED, why), {}};
  }
  const Key key{worker, incarnation, manifest.result_id()};
  if (const auto known = intakes_.find(key); known != intakes_.end()) return {ask_for(known->second), {}};
  std::string why_not;
  if (!is_wanted(manifest, why_not)) return refuse(worker, manifest, why_not);
  if (!figures_are_plausible(manifest)) {
    Answer answer = refuse(worker, manifest, "implausible figures");
    answer.accusation = "its result's figures are impossible";
    return answer;
  }
  auto intake = ResultIntake::open(folder_ / fmt::format("incoming-{}-{}", worker, manifest.result_id()), manifest);
  if (!intake) {
    wait_for_disk(intake.error());
    return {};
  }
  if (intake->complete()) return take_in(worker, std::move(*intake));
  return {ask_for(intakes_.emplace(key, std::move(*intake)).first->second), {}};
}

Answer FarmJob::on_chunk(const std::string& worker, std::uint64_t incarnation, const wire::ResultChunk& chunk) {
  const auto found = intakes_.find({worker, incarnation, chunk.result_id()});
  if (found == intakes_.end() || record_.state == JobState::kWaiting) return {};
  ResultIntake& intake = found->second;
  if (const auto put = intake.put(chunk.index(), chunk.data()); !put) {
    wait_for_disk(put.error());
    return {};
  }
  if (intake.complete()) {
    ResultIntake whole = std::move(intake);
    intakes_.erase(found);
    return take_in(worker, std::move(whole));
  }
  if (intake.wants_more()) return {ask_for(intake), {}};
  return {};
}

Answer FarmJob::take_in(const std::string& worker, ResultIntake intake) {
  const wire::ResultManifest& manifest = intake.manifest();
  std::string why_not;
  // Another worker's result may have come in while this one was on its way.
  if (!is_wanted(manifest, why_not)) return refuse(worker, manifest, why_not);
  const double start = around_.clock.now();
  Answer answer =
      manifest.kind() == wire::Task::PREPARE ? take_in_prepared(worker, intake) : take_in_sums(worker, intake);
  const double took = around_.clock.now() - start;
  merge_seconds_ += took;
  around_.metrics.merge_seconds.observe(took);
  if (answer.reply && answer.reply->verdict() == wire::ResultReply::ACCEPTED) {
    bytes_received_ += intake.bytes();
    around_.metrics.bytes_received += intake.bytes();
  }
  return answer;
}

Answer FarmJob::take_in_prepared(const std::string& worker, const ResultIntake& intake) {
  const wire::ResultManifest& manifest = intake.manifest();
  const auto wrong = [&](const std::string& what) -> Answer {
    forget_worker(worker);
    repeat_prepare();
    return {reply_to(manifest, wire::ResultReply::REFUSED, what), what};
  };
  auto options = from_wire(manifest.prepared().film());
  if (!options) return wrong(options.error().message);
  const JobSpec& spec = record_.spec;
  if (options->width != spec.image.width || options->height != spec.image.height)
    return wrong("its film has another size");
  Film film(*options);
  if (options->estimator != Estimator::kPath) {
    // The film's own memory: a second copy of the radii would be the coordinator's peak.
    std::vector<ProgressivePixel> state = std::move(film.state());
    StateUnpacker unpacker(state);
    for (std::size_t i = 0; i < static_cast<std::size_t>(manifest.chunk_xxh3_size()); ++i) {
      const auto chunk = intake.read(i);
      if (!chunk) {
        wait_for_disk(chunk.error());
        return {};
      }
      if (auto added = unpacker.add(*chunk); !added) return wrong(added.error().message);
    }
    if (!unpacker.complete() || to_wire(unpacker.content()) != manifest.content())
      return wrong("its radii are not what it announced");
    film.set_initial_radii(std::move(state));
  }
  record_.scene_hash = manifest.prepared().scene_hash();
  record_.plan = manifest.prepared().plan_line();
  for (const std::string& warning : manifest.prepared().warnings()) record_.warnings.push_back(warning);
  log("info", worker, fmt::format("scene prepared in {:.2f} s: {}", manifest.trace_seconds(), record_.plan));
  preparing_.reset();
  start_running(std::move(film));
  return {reply_to(manifest, wire::ResultReply::ACCEPTED, ""), {}};
}

Answer FarmJob::take_in_sums(const std::string& worker, const ResultIntake& intake) {
  const wire::ResultManifest& manifest = intake.manifest();
  StatisticsUnpacker unpacker(film_->sums());
  const auto chunks = static_cast<std::size_t>(manifest.chunk_xxh3_size());
  std::size_t added = 0;
  std::string wrong;
  std::optional<Error> disk;
  for (; added < chunks && wrong.empty() && !disk; ++added) {
    const auto chunk = intake.read(added);
    if (!chunk) {
      disk = chunk.error();
      break;
    }
    if (auto sum = unpacker.add(*chunk); !sum) {
      wrong = sum.error().message;
      break;
    }
  }
  if (!disk && wrong.empty() && to_wire(unpacker.content()) != manifest.content())
    wrong = "its sums are not what it announced";
  if (disk || !wrong.empty()) {
    for (std::size_t i = 0; i < added; ++i) {
      const auto chunk = intake.read(i);
      if (!chunk || !unpacker.take_off(*chunk)) {
        end_failed("a refused result could not be taken off again: the sums are lost since the last checkpoint");
        return {};
      }
    }
    if (disk) {
      wait_for_disk(*disk);
      return {};
    }
    for (const UnitRange& range : ranges_of(manifest)) {
      if (UnitLedger::Out* unit = ledger_.find(range.first)) repeat_unit(*unit, fmt::format("{}: {}", worker, wrong));
    }
    return {reply_to(manifest, wire::ResultReply::REFUSED, wrong), wrong};
  }
  count(worker, manifest);
  after_progress();
  return {reply_to(manifest, wire::ResultReply::ACCEPTED, ""), {}};
}

void FarmJob::count(const std::string& worker, const wire::ResultManifest& manifest) {
  Statistics& sums = film_->sums();
  const std::uint64_t sub_passes = sub_passes_of(manifest);
  sums.sub_passes += sub_passes;
  sums.photon_paths += manifest.photon_paths();
  sums.photons_stored += manifest.photons_stored();
  sums.rays += manifest.rays();
  sums.faults += Faults{manifest.not_finite(), manifest.overflow()};
  const std::vector<UnitRange> ranges = ranges_of(manifest);
  constexpr std::size_t kRemembered = 4096;
  const std::string name = name_of_units(ranges);
  first_results_[name] = {worker, manifest.content()};
  first_order_.push_back(name);
  if (first_order_.size() > kRemembered) {
    first_results_.erase(first_order_.front());
    first_order_.pop_front();
  }
  remember(worker, manifest);
  Metrics& metrics = around_.metrics;
  metrics.rays += manifest.rays();
  metrics.photon_paths += manifest.photon_paths();
  metrics.sub_passes += sub_passes;
  for (const UnitRange& range : ranges) {
    // A result says how long all its units took together.
    metrics.unit_seconds.observe(manifest.trace_seconds() * static_cast<double>(range.count) /
                                 static_cast<double>(sub_passes));
    ++metrics.units;
    ledger_.finish(range);
    ++units_done_;
  }
  constexpr double kSmoothing = 0.25;
  const double each = manifest.trace_seconds() / static_cast<double>(sub_passes);
  sub_pass_seconds_ = sub_pass_seconds_ > 0 ? sub_pass_seconds_ + kSmoothing * (each - sub_pass_seconds_) : each;
}

}  // namespace pf
