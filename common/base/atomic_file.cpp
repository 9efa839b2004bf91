#include "common/base/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>

namespace pf {
namespace {

namespace fs = std::filesystem;

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool valid() const { return fd_ >= 0; }
  /// Network file systems report some write errors only here.
  [[nodiscard]] bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

/// Removes the temporary file unless it was renamed, also when a writer throws.
class TemporaryFile {
 public:
  explicit TemporaryFile(fs::path path) : path_(std::move(path)) {}
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    if (!renamed_) ::unlink(path_.c_str());
  }
  [[nodiscard]] const fs::path& path() const { return path_; }
  [[nodiscard]] bool rename_to(const fs::path& file) {
    renamed_ = ::rename(path_.c_str(), file.c_str()) == 0;
    return renamed_;
  }

 private:
  fs::path path_;
  bool renamed_ = false;
};

tl::unexpected<Error> system_failure(ErrorKind kind, const fs::path& file, std::string_view what) {
  const int error = errno;
  return fail(kind, fmt::format("{}: {}: {}", file.string(), what, std::generic_category().message(error)));
}

fs::path folder_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : fs::path("."); }

/// `.NAME.<random>.tmp.EXT`: hidden, recognisable, and with the extension by which image libraries choose a
/// format.
struct TemporaryName {
  static constexpr std::size_t kDigits = 16;
  std::string before, after;

  explicit TemporaryName(const fs::path& file) {
    constexpr std::size_t kMaxStem = 100, kMaxExtension = 32;  // the whole stays below NAME_MAX = 255
    std::string extension = file.extension().string();
    if (extension.size() > kMaxExtension) extension.clear();
    before = fmt::format(".{}.", file.filename().string().substr(0, kMaxStem));
    after = fmt::format(".tmp{}", extension);
  }
  [[nodiscard]] std::string with(std::uint64_t random) const {
    return fmt::format("{}{:0{}x}{}", before, random, kDigits, after);
  }
  [[nodiscard]] bool matches(std::string_view name) const {
    if (name.size() != before.size() + kDigits + after.size()) return false;
    if (!name.starts_with(before) || !name.ends_with(after)) return false;
    return name.substr(before.size(), kDigits).find_first_not_of("0123456789abcdef") == std::string_view::npos;
  }
};

/// Removes what killed processes have left of earlier writes of the same file. A writer holds a lock on its
/// temporary file until that is renamed, and the lock goes when its process does; a process id would not do,
/// because the folder may be shared with other machines. What cannot be locked stays.
void remove_leftovers(const fs::path& folder, const TemporaryName& name) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (!name.matches(entry->path().filename().native())) continue;
    const FileDescriptor fd(::open(entry->path().c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    if (fd.valid() && ::flock(fd.get(), LOCK_EX | LOCK_NB) == 0) ::unlink(entry->path().c_str());
  }
}

struct Created {
  FileDescriptor lock;
  fs::path path;
};

/// Makes an empty temporary file and locks it.
Result<Created> create_temporary(const fs::path& file, const TemporaryName& name, ::mode_t mode) {
  while (true) {
    std::uint64_t random = 0;
    if (::getrandom(&random, sizeof random, 0) != static_cast<ssize_t>(sizeof random)) {
      return system_failure(ErrorKind::kInternal, file, "cannot name a temporary file");
    }
    fs::path path = folder_of(file) / name.with(random);
    FileDescriptor fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
    if (!fd.valid()) return system_failure(ErrorKind::kInternal, file, "cannot write");
    // A file system without locks removes no leftovers either, so a failure does no harm.
    while (::flock(fd.get(), LOCK_EX) != 0 && errno == EINTR) {
    }
    struct ::stat status = {};
    if (::fstat(fd.get(), &status) != 0) return system_failure(ErrorKind::kInternal, file, "cannot write");
    if (status.st_nlink > 0) return Created{std::move(fd), std::move(path)};
    // Another writer took it for a leftover before it was locked.
  }
}

