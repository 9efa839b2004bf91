// The folder of a store:
//   ab/abcd...            blobs, read-only, under their SHA-256; the time of the last change is that of the last use
//   partial/abcd....PID   what has come so far of a blob that a process fetches in parts
//   incoming/...          files that are being written; locked while their writer lives

#include "common/wire/blob_store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <system_error>
#include <tuple>
#include <vector>

#include <fmt/format.h>

#include "common/base/hash.h"
#include "common/wire/limits.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPieceBytes = std::size_t{1} << 20;

class File {
 public:
  explicit File(int fd) : fd_(fd) {}
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool valid() const { return fd_ >= 0; }

 private:
  int fd_;
};

/// Removes the file unless it was renamed meanwhile.
struct RemoveOnExit {
  fs::path file;
  ~RemoveOnExit() { ::unlink(file.c_str()); }
};

tl::unexpected<Error> disk_failure(const fs::path& file, std::string_view what) {
  const int error = errno;
  const std::string why =
      error == ENOSPC || error == EDQUOT ? "the disk is full" : std::generic_category().message(error);
  return fail(ErrorKind::kInternal, fmt::format("{}: {}: {}", file.string(), what, why));
}

bool write_all(int fd, std::string_view bytes, std::uint64_t offset) {
  while (!bytes.empty()) {
    const ::ssize_t written = ::pwrite(fd, bytes.data(), bytes.size(), static_cast<::off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(written));
    offset += static_cast<std::uint64_t>(written);
  }
  return true;
}

/// Reads until `count` bytes or the end; false on an error.
bool read_at(int fd, std::uint64_t offset, std::size_t count, std::string& out) {
  out.resize(count);
  std::size_t filled = 0;
  while (filled < count) {
    const ::ssize_t got = ::pread(fd, out.data() + filled, count - filled, static_cast<::off_t>(offset + filled));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return false;
    if (got == 0) break;
    filled += static_cast<std::size_t>(got);
  }
  out.resize(filled);
  return true;
}

bool is_sha256(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool sync_folder(const fs::path& folder) {
  const File fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return fd.valid() && ::fsync(fd.get()) == 0;
}

tl::unexpected<Error> not_an_id(const BlobId& id) {
  return fail(ErrorKind::kInvalidInput, fmt::format("blob refused: {} bytes are no SHA-256", id.sha256.size()));
}

}  // namespace

