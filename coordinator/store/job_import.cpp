#include "coordinator/store/job_record.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

constexpr std::uint64_t kMaxRecordBytes = 16 << 20;

Result<JobState> state_of(const std::string& name) {
  if (const auto state = job_state_of(name)) return *state;
  return fail(ErrorKind::kInternal, fmt::format("no job state is called \"{}\"", name));
}

}  // namespace

Result<JobRecord> import_job_json(const std::filesystem::path& folder) {
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
    r.figures.passes = figures.at("passes").get<std::uint64_t>();
    r.figures.rounds = figures.at("rounds").get<std::uint64_t>();
    r.figures.rays = figures.at("rays").get<std::uint64_t>();
    r.figures.photon_paths = figures.at("photon_paths").get<std::uint64_t>();
    r.figures.seconds = figures.at("seconds").get<double>();
    return r;
  } catch (const nlohmann::json::exception& e) {
    return fail(ErrorKind::kInternal, fmt::format("{}: {}", file.string(), e.what()));
  }
}

}  // namespace pf
