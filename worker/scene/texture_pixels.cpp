#include "worker/scene/texture_pixels.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <system_error>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <fmt/format.h>

namespace pf {
namespace {

std::size_t blocks(std::size_t texels) { return (texels + 3) / 4; }

/// Maps `bytes` of a new file without a name in the temporary folder. The room is taken at once: a disk that
/// fills up later would end the process by a signal. Null on failure, with errno set.
std::uint8_t* map_temporary_file(const std::filesystem::path& folder, std::size_t bytes) {
  int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file < 0) {  // a file system without O_TMPFILE
    std::string path = (folder / "photonfarm-texture-XXXXXX").string();
    file = ::mkostemp(path.data(), O_CLOEXEC);
    if (file < 0) return nullptr;
    ::unlink(path.c_str());
  }
  const int full = ::posix_fallocate(file, 0, static_cast<off_t>(bytes));
  void* mapped = full == 0 ? ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0) : MAP_FAILED;
  const int reason = full != 0 ? full : errno;
  ::close(file);
  errno = reason;
  return mapped == MAP_FAILED ? nullptr : static_cast<std::uint8_t*>(mapped);
}

}  // namespace

void TexturePixels::Release::operator()(std::uint8_t* p) const {
  if (mapped > 0) {
    ::munmap(p, mapped);
  } else {
    delete[] p;
  }
}

std::size_t TexturePixels::bytes(const PixelLayout& layout) {
  return blocks(layout.width) * blocks(layout.height) * 16 * layout.channels * layout.bytes_per_channel;
}

Result<TexturePixels> TexturePixels::allocate(const PixelLayout& layout, bool in_memory, const std::string& name) {
  TexturePixels result;
  result.layout_ = layout;
  result.blocks_per_row_ = blocks(layout.width);
  result.texel_bytes_ = layout.channels * layout.bytes_per_channel;
  const std::size_t size = bytes(layout);
  if (in_memory) {
    result.data_ = {new (std::nothrow) std::uint8_t[size], Release{0}};
    if (!result.data_) {
      return fail(ErrorKind::kInternal, fmt::format("{}: no memory for {} MiB of texels", name, size >> 20));
    }
    return result;
  }
  std::error_code ignored;
  const auto folder = std::filesystem::temp_directory_path(ignored);
  result.data_ = {map_temporary_file(folder, size), Release{size}};
  if (!result.data_) {
    return fail(ErrorKind::kInternal, fmt::format("{}: no room for {} MiB of texels in {}: {}", name, size >> 20,
                                                  folder.string(), std::generic_category().message(errno)));
  }
  return result;
}

void TexturePixels::set_row(std::size_t y, std::span<const std::uint8_t> row) {
  for (std::size_t x = 0; x < layout_.width; ++x) {
    std::copy_n(row.data() + x * texel_bytes_, texel_bytes_, data_.get() + offset(x, y));
  }
}

}  // namespace pf
