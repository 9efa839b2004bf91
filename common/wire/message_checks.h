#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "messages.pb.h"

namespace pf {

namespace wire = photonfarm::wire::v1;

/// Looks at the fields of one message and keeps the first that is wrong.
class FieldChecks {
 public:
  /// `place` stands before every field's name; parts end with '.'.
  explicit FieldChecks(std::string place) : place_(std::move(place)) {}

  void expect(bool holds, std::string_view field, std::string_view expected);
  void version(std::uint32_t version);
  void name(std::string_view value, std::string_view field);
  void name_or_empty(std::string_view value, std::string_view field);
  /// At most `most` bytes.
  void text(std::string_view value, std::string_view field, std::size_t most);
  void build_id(std::string_view value);
  void range(double value, double least, double most, std::string_view field);
  void image(std::uint64_t width, std::uint64_t height);
  void blob(bool present, const wire::Blob& blob, std::string_view field, std::uint64_t most_bytes);
  void part(const wire::Blob& blob, std::uint64_t offset, std::uint64_t bytes);
  void kind(wire::Task::Kind kind);
  /// `prepare`: only the attempt counts, so that the unit may be empty.
  void unit(const wire::Unit& unit, const std::string& field, bool prepare);
  void film(const wire::FilmOptions& options, const std::string& field);
  /// Takes over what is wrong in a part of this message.
  void part(std::optional<std::string> wrong);

  /// `place.field: expected ...` of the first field that is wrong.
  [[nodiscard]] const std::optional<std::string>& wrong() const { return wrong_; }

 private:
  std::string place_;
  std::optional<std::string> wrong_;
};

[[nodiscard]] std::optional<std::string> what_is_wrong(const wire::Task& task);
[[nodiscard]] std::optional<std::string> what_is_wrong(const wire::FromWorker& message);
[[nodiscard]] std::optional<std::string> what_is_wrong(const wire::ToWorker& message);
[[nodiscard]] std::optional<std::string> what_is_wrong(const wire::Bundle& bundle);
[[nodiscard]] std::optional<std::string> what_is_wrong(const wire::FilmOptions& options);

}  // namespace pf
