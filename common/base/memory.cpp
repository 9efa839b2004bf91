#include "common/base/memory.h"

#include <charconv>
#include <string_view>

#include <malloc.h>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

/// A line `key: 123 kB` of /proc/self/status, in bytes. getrusage's peak would be the parent's after fork and
/// exec.
std::uint64_t status_bytes(std::string_view key) {
  constexpr std::uint64_t kMaxStatusBytes = 1 << 16;
  const auto status = read_file("/proc/self/status", kMaxStatusBytes);
  if (!status) return 0;
  const std::size_t start = status->find(key);
  if (start == std::string::npos) return 0;
  const std::size_t digits = status->find_first_of("0123456789", start + key.size());
  if (digits == std::string::npos) return 0;
  std::uint64_t kibibytes = 0;
  std::from_chars(status->data() + digits, status->data() + status->size(), kibibytes);
  return kibibytes * 1024;
}

}  // namespace

std::uint64_t peak_resident_bytes() { return status_bytes("VmHWM:"); }
std::uint64_t resident_bytes() { return status_bytes("VmRSS:"); }

void keep_freed_memory() {
  // By default glibc gives back what is free at a heap's end once it is twice the largest block that was ever freed.
  constexpr int kMappedBytes = 32 << 20;  // the largest that glibc itself would come to
  constexpr int kKeptBytes = 256 << 20;
  mallopt(M_MMAP_THRESHOLD, kMappedBytes);  // NOLINT(concurrency-mt-unsafe): no thread has been started yet
  mallopt(M_TRIM_THRESHOLD, kKeptBytes);    // NOLINT(concurrency-mt-unsafe)
}

}  // namespace pf
