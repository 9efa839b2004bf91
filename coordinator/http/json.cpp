#include "coordinator/http/json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <set>
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

/// First byte and length of the value of the last top-level member `key`. `text` must be valid JSON with an
/// object at its root.
std::pair<std::size_t, std::size_t> extent_of_member(std::string_view text, std::string_view key) {
  std::pair<std::size_t, std::size_t> extent{0, 0};
  std::string_view last_string;
  bool wanted = false;
  std::size_t begin = 0;
  int depth = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') {
      const std::size_t from = i + 1;
      for (++i; text[i] != '"'; ++i) {
        if (text[i] == '\\') ++i;
      }
      if (depth == 1) last_string = text.substr(from, i - from);
    } else if (c == '{' || c == '[') {
      ++depth;
    } else if (c == ':' && depth == 1) {
      wanted = last_string == key;
      begin = i + 1;
    } else if (c == ',' || c == '}' || c == ']') {
      if (depth == 1 && wanted) {
        extent = {begin, i - begin};
        wanted = false;
      }
      if (c != ',') --depth;
    }
  }
  return extent;
}

tl::unexpected<Error> bad(std::string message) {
  return fail(ErrorKind::kInvalidInput, "request body: " + std::move(message));
}

bool is_sha256(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

Result<std::pair<std::string, BlobId>> parse_file(const json& file, std::size_t index) {
  const auto place = [&](std::string_view member) { return fmt::format("files[{}].{}", index, member); };
  if (!file.is_object())
    return bad(fmt::format("files[{}] is not an object; expected path, sha256, bytes", index));
  const auto text = [&](const char* member) {
    const auto found = file.find(member);
    return found != file.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  const std::string path = text("path"), sha256 = text("sha256");
  if (!is_bundle_path(path)) {
    return bad(place("path") + ": expected a relative path below the job's folder without '.' and '..'");
  }
  if (!is_sha256(sha256)) return bad(place("sha256") + ": expected 64 lower-case hexadecimal digits");
  const auto bytes = file.find("bytes");
  if (bytes == file.end() || !bytes->is_number_unsigned() || bytes->get<std::uint64_t>() > kMaxBlobBytes) {
    return bad(fmt::format("{}: expected an integer from 0 to {}", place("bytes"), kMaxBlobBytes));
  }
  return std::pair(path, BlobId{sha256, bytes->get<std::uint64_t>()});
}

}  // namespace

json to_json(const JobView& job) {
  return {{"id", job.id},
          {"name", job.name},
          {"state", to_string(job.state)},
          {"message", job.message},
          {"priority", job.priority},
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

json to_json(const LogEntry& entry) {
  return {{"number", entry.number},
          {"unix_ms", entry.unix_ms},
          {"level", entry.level},
          {"source", entry.source},
          {"text", entry.text}};
}

std::string json_line(const json& value) {
  return value.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

std::string_view place_of(std::string_view message) {
  // From the left, the first `:digits:digits: `: file names may hold colons, and details may quote places of
  // their own.
  const auto digits = [&](std::size_t from) {
    std::size_t end = from;
    while (end < message.size() && std::isdigit(static_cast<unsigned char>(message[end])) != 0) ++end;
    return end;
  };
  for (std::size_t colon = message.find(':'); colon != std::string_view::npos;
       colon = message.find(':', colon + 1)) {
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

Result<Submission> parse_submission(std::string body) {
  const json document = json::parse(body, nullptr, false);
  // The library takes a NUL for the end of its input.
  if (document.is_discarded() || body.find('\0') != std::string::npos) {
    return bad("not valid JSON; expected {\"spec\": {...}, \"files\": [...]}");
  }
  if (!document.is_object()) return bad("not a JSON object; expected {\"spec\": {...}, \"files\": [...]}");
  for (const auto& [key, value] : document.items()) {
    if (key != "spec" && key != "files")
      return bad(fmt::format("unknown member '{}'; expected spec and files", key));
  }
  if (!document.contains("spec") || !document["spec"].is_object()) {
    return bad("spec: expected an object, the job model as JSON");
  }
  if (!document.contains("files") || !document["files"].is_array()) return bad("files: expected an array");
  if (document["files"].size() > kMaxBundleFiles) {
    return bad(
        fmt::format("files: {} of them; expected at most {}", document["files"].size(), kMaxBundleFiles));
  }
  Submission submission;
  std::set<std::string> paths;
  for (std::size_t i = 0; i < document["files"].size(); ++i) {
    auto file = parse_file(document["files"][i], i);
    if (!file) return tl::unexpected(file.error());
    if (!paths.insert(file->first).second)
      return bad(fmt::format("files[{}].path: '{}' comes twice", i, file->first));
    submission.files.push_back(std::move(*file));
  }
  const auto [begin, length] = extent_of_member(body, "spec");
  if (length == 0) return bad("spec: its name must be written without escapes");
  for (std::size_t i = 0; i < body.size(); ++i) {
    if ((i < begin || i >= begin + length) && body[i] != '\n') body[i] = ' ';
  }
  body.resize(begin + length);
  submission.spec_json = std::move(body);
  return submission;
}

}  // namespace pf
