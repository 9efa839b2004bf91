#pragma once

#include <string>
#include <string_view>

#include "common/base/hash.h"
#include "common/base/result.h"
#include "common/film/film.h"
#include "common/wire/blob_store.h"
#include "messages.pb.h"

namespace pf {

namespace wire = photonfarm::wire::v1;

// Every message is parsed by one of these and nowhere else: size, version, names, lengths of hashes, counts,
// ranges and finite numbers are checked, so that what comes out can be trusted to be well-formed. Errors:
// kInvalidInput, naming the field.
[[nodiscard]] Result<wire::Task> parse_task(std::string_view bytes);
[[nodiscard]] Result<wire::FromWorker> parse_from_worker(std::string_view bytes);
[[nodiscard]] Result<wire::ToWorker> parse_to_worker(std::string_view bytes);
[[nodiscard]] Result<wire::Bundle> parse_bundle(std::string_view bytes);

/// Deterministic serialisation (equal messages, equal bytes).
[[nodiscard]] std::string to_bytes(const google::protobuf::MessageLite& message);

[[nodiscard]] wire::FilmOptions to_wire(const FilmOptions& options);
/// Errors: kInvalidInput: sizes, steps that are no positive finite numbers, alpha outside (0, 1].
[[nodiscard]] Result<FilmOptions> from_wire(const wire::FilmOptions& options);

/// 16 bytes, low half first, little-endian; as in ResultManifest.content.
[[nodiscard]] std::string to_wire(const Hash128& hash);
/// 32 bytes from 64 hexadecimal digits, and back.
[[nodiscard]] std::string sha256_bytes(std::string_view hex);
[[nodiscard]] std::string sha256_hex_of_bytes(std::string_view bytes);
/// [A-Za-z0-9_-]{1,64}
[[nodiscard]] bool is_wire_name(std::string_view name);
/// A path inside a bundle: relative, no empty part, '.' or '..', no NUL or backslash, at most 1024 bytes.
[[nodiscard]] bool is_bundle_path(std::string_view path);

/// The blob that a message speaks of.
[[nodiscard]] BlobId id_of(const wire::Blob& blob);

}  // namespace pf
