#include "jobs/submission.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <array>
#include <set>
#include <system_error>
#include <utility>

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
  const auto hashed = hashed_files_of_job(spec);
  if (!hashed) return tl::unexpected(hashed.error());
  std::vector<SubmittedFile> files;
  for (const auto& [path, id] : *hashed) files.push_back({path, spec.folder / path, id});
  return files;
}

json submission_body(const JobSpec& spec, const std::vector<SubmittedFile>& files) {
  json listed = json::array();
  for (const SubmittedFile& file : files)
    listed.push_back({{"path", file.path}, {"sha256", file.id.sha256}, {"bytes", file.id.bytes}});
  return {{"spec", json::parse(canonical_json(spec))}, {"files", std::move(listed)}};
}

Result<void> upload_files(ServiceClient& client, const std::vector<SubmittedFile>& files) {
  std::set<std::string> sent;
  for (const SubmittedFile& file : files) {
    if (!sent.insert(file.id.sha256).second) continue;
    if (auto uploaded = upload(client, file); !uploaded) return uploaded;
  }
  return {};
}

namespace {

Result<json> post_job(ServiceClient& client, const JobSpec& spec, const std::vector<SubmittedFile>& files,
                      const std::string& path) {
  const auto key = new_key();
  if (!key) return tl::unexpected(key.error());
  return client.ask({.method = "POST",
                     .path = path,
                     .headers = {{"Idempotency-Key", *key}},
                     .body = submission_body(spec, files).dump()},
                    true);
}

}  // namespace

Result<json> submit_known_files(ServiceClient& client, const JobSpec& spec, const std::vector<SubmittedFile>& files) {
  for (const SubmittedFile& file : files) {
    const auto head = client.call({.method = "HEAD", .path = "/v1/blobs/" + file.id.sha256});
    if (!head) return tl::unexpected(head.error());
    if (head->status == 404) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("{} does not have {} any more (SHA-256 {}); expected --scene FOLDER with the job's files",
                              client.url(), file.path, file.id.sha256));
    }
    if (head->status != 200) return tl::unexpected(client.check(*head).error());
  }
  return post_job(client, spec, files, std::string(kJobsPath));
}

Result<json> submit_job(ServiceClient& client, const JobSpec& spec, const std::vector<SubmittedFile>& files,
                        const std::string& path) {
  if (auto uploaded = upload_files(client, files); !uploaded) return tl::unexpected(uploaded.error());
  return post_job(client, spec, files, path);
}

}  // namespace pf
