#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace pf {

enum class FileAccess {
  kByUmask,   ///< as any other file of the user
  kOwnerOnly  ///< mode 0600, for secrets
};

/// Writes `bytes` to `file` so that a reader, or a restart after a crash or power cut, finds either the whole
/// old file or the whole new one. The bytes go to a temporary file beside `file` (hidden, same extension),
/// which is fsynced and renamed over it; then the folder is fsynced.
///
/// On any error up to the rename, a full disk included, the old file is as it was and the temporary one is
/// removed. An error of the folder's fsync is reported too, but leaves the new file in place. A process
/// killed while it writes leaves its temporary file behind; the next write of the same file removes it, but
/// never one that a living process is writing. Errors: kInternal.
[[nodiscard]] Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view bytes,
                                                 FileAccess access = FileAccess::kByUmask);
[[nodiscard]] Result<void> write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes,
                                                 FileAccess access = FileAccess::kByUmask);

/// Writes the file at the path that it is given. That file exists already, empty, and is locked: it must be
/// overwritten, not replaced by another one.
using FileWriter = std::function<Result<void>(const std::filesystem::path& temporary)>;

/// The same for a library that wants a path to write to. An error of `write` is returned unchanged.
[[nodiscard]] Result<void> write_file_atomically(const std::filesystem::path& file, const FileWriter& write,
                                                 FileAccess access = FileAccess::kByUmask);

/// The whole content of a regular file of at most `max_bytes`. Never blocks on pipes or devices: they are
/// errors. Errors: `kind`, naming the file.
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path& file, std::uint64_t max_bytes,
                                            ErrorKind kind = ErrorKind::kInvalidInput);

}  // namespace pf
