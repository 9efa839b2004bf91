#include "common/base/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
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

fs::path folder_of(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

/// `.NAME.<random>.tmp.EXT`: hidden, recognisable, and with the extension by which image libraries choose a
/// format.
Result<fs::path> temporary_name(const fs::path& file) {
  std::uint64_t random = 0;
  if (::getrandom(&random, sizeof random, 0) != static_cast<ssize_t>(sizeof random)) {
    return system_failure(ErrorKind::kInternal, file, "cannot name a temporary file");
  }
  constexpr std::size_t kMaxStem = 100, kMaxExtension = 32;  // the whole stays below NAME_MAX = 255
  std::string extension = file.extension().string();
  if (extension.size() > kMaxExtension) extension.clear();
  const std::string stem = file.filename().string().substr(0, kMaxStem);
  return folder_of(file) / fmt::format(".{}.{:016x}.tmp{}", stem, random, extension);
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
    return fail(ErrorKind::kInternal,
                fmt::format("{}: cannot write; expected the name of a file", file.string()));
  }
  const auto name = temporary_name(file);
  if (!name) return tl::unexpected(name.error());
  const ::mode_t mode = access == FileAccess::kOwnerOnly ? 0600 : 0666;
  FileDescriptor created(::open(name->c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
  if (!created.valid()) return system_failure(ErrorKind::kInternal, file, "cannot write");
  TemporaryFile temporary(*name);
  if (!created.close()) return system_failure(ErrorKind::kInternal, file, "cannot write");

  if (auto written = write(temporary.path()); !written) return written;

  FileDescriptor fd(::open(temporary.path().c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid() || ::fsync(fd.get()) != 0 || !fd.close()) {
    return system_failure(ErrorKind::kInternal, file, "cannot write to disk");
  }
  if (!temporary.rename_to(file)) return system_failure(ErrorKind::kInternal, file, "cannot replace");
  if (!sync_folder(folder_of(file))) {
    return system_failure(ErrorKind::kInternal, file,
                          "written, but a power cut may lose it: cannot sync its folder");
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

Result<void> write_file_atomically(const fs::path& file, std::span<const std::byte> bytes,
                                   FileAccess access) {
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
    return fail(kind,
                fmt::format("{}: larger than {} bytes; expected at most that", file.string(), max_bytes));
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
