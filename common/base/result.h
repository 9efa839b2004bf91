#pragma once

#include <string>
#include <utility>

#include <tl/expected.hpp>

namespace pf {

/// What kind of thing went wrong; decides the exit code of a command (see exit_code).
enum class ErrorKind {
  kUsage,         ///< wrong command line
  kInvalidSpec,   ///< job file
  kInvalidInput,  ///< scene or image: missing, broken or unsupported
  kUnavailable,   ///< engine or coordinator not reachable
  kTimeout,       ///< waited longer than allowed
  kInterrupted,   ///< the user asked to stop; a checkpoint is left
  kInternal       ///< job failed: full disk, overflow of exact sums, a bug
};

/// An error to be shown as one line: `where: what; expected; hint`.
struct Error {
  ErrorKind kind = ErrorKind::kInternal;
  /// `file:line:column: what is wrong; what was expected; nearest valid name`, without a trailing full stop.
  std::string message;
};

template <typename T>
using Result = tl::expected<T, Error>;

/// Shorthand: `return fail(ErrorKind::kInvalidInput, fmt::format(...));`
[[nodiscard]] inline tl::unexpected<Error> fail(ErrorKind kind, std::string message) {
  return tl::unexpected<Error>(Error{kind, std::move(message)});
}

/// Exit code of the command-line contract: 0 done, 2 usage or spec, 3 scene or image input, 4 engine or coordinator
/// not reachable, 5 job failed or cancelled, 130 interrupted.
[[nodiscard]] constexpr int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
    case ErrorKind::kInvalidSpec:
      return 2;
    case ErrorKind::kInvalidInput:
      return 3;
    case ErrorKind::kUnavailable:
    case ErrorKind::kTimeout:
      return 4;
    case ErrorKind::kInterrupted:
      return 130;
    case ErrorKind::kInternal:
      return 5;
  }
  return 5;
}

}  // namespace pf
