#include "common/spec/job_spec.h"

#include <algorithm>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/spec/document.h"
#include "common/spec/key_table.h"
#include "common/spec/reader.h"

namespace pf {
namespace {

using Parser = Result<spec::Value> (*)(std::string_view text, std::string_view origin);

Result<JobSpec> parse_job(Parser parser, std::string_view text, std::string_view origin,
                          const std::vector<std::string>& overrides) {
  if (text.size() > spec::kMaxSpecBytes) {
    return fail(ErrorKind::kInvalidSpec, fmt::format("{}:1:1: the file has {} bytes; expected at most {}", origin,
                                                     text.size(), spec::kMaxSpecBytes));
  }
  const auto document = parser(text, origin);
  if (!document) return tl::unexpected(document.error());
  spec::Reader reader(origin);
  if (auto done = reader.read(*document); !done) return tl::unexpected(done.error());
  for (const std::string& argument : overrides) {
    if (auto done = reader.override_with(argument); !done) return tl::unexpected(done.error());
  }
  return reader.finish();
}

}  // namespace

Result<JobSpec> parse_job_toml(std::string_view text, std::string_view origin,
                               const std::vector<std::string>& overrides) {
  return parse_job(&spec::parse_toml_document, text, origin, overrides);
}

Result<JobSpec> parse_job_json(std::string_view text, std::string_view origin,
                               const std::vector<std::string>& overrides) {
  return parse_job(&spec::parse_json_document, text, origin, overrides);
}

Result<JobSpec> load_job(const std::filesystem::path& file, const std::vector<std::string>& overrides) {
  const auto text = read_file(file, spec::kMaxSpecBytes, ErrorKind::kInvalidSpec);
  if (!text) return tl::unexpected(text.error());
  auto job = file.extension() == ".json" ? parse_job_json(*text, file.string(), overrides)
                                         : parse_job_toml(*text, file.string(), overrides);
  if (job) job->folder = file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
  return job;
}

std::int64_t photon_paths(const JobSpec& spec) {
  if (spec.integrator.photons > 0) return spec.integrator.photons;
  switch (spec.integrator.type) {
    case IntegratorType::kPhotonMap:
    case IntegratorType::kFinalGather:
    case IntegratorType::kIrradianceCache:
      return 500'000;
    default:
      return std::clamp(std::int64_t{2} * spec.image.width * spec.image.height, kFewestPhotonPaths, kMostPhotonPaths);
  }
}

bool may_trace(const JobSpec& spec, std::uint64_t paths) {
  const auto asked = static_cast<std::uint64_t>(photon_paths(spec));
  const IntegratorType type = spec.integrator.type;
  const bool planned = spec.integrator.photons == 0 && (type == IntegratorType::kAuto || type == IntegratorType::kSppm);
  if (!planned) return paths == asked;
  return paths >= static_cast<std::uint64_t>(kFewestPhotonPaths) &&
         paths <= static_cast<std::uint64_t>(kMostPhotonPaths);
}

std::string_view to_string(IntegratorType type) { return spec::integrator_names()[static_cast<std::size_t>(type)]; }

std::string_view to_string(ProgressiveMode mode) { return spec::mode_names()[static_cast<std::size_t>(mode)]; }

}  // namespace pf
