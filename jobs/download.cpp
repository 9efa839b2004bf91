// Downloads that resume: what has come lies beside the target as `.NAME.<16 digits>.part`, the digits being a
// hash of the job and of the content's ETag, so that parts of two contents never meet.

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/base/hash.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kDigits = 16;
constexpr std::string_view kEnd = ".part";

tl::unexpected<Error> disk_failure(const fs::path& file, std::string_view what) {
  const int error = errno;
  return fail(ErrorKind::kInternal,
              fmt::format("{}: {}: {}", file.string(), what, std::generic_category().message(error)));
}

/// What has come so far of a file.
class PartialFile {
 public:
  static Result<PartialFile> open(const fs::path& path) {
    PartialFile file(::open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666), path);
    struct ::stat status = {};
    if (file.fd_ < 0 || ::fstat(file.fd_, &status) != 0) return disk_failure(path, "cannot write");
    file.bytes_ = static_cast<std::uint64_t>(status.st_size);
    return file;
  }
  PartialFile(PartialFile&& other) noexcept
      : fd_(std::exchange(other.fd_, -1)), path_(std::move(other.path_)), bytes_(other.bytes_) {}
  PartialFile& operator=(PartialFile&&) = delete;
  ~PartialFile() {
    if (fd_ >= 0) ::close(fd_);
  }

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  Result<void> clear() {
    bytes_ = 0;
    if (::ftruncate(fd_, 0) != 0) return disk_failure(path_, "cannot write");
    return {};
  }
  Result<void> append(std::string_view piece) {
    while (!piece.empty()) {
      const ssize_t done = ::pwrite(fd_, piece.data(), piece.size(), static_cast<off_t>(bytes_));
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) return disk_failure(path_, "cannot write");
      piece.remove_prefix(static_cast<std::size_t>(done));
      bytes_ += static_cast<std::uint64_t>(done);
    }
    return {};
  }
  Result<void> become(const fs::path& target) {
    if (::fsync(fd_) != 0) return disk_failure(path_, "cannot write to disk");
    if (::rename(path_.c_str(), target.c_str()) != 0) return disk_failure(target, "cannot replace");
    return {};
  }

 private:
  PartialFile(int fd, fs::path path) : fd_(fd), path_(std::move(path)) {}
  int fd_;
  fs::path path_;
  std::uint64_t bytes_ = 0;
};

std::string part_name(const fs::path& target, std::string_view id, std::string_view etag) {
  return fmt::format(".{}.{:0{}x}{}", target.filename().string(), xxh3_64(fmt::format("{}\n{}", id, etag)), kDigits,
                     kEnd);
}

/// Removes parts of other contents of the same target.
void remove_other_parts(const fs::path& target, const std::string& mine) {
  const std::string before = fmt::format(".{}.", target.filename().string());
  std::error_code error;
  for (fs::directory_iterator entry(target.parent_path(), error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name != mine && name.size() == mine.size() && name.starts_with(before) && name.ends_with(kEnd)) {
      std::error_code ignored;
      fs::remove(entry->path(), ignored);
    }
  }
}

std::string header(const ServiceReply& reply, const char* name) {
  const auto found = reply.headers.find(name);
  return found == reply.headers.end() ? std::string() : found->second;
}

std::optional<std::uint64_t> number(const std::string& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// One connection's worth of content appended to `part`. Errors: kUnavailable when less than all came: try
/// again.
Result<void> fetch_rest(ServiceClient& client, const std::string& address, const std::string& etag, std::uint64_t bytes,
                        PartialFile& part) {
  Result<void> stored;
  ServiceCall call{.path = address};
  if (part.bytes() > 0) call.headers = {{"Range", fmt::format("bytes={}-", part.bytes())}, {"If-Range", etag}};
  call.begin = [&](const ServiceReply& head) {
    if (header(head, "etag") != etag) {
      stored = fail(ErrorKind::kUnavailable, client.url() + ": the file was replaced meanwhile");
    } else if (head.status == 200) {
      stored = part.clear();
    } else if (!header(head, "content-range").starts_with(fmt::format("bytes {}-", part.bytes()))) {
      stored = fail(ErrorKind::kInternal, client.url() + ": sends another range than was asked for");
    }
    return stored.has_value();
  };
  call.take = [&](std::string_view piece) {
    if (piece.size() > bytes - std::min(bytes, part.bytes())) {
      stored = fail(ErrorKind::kInternal, client.url() + ": sends more than it announced");
    } else {
      stored = part.append(piece);
    }
    return stored.has_value();
  };
  const auto reply = client.try_call(call);
  if (!stored) return stored;
  if (!reply) return tl::unexpected(reply.error());
  if (auto checked = client.check(*reply); !checked) return checked;
  if (part.bytes() != bytes) {
    return fail(ErrorKind::kUnavailable, fmt::format("{}: sent {} of {} bytes", client.url(), part.bytes(), bytes));
  }
  return {};
}

Result<void> download_file(ServiceClient& client, const std::string& id, const char* artifact, const fs::path& target) {
  const std::string address = fmt::format("/v1/jobs/{}/{}", id, artifact);
  while (true) {
    const auto head = client.call({.method = "HEAD", .path = address});
    if (!head) return tl::unexpected(head.error());
    if (head->status != 200) {
      // A HEAD has no body that could say why.
      const auto reply = client.call({.path = address, .headers = {{"Range", "bytes=0-0"}}});
      if (!reply) return tl::unexpected(reply.error());
      if (auto checked = client.check(*reply); !checked) return checked;
      continue;  // it is there now
    }
    const std::string etag = header(*head, "etag");
    const auto bytes = number(header(*head, "content-length"));
    if (etag.empty() || !bytes) {
      return fail(ErrorKind::kUnavailable, client.url() + ": names neither size nor ETag; is it a photonfarm service?");
    }
    const std::string name = part_name(target, id, etag);
    remove_other_parts(target, name);
    auto part = PartialFile::open(target.parent_path() / name);
    if (!part) return tl::unexpected(part.error());
    if (part->bytes() > *bytes) {
      if (auto cleared = part->clear(); !cleared) return cleared;
    }
    Result<void> fetched = part->bytes() == *bytes ? Result<void>() : fetch_rest(client, address, etag, *bytes, *part);
    if (fetched) return part->become(target);
    if (fetched.error().kind != ErrorKind::kUnavailable) return fetched;
    if (auto waited = client.wait_to_retry(fetched.error()); !waited) return waited;
  }
}

bool is_file_name(std::string_view name) {
  return !name.empty() && name.size() <= 100 && name != "." && name != ".." &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") ==
             std::string_view::npos;
}

}  // namespace

Result<DownloadedFiles> download_job(ServiceClient& client, const json& job, const fs::path& folder) {
  const std::string id = job_text(job, "id"), name = job_text(job, "name");
  if (!is_file_name(name)) {
    return fail(ErrorKind::kInternal, fmt::format("{}: the job's name '{}' cannot name a file", client.url(), name));
  }
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return fail(ErrorKind::kInternal, fmt::format("{}: cannot make this folder: {}", folder.string(), error.message()));
  const DownloadedFiles files{folder / (name + ".exr"), folder / (name + ".png"), folder / (name + ".json")};
  const std::pair<const char*, fs::path> wanted[] = {
      {"image.exr", files.exr}, {"image.png", files.png}, {"figures.json", files.json}};
  for (const auto& [artifact, target] : wanted) {
    if (auto done = download_file(client, id, artifact, target); !done) return tl::unexpected(done.error());
  }
  return files;
}

}  // namespace pf
