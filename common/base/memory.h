#pragma once

#include <cstdint>

namespace pf {

/// Most bytes of physical memory that this process has held so far; 0 where the system does not say.
[[nodiscard]] std::uint64_t peak_resident_bytes();
/// Bytes of physical memory that this process holds now; 0 where the system does not say.
[[nodiscard]] std::uint64_t resident_bytes();

/// From now on most of what is freed is used again without asking the system: for a process that takes and gives back
/// the same megabytes in every pass. To be called before threads start.
void keep_freed_memory();

}  // namespace pf
