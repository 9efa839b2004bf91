#include "coordinator/http/json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <utility>

#include "common/wire/limits.h"
#include "common/wire/messages.h"

namespace pf {
namespace {

using nlohmann::json;

template <typename T>
json or_null(const std::optional<T>& value) {
  return value ? json(*value) : json(nullptr);
}

}  // namespace

json to_json(const JobView& job) {
  return {{"id", job.id},
          {"name", job.name},
          {"state", to_string(job.state)},
          {"message", job.message},
          {"priority", job.priority},
          {"max_workers", job.max_workers},
          {"submitted_by", job.submitted_by},
          {"paused_by", job.paused_by},
          {"extended", job.extended},
          {"expired", job.expired},
          {"algorithm", job.algorithm},
          {"width", job.width},
          {"height", job.height},
          {"passes_done", job.passes_done},
          {"passes_wanted", job.passes_wanted},
          {"stop_seconds", job.stop_seconds},
          {"stop_error", job.stop_error},
          {"rounds", job.rounds},
          {"estimated_error", or_null(job.estimated_error)},
          {"seconds", job.seconds},
          {"seconds_left", or_null(job.seconds_left)},
          {"rays", job.rays},
          {"photon_paths", job.photon_paths},
          {"rays_per_second", job.rays_per_second},
          {"passes_per_second", job.passes_per_second},
          {"workers", job.workers},
          {"units_done", job.units_done},
          {"units_repeated", job.units_repeated},
          {"bytes_received", job.bytes_received},
          {"merge_seconds", job.merge_seconds},
          {"image_hash", job.image_hash},
          {"scene_hash", job.scene_hash},
          {"spec_hash", job.spec_hash},
          {"warnings", job.warnings},
          {"submitted_unix_ms", job.submitted_unix_ms},
          {"started_unix_ms", job.started_unix_ms},
          {"ended_unix_ms", job.ended_unix_ms}};
}

json to_json(const WorkerView& worker) {
  return {{"name", worker.name},
          {"host", worker.host},
          {"process", worker.process},
          {"state", worker.state},
          {"message", worker.message},
          {"job_id", worker.job_id},
          {"units_held", worker.units_held},
          {"rays", worker.rays},
          {"sub_passes", worker.sub_passes},
          {"seconds_since_heard", worker.seconds_since_heard}};
}

json to_json(const UnitView& unit) {
  return {
      {"first", unit.first},     {"count", unit.count},       {"part", unit.part.empty() ? json() : json(unit.part)},
      {"state", unit.state},     {"attempts", unit.attempts}, {"worker", unit.worker},
      {"seconds", unit.seconds}, {"result", unit.result},     {"sums_hash", unit.sums_hash}};
}

json to_json(const ConvergencePoint& point) {
  return {{"seconds", point.seconds},
          {"passes", point.passes},
          {"rounds", point.rounds},
          {"rays", point.rays},
          {"estimated_error", or_null(point.estimated_error)}};
}

json to_json(const LogEntry& entry) {
  return {{"number", entry.number},
          {"unix_ms", entry.unix_ms},
          {"level", entry.level},
          {"source", entry.source},
          {"text", entry.text}};
}

std::string json_line(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace) + "\n"; }

std::string_view place_of(std::string_view message) {
  // From the left, the first `:digits:digits: `: file names may hold colons, and details may quote places of
  // their own.
  const auto digits = [&](std::size_t from) {
    std::size_t end = from;
    while (end < message.size() && std::isdigit(static_cast<unsigned char>(message[end])) != 0) ++end;
    return end;
  };
  for (std::size_t colon = message.find(':'); colon != std::string_view::npos; colon = message.find(':', colon + 1)) {
    const std::size_t line = digits(colon + 1);
    if (colon == 0 || line == colon + 1 || line >= message.size() || message[line] != ':') continue;
    const std::size_t column = digits(line + 1);
    if (column > line + 1 && message.substr(column).starts_with(": ")) return message.substr(0, column);
  }
  return {};
}

std::string_view status_title(int status) {
  switch (status) {
    case 200:
      return "OK";
    case 400:
      return "Bad Request";
    case 401:
      return "Unauthorized";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 410:
      return "Gone";
    case 405:
      return "Method Not Allowed";
    case 408:
      return "Request Timeout";
    case 409:
      return "Conflict";
    case 411:
      return "Length Required";
    case 413:
      return "Content Too Large";
    case 414:
      return "URI Too Long";
    case 415:
      return "Unsupported Media Type";
    case 416:
      return "Range Not Satisfiable";
    case 422:
      return "Unprocessable Content";
    case 429:
      return "Too Many Requests";
    case 431:
      return "Request Header Fields Too Large";
    case 500:
      return "Internal Server Error";
    case 503:
      return "Service Unavailable";
    default:
      return status < 400 ? "OK" : "Error";
  }
}

std::string_view problem_type(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
      return "not-found";
    case ErrorKind::kInvalidSpec:
      return "invalid-spec";
    case ErrorKind::kInvalidInput:
      return "invalid-input";
    case ErrorKind::kUnavailable:
    case ErrorKind::kTimeout:
    case ErrorKind::kInterrupted:
      return "unavailable";
    case ErrorKind::kInternal:
      return "internal";
  }
  return "internal";
}

std::string problem_json(int status, std::string_view type, std::string_view detail) {
  json problem = {{"type", fmt::format("urn:photonfarm:problem:{}", type)},
                  {"title", status_title(status)},
                  {"status", status},
                  {"detail", detail}};
  if (const std::string_view place = place_of(detail); !place.empty()) problem["place"] = place;
  return json_line(problem);
}

}  // namespace pf
