#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "coordinator/http/file.h"
#include "coordinator/http/tokens.h"

namespace pf {

// Requests and replies as the routes see them: free of the HTTP library, which stays in http_server.cpp.

struct HttpRequest {
  std::string method;
  std::string path;                                ///< percent-decoded, without the query
  std::multimap<std::string, std::string> params;  ///< of the query, decoded
  std::map<std::string, std::string> headers;      ///< names in lower case
  /// Hands the body over in pieces until `take` returns false. False when it did, or when the body did not
  /// come whole.
  std::function<bool(const std::function<bool(std::string_view piece)>& take)> read_body;
  Caller caller;  ///< who asks; set by refused_access

  /// Empty when absent.
  [[nodiscard]] std::string header(const std::string& lower_case_name) const;
  [[nodiscard]] std::string param(const std::string& name) const;
};

/// A part of a file. Shared because the HTTP library copies what it calls.
struct FileSlice {
  std::shared_ptr<const OpenFile> file;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};

/// Bytes that others read too, which `owner` keeps.
struct SharedBytes {
  std::shared_ptr<const void> owner;
  std::string_view bytes;
};

/// Appends the next piece of a stream, or nothing when there is none within a fraction of a second; false at
/// its end.
using NextPiece = std::function<bool(std::string& piece)>;

struct HttpReply {
  int status = 200;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers;
  std::variant<std::string, FileSlice, SharedBytes, NextPiece> body;
};

/// The number that `text` is, when it is decimal digits and nothing else.
[[nodiscard]] std::optional<std::uint64_t> whole_number(std::string_view text);

}  // namespace pf
