#include "coordinator/result_intake.h"

#include <cerrno>
#include <system_error>

#include <fmt/format.h>

#include "common/base/hash.h"

namespace pf {
namespace {

tl::unexpected<Error> disk_error(const std::string& name, std::string_view what) {
  return fail(ErrorKind::kInternal, fmt::format("{}: {}: {}", name, what, std::generic_category().message(errno)));
}

}  // namespace

Result<ResultIntake> ResultIntake::open(const std::filesystem::path& spool, wire::ResultManifest manifest) {
  ResultIntake intake;
  intake.name_ = spool.string();
  intake.spool_.reset(std::fopen(spool.c_str(), "w+b"));
  if (!intake.spool_) return disk_error(intake.name_, "cannot be made");
  // Unbuffered: what a full disk refused is not written later over something else.
  std::setvbuf(intake.spool_.get(), nullptr, _IONBF, 0);
  // The file lives as long as it is open: nothing is left behind by a coordinator that is killed.
  std::remove(spool.c_str());
  intake.chunks_.resize(static_cast<std::size_t>(manifest.chunk_xxh3_size()));
  intake.manifest_ = std::move(manifest);
  return intake;
}

Result<bool> ResultIntake::put(std::uint32_t index, std::string_view data) {
  if (index >= chunks_.size()) return false;
  Chunk& chunk = chunks_[index];
  if (chunk.offset >= 0) return false;
  if (std::exchange(chunk.asked, false)) --awaited_;
  if (xxh3_64(data) != manifest_.chunk_xxh3(static_cast<int>(index))) return false;
  const auto offset = static_cast<std::int64_t>(bytes_);
  if (std::fseek(spool_.get(), static_cast<long>(offset), SEEK_SET) != 0 ||
      std::fwrite(data.data(), 1, data.size(), spool_.get()) != data.size()) {
    std::clearerr(spool_.get());
    return disk_error(name_, "cannot write");
  }
  chunk.offset = offset;
  chunk.bytes = static_cast<std::uint32_t>(data.size());
  bytes_ += data.size();
  ++kept_;
  return true;
}

std::vector<std::uint32_t> ResultIntake::ask() {
  std::vector<std::uint32_t> indices;
  awaited_ = 0;
  for (Chunk& chunk : chunks_) chunk.asked = false;
  for (std::size_t i = 0; i < chunks_.size() && indices.size() < kAskAtOnce; ++i) {
    if (chunks_[i].offset >= 0) continue;
    chunks_[i].asked = true;
    indices.push_back(static_cast<std::uint32_t>(i));
  }
  awaited_ = indices.size();
  return indices;
}

Result<std::string> ResultIntake::read(std::size_t index) const {
  const Chunk& chunk = chunks_[index];
  std::string data(chunk.bytes, '\0');
  if (std::fseek(spool_.get(), static_cast<long>(chunk.offset), SEEK_SET) != 0 ||
      std::fread(data.data(), 1, data.size(), spool_.get()) != data.size()) {
    return disk_error(name_, "cannot read back");
  }
  return data;
}

}  // namespace pf
