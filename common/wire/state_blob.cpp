#include "common/wire/state_blob.h"

#include <cstring>
#include <fstream>

#include <fmt/format.h>

#include "common/wire/limits.h"
#include "common/wire/statistics_codec.h"

namespace pf {

Result<BlobId> write_state_blob(const std::vector<ProgressivePixel>& state, BlobStore& store) {
  return store.put_stream([&](const BlobStore::Sink& sink) -> Result<void> {
    const auto packed = pack_state(state, [&](std::string_view chunk) -> Result<void> {
      const auto length = static_cast<std::uint32_t>(chunk.size());
      if (auto put = sink({reinterpret_cast<const char*>(&length), sizeof(length)}); !put) return put;
      return sink(chunk);
    });
    if (!packed) return tl::unexpected(packed.error());
    return {};
  });
}

Result<std::vector<ProgressivePixel>> read_state_blob(const std::filesystem::path& file, std::size_t pixels) {
  const auto broken = [&](std::string_view why) {
    return fail(ErrorKind::kInvalidInput, fmt::format("{}: no state of {} pixels: {}", file.string(), pixels, why));
  };
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return broken("cannot be read");
  std::vector<ProgressivePixel> state(pixels);
  StateUnpacker unpacker(state);
  std::string chunk;
  std::uint32_t length = 0;
  while (stream.read(reinterpret_cast<char*>(&length), sizeof(length))) {
    if (length > kMaxChunkBytes) return broken("a chunk is too long");
    chunk.resize(length);
    if (!stream.read(chunk.data(), static_cast<std::streamsize>(length))) return broken("ends early");
    if (auto added = unpacker.add(chunk); !added) return broken(added.error().message);
  }
  if (stream.gcount() != 0 || !unpacker.complete()) return broken("ends early");
  return state;
}

}  // namespace pf
