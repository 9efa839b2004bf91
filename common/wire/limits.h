#pragma once

#include <cstddef>
#include <cstdint>

namespace pf {

/// Version of every message; another one is refused and named.
inline constexpr std::uint32_t kWireVersion = 2;
/// Largest payload of one chunk, before the envelope: with it a message stays below the engine's default of 1
/// MiB.
inline constexpr std::size_t kMaxChunkBytes = 1000 * 1000;
inline constexpr std::size_t kMaxMessageBytes = 1024 * 1024;
inline constexpr std::uint64_t kMaxPixels = std::uint64_t{1} << 28;
/// Chunks and units of one result, files of a bundle.
inline constexpr std::size_t kMaxChunks = 65536;
inline constexpr std::size_t kMaxUnits = 4096;
inline constexpr std::size_t kMaxBundleFiles = 4096;
inline constexpr std::size_t kMaxBundleBytes = 1000 * 1000;             ///< of the manifest itself: one chunk
inline constexpr std::uint64_t kMaxBlobBytes = std::uint64_t{1} << 34;  ///< of one file: 16 GiB
/// Names of jobs and workers: [A-Za-z0-9_-]{1,64}; they are parts of subjects and of paths.
inline constexpr std::size_t kMaxNameBytes = 64;
inline constexpr std::size_t kMaxTextBytes = 4096;  ///< log lines and reasons; longer ones are cut

}  // namespace pf
