#include "coordinator/http/notifier.h"

#include <algorithm>
#include <array>
#include <system_error>

#include <fmt/format.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "coordinator/http/json.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{64} << 20;

}  // namespace

Result<Notifier> Notifier::open(std::filesystem::path file, std::function<std::int64_t()> unix_ms) {
  Notifier notifier(std::move(file), std::move(unix_ms));
  std::error_code ignored;
  if (std::filesystem::exists(notifier.file_, ignored)) {
    if (auto loaded = notifier.load(); !loaded) return tl::unexpected(loaded.error());
    return notifier;
  }
  notifier.since_ = notifier.unix_ms_();
  if (auto saved = notifier.save(); !saved) return tl::unexpected(saved.error());
  return notifier;
}

Result<void> Notifier::load() {
  const auto text = read_file(file_, kMaxFileBytes);
  if (!text) return tl::unexpected(text.error());
  try {
    const json document = json::parse(*text);
    since_ = document.at("since").get<std::int64_t>();
    noted_ = document.at("noted").get<std::map<std::string, std::int64_t>>();
    for (const auto& [id, pending] : document.at("pending").items()) {
      pending_[id] = {pending.at("body").get<std::string>(), pending.at("attempts").get<int>(),
                      pending.at("next_unix_ms").get<std::int64_t>()};
    }
  } catch (const json::exception&) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: is damaged; remove it: jobs that ended so far are then not told of", file_.string()));
  }
  return {};
}

Result<void> Notifier::save() const {
  json pending = json::object();
  for (const auto& [id, p] : pending_)
    pending[id] = {{"body", p.body}, {"attempts", p.attempts}, {"next_unix_ms", p.next_unix_ms}};
  const json document = {{"since", since_}, {"noted", noted_}, {"pending", std::move(pending)}};
  return write_file_atomically(file_, document.dump(-1, ' ', false, json::error_handler_t::replace) + "\n",
                               FileAccess::kOwnerOnly);
}

Result<void> Notifier::look(const std::vector<JobView>& jobs) {
  std::map<std::string, std::int64_t> noted;
  bool changed = false;
  for (const JobView& job : jobs) {
    const auto before = noted_.find(job.id);
    const std::int64_t last = before == noted_.end() ? 0 : before->second;
    if (last != 0) noted[job.id] = last;
    // A job that was extended ends again.
    if (!has_ended(job.state) || job.ended_unix_ms < since_ || job.ended_unix_ms == last) continue;
    noted[job.id] = job.ended_unix_ms;
    const std::string id = fmt::format("{}-{}", job.id, job.ended_unix_ms);
    pending_[id] = {json_line({{"event", "job.ended"}, {"delivery", id}, {"job", to_json(job)}}), 0, unix_ms_()};
    changed = true;
  }
  changed = changed || noted.size() != noted_.size();
  noted_ = std::move(noted);
  return changed ? save() : Result<void>();
}

std::optional<Notice> Notifier::due() const {
  const auto earliest = std::ranges::min_element(pending_, {}, [](const auto& p) { return p.second.next_unix_ms; });
  if (earliest == pending_.end() || earliest->second.next_unix_ms > unix_ms_()) return std::nullopt;
  return Notice{earliest->first, earliest->second.body};
}

Result<bool> Notifier::tried(const std::string& id, bool arrived) {
  const auto found = pending_.find(id);
  if (found == pending_.end()) return true;
  Pending& pending = found->second;
  bool goes_on = true;
  if (arrived || ++pending.attempts >= kMostAttempts) {
    goes_on = arrived;
    pending_.erase(found);
  } else {
    pending.next_unix_ms = unix_ms_() + std::min(kLongestPause, kFirstPause << std::min(pending.attempts - 1, 20));
  }
  if (auto saved = save(); !saved) return tl::unexpected(saved.error());
  return goes_on;
}

std::string webhook_signature(std::string_view secret, std::int64_t unix_seconds, std::string_view body) {
  const std::string text = fmt::format("{}.{}", unix_seconds, body);
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size);
  std::string hex;
  for (unsigned i = 0; i < size; ++i) hex += fmt::format("{:02x}", digest[i]);
  return fmt::format("t={},v1={}", unix_seconds, hex);
}

}  // namespace pf
