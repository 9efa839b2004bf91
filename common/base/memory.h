#pragma once

#include <cstdint>

namespace pf {

/// Most bytes of physical memory that this process has held so far; 0 where the system does not say.
[[nodiscard]] std::uint64_t peak_resident_bytes();
/// Bytes of physical memory that this process holds now; 0 where the system does not say.
[[nodiscard]] std::uint64_t resident_bytes();

}  // namespace pf
