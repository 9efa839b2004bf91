#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "coordinator/store/job_record.h"

namespace pf {

std::string checkpoint_identity(const JobRecord& record, const std::string& build_id) {
  return fmt::format("farm spec {} scene {} build {}", image_hash_of_spec(record.spec), record.scene_hash, build_id);
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
                        {"merge_seconds", merge_seconds},
                        {"next_result", next_result}}
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
    note.next_result = json.value("next_result", std::uint64_t{1});
    return note;
  } catch (const nlohmann::json::exception& e) {
    return fail(ErrorKind::kInternal, fmt::format("the checkpoint's note of units is broken: {}", e.what()));
  }
}

}  // namespace pf
