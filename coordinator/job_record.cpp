#include "coordinator/job_record.h"

#include <array>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

constexpr std::array<std::string_view, 8> kStateNames{"queued",    "preparing", "running", "waiting",
                                                      "finishing", "done",      "failed",  "cancelled"};
constexpr std::uint64_t kMaxRecordBytes = 16 << 20;

Result<JobState> state_of(const std::string& name) {
  for (std::size_t i = 0; i < kStateNames.size(); ++i) {
    if (kStateNames[i] == name) return static_cast<JobState>(i);
  }
  return fail(ErrorKind::kInternal, fmt::format("no job state is called \"{}\"", name));
}

}  // namespace

std::string_view to_string(JobState state) { return kStateNames[static_cast<std::size_t>(state)]; }

Result<void> JobRecord::save(const std::filesystem::path& folder) const {
  const nlohmann::json json = {{"id", id},
                               {"spec", canonical_json(spec)},
                               {"bundle", {{"sha256", bundle.sha256}, {"bytes", bundle.bytes}}},
                               {"idempotency_key", idempotency_key},
                               {"state", to_string(state)},
                               {"message", message},
                               {"end_state", to_string(end_state)},
                               {"submitted_unix_ms", submitted_unix_ms},
                               {"started_unix_ms", started_unix_ms},
                               {"ended_unix_ms", ended_unix_ms},
                               {"scene_hash", scene_hash},
                               {"plan", plan},
                               {"image_hash", image_hash},
                               {"warnings", warnings},
                               {"estimated_error", estimated_error},
                               {"figures",
                                {{"passes", figures.passes},
                                 {"rounds", figures.rounds},
                                 {"rays", figures.rays},
                                 {"photon_paths", figures.photon_paths},
                                 {"seconds", figures.seconds}}}};
  // Texts come from scenes and workers: whatever bytes they hold, the record can be written.
  return write_file_atomically(folder / "job.json",
                               json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

Result<JobRecord> JobRecord::load(const std::filesystem::path& folder) {
  const auto file = folder / "job.json";
  const auto text = read_file(file, kMaxRecordBytes, ErrorKind::kInternal);
  if (!text) return tl::unexpected(text.error());
  try {
    const auto json = nlohmann::json::parse(*text);
    auto spec = parse_job_json(json.at("spec").get<std::string>(), file.string());
    if (!spec) return tl::unexpected(spec.error());
    auto state = state_of(json.at("state").get<std::string>());
    if (!state) return tl::unexpected(state.error());
    JobRecord r;
    r.id = json.at("id").get<std::string>();
    r.spec = std::move(*spec);
    r.bundle = {json.at("bundle").at("sha256").get<std::string>(), json.at("bundle").at("bytes").get<std::uint64_t>()};
    r.idempotency_key = json.at("idempotency_key").get<std::string>();
    r.state = *state;
    r.message = json.at("message").get<std::string>();
    r.end_state = state_of(json.value("end_state", "done")).value_or(JobState::kDone);
    r.submitted_unix_ms = json.at("submitted_unix_ms").get<std::int64_t>();
    r.started_unix_ms = json.at("started_unix_ms").get<std::int64_t>();
    r.ended_unix_ms = json.at("ended_unix_ms").get<std::int64_t>();
    r.scene_hash = json.at("scene_hash").get<std::string>();
    r.plan = json.at("plan").get<std::string>();
    r.image_hash = json.at("image_hash").get<std::string>();
    r.warnings = json.at("warnings").get<std::vector<std::string>>();
    r.estimated_error = json.at("estimated_error").get<double>();
    const auto& figures = json.at("figures");
    r.figures = {figures.at("passes").get<std::uint64_t>(), figures.at("rounds").get<std::uint64_t>(),
                 figures.at("rays").get<std::uint64_t>(), figures.at("photon_paths").get<std::uint64_t>(),
                 figures.at("seconds").get<double>()};
    return r;
  } catch (const nlohmann::json::exception& e) {
    return fail(ErrorKind::kInternal, fmt::format("{}: {}", file.string(), e.what()));
  }
}

std::string CheckpointNote::to_json() const {
  nlohmann::json ranges = nlohmann::json::array();
  for (const UnitRange& r : done_beyond) ranges.push_back({r.first, r.count});
  return nlohmann::json{{"done_below", done_below},
                        {"done_beyond", ranges},
                        {"seconds", seconds},
                        {"units_done", units_done},
                        {"units_repeated", units_repeated},
                        {"bytes_received", bytes_received},
                        {"merge_seconds", merge_seconds}}
      .dump();
}

Result<CheckpointNote> CheckpointNote::from_json(const std::string& text) {
  try {
    const auto json = nlohmann::json::parse(text);
    CheckpointNote note;
    note.done_below = json.at("done_below").get<std::uint64_t>();
    for (const auto& range : json.at("done_beyond")) {
      note.done_beyond.push_back({range.at(0).get<std::uint64_t>(), range.at(1).get<std::uint64_t>()});
    }
    note.seconds = json.at("seconds").get<double>();
    note.units_done = json.at("units_done").get<std::uint64_t>();
    note.units_repeated = json.at("units_repeated").get<std::uint64_t>();
    note.bytes_received = json.at("bytes_received").get<std::uint64_t>();
    note.merge_seconds = json.at("merge_seconds").get<double>();
    return note;
  } catch (const nlohmann::json::exception& e) {
    return fail(ErrorKind::kInternal, fmt::format("the checkpoint's note of units is broken: {}", e.what()));
  }
}

}  // namespace pf
