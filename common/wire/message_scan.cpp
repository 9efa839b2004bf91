#include "common/wire/message_scan.h"

#include <cstdint>
#include <map>

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include "common/wire/limits.h"

namespace pf {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

constexpr std::size_t kMaxUnknownFields = 64;
static_assert(kMaxBundleFiles <= kMaxUnits);

class Scan {
 public:
  std::optional<std::string> message(const Descriptor& schema, std::string_view bytes, const std::string& place);

 private:
  std::optional<std::string> field(const FieldDescriptor& field, std::string_view bytes, const std::string& place);

  std::size_t unknown_ = 0;
};

std::string path_of(const std::string& place, const FieldDescriptor& field) {
  return place.empty() ? field.name() : place + "." + field.name();
}

std::optional<std::string> Scan::message(const Descriptor& schema, std::string_view bytes, const std::string& place) {
  const std::string where = place.empty() ? std::string(schema.name()) : place;
  std::map<int, std::size_t> seen;
  CodedInputStream in(reinterpret_cast<const std::uint8_t*>(bytes.data()), static_cast<int>(bytes.size()));
  while (const std::uint32_t tag = in.ReadTag()) {
    const FieldDescriptor* known = schema.FindFieldByNumber(WireFormatLite::GetTagFieldNumber(tag));
    if (known == nullptr && ++unknown_ > kMaxUnknownFields) return where + ": more than 64 unknown fields";
    const bool delimited = WireFormatLite::GetTagWireType(tag) == WireFormatLite::WIRETYPE_LENGTH_DELIMITED;
    if (known != nullptr) {
      const std::size_t times = ++seen[known->number()];
      if (!known->is_repeated() && times > 1) return path_of(place, *known) + ": stands twice";
      if (known->is_repeated() && !known->is_packable() && times > kMaxUnits) {
        return fmt::format("{}: more than {} elements", path_of(place, *known), kMaxUnits);
      }
    }
    if (!delimited) {
      // Groups nest without a length; this schema has none.
      if (WireFormatLite::GetTagWireType(tag) == WireFormatLite::WIRETYPE_START_GROUP ||
          !WireFormatLite::SkipField(&in, tag)) {
        return where + ": broken field";
      }
      continue;
    }
    std::uint32_t length = 0;
    if (!in.ReadVarint32(&length)) return where + ": broken length";
    const auto at = static_cast<std::size_t>(in.CurrentPosition());
    if (length > bytes.size() - at || !in.Skip(static_cast<int>(length))) return where + ": cut short";
    if (known == nullptr) continue;
    if (auto wrong = field(*known, bytes.substr(at, length), path_of(place, *known))) return wrong;
  }
  if (!in.ConsumedEntireMessage()) return where + ": broken tag";
  return std::nullopt;
}

std::optional<std::string> Scan::field(const FieldDescriptor& field, std::string_view bytes, const std::string& place) {
  // The schema has no message inside itself, so its depth bounds this recursion.
  if (field.type() == FieldDescriptor::TYPE_MESSAGE) return message(*field.message_type(), bytes, place);
  if (field.type() == FieldDescriptor::TYPE_STRING && !is_utf8(bytes)) return place + ": is not valid UTF-8";
  return std::nullopt;
}

}  // namespace

std::optional<std::string> scan_message(const Descriptor& schema, std::string_view bytes) {
  return Scan().message(schema, bytes, "");
}

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const auto byte = [&](std::size_t k) { return static_cast<std::uint32_t>(static_cast<unsigned char>(text[k])); };
    const std::uint32_t first = byte(i);
    if (first < 0x80) {
      ++i;
      continue;
    }
    const std::size_t length = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
    if (first < 0xc2 || first > 0xf4 || text.size() - i < length) return false;
    std::uint32_t point = first & (0x7fu >> length);
    for (std::size_t k = 1; k < length; ++k) {
      if ((byte(i + k) & 0xc0u) != 0x80u) return false;
      point = point << 6 | (byte(i + k) & 0x3fu);
    }
    constexpr std::uint32_t kLeast[] = {0x80, 0x800, 0x10000};
    if (point < kLeast[length - 2] || point > 0x10ffff || (point >= 0xd800 && point <= 0xdfff)) return false;
    i += length;
  }
  return true;
}

}  // namespace pf
