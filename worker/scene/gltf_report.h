#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf::gltf {

/// Text from a file as it may stand in a message: in double quotes, control characters escaped, cut after 96
/// bytes.
[[nodiscard]] std::string in_quotes(std::string_view text);

/// What the checks of one file have found. The first error stands: everything after it may only be a
/// consequence. Every message reads `file: /json/pointer: what; what was expected`.
class Report {
 public:
  explicit Report(std::string file) : file_(std::move(file)) {}

  void error(std::string_view pointer, std::string_view what);
  /// A fault that cannot touch the image, or something that the image will lack. Equal lines appear once;
  /// after kMaxWarnings only their number is kept.
  void warn(std::string_view pointer, std::string_view what);
  /// A warning made of an error that turned out not to touch the image.
  void warn(const Error& error, std::string_view remark);
  /// An error for the caller to return.
  [[nodiscard]] tl::unexpected<Error> fail(std::string_view pointer, std::string_view what) const;

  [[nodiscard]] bool failed() const { return error_.has_value(); }
  [[nodiscard]] Result<void> result() const;
  [[nodiscard]] std::size_t warning_count() const { return warnings_.size() + suppressed_; }
  [[nodiscard]] std::vector<std::string> take_warnings();

  static constexpr std::size_t kMaxWarnings = 100;

 private:
  void add_warning(std::string text);
  [[nodiscard]] std::string line(std::string_view pointer, std::string_view what) const;

  std::string file_;
  std::optional<Error> error_;
  std::vector<std::string> warnings_;
  std::size_t suppressed_ = 0;
};

/// `a/b` with the reference token escaped for a JSON pointer (RFC 6901) and for a terminal.
[[nodiscard]] std::string child(std::string_view pointer, std::string_view key);
[[nodiscard]] std::string child(std::string_view pointer, std::size_t index);

}  // namespace pf::gltf
