// Any bytes as a job file: no crash, no hang, one-line errors, and canonical forms that read back as the same
// job.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>
#include <vector>

#include "common/spec/document.h"
#include "common/spec/job_spec.h"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

void check(const pf::Result<pf::JobSpec>& job) {
  if (!job) {
    const std::string& message = job.error().message;
    require(!message.empty() && job.error().kind == pf::ErrorKind::kInvalidSpec);
    require(pf::spec::printable(message, message.size()) == message);  // one line of valid UTF-8
    return;
  }
  const std::string canonical = pf::canonical_json(*job);
  const auto again = pf::parse_job_json(canonical, "canonical");
  require(again.has_value() && pf::canonical_json(*again) == canonical);
  require(pf::image_hash_of_spec(*again) == pf::image_hash_of_spec(*job));
}

}  // namespace

/// The first byte chooses what the rest is: TOML, JSON, or one override a line for a valid job.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data + 1), size - 1);
  switch (data[0]) {
    case 'T':
      check(pf::parse_job_toml(text, "fuzz"));
      break;
    case 'J':
      check(pf::parse_job_json(text, "fuzz"));
      break;
    default: {
      std::vector<std::string> overrides(1);
      for (const char c : text) {
        if (c == '\n') {
          overrides.emplace_back();
        } else {
          overrides.back() += c;
        }
      }
      check(pf::parse_job_toml("job.name = 'fuzz'\nscene.file = 'fuzz.glb'\n", "fuzz", overrides));
    }
  }
  return 0;
}
