// File of an irradiance cache, little-endian, no padding:
//   8 bytes  "PFIRRC02"
//   u64 options, u64 seed, u32 next_id
//   u32 count of views, u64 each
//   u32 count of parts, each: u64 hash low, u64 hash high, u8 whether it has bounds (1) or not (0), with them
//   6 floats,
//       3 floats flux, 3 floats axis, float cosine
//   u32 count of records, each: 3 floats position, 3 normal, 3 geometric normal, float extent, 3 irradiance,
//       9 rotation, 9 translation, float radius, float least, float most, u32 id, u32 rays, then u16 distance of every
//       cell of its hemisphere and u16 luminance of every cell
//   8 bytes  XXH3 of everything before

#include "worker/photon/irradiance_file.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "common/base/hash.h"

namespace pf {
namespace {

static_assert(std::endian::native == std::endian::little);
constexpr std::string_view kMagic = "PFIRRC02";
constexpr std::size_t kPartBytes = 16 + 1 + 7 * 4;    // without bounds
constexpr std::size_t kRecordBytes = 34 * 4 + 2 * 4;  // without the reach
/// More rays of one hemisphere than the job file allows.
constexpr std::uint32_t kMaxRays = 1u << 20;

class Writer {
 public:
  template <typename T>
  void put(T value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void put(const Vec3f& v) { put(v.x), put(v.y), put(v.z); }
  void put(const RgbGradient& gradient) {
    for (const Vec3f& g : gradient) put(g);
  }
  void raw(std::string_view text) { bytes_ += text; }
  [[nodiscard]] std::string take() {
    put(xxh3_64(bytes_));
    return std::move(bytes_);
  }

 private:
  std::string bytes_;
};

/// Takes values one after the other; what is wrong first is kept, and all later values are zeros.
class Reader {
 public:
  Reader(std::string_view bytes, std::string_view origin) : bytes_(bytes), origin_(origin) {}

  template <typename T>
  [[nodiscard]] T take() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    if (holds(sizeof(T))) {
      std::memcpy(&value, bytes_.data() + at_, sizeof(T));
      at_ += sizeof(T);
    }
    return value;
  }
  [[nodiscard]] Vec3f vector(const char* what) {
    const float x = number(what), y = number(what);
    return {x, y, number(what)};
  }
  [[nodiscard]] Vec3f unit_vector(const char* what) {
    const Vec3f v = vector(what);
    constexpr float kTolerance = 1e-3f;
    if (!(std::abs(length(v) - 1.0f) < kTolerance)) wrong(what, "a unit vector");
    return v;
  }
  [[nodiscard]] RgbGradient gradient(const char* what) {
    const Vec3f r = vector(what), g = vector(what);
    return {r, g, vector(what)};
  }
  [[nodiscard]] float number(const char* what) {
    const float value = take<float>();
    if (!std::isfinite(value)) wrong(what, "a finite number");
    return value;
  }
  [[nodiscard]] float positive(const char* what) {
    const float value = number(what);
    if (!(value > 0.0f)) wrong(what, "a number above 0");
    return value;
  }
  /// A count of things of at least so many bytes each.
  [[nodiscard]] std::uint32_t count(const char* what, std::size_t bytes_each) {
    const auto value = take<std::uint32_t>();
    if ((bytes_.size() - at_) / bytes_each >= value) return value;
    wrong(what, fmt::format("at most {}", (bytes_.size() - at_) / bytes_each));
    return 0;
  }
  /// Whether so many bytes are left.
  [[nodiscard]] bool holds(std::size_t bytes) {
    if (bytes_.size() - at_ < bytes) wrong("the file ends early", fmt::format("{} more bytes", bytes));
    return good();
  }
  void wrong(std::string_view what, std::string_view expected) {
    if (error_.empty()) error_ = fmt::format("{}: byte {}: {}; expected {}", origin_, at_, what, expected);
  }
  [[nodiscard]] bool good() const { return error_.empty(); }
  [[nodiscard]] const std::string& error() const { return error_; }
  [[nodiscard]] bool at_end() const { return at_ == bytes_.size(); }

