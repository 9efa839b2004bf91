#include "common/wire/messages.h"

#include <algorithm>
#include <cctype>

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include "common/wire/limits.h"
#include "common/wire/message_checks.h"
#include "common/wire/message_scan.h"

namespace pf {
namespace {

constexpr std::size_t kMaxTaskBytes = 4096;
constexpr std::size_t kMaxPathBytes = 1024;

int digit_of(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

template <typename Message>
Result<Message> parse(std::string_view bytes, std::size_t most_bytes) {
  const auto refuse = [](std::string why) {
    return fail(ErrorKind::kInvalidInput, "message refused: " + std::move(why));
  };
  const google::protobuf::Descriptor& schema = *Message::descriptor();
  if (bytes.size() > most_bytes) {
    return refuse(fmt::format("{}: {} bytes; expected at most {}", schema.name(), bytes.size(), most_bytes));
  }
  if (auto wrong = scan_message(schema, bytes)) return refuse(std::move(*wrong));
  Message message;
  if (!message.ParsePartialFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return refuse(schema.name() + ": is not of this schema");
  }
  message.DiscardUnknownFields();
  if (auto wrong = pf::what_is_wrong(message)) return refuse(std::move(*wrong));
  return message;
}

}  // namespace

Result<wire::Task> parse_task(std::string_view bytes) { return parse<wire::Task>(bytes, kMaxTaskBytes); }
Result<wire::FromWorker> parse_from_worker(std::string_view bytes) {
  return parse<wire::FromWorker>(bytes, kMaxMessageBytes);
}
Result<wire::ToWorker> parse_to_worker(std::string_view bytes) {
  return parse<wire::ToWorker>(bytes, kMaxMessageBytes);
}
Result<wire::Bundle> parse_bundle(std::string_view bytes) { return parse<wire::Bundle>(bytes, kMaxBundleBytes); }

std::string to_bytes(const google::protobuf::MessageLite& message) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream out(&stream);
    out.SetSerializationDeterministic(true);
    message.SerializePartialToCodedStream(&out);
  }
  return bytes;
}

wire::FilmOptions to_wire(const FilmOptions& options) {
  wire::FilmOptions out;
  out.set_width(static_cast<std::uint32_t>(options.width));
  out.set_height(static_cast<std::uint32_t>(options.height));
  out.set_estimator(static_cast<std::uint32_t>(options.estimator));
  out.set_radiance_step(options.scale.radiance);
  out.set_flow_step(options.scale.flow);
  out.set_square_step(options.scale.square);
  out.set_depth_step(options.scale.depth);
  out.set_alpha(options.alpha);
  out.set_round_growth(options.round_growth);
  out.set_extra(static_cast<std::uint32_t>(options.extra));
  out.set_part_edge(static_cast<std::uint32_t>(options.part_edge));
  out.set_hit_points(static_cast<std::uint32_t>(options.hit_points));
  return out;
}

Result<FilmOptions> from_wire(const wire::FilmOptions& options) {
  if (auto wrong = what_is_wrong(options)) return fail(ErrorKind::kInvalidInput, std::move(*wrong));
  FilmOptions out;
  out.width = static_cast<int>(options.width());
  out.height = static_cast<int>(options.height());
  out.estimator = static_cast<Estimator>(options.estimator());
  out.scale = {options.radiance_step(), options.flow_step(), options.square_step(), options.depth_step()};
  out.alpha = options.alpha();
  out.round_growth = options.round_growth();
  out.extra = static_cast<Extra>(options.extra());
  out.part_edge = static_cast<int>(options.part_edge());
  out.hit_points = static_cast<int>(options.hit_points());
  return out;
}

std::string to_wire(const Hash128& hash) {
  std::string bytes;
  for (const std::uint64_t half : {hash.low, hash.high}) {
    for (int shift = 0; shift < 64; shift += 8) bytes += static_cast<char>(half >> shift & 0xff);
  }
  return bytes;
}

std::string sha256_bytes(std::string_view hex) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    const int high = digit_of(hex[i]);
    const int low = digit_of(hex[i + 1]);
    if (high < 0 || low < 0) return {};
    bytes += static_cast<char>(high * 16 + low);
  }
  return bytes;
}

std::string sha256_hex_of_bytes(std::string_view bytes) {
  std::string hex;
  for (const char c : bytes) hex += fmt::format("{:02x}", static_cast<unsigned char>(c));
  return hex;
}

bool is_wire_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxNameBytes && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

bool is_bundle_path(std::string_view path) {
  if (path.empty() || path.size() > kMaxPathBytes) return false;
  // Control characters would make trouble in messages and terminals; the loader takes none either.
  const auto forbidden = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == '\\'; };
  if (std::any_of(path.begin(), path.end(), forbidden)) return false;
  while (true) {
    const std::size_t slash = path.find('/');
    const std::string_view part = path.substr(0, slash);
    if (part.empty() || part == "." || part == "..") return false;
    if (slash == std::string_view::npos) return true;
    path.remove_prefix(slash + 1);
  }
}

BlobId id_of(const wire::Blob& blob) { return {sha256_hex_of_bytes(blob.sha256()), blob.bytes()}; }

}  // namespace pf
