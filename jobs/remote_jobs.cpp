#include "jobs/remote_jobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "common/base/nearest_name.h"
#include "jobs/job_text.h"

namespace pf {
namespace {

using nlohmann::json;

/// Takes server-sent events apart and gives the data of each.
class EventReader {
 public:
  explicit EventReader(std::function<void(const std::string&)> take) : take_(std::move(take)) {}
  void read(std::string_view piece) {
    for (const char c : piece) {
      if (c != '\n') {
        line_ += c;
        continue;
      }
      constexpr std::string_view kData = "data: ";
      if (line_.starts_with(kData)) take_(line_.substr(kData.size()));
      line_.clear();
    }
  }

 private:
  std::function<void(const std::string&)> take_;
  std::string line_;
};

}  // namespace

Result<json> list_jobs(ServiceClient& client, const std::string& state, bool patient) {
  json all = json::array();
  std::string before;
  do {
    std::string path = "/v1/jobs?";
    if (!state.empty()) path += "state=" + state + "&";
    if (!before.empty()) path += "before=" + before;
    path.erase(path.find_last_not_of("?&") + 1);
    auto page = client.ask({.path = path}, patient);
    if (!page) return page;
    const json jobs = page->value("jobs", json::array());
    if (!jobs.is_array()) break;
    all.insert(all.begin(), jobs.begin(), jobs.end());
    const std::string next = job_text(*page, "before");
    if (next == before || !is_path_segment(next)) break;
    before = next;
  } while (true);
  return all;
}

Result<json> find_job(ServiceClient& client, const std::string& what, bool patient) {
  auto listed = list_jobs(client, "", patient);
  if (!listed) return listed;
  const json& jobs = *listed;
  std::vector<const json*> named, begun;
  std::vector<std::string> known;
  for (const json& job : jobs) {
    const std::string id = job_text(job, "id"), name = job_text(job, "name");
    if (id == what) return job;
    if (name == what) named.push_back(&job);
    if (id.starts_with(what)) begun.push_back(&job);
    known.insert(known.end(), {id, name});
  }
  if (!named.empty()) {
    return **std::ranges::max_element(named, {}, [](const json* job) { return job_number(*job, "submitted_unix_ms"); });
  }
  if (begun.size() == 1 && !what.empty()) return *begun.front();
  if (begun.size() > 1 && !what.empty()) {
    return fail(ErrorKind::kUsage,
                fmt::format("'{}' begins the ids of {} jobs, among them {} and {}; expected more of it", what,
                            begun.size(), job_text(*begun[0], "id"), job_text(*begun[1], "id")));
  }
  std::string message =
      fmt::format("{} knows no job '{}'; expected an id, the begin of one, or a job's name", client.url(), what);
  if (const auto near = nearest_name(what, std::span<const std::string>(known)))
    message += fmt::format("; did you mean '{}'?", *near);
  return fail(ErrorKind::kUsage, message);
}

Result<json> all_units(ServiceClient& client, const std::string& id) {
  json units = json::array();
  std::optional<double> after;
  while (true) {
    std::string path = "/v1/jobs/" + id + "/units";
    if (after) path += fmt::format("?after={:.0f}", *after);
    auto page = client.ask({.path = path}, true);
    if (!page) return page;
    const json more = page->value("units", json::array());
    if (!more.is_array() || more.empty()) return units;
    const double last = job_number(more.back(), "first");
    // A service that knows no pages sends the same ones again.
    if (after && last <= *after) return units;
    units.insert(units.end(), more.begin(), more.end());
    after = last;
  }
}

Result<json> watch_job(ServiceClient& client, const std::string& id, const std::function<void(const json&)>& show) {
  json last;
  while (true) {
    EventReader reader([&](const std::string& data) {
      json job = json::parse(data, nullptr, false);
      if (!job.is_object()) return;
      last = std::move(job);
      show(last);
    });
    ServiceCall call{.path = "/v1/jobs/" + id + "/events"};
    call.take = [&](std::string_view piece) {
      reader.read(piece);
      return true;
    };
    const auto reply = client.call(call);
    if (job_has_ended(last)) return last;
    if (reply && reply->status != 200) return tl::unexpected(client.check(*reply).error());
    // The stream broke off: the coordinator stopped. `call` was as patient as it may be about reaching it.
    Error error{ErrorKind::kUnavailable, client.url() + ": ends the events of a job that has not ended"};
    if (!reply) return tl::unexpected(reply.error());
    if (auto waited = client.wait_to_retry(error); !waited) return tl::unexpected(waited.error());
  }
}

}  // namespace pf
