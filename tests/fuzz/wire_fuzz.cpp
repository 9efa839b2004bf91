// Any bytes as what comes over the wire: no crash, no hang, no flood of memory. What is taken keeps the
// promises of messages.h and statistics_codec.h; what is refused leaves no trace. The first byte chooses the
// reader; seeds are the golden messages (tests/unit/wire/golden_test.cpp writes both).
#include <zstd.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

#include "common/wire/bundle.h"
#include "common/wire/limits.h"
#include "common/wire/messages.h"
#include "common/wire/statistics_codec.h"

namespace {

constexpr int kWidth = 70;
constexpr int kHeight = 60;  // one whole tile and a part of one

void require(bool holds) {
  if (!holds) std::abort();
}

template <typename T>
void require_good_error(const pf::Result<T>& result) {
  if (result) return;
  require(!result.error().message.empty());
  for (const char c : result.error().message) require(static_cast<unsigned char>(c) >= 0x20);
}

/// What was taken is taken again, with equal bytes.
template <typename Parse>
void check_message(std::string_view bytes, Parse parse) {
  const auto message = parse(bytes);
  require_good_error(message);
  if (!message) return;
  const std::string again = pf::to_bytes(*message);
  const auto second = parse(again);
  require(second.has_value() && pf::to_bytes(*second) == again);
}

void check_statistics(std::string_view chunk) {
  pf::Statistics sums(kWidth, kHeight);
  const pf::Statistics before = sums;
  pf::StatisticsUnpacker unpacker(sums);
  const auto added = unpacker.add(chunk);
  require_good_error(added);
  if (added) {
    require(!unpacker.add(chunk));  // a second time
    require(unpacker.take_off(chunk).has_value());
  }
  require(sums.pixels == before.pixels && sums.features == before.features);
}

void check_state(std::string_view chunk) {
  std::vector<pf::ProgressivePixel> state(std::size_t{kWidth} * kHeight);
  pf::StateUnpacker unpacker(state);
  const auto added = unpacker.add(chunk);
  require_good_error(added);
  for (const pf::ProgressivePixel& p : state) {
    for (const float radius : {p[pf::kCaustic].radius2, p[pf::kIndirect].radius2, p.covered_radius}) {
      require(std::isfinite(radius) && radius >= 0.0f && (added || radius == 0.0f));
    }
  }
}

/// The decoders see content that zstd would hardly ever let a fuzzer reach.
std::string compressed(std::string_view content) {
  std::string chunk(ZSTD_compressBound(content.size()), '\0');
  chunk.resize(ZSTD_compress(chunk.data(), chunk.size(), content.data(), content.size(), 1));
  return chunk;
}

/// A folder and an empty store for bundles; nothing may ever be laid out from it.
class Unpacker {
 public:
  Unpacker() {
    std::string pattern = (std::filesystem::temp_directory_path() / "photonfarm-fuzz-XXXXXX").string();
    require(::mkdtemp(pattern.data()) != nullptr);
    folder_ = pattern;
  }
  Unpacker(const Unpacker&) = delete;
  Unpacker& operator=(const Unpacker&) = delete;
  ~Unpacker() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  void check(std::string_view manifest) {
    const auto store = pf::BlobStore::open(folder_ / "blobs", 0);
    require(store.has_value());
    const auto spec = pf::unpack_bundle(manifest, *store, folder_ / "job");
    require_good_error(spec);
    require(!spec && !std::filesystem::exists(folder_ / "job"));
  }

 private:
  std::filesystem::path folder_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static Unpacker unpacker;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0]) {
    case '0':
      check_message(bytes, &pf::parse_task);
      break;
    case '1':
      check_message(bytes, &pf::parse_from_worker);
      break;
    case '2':
      check_message(bytes, &pf::parse_to_worker);
      break;
    case '3':
      check_message(bytes, &pf::parse_bundle);
      break;
    case '4':
      check_statistics(bytes);
      break;
    case '5':
      check_state(bytes);
      break;
    case '6':
      check_statistics(compressed(bytes));
      break;
    case '7':
      check_state(compressed(bytes));
      break;
    case '8':
      unpacker.check(bytes);
      break;
    default:
      break;
  }
  return 0;
}