Result<BlobStore> BlobStore::open(fs::path folder, std::uint64_t max_bytes) {
  BlobStore store(std::move(folder), max_bytes);
  std::error_code error;
  for (const char* part : {"partial", "incoming"}) {
    fs::create_directories(store.folder_ / part, error);
    if (error) {
      return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", store.folder_.string(), error.message()));
    }
  }
  for (fs::directory_iterator entry(store.folder_ / "partial", error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string extension = entry->path().extension().string();
    const long pid = extension.empty() ? 0 : std::strtol(extension.c_str() + 1, nullptr, 10);
    if (pid <= 0 || (::kill(static_cast<::pid_t>(pid), 0) != 0 && errno == ESRCH)) ::unlink(entry->path().c_str());
  }
  // A writer holds a lock on its file, and the lock goes when its process does; a new file may not be locked yet.
  constexpr std::chrono::seconds kNew{60};
  for (fs::directory_iterator entry(store.folder_ / "incoming", error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (fs::file_time_type::clock::now() - entry->last_write_time(ignored) < kNew) continue;
    const File fd(::open(entry->path().c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    if (fd.valid() && ::flock(fd.get(), LOCK_EX | LOCK_NB) == 0) ::unlink(entry->path().c_str());
  }
  std::vector<std::tuple<fs::file_time_type, std::string, std::uint64_t>> found;
  for (fs::directory_iterator part(store.folder_, error), end; !error && part != end; part.increment(error)) {
    if (part->path().filename().native().size() != 2) continue;
    std::error_code skipped;
    for (fs::directory_iterator entry(part->path(), skipped); !skipped && entry != end; entry.increment(skipped)) {
      std::error_code ignored;
      const std::uint64_t bytes = entry->file_size(ignored);
      if (ignored || !is_sha256(entry->path().filename().native())) continue;
      found.emplace_back(entry->last_write_time(ignored), entry->path().filename().string(), bytes);
    }
  }
  if (error) return fail(ErrorKind::kInternal, fmt::format("{}: {}", store.folder_.string(), error.message()));
  std::sort(found.begin(), found.end());
  for (const auto& [time, sha256, bytes] : found) {
    store.entries_[sha256] = {bytes, ++store.uses_};
    store.bytes_ += bytes;
  }
  store.make_room({});
  return store;
}

bool BlobStore::has(const BlobId& id) const {
  struct ::stat status = {};
  return is_sha256(id.sha256) && ::stat(path_of(id).c_str(), &status) == 0 && S_ISREG(status.st_mode) &&
         static_cast<std::uint64_t>(status.st_size) == id.bytes;
}

fs::path BlobStore::path_of(const BlobId& id) const {
  if (!is_sha256(id.sha256)) return {};
  return folder_ / id.sha256.substr(0, 2) / id.sha256;
}

// A process's own: two that fetch the same blob do not write over each other.
fs::path BlobStore::partial_path(const BlobId& id) const {
  return folder_ / "partial" / fmt::format("{}.{}", id.sha256, ::getpid());
}

Result<BlobId> BlobStore::put(std::string_view bytes) {
  const BlobId id{sha256_hex(bytes), bytes.size()};
  if (has(id)) {
    used(id);
    return id;
  }
  return put_stream([&](const Sink& sink) { return sink(bytes); });
}

Result<BlobId> BlobStore::put_file(const fs::path& file) {
  // O_NONBLOCK: opening a named pipe must not wait for its writer.
  const File fd(::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  const auto unreadable = [&](std::string_view why) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: cannot be read: {}", file.string(), why));
  };
  struct ::stat status = {};
  if (!fd.valid() || ::fstat(fd.get(), &status) != 0) return unreadable(std::generic_category().message(errno));
  if (!S_ISREG(status.st_mode)) return unreadable("not a regular file");
  return put_stream([&](const Sink& sink) -> Result<void> {
    std::string piece;
    for (std::uint64_t offset = 0;; offset += piece.size()) {
      if (!read_at(fd.get(), offset, kPieceBytes, piece)) return unreadable(std::generic_category().message(errno));
      if (piece.empty()) return {};
      if (auto written = sink(piece); !written) return written;
    }
  });
}

Result<BlobId> BlobStore::put_stream(const std::function<Result<void>(const Sink& sink)>& write) {
  std::string pattern = (folder_ / "incoming" / "XXXXXX").string();
  const File fd(::mkostemp(pattern.data(), O_CLOEXEC));
  if (!fd.valid()) return disk_failure(folder_, "cannot write");
  const RemoveOnExit remove{pattern};
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) return disk_failure(pattern, "cannot lock");
  Sha256 hash;
  BlobId id;
  const Sink sink = [&](std::string_view bytes) -> Result<void> {
    if (bytes.size() > kMaxBlobBytes - id.bytes) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("a file is larger than {} bytes; expected at most that", kMaxBlobBytes));
    }
    if (!write_all(fd.get(), bytes, id.bytes)) return disk_failure(pattern, "cannot write");
    hash.update(bytes);
    id.bytes += bytes.size();
    return {};
  };
  if (auto written = write(sink); !written) return tl::unexpected(written.error());
  id.sha256 = hash.hex();
  if (!has(id)) {
    if (::fchmod(fd.get(), 0444) != 0 || ::fsync(fd.get()) != 0) return disk_failure(pattern, "cannot write");
    if (auto named = name_file(pattern, id); !named) return tl::unexpected(named.error());
  }
  used(id);
  make_room(id);
  return id;
}

Result<void> BlobStore::name_file(const fs::path& file, const BlobId& id) {
  const fs::path path = path_of(id);
  std::error_code error;
  fs::create_directory(path.parent_path(), error);
  if (error)
    return fail(ErrorKind::kInternal,
                fmt::format("{}: cannot be made: {}", path.parent_path().string(), error.message()));
  if (::rename(file.c_str(), path.c_str()) != 0) return disk_failure(path, "cannot be named");
  if (!sync_folder(path.parent_path()) || !sync_folder(folder_)) return disk_failure(path, "cannot sync its folder");
  return {};
}

Result<std::string> BlobStore::read(const BlobId& id, std::uint64_t offset, std::size_t count) {
  if (!has(id)) return fail(ErrorKind::kInvalidInput, fmt::format("blob {} is not here", id.sha256.substr(0, 64)));
  const File fd(::open(path_of(id).c_str(), O_RDONLY | O_CLOEXEC));
  std::string bytes;
  // The blob's size, not the caller's wish, bounds the memory.
  const std::uint64_t left = offset < id.bytes ? id.bytes - offset : 0;
  if (!fd.valid() ||
      !read_at(fd.get(), offset, static_cast<std::size_t>(std::min<std::uint64_t>(count, left)), bytes)) {
    return disk_failure(path_of(id), "cannot be read");
  }
  used(id);
  return bytes;
}

std::uint64_t BlobStore::partial_bytes(const BlobId& id) const {
  struct ::stat status = {};
  if (!is_sha256(id.sha256) || ::stat(partial_path(id).c_str(), &status) != 0) return 0;
  return static_cast<std::uint64_t>(status.st_size);
}

Result<void> BlobStore::append_partial(const BlobId& id, std::uint64_t offset, std::string_view bytes) {
  if (!is_sha256(id.sha256)) return not_an_id(id);
  const std::uint64_t here = partial_bytes(id);
  if (offset != here || bytes.size() > id.bytes || offset > id.bytes - bytes.size()) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("blob {}: a part of {} bytes at {}; expected one at {}, {} bytes in all", id.sha256,
                            bytes.size(), offset, here, id.bytes));
  }
  const fs::path path = partial_path(id);
  const File fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644));
  if (!fd.valid()) return disk_failure(path, "cannot write");
  if (write_all(fd.get(), bytes, offset)) return {};
  auto failure = disk_failure(path, "cannot write");
  // What was begun of this part goes, so that the next one fits.
  [[maybe_unused]] const int ignored = ::ftruncate(fd.get(), static_cast<::off_t>(offset));
  return failure;
}

