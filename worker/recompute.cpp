#include "worker/recompute.h"

#include <charconv>
#include <optional>
#include <thread>

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "common/wire/messages.h"
#include "common/wire/statistics_codec.h"
#include "worker/render_job.h"

namespace pf {
namespace {

using nlohmann::json;

/// Sub-passes in a row: the first, and how many.
using Range = std::pair<std::uint64_t, std::uint64_t>;

Result<std::vector<Range>> parse_units(const std::string& text) {
  std::vector<Range> ranges;
  const char* at = text.data();
  const char* const end = at + text.size();
  while (at < end) {
    Range range;
    const auto first = std::from_chars(at, end, range.first);
    const bool colon = first.ec == std::errc() && first.ptr < end && *first.ptr == ':';
    const auto count = colon ? std::from_chars(first.ptr + 1, end, range.second)
                             : std::from_chars_result{at, std::errc::invalid_argument};
    constexpr std::uint64_t kMost = std::uint64_t{1} << 40;
    if (count.ec != std::errc() || (count.ptr < end && *count.ptr != ',') || range.second == 0 ||
        range.second > kMost || range.first > kMost)
      return fail(ErrorKind::kUsage, fmt::format("--units {}: expected FIRST:COUNT,FIRST:COUNT...", text));
    ranges.push_back(range);
    at = count.ptr < end ? count.ptr + 1 : end;
  }
  if (ranges.empty()) return fail(ErrorKind::kUsage, "--units: expected FIRST:COUNT,FIRST:COUNT...");
  return ranges;
}

/// Hexadecimal, byte by byte, as the coordinator keeps hashes of results.
std::string hex(const std::string& bytes) {
  std::string text;
  for (const char byte : bytes) text += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  return text;
}

/// The film that a farm's checkpoint holds (FarmJob::identity names it so).
Result<Film> load_film(const LoadedJob& job, const std::filesystem::path& checkpoint) {
  return Film::load(checkpoint, fmt::format("farm spec {} scene {} build {}", image_hash_of_spec(job.spec),
                                            job.scene_hash, kBuildId));
}

/// Traces what one result brought; empty when its round's radii are not known.
std::optional<PackedStatistics> sums_of(const LoadedJob& job, const Film& first_round, const Film* open_round,
                                        const std::vector<Range>& ranges) {
  const FilmOptions& options = first_round.options();
  const Film* film = &first_round;
  for (const auto& [first, count] : ranges) {
    if (options.estimator != Estimator::kShared || first + count <= first_round.round_end()) continue;
    if (open_round == nullptr || first < open_round->round_begin() || first + count > open_round->round_end())
      return std::nullopt;
    film = open_round;
  }
  Statistics sums(options.width * options.hit_points, options.height, false);
  for (const auto& [first, count] : ranges) {
    sums.make_room(PassOrder(options).part(first).sample, options.extra);
    job.integrator->run({first, count}, film->state(), sums);
  }
  return pack_statistics(sums);
}

Result<std::string> recompute(const RecomputeRequest& request, const Clock& clock) {
  const auto job = load_job_scene(request.spec, clock);
  if (!job) return tl::unexpected(job.error());
  Film first(job->integrator->film_options());
  if (auto radii = job->integrator->initial_radii(); !radii.empty()) first.set_initial_radii(std::move(radii));
  std::optional<Film> open;
  if (!request.checkpoint.empty()) {
    auto loaded = load_film(*job, request.checkpoint);
    if (!loaded) return tl::unexpected(loaded.error());
    open.emplace(std::move(*loaded));
  }
  json results = json::array();
  for (const std::string& text : request.units) {
    const auto ranges = parse_units(text);
    if (!ranges) return tl::unexpected(ranges.error());
    const auto packed = sums_of(*job, first, open ? &*open : nullptr, *ranges);
    if (!packed) {
      results.push_back({{"units", text}, {"cannot", "the radii of its round are not known any more"}});
      continue;
    }
    std::uint64_t bytes = 0;
    for (const std::string& chunk : packed->chunks) bytes += chunk.size();
    results.push_back({{"units", text}, {"hash", hex(to_wire(packed->content))}, {"bytes", bytes}});
  }
  std::uint64_t state_bytes = 0;
  const auto state = pack_state(first.state(), [&](std::string_view chunk) -> Result<void> {
    state_bytes += chunk.size();
    return {};
  });
  if (!state) return tl::unexpected(state.error());
  return json{{"results", std::move(results)}, {"state_bytes", first.state().empty() ? 0 : state_bytes}}.dump(2);
}

}  // namespace

Result<std::string> recompute_units(const RecomputeRequest& request, const Clock& clock) {
  const int threads =
      request.threads > 0 ? request.threads : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  Result<std::string> result = fail(ErrorKind::kInternal, "not run");
  arena.execute([&] { result = recompute(request, clock); });
  return result;
}

}  // namespace pf
