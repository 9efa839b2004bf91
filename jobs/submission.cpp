#include "jobs/submission.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <array>
#include <set>
#include <system_error>
#include <utility>

#include "common/base/hash.h"
#include "common/wire/bundle.h"

namespace pf {
namespace {

using nlohmann::json;

/// Names this submission, so that a repetition of it is no second one.
Result<std::string> new_key() {
  std::array<unsigned char, 16> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) {
    return fail(ErrorKind::kInternal, "the system gives no random bytes");
  }
  std::string key;
  for (const unsigned char byte : random) key += fmt::format("{:02x}", byte);
  return key;
}

Result<void> upload(ServiceClient& client, const SubmittedFile& file) {
  const std::string address = "/v1/blobs/" + file.id.sha256;
  const auto head = client.call({.method = "HEAD", .path = address});
  if (!head) return tl::unexpected(head.error());
  if (head->status == 200) return {};
  if (head->status != 404) return client.check(*head);
  const auto put = client.call({.method = "PUT", .path = address, .file = file.source});
  if (!put) return tl::unexpected(put.error());
  if (auto checked = client.check(*put); !checked) {
    return fail(checked.error().kind, fmt::format("{}: {}", file.source.string(), checked.error().message));
  }
  return {};
}

}  // namespace

Result<std::vector<SubmittedFile>> hash_files(const JobSpec& spec) {
  const auto bundle = files_of_job(spec);
  if (!bundle) return tl::unexpected(bundle.error());
  std::vector<SubmittedFile> files;
  for (const BundleFile& file : *bundle) {
    auto hash = sha256_hex_of_file(file.source);
    if (!hash) return tl::unexpected(hash.error());
    std::error_code error;
    const std::uint64_t bytes = std::filesystem::file_size(file.source, error);
    if (error)
      return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.source.string(), error.message()));
    files.push_back({file.path, file.source, {std::move(*hash), bytes}});
  }
  return files;
}

Result<json> submit_job(ServiceClient& client, const JobSpec& spec, const std::vector<SubmittedFile>& files) {
  const auto key = new_key();
  if (!key) return tl::unexpected(key.error());
  json listed = json::array();
  std::set<std::string> sent;
  for (const SubmittedFile& file : files) {
    listed.push_back({{"path", file.path}, {"sha256", file.id.sha256}, {"bytes", file.id.bytes}});
    if (!sent.insert(file.id.sha256).second) continue;
    if (auto uploaded = upload(client, file); !uploaded) return tl::unexpected(uploaded.error());
  }
  const json body = {{"spec", json::parse(canonical_json(spec))}, {"files", std::move(listed)}};
  return client.ask(
      {.method = "POST", .path = "/v1/jobs", .headers = {{"Idempotency-Key", *key}}, .body = body.dump()},
      true);
}

}  // namespace pf