 private:
  std::string_view bytes_, origin_;
  std::size_t at_ = 0;
  std::string error_;
};

void put_part(Writer& out, const ScenePart& part) {
  out.put(part.hash.low), out.put(part.hash.high);
  const bool bounded = !part.everywhere();
  out.put(static_cast<std::uint8_t>(bounded ? 1 : 0));
  if (bounded) out.put(part.bounds.min), out.put(part.bounds.max);
  out.put(part.flux), out.put(part.axis), out.put(part.cosine);
}

ScenePart take_part(Reader& in) {
  ScenePart part;
  part.hash.low = in.take<std::uint64_t>();
  part.hash.high = in.take<std::uint64_t>();
  const auto bounded = in.take<std::uint8_t>();
  if (bounded > 1) in.wrong("flag of a part's bounds", "0 or 1");
  if (bounded == 1) {
    const Vec3f low = in.vector("bounds of a part"), high = in.vector("bounds of a part");
    part.bounds = {low, high};
    if (low.x > high.x || low.y > high.y || low.z > high.z) in.wrong("bounds of a part", "low corner first");
  }
  part.flux = in.vector("flux of a part");
  part.axis = in.unit_vector("axis of a part");
  part.cosine = in.number("cone of a part");
  return part;
}

void put_record(Writer& out, const IrradianceRecord& record, const RecordReach& reach) {
  out.put(record.position), out.put(record.normal), out.put(record.geometric_normal), out.put(record.extent);
  out.put(record.irradiance), out.put(record.rotation), out.put(record.translation);
  out.put(record.radius), out.put(record.least), out.put(record.most), out.put(record.id), out.put(record.rays);
  for (const std::uint16_t distance : reach.distance) out.put(distance);
  for (const std::uint16_t luminance : reach.luminance) out.put(luminance);
}

IrradianceRecord take_record(Reader& in, std::uint32_t next_id) {
  IrradianceRecord record;
  record.position = in.vector("position of a record");
  record.normal = in.unit_vector("normal of a record");
  record.geometric_normal = in.unit_vector("geometric normal of a record");
  record.extent = in.number("extent of a record");
  record.irradiance = in.vector("irradiance of a record");
  if (min_component(record.irradiance) < 0.0f) in.wrong("irradiance of a record", "no negative number");
  record.rotation = in.gradient("gradient of a record");
  record.translation = in.gradient("gradient of a record");
  record.radius = in.positive("radius of a record");
  record.least = in.positive("bounds of a record's radius");
  record.most = in.positive("bounds of a record's radius");
  record.id = in.take<std::uint32_t>();
  if (in.good() && record.id >= next_id) in.wrong("id of a record", fmt::format("less than {}", next_id));
  record.rays = in.take<std::uint32_t>();
  if (record.rays < 1 || record.rays > kMaxRays) {
    in.wrong("rays of a record", fmt::format("1 to {}", kMaxRays));
    record.rays = 1;
  }
  return record;
}

RecordReach take_reach(Reader& in, std::uint32_t cells) {
  RecordReach reach;
  if (!in.holds(std::size_t{4} * cells)) return reach;
  for (auto* values : {&reach.distance, &reach.luminance}) {
    values->reserve(cells);
    for (std::uint32_t i = 0; i < cells && in.good(); ++i) {
      values->push_back(in.take<std::uint16_t>());
      if (!(unpack_half(values->back()) >= 0.0f)) in.wrong("reach of a record", "no negative number");
    }
  }
  return reach;
}

}  // namespace

std::string to_bytes(const IrradianceFile& file) {
  Writer out;
  out.raw(kMagic);
  out.put(file.options), out.put(file.seed), out.put(file.next_id);
  out.put(static_cast<std::uint32_t>(file.views.size()));
  for (const std::uint64_t view : file.views) out.put(view);
  out.put(static_cast<std::uint32_t>(file.parts.size()));
  for (const ScenePart& part : file.parts) put_part(out, part);
  out.put(static_cast<std::uint32_t>(file.records.size()));
  for (std::size_t i = 0; i < file.records.size(); ++i) put_record(out, file.records[i], file.reaches[i]);
  return out.take();
}

Result<IrradianceFile> parse_irradiance_file(std::string_view bytes, std::string_view origin) {
  if (!bytes.starts_with(kMagic)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: byte 0: not an irradiance cache; expected \"{}\"", origin, kMagic));
  }
  std::uint64_t checksum = 0;
  if (bytes.size() < kMagic.size() + sizeof(checksum)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: byte {}: the file ends early; expected a checksum", origin, bytes.size()));
  }
  const std::string_view content = bytes.substr(0, bytes.size() - sizeof(checksum));
  std::memcpy(&checksum, bytes.data() + content.size(), sizeof(checksum));
  if (checksum != xxh3_64(content)) {
    return fail(
        ErrorKind::kInvalidInput,
        fmt::format("{}: byte {}: wrong checksum; expected the file as it was written", origin, content.size()));
  }
  Reader in(content, origin);
  for (std::size_t i = 0; i < kMagic.size(); ++i) static_cast<void>(in.take<char>());
  IrradianceFile file;
  file.options = in.take<std::uint64_t>();
  file.seed = in.take<std::uint64_t>();
  file.next_id = in.take<std::uint32_t>();
  for (std::uint32_t left = in.count("number of views", sizeof(std::uint64_t)); left > 0; --left) {
    file.views.push_back(in.take<std::uint64_t>());
  }
  for (std::uint32_t left = in.count("number of parts", kPartBytes); left > 0 && in.good(); --left) {
    file.parts.push_back(take_part(in));
  }
  for (std::uint32_t left = in.count("number of records", kRecordBytes); left > 0 && in.good(); --left) {
    file.records.push_back(take_record(in, file.next_id));
    file.reaches.push_back(take_reach(in, file.records.back().grid().cells()));
  }
  if (in.good() && !in.at_end()) in.wrong("more bytes than records", "the checksum");
  if (!in.good()) return fail(ErrorKind::kInvalidInput, in.error());
  return file;
}

}  // namespace pf
