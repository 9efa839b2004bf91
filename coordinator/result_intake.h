#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/wire/messages.h"

namespace pf {

/// A result on its way in: its chunks gather in a file, so that the coordinator's memory does not grow with the image
/// or the number of workers, and are merged once all are there.
class ResultIntake {
 public:
  /// Chunks asked for at a time: bounds what is under way to the coordinator.
  static constexpr std::size_t kAskAtOnce = 16;

  [[nodiscard]] static Result<ResultIntake> open(const std::filesystem::path& spool, wire::ResultManifest manifest);
  ResultIntake(ResultIntake&&) noexcept = default;
  ResultIntake& operator=(ResultIntake&&) noexcept = default;

  [[nodiscard]] const wire::ResultManifest& manifest() const { return manifest_; }
  /// Keeps a chunk. One whose hash is not the manifest's (damaged on the way) and one that is here already are dropped:
  /// false. Errors: kInternal for the disk.
  [[nodiscard]] Result<bool> put(std::uint32_t index, std::string_view data);
  [[nodiscard]] bool complete() const { return kept_ == chunks_.size(); }
  /// True when all chunks asked for last have come.
  [[nodiscard]] bool wants_more() const { return awaited_ == 0 && !complete(); }
  /// Indices of the next missing chunks; they count as asked for.
  [[nodiscard]] std::vector<std::uint32_t> ask();
  [[nodiscard]] Result<std::string> read(std::size_t index) const;
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Chunk {
    std::int64_t offset = -1;
    std::uint32_t bytes = 0;
    bool asked = false;
  };
  struct CloseFile {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };

  ResultIntake() = default;
  std::unique_ptr<std::FILE, CloseFile> spool_;
  std::string name_;
  wire::ResultManifest manifest_;
  std::vector<Chunk> chunks_;
  std::size_t kept_ = 0;
  std::size_t awaited_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace pf
