// Any bytes as the file of an irradiance cache: no crash, no hang, no flood of memory. What is taken keeps
// the promises of irradiance_file.h, and a cache made of it can be read. Bytes are tried as they are and
// below a right checksum, which a fuzzer would hardly ever find.
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "common/base/hash.h"
#include "worker/photon/irradiance_file.h"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

void check(std::string_view bytes) {
  const auto file = pf::parse_irradiance_file(bytes, "fuzz");
  if (!file) {
    require(file.error().message.starts_with("fuzz: byte "));
    require(file.error().message.find("; expected ") != std::string::npos);
    for (const char c : file.error().message) require(static_cast<unsigned char>(c) >= 0x20);
    return;
  }
  require(pf::to_bytes(*file) == bytes);
  require(file->reaches.size() == file->records.size());
  constexpr std::size_t kReadable = 1000;  // more records show nothing new
  if (file->records.size() > kReadable) return;
  pf::IrradianceCache cache({{-1, -1, -1}, {1, 1, 1}}, 0.15f);
  cache.assign(file->records);
  for (const pf::IrradianceRecord& record : file->records) {
    require(record.id < file->next_id);
    static_cast<void>(cache.interpolate(record.position, record.normal));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  check(bytes);
  const std::uint64_t checksum = pf::xxh3_64(bytes);
  bytes.append(reinterpret_cast<const char*>(&checksum), sizeof(checksum));
  check(bytes);
  return 0;
}