bool write_all(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    constexpr std::size_t kChunk = std::size_t{1} << 30;
    const ssize_t written = ::write(fd, bytes.data(), std::min(bytes.size(), kChunk));
    if (written < 0) {
      if (errno == EINTR) continue;
      return false;
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return true;
}

bool sync_folder(const fs::path& folder) {
  const FileDescriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd.valid()) return false;
  // Some file systems know no fsync of folders and say so with these; nothing better can be done there.
  return ::fsync(fd.get()) == 0 || errno == EINVAL || errno == ENOTSUP;
}

}  // namespace

Result<void> write_file_atomically(const fs::path& file, const FileWriter& write, FileAccess access) {
  if (!file.has_filename()) {
    return fail(ErrorKind::kInternal, fmt::format("{}: cannot write; expected the name of a file", file.string()));
  }
  const TemporaryName name(file);
  remove_leftovers(folder_of(file), name);
  const auto created = create_temporary(file, name, access == FileAccess::kOwnerOnly ? 0600 : 0666);
  if (!created) return tl::unexpected(created.error());
  TemporaryFile temporary(created->path);

  if (auto written = write(temporary.path()); !written) return written;

  FileDescriptor fd(::open(temporary.path().c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid() || ::fsync(fd.get()) != 0 || !fd.close()) {
    return system_failure(ErrorKind::kInternal, file, "cannot write to disk");
  }
  if (!temporary.rename_to(file)) return system_failure(ErrorKind::kInternal, file, "cannot replace");
  if (!sync_folder(folder_of(file))) {
    return system_failure(ErrorKind::kInternal, file, "written, but a power cut may lose it: cannot sync its folder");
  }
  return {};
}

Result<void> write_file_atomically(const fs::path& file, std::string_view bytes, FileAccess access) {
  const FileWriter write = [&](const fs::path& temporary) -> Result<void> {
    FileDescriptor fd(::open(temporary.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC));
    if (!fd.valid() || !write_all(fd.get(), bytes) || !fd.close()) {
      return system_failure(ErrorKind::kInternal, file, "cannot write");
    }
    return {};
  };
  return write_file_atomically(file, write, access);
}

Result<void> write_file_atomically(const fs::path& file, std::span<const std::byte> bytes, FileAccess access) {
  // char may alias anything, so this view of the bytes is well defined.
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return write_file_atomically(file, text, access);
}

Result<std::string> read_file(const fs::path& file, std::uint64_t max_bytes, ErrorKind kind) {
  // O_NONBLOCK: opening a named pipe must not wait for its writer.
  const FileDescriptor fd(::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (!fd.valid()) return system_failure(kind, file, "cannot open");
  struct ::stat status = {};
  if (::fstat(fd.get(), &status) != 0) return system_failure(kind, file, "cannot read");
  if (!S_ISREG(status.st_mode)) {
    return fail(kind, fmt::format("{}: not a regular file; expected a file to read", file.string()));
  }
  const auto size = static_cast<std::uint64_t>(status.st_size);
  const auto too_large = [&] {
    return fail(kind, fmt::format("{}: larger than {} bytes; expected at most that", file.string(), max_bytes));
  };
  if (size > max_bytes) return too_large();

  // The file may grow meanwhile, and files of /proc say that they are empty: the end of file alone decides.
  constexpr std::uint64_t kMinBuffer = 4096;
  std::string content(std::min(std::max(size, kMinBuffer), max_bytes) + 1, '\0');
  std::size_t filled = 0;
  while (true) {
    if (filled == content.size()) content.resize(std::min<std::uint64_t>(content.size() * 2, max_bytes) + 1);
    const ssize_t got = ::read(fd.get(), content.data() + filled, content.size() - filled);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return system_failure(kind, file, "cannot read");
    if (got == 0) break;
    filled += static_cast<std::size_t>(got);
    if (filled > max_bytes) return too_large();
  }
  content.resize(filled);
  return content;
}

}  // namespace pf
