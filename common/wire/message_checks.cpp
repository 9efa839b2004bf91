#include "common/wire/message_checks.h"

#include <cmath>
#include <set>

#include <fmt/format.h>

#include "common/film/film.h"
#include "common/film/image.h"
#include "common/spec/document.h"
#include "common/wire/limits.h"
#include "common/wire/messages.h"
#include "common/wire/statistics_codec.h"

namespace pf {
namespace {

constexpr std::size_t kSha256Bytes = 32;
constexpr std::size_t kContentBytes = 16;
constexpr std::size_t kMaxBuildIdBytes = 256;
constexpr std::size_t kMaxHostBytes = 255;
constexpr double kMaxSeconds = 1e9;  // as in the job file
constexpr double kMaxGrowth = 1000;
constexpr std::uint64_t kSubPassesEnd = std::uint64_t{1} << 32;  // the random streams count sub-passes in 32 bits
constexpr std::uint32_t kMaxThreads = 65536;
constexpr auto kLastErrorKind = static_cast<std::uint32_t>(ErrorKind::kInternal);

}  // namespace

void FieldChecks::expect(bool holds, std::string_view field, std::string_view expected) {
  if (!holds && !wrong_) wrong_ = fmt::format("{}{}: expected {}", place_, field, expected);
}

void FieldChecks::part(std::optional<std::string> wrong) {
  if (!wrong_) wrong_ = std::move(wrong);
}

void FieldChecks::version(std::uint32_t version) {
  expect(version == kWireVersion, "version", fmt::format("{}, got {}", kWireVersion, version));
}

void FieldChecks::name(std::string_view value, std::string_view field) {
  expect(is_wire_name(value), field, "1 to 64 of the characters A-Z, a-z, 0-9, '_' and '-'");
}

void FieldChecks::name_or_empty(std::string_view value, std::string_view field) {
  if (!value.empty()) name(value, field);
}

void FieldChecks::text(std::string_view value, std::string_view field, std::size_t most) {
  expect(value.size() <= most, field, fmt::format("at most {} bytes, got {}", most, value.size()));
}

void FieldChecks::build_id(std::string_view value) {
  expect(!value.empty(), "build_id", "a build");
  text(value, "build_id", kMaxBuildIdBytes);
}

void FieldChecks::range(double value, double least, double most, std::string_view field) {
  // Written so that a NaN is outside.
  expect(value >= least && value <= most, field, fmt::format("a number from {} to {}", least, most));
}

void FieldChecks::image(std::uint64_t width, std::uint64_t height) {
  expect(width >= 1 && width <= std::uint64_t{kMaxImageEdge}, "width", fmt::format("1 to {}", kMaxImageEdge));
  expect(height >= 1 && height <= std::uint64_t{kMaxImageEdge}, "height", fmt::format("1 to {}", kMaxImageEdge));
  expect(width * height <= kMaxPixels, "width", fmt::format("at most {} pixels in all", kMaxPixels));
}

void FieldChecks::blob(bool present, const wire::Blob& blob, std::string_view field, std::uint64_t most_bytes) {
  expect(present, field, "a blob");
  expect(blob.sha256().size() == kSha256Bytes, fmt::format("{}.sha256", field), "32 bytes");
  expect(blob.bytes() <= most_bytes, fmt::format("{}.bytes", field), fmt::format("at most {}", most_bytes));
}

void FieldChecks::part(const wire::Blob& blob, std::uint64_t offset, std::uint64_t bytes) {
  expect(offset <= blob.bytes() && bytes <= blob.bytes() - offset, "offset", "a place inside the blob");
}

void FieldChecks::kind(wire::Task::Kind kind) {
  expect(kind == wire::Task::PREPARE || kind == wire::Task::SUB_PASSES, "kind", "PREPARE or SUB_PASSES");
}

void FieldChecks::unit(const wire::Unit& unit, const std::string& field, bool prepare) {
  expect(unit.attempt() >= 1, field + ".attempt", "1 or more");
  expect(prepare || unit.sub_passes() >= 1, field + ".sub_passes", "1 or more");
  // Both below 2^32 first: their sum cannot wrap.
  expect(unit.first_sub_pass() < kSubPassesEnd, field + ".first_sub_pass", "below 2^32");
  expect(unit.sub_passes() <= kSubPassesEnd && unit.first_sub_pass() + unit.sub_passes() <= kSubPassesEnd,
         field + ".sub_passes", "an end of at most 2^32");
}

void FieldChecks::film(const wire::FilmOptions& options, const std::string& field) {
  FieldChecks checks(place_ + field + (field.empty() ? "" : "."));
  checks.image(options.width(), options.height());
  checks.expect(options.estimator() <= static_cast<std::uint32_t>(Estimator::kIndependent), "estimator",
                "a known estimator");
  const auto step = [&](double value, std::string_view name) {
    checks.expect(std::isnormal(value) && value > 0.0, name, "a positive finite number");
  };
  step(options.radiance_step(), "radiance_step");
  step(options.flow_step(), "flow_step");
  step(options.square_step(), "square_step");
  step(options.depth_step(), "depth_step");
  checks.expect(options.alpha() > 0.0 && options.alpha() <= 1.0, "alpha", "a number above 0, at most 1");
  checks.range(options.round_growth(), 0.0, kMaxGrowth, "round_growth");
  checks.expect(options.extra() <= static_cast<std::uint32_t>(Extra::kBias), "extra", "a known kind of extra sums");
  checks.expect(options.hit_points() >= 1 && options.hit_points() <= std::uint64_t{kMaxImageEdge}, "hit_points",
                "at least 1");
  checks.image(std::uint64_t{options.width()} * options.hit_points(), options.height());
  checks.expect(options.part_edge() <= std::uint64_t{kMaxImageEdge}, "part_edge",
                "at most the longest edge of an image");
  part(checks.wrong());
}

std::optional<std::string> what_is_wrong(const wire::FilmOptions& options) {
  FieldChecks checks("FilmOptions.");
  checks.film(options, "");
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::Task& task) {
  FieldChecks checks("Task.");
  checks.version(task.version());
  checks.build_id(task.build_id());
  checks.name(task.job_id(), "job_id");
  checks.kind(task.kind());
  const bool prepare = task.kind() == wire::Task::PREPARE;
  checks.expect(task.has_unit(), "unit", "a unit");
  checks.unit(task.unit(), "unit", prepare);
  checks.expect(prepare || task.round_begin() <= task.unit().first_sub_pass(), "round_begin",
                "at most the unit's first sub-pass");
  checks.blob(task.has_bundle(), task.bundle(), "bundle", kMaxBundleBytes);
  checks.expect(!prepare || !task.has_state(), "state", "none for PREPARE");
  if (task.has_state()) checks.blob(true, task.state(), "state", kMaxBlobBytes);
  checks.range(task.timeout_seconds(), 0.0, kMaxSeconds, "timeout_seconds");
  checks.image(task.width(), task.height());
  return checks.wrong();
}

namespace {

std::optional<std::string> what_is_wrong(const wire::Heartbeat& heartbeat) {
  FieldChecks checks("FromWorker.heartbeat.");
  checks.text(heartbeat.host(), "host", kMaxHostBytes);
  checks.expect(heartbeat.threads() <= kMaxThreads, "threads", fmt::format("at most {}", kMaxThreads));
  checks.build_id(heartbeat.build_id());
  checks.expect(wire::Heartbeat::Activity_IsValid(heartbeat.activity()), "activity", "a known activity");
  checks.name_or_empty(heartbeat.job_id(), "job_id");
  for (int i = 0; i < heartbeat.held_size(); ++i) checks.unit(heartbeat.held(i), fmt::format("held[{}]", i), true);
  checks.range(heartbeat.trace_seconds(), 0.0, kMaxSeconds, "trace_seconds");
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::BlobRequest& request) {
  FieldChecks checks("FromWorker.blob_request.");
  checks.blob(request.has_blob(), request.blob(), "blob", kMaxBlobBytes);
  checks.part(request.blob(), request.offset(), 0);
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::Prepared& prepared) {
  FieldChecks checks("FromWorker.result.prepared.");
  checks.expect(prepared.has_film(), "film", "film options");
  checks.film(prepared.film(), "film");
  checks.expect(!prepared.scene_hash().empty(), "scene_hash", "a hash");
  checks.text(prepared.scene_hash(), "scene_hash", kMaxBuildIdBytes);
  checks.text(prepared.plan_line(), "plan_line", kMaxTextBytes);
  for (int i = 0; i < prepared.warnings_size(); ++i) {
    checks.text(prepared.warnings(i), fmt::format("warnings[{}]", i), kMaxTextBytes);
  }
  return checks.wrong();
}

void check_units(const wire::ResultManifest& result, FieldChecks& checks) {
  const bool prepare = result.kind() == wire::Task::PREPARE;
  checks.expect(result.units_size() >= 1 && static_cast<std::size_t>(result.units_size()) <= kMaxUnits &&
                    (!prepare || result.units_size() == 1),
                "units", prepare ? "one unit" : fmt::format("1 to {} units", kMaxUnits));
  std::uint64_t end = prepare ? 0 : result.round_begin();
  for (int i = 0; i < result.units_size(); ++i) {
    const wire::Unit& unit = result.units(i);
    const std::string field = fmt::format("units[{}]", i);
    checks.unit(unit, field, prepare);
    checks.expect(unit.first_sub_pass() >= end, field + ".first_sub_pass",
                  i == 0 ? "none before round_begin" : "units in ascending order that share no sub-pass");
    if (checks.wrong()) return;
    end = unit.first_sub_pass() + unit.sub_passes();
  }
}

std::optional<std::string> what_is_wrong(const wire::ResultManifest& result) {
  FieldChecks checks("FromWorker.result.");
  checks.version(result.version());
  checks.build_id(result.build_id());
  checks.name(result.job_id(), "job_id");
  checks.kind(result.kind());
  check_units(result, checks);
  const auto chunks = static_cast<std::size_t>(result.chunk_xxh3_size());
  checks.expect(chunks <= kMaxChunks, "chunk_xxh3", fmt::format("at most {} chunks", kMaxChunks));
  checks.expect(result.content().size() == kContentBytes, "content", "16 bytes");
  checks.range(result.trace_seconds(), 0.0, kMaxSeconds, "trace_seconds");
  checks.range(result.transfer_seconds(), 0.0, kMaxSeconds, "transfer_seconds");
  checks.expect(result.largest_chunk_bytes() <= kMaxChunkBytes, "largest_chunk_bytes",
                fmt::format("at most {}", kMaxChunkBytes));
  const bool prepare = result.kind() == wire::Task::PREPARE;
  checks.expect(result.has_prepared() == prepare, "prepared", prepare ? "film options" : "none for SUB_PASSES");
  if (prepare) {
    checks.part(what_is_wrong(result.prepared()));
    const wire::FilmOptions& film = result.prepared().film();
    const bool radii = film.estimator() != static_cast<std::uint32_t>(Estimator::kPath);
    const std::size_t most = radii ? most_chunks(std::uint64_t{film.width()} * film.height()) : 0;
    checks.expect(chunks <= most && (chunks > 0 || !radii), "chunk_xxh3",
                  fmt::format("at most {} chunks of radii, none for the path tracer", most));
  }
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::ResultChunk& chunk) {
  FieldChecks checks("FromWorker.chunk.");
  checks.name(chunk.job_id(), "job_id");
  checks.expect(chunk.index() < kMaxChunks, "index", fmt::format("below {}", kMaxChunks));
  checks.expect(!chunk.data().empty() && chunk.data().size() <= kMaxChunkBytes, "data",
                fmt::format("1 to {} bytes", kMaxChunkBytes));
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::TaskFailed& failed) {
  FieldChecks checks("FromWorker.failed.");
  checks.name(failed.job_id(), "job_id");
  checks.kind(failed.kind());
  checks.expect(failed.has_unit(), "unit", "a unit");
  checks.unit(failed.unit(), "unit", failed.kind() == wire::Task::PREPARE);
  checks.expect(failed.error_kind() <= kLastErrorKind, "error_kind", "a known kind of error");
  checks.text(failed.message(), "message", kMaxTextBytes);
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::LogLine& log) {
  FieldChecks checks("FromWorker.log.");
  checks.expect(wire::LogLine::Level_IsValid(log.level()), "level", "a known level");
  checks.name_or_empty(log.job_id(), "job_id");
  checks.text(log.text(), "text", kMaxTextBytes);
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::BlobPart& part) {
  FieldChecks checks("ToWorker.blob_part.");
  checks.blob(part.has_blob(), part.blob(), "blob", kMaxBlobBytes);
  checks.text(part.data(), "data", kMaxChunkBytes);
  checks.part(part.blob(), part.offset(), part.data().size());
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::ResultReply& reply) {
  FieldChecks checks("ToWorker.result_reply.");
  checks.name(reply.job_id(), "job_id");
  checks.expect(
      reply.verdict() != wire::ResultReply::VERDICT_UNSPECIFIED && wire::ResultReply::Verdict_IsValid(reply.verdict()),
      "verdict", "WANTED, ACCEPTED or REFUSED");
  checks.expect(static_cast<std::size_t>(reply.missing_size()) <= kMaxChunks, "missing",
                fmt::format("at most {} chunks", kMaxChunks));
  std::uint64_t next = 0;
  for (int i = 0; i < reply.missing_size() && !checks.wrong(); ++i) {
    checks.expect(reply.missing(i) >= next && reply.missing(i) < kMaxChunks, fmt::format("missing[{}]", i),
                  fmt::format("ascending numbers below {}", kMaxChunks));
    next = std::uint64_t{reply.missing(i)} + 1;
  }
  checks.text(reply.reason(), "reason", kMaxTextBytes);
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::Welcome& welcome) {
  FieldChecks checks("ToWorker.welcome.");
  checks.text(welcome.reason(), "reason", kMaxTextBytes);
  checks.range(welcome.ack_wait_seconds(), 0.0, kMaxSeconds, "ack_wait_seconds");
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::JobEnded& ended) {
  FieldChecks checks("ToWorker.job_ended.");
  checks.name(ended.job_id(), "job_id");
  return checks.wrong();
}

}  // namespace

std::optional<std::string> what_is_wrong(const wire::FromWorker& message) {
  FieldChecks checks("FromWorker.");
  checks.version(message.version());
  checks.name(message.worker(), "worker");
  switch (message.body_case()) {
    case wire::FromWorker::kHeartbeat:
      checks.part(what_is_wrong(message.heartbeat()));
      break;
    case wire::FromWorker::kBlobRequest:
      checks.part(what_is_wrong(message.blob_request()));
      break;
    case wire::FromWorker::kResult:
      checks.part(what_is_wrong(message.result()));
      break;
    case wire::FromWorker::kChunk:
      checks.part(what_is_wrong(message.chunk()));
      break;
    case wire::FromWorker::kFailed:
      checks.part(what_is_wrong(message.failed()));
      break;
    case wire::FromWorker::kLog:
      checks.part(what_is_wrong(message.log()));
      break;
    case wire::FromWorker::BODY_NOT_SET:
      checks.expect(false, "body", "a message that this version knows");
      break;
  }
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::ToWorker& message) {
  FieldChecks checks("ToWorker.");
  checks.version(message.version());
  switch (message.body_case()) {
    case wire::ToWorker::kBlobPart:
      checks.part(what_is_wrong(message.blob_part()));
      break;
    case wire::ToWorker::kResultReply:
      checks.part(what_is_wrong(message.result_reply()));
      break;
    case wire::ToWorker::kWelcome:
      checks.part(what_is_wrong(message.welcome()));
      break;
    case wire::ToWorker::kJobEnded:
      checks.part(what_is_wrong(message.job_ended()));
      break;
    case wire::ToWorker::BODY_NOT_SET:
      checks.expect(false, "body", "a message that this version knows");
      break;
  }
  return checks.wrong();
}

std::optional<std::string> what_is_wrong(const wire::Bundle& bundle) {
  FieldChecks checks("Bundle.");
  checks.version(bundle.version());
  checks.expect(!bundle.spec_json().empty(), "spec_json", "a job");
  checks.text(bundle.spec_json(), "spec_json", spec::kMaxSpecBytes);
  checks.expect(static_cast<std::size_t>(bundle.files_size()) <= kMaxBundleFiles, "files",
                fmt::format("at most {} files", kMaxBundleFiles));
  std::set<std::string_view> folders;
  std::string_view before;
  for (int i = 0; i < bundle.files_size() && !checks.wrong(); ++i) {
    const wire::Bundle::File& file = bundle.files(i);
    const std::string field = fmt::format("files[{}]", i);
    const std::string_view path = file.path();
    checks.expect(is_bundle_path(path), field + ".path", "a relative path without empty parts, '.' or '..'");
    checks.expect(before < path, field + ".path", "paths in ascending order, none twice");
    before = path;
    // Any folder of this path sorts before it, so that a file of that name has come already.
    for (std::size_t slash = path.find('/'); slash != std::string_view::npos; slash = path.find('/', slash + 1)) {
      folders.insert(path.substr(0, slash));
    }
    checks.blob(file.has_content(), file.content(), field + ".content", kMaxBlobBytes);
  }
  for (int i = 0; i < bundle.files_size() && !checks.wrong(); ++i) {
    checks.expect(!folders.contains(bundle.files(i).path()), fmt::format("files[{}].path", i),
                  "a file, not the folder of another one");
  }
  return checks.wrong();
}

}  // namespace pf
