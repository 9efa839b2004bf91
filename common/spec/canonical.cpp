#include <nlohmann/json.hpp>

#include "common/base/hash.h"
#include "common/spec/json_value.h"
#include "common/spec/key_table.h"

namespace pf {
namespace {

/// nlohmann's object sorts its keys, and it writes the shortest digits that read back as the same number.
nlohmann::json to_json(const JobSpec& spec, bool image_only) {
  nlohmann::json document = nlohmann::json::object();
  for (const spec::Key& key : spec::job_keys()) {
    if (image_only && !key.decides_image) continue;
    nlohmann::json& table = key.table.empty() ? document : document[std::string(key.table)];
    table[std::string(key.name)] = spec::json_value(spec, key);
  }
  return document;
}

std::string dump(const nlohmann::json& document) {
  return document.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

std::string canonical_json(const JobSpec& spec) { return dump(to_json(spec, false)); }

std::string image_hash_of_spec(const JobSpec& spec) { return sha256_hex(dump(to_json(spec, true))); }

}  // namespace pf