Result<void> BlobStore::finish_partial(const BlobId& id) {
  if (!is_sha256(id.sha256)) return not_an_id(id);
  const fs::path path = partial_path(id);
  if (has(id)) {  // another process was faster, or it was put
    ::unlink(path.c_str());
    used(id);
    return {};
  }
  const File fd(::open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644));
  if (!fd.valid()) return disk_failure(path, "cannot be read");
  Sha256 hash;
  std::uint64_t bytes = 0;
  for (std::string piece; bytes == 0 || !piece.empty(); bytes += piece.size()) {
    if (!read_at(fd.get(), bytes, kPieceBytes, piece)) return disk_failure(path, "cannot be read");
    hash.update(piece);
    if (piece.empty()) break;
  }
  if (bytes != id.bytes || hash.hex() != id.sha256) {
    ::unlink(path.c_str());
    return fail(ErrorKind::kInvalidInput,
                fmt::format("blob {} of {} bytes: got {} bytes of SHA-256 {}", id.sha256, id.bytes, bytes, hash.hex()));
  }
  if (::fchmod(fd.get(), 0444) != 0 || ::fsync(fd.get()) != 0) return disk_failure(path, "cannot write");
  if (auto named = name_file(path, id); !named) return named;
  used(id);
  make_room(id);
  return {};
}

void BlobStore::used(const BlobId& id) {
  Entry& entry = entries_[id.sha256];
  bytes_ += id.bytes - entry.bytes;
  entry = {id.bytes, ++uses_};
  // Remembers the order over restarts; a failure costs no more than that.
  [[maybe_unused]] const int ignored = ::utimensat(AT_FDCWD, path_of(id).c_str(), nullptr, 0);
}

void BlobStore::forget(const std::string& sha256) {
  const auto entry = entries_.find(sha256);
  if (entry == entries_.end()) return;
  bytes_ -= entry->second.bytes;
  entries_.erase(entry);
}

void BlobStore::make_room(const BlobId& except) {
  while (max_bytes_ > 0 && bytes_ > max_bytes_) {
    const auto oldest = [&] {
      auto best = entries_.end();
      for (auto it = entries_.begin(); it != entries_.end(); ++it) {
        if (it->first == except.sha256 || pins_.contains(it->first)) continue;
        if (best == entries_.end() || it->second.last_use < best->second.last_use) best = it;
      }
      return best;
    }();
    if (oldest == entries_.end()) return;
    ::unlink(path_of({oldest->first, 0}).c_str());
    forget(oldest->first);
  }
}

void BlobStore::pin(const BlobId& id) { ++pins_[id.sha256]; }

void BlobStore::unpin(const BlobId& id) {
  const auto pinned = pins_.find(id.sha256);
  if (pinned == pins_.end() || --pinned->second > 0) return;
  pins_.erase(pinned);
  make_room({});
}

void BlobStore::remove(const BlobId& id) {
  if (!is_sha256(id.sha256)) return;
  ::unlink(path_of(id).c_str());
  ::unlink(partial_path(id).c_str());
  forget(id.sha256);
}

}  // namespace pf
