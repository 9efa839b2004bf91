// What clients post, taken apart.

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <utility>

#include "common/wire/limits.h"
#include "common/wire/messages.h"
#include "coordinator/http/json.h"

namespace pf {
namespace {

using nlohmann::json;

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
  if (!file.is_object()) return bad(fmt::format("files[{}] is not an object; expected path, sha256, bytes", index));
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

Result<json> parse_object(const std::string& body, std::string_view expected) {
  json document = json::parse(body, nullptr, false);
  // The library takes a NUL for the end of its input.
  if (document.is_discarded() || body.find('\0') != std::string::npos)
    return bad(fmt::format("not valid JSON; expected {}", expected));
  if (!document.is_object()) return bad(fmt::format("not a JSON object; expected {}", expected));
  return document;
}

/// Hands each member to `take`, which returns what was expected instead, or nothing when all is well.
template <typename Take>
Result<void> take_members(const std::string& body, std::string_view expected, const Take& take) {
  const auto document = parse_object(body, expected);
  if (!document) return tl::unexpected(document.error());
  if (document->empty()) return bad(fmt::format("empty; expected {}", expected));
  for (const auto& [key, value] : document->items()) {
    const std::optional<std::string_view> wrong = take(key, value);
    if (!wrong) continue;
    if (wrong->empty()) return bad(fmt::format("unknown member '{}'; expected {}", key, expected));
    return bad(fmt::format("{}: expected {}", key, *wrong));
  }
  return {};
}

std::optional<std::string_view> take_count(const json& value, std::optional<std::int64_t>& to) {
  constexpr std::int64_t kMost = std::int64_t{1} << 32;
  if (!value.is_number_integer() || value < 0 || value > kMost) return "a whole number from 0";
  to = value.get<std::int64_t>();
  return std::nullopt;
}

std::optional<std::string_view> take_number(const json& value, std::optional<double>& to) {
  if (!value.is_number() || !std::isfinite(value.get<double>()) || value.get<double>() < 0) return "a number from 0";
  to = value.get<double>();
  return std::nullopt;
}

}  // namespace

Result<Submission> parse_submission(std::string body, FilesMember files) {
  auto parsed = parse_object(body, R"({"spec": {...}, "files": [...]})");
  if (!parsed) return tl::unexpected(parsed.error());
  json& document = *parsed;
  if (files == FilesMember::kOptional && !document.contains("files")) document["files"] = json::array();
  for (const auto& [key, value] : document.items()) {
    if (key != "spec" && key != "files") return bad(fmt::format("unknown member '{}'; expected spec and files", key));
  }
  if (!document.contains("spec") || !document["spec"].is_object()) {
    return bad("spec: expected an object, the job model as JSON");
  }
  if (!document.contains("files") || !document["files"].is_array()) return bad("files: expected an array");
  if (document["files"].size() > kMaxBundleFiles) {
    return bad(fmt::format("files: {} of them; expected at most {}", document["files"].size(), kMaxBundleFiles));
  }
  Submission submission;
  std::set<std::string> paths;
  for (std::size_t i = 0; i < document["files"].size(); ++i) {
    auto file = parse_file(document["files"][i], i);
    if (!file) return tl::unexpected(file.error());
    if (!paths.insert(file->first).second) return bad(fmt::format("files[{}].path: '{}' comes twice", i, file->first));
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

Result<bool> parse_cancel(const std::string& body) {
  bool discard = false;
  const auto taken =
      take_members(body, R"({"discard": true or false})", [&](const std::string& key, const json& value) {
        if (key != "discard") return std::optional<std::string_view>("");
        if (!value.is_boolean()) return std::optional<std::string_view>("true or false");
        discard = value.get<bool>();
        return std::optional<std::string_view>();
      });
  if (!taken) return tl::unexpected(taken.error());
  return discard;
}

Result<StopChange> parse_stops(const std::string& body) {
  StopChange stops;
  const auto taken = take_members(body, R"({"passes": N, "seconds": S, "error": E}, at least one of them)",
                                  [&](const std::string& key, const json& value) -> std::optional<std::string_view> {
                                    if (key == "passes") return take_count(value, stops.passes);
                                    if (key == "seconds") return take_number(value, stops.seconds);
                                    if (key == "error") return take_number(value, stops.error);
                                    return "";
                                  });
  if (!taken) return tl::unexpected(taken.error());
  return stops;
}

Result<JobChange> parse_change(const std::string& body) {
  JobChange change;
  const auto whole = [](const json& value, std::optional<int>& to) -> std::optional<std::string_view> {
    std::optional<std::int64_t> number;
    const auto wrong = take_count(value, number);
    constexpr std::int64_t kMost = 1 << 20;  // the job says what it permits
    if (!wrong) to = static_cast<int>(std::min(*number, kMost));
    return wrong;
  };
  const auto taken = take_members(body, R"({"priority": 0..100, "max_workers": N}, at least one of them)",
                                  [&](const std::string& key, const json& value) -> std::optional<std::string_view> {
                                    if (key == "priority") return whole(value, change.priority);
                                    if (key == "max_workers") return whole(value, change.max_workers);
                                    return "";
                                  });
  if (!taken) return tl::unexpected(taken.error());
  return change;
}

}  // namespace pf
