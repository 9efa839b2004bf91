#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "common/base/result.h"

namespace pf {

/// A blob by its content: SHA-256 (64 hexadecimal digits) and size.
struct BlobId {
  std::string sha256;
  std::uint64_t bytes = 0;
  friend bool operator==(const BlobId&, const BlobId&) = default;
  friend auto operator<=>(const BlobId&, const BlobId&) = default;
};

/// Files named by the SHA-256 of their content, in a folder: `FOLDER/ab/abcdef...`. A file under its final
/// name is whole and was verified. Not thread-safe; several processes may share a folder (renames are
/// atomic). Errors: kInvalidInput for content that does not fit its name, kInternal for the disk (the message
/// says when it is full).
class BlobStore {
 public:
  /// `max_bytes`: least recently used blobs are removed beyond it, pinned ones never; 0: no bound.
  [[nodiscard]] static Result<BlobStore> open(std::filesystem::path folder, std::uint64_t max_bytes);

  [[nodiscard]] bool has(const BlobId& id) const;
  /// Where the blob lies or would lie; empty for an id whose hash is none. Files there are read-only.
  [[nodiscard]] std::filesystem::path path_of(const BlobId& id) const;
  [[nodiscard]] Result<BlobId> put(std::string_view bytes);
  /// Copies a file in (reflink or hard link never: the source may change).
  [[nodiscard]] Result<BlobId> put_file(const std::filesystem::path& file);
  /// Takes what `write` writes, in pieces; nothing of the blob's size is held in memory.
  using Sink = std::function<Result<void>(std::string_view bytes)>;
  [[nodiscard]] Result<BlobId> put_stream(const std::function<Result<void>(const Sink& sink)>& write);
  /// At most `count` bytes from `offset`; less only at the end. Counts as a use.
  [[nodiscard]] Result<std::string> read(const BlobId& id, std::uint64_t offset, std::size_t count);

  /// Fetching from elsewhere in parts, in order, able to go on after a restart: bytes already here ...
  [[nodiscard]] std::uint64_t partial_bytes(const BlobId& id) const;
  /// ... the next part (`offset` must equal partial_bytes) ...
  [[nodiscard]] Result<void> append_partial(const BlobId& id, std::uint64_t offset, std::string_view bytes);
  /// ... and the end: verifies size and hash and gives the blob its name. A wrong one is removed and is an
  /// error.
  [[nodiscard]] Result<void> finish_partial(const BlobId& id);

  /// Pins count: as many unpins undo them.
  void pin(const BlobId& id);
  void unpin(const BlobId& id);
  void remove(const BlobId& id);
  /// Of the blobs that this object has met; partial ones apart.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Entry {
    std::uint64_t bytes = 0;
    std::uint64_t last_use = 0;  ///< counts uses
  };

  BlobStore(std::filesystem::path folder, std::uint64_t max_bytes)
      : folder_(std::move(folder)), max_bytes_(max_bytes) {}
  [[nodiscard]] std::filesystem::path partial_path(const BlobId& id) const;
  /// Gives a synced file in `incoming` its final name.
  [[nodiscard]] Result<void> name_file(const std::filesystem::path& file, const BlobId& id);
  void used(const BlobId& id);
  void make_room(const BlobId& except);
  void forget(const std::string& sha256);

  std::filesystem::path folder_;
  std::uint64_t max_bytes_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t uses_ = 0;
  std::map<std::string, Entry> entries_;
  std::map<std::string, std::size_t> pins_;
};

}  // namespace pf
