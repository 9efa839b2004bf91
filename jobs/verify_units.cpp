#include "jobs/verify_units.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <ostream>
#include <random>
#include <utility>

#include <fmt/format.h>

#include "build_id.h"
#include "jobs/job_text.h"
#include "jobs/process.h"
#include "jobs/provenance.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// Units whose sums came in one result, and the hash that this result had.
struct ResultUnits {
  std::string hash;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> units;  ///< first, count
  [[nodiscard]] std::string text() const {
    std::string all;
    for (const auto& [first, count] : units) all += fmt::format("{}{}:{}", all.empty() ? "" : ",", first, count);
    return all;
  }
};

std::vector<ResultUnits> results_of(const json& units) {
  std::map<std::string, ResultUnits> by_hash;
  for (const json& unit : units) {
    const std::string hash = job_text(unit, "sums_hash");
    if (job_text(unit, "state") != "done" || hash.empty()) continue;
    ResultUnits& result = by_hash[hash];
    result.hash = hash;
    result.units.emplace_back(static_cast<std::uint64_t>(job_number(unit, "first")),
                              static_cast<std::uint64_t>(job_number(unit, "count")));
  }
  std::vector<ResultUnits> results;
  results.reserve(by_hash.size());
  for (auto& [hash, result] : by_hash) results.push_back(std::move(result));
  return results;
}

Result<void> fetch(ServiceClient& client, const std::string& path, const fs::path& file) {
  std::ofstream out(file, std::ios::binary);
  ServiceCall call{.path = path};
  call.take = [&](std::string_view piece) {
    return static_cast<bool>(out.write(piece.data(), static_cast<std::streamsize>(piece.size())));
  };
  const auto reply = client.call(call);
  if (!reply) return tl::unexpected(reply.error());
  if (auto checked = client.check(*reply); !checked) return checked;
  out.close();
  return out ? Result<void>() : fail(ErrorKind::kInternal, file.string() + ": cannot be written");
}

/// What the renderer makes of these units: one object each, {"units", "hash"} or {"units", "cannot"}.
Result<json> recompute(const ClientCommand& command, const fs::path& job, const fs::path& checkpoint,
                       const std::vector<ResultUnits>& results) {
  Arguments arguments = {"unit", job.string(), "--checkpoint", checkpoint.string()};
  for (const ResultUnits& result : results) arguments.insert(arguments.end(), {"--units", result.text()});
  const auto run = run_and_capture(command.context().folder / "photonfarm-worker", arguments, kRenderSeconds);
  if (!run) return tl::unexpected(run.error());
  json document = json::parse(run->output, nullptr, false);
  if (run->end.exit_code != 0 || !document.is_object() || !document.contains("results") ||
      document["results"].size() != results.size())
    return fail(ErrorKind::kInternal, fmt::format("recomputing failed with exit code {}", run->end.exit_code));
  return document["results"];
}

int report(const ClientCommand& command, const std::string& id, const std::vector<ResultUnits>& chosen,
           const json& again, std::size_t known) {
  std::size_t same = 0, different = 0, impossible = 0;
  json list = json::array();
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const std::string hash = job_text(again[i], "hash");
    const char* verdict = hash.empty() ? "cannot" : hash == chosen[i].hash ? "same" : "different";
    ++(hash.empty() ? impossible : hash == chosen[i].hash ? same : different);
    list.push_back({{"units", chosen[i].text()}, {"kept", chosen[i].hash}, {"recomputed", hash}, {"verdict", verdict}});
    if (different > 0 && !command.json() && hash != chosen[i].hash && !hash.empty())
      command.context().out << fmt::format("  sub-passes {}: the coordinator kept {}, here {}\n", chosen[i].text(),
                                           chosen[i].hash, hash);
  }
  if (command.json()) {
    command.print({{"job", id},
                   {"results", list},
                   {"same", same},
                   {"different", different},
                   {"not_possible", impossible},
                   {"known", known}});
  } else {
    command.context().out << fmt::format(
        "{}: {} of {} results recomputed from spec and scene by the same build: {} the same, {} "
        "different{}\n",
        id, same + different, known, same, different,
        impossible > 0 ? fmt::format("; {} cannot be: the radii of their rounds are gone", impossible) : std::string());
    if (same + different == 0)
      command.context().out << "nothing was shown; 'photonfarm verify IMAGE.exr' renders the whole image\n";
  }
  return different > 0 ? exit_code(ErrorKind::kInternal) : 0;
}

}  // namespace

int verify_units(ClientCommand& command, const std::string& what, const std::string& scene,
                 const VerifyUnitsOptions& options, const fs::path& scratch) {
  const auto job = find_job(command.client(), what, true);
  if (!job) return command.report(job.error());
  const std::string id = job_text(*job, "id"), path = "/v1/jobs/" + id;
  const fs::path image = scratch / "image.exr", checkpoint = scratch / "film.checkpoint";
  if (auto got = fetch(command.client(), path + "/image.exr", image); !got) return command.report(got.error());
  if (auto got = fetch(command.client(), path + "/checkpoint", checkpoint); !got) return command.report(got.error());
  auto origin = read_origin(image);
  if (!origin) return command.report(origin.error());
  if (origin->build_id != kBuildId) {
    return command.report(
        {ErrorKind::kUsage, fmt::format("{}: is of build {}, this is {}; only the same build gives the same sums", id,
                                        origin->build_id, kBuildId)});
  }
  const auto scene_found =
      scene.empty() ? fetch_scene(command.client(), *origin, scratch / "fetched") : use_scene_folder(*origin, scene);
  if (!scene_found) return command.report(scene_found.error());
  const auto laid_out = lay_out_job(*origin, scratch / "scene");
  if (!laid_out) return command.report(laid_out.error());
  const auto units = all_units(command.client(), id);
  if (!units) return command.report(units.error());
  std::vector<ResultUnits> results = results_of(*units);
  const std::size_t known = results.size();
  std::mt19937_64 random(options.seed ? *options.seed : std::random_device{}());
  std::ranges::shuffle(results, random);
  if (results.size() > static_cast<std::size_t>(options.count)) results.resize(static_cast<std::size_t>(options.count));
  if (results.empty())
    return command.report({ErrorKind::kInternal, fmt::format("{}: the service keeps no hashes of its units", id)});
  const auto again = recompute(command, *laid_out, checkpoint, results);
  if (!again) return command.report(again.error());
  return report(command, id, results, *again, known);
}

}  // namespace pf
