#pragma once

#include <optional>
#include <span>
#include <string_view>

#include "coordinator/http/message.h"

namespace pf {

/// A file of the dashboard, in the program itself.
struct WebFile {
  std::string_view path;  ///< "/" or "/assets/NAME"
  std::string_view content_type;
  std::string_view etag;  ///< with its quotes
  bool hashed = false;    ///< its name holds a hash of its content: it never changes
  std::string_view content;
};

/// The dashboard's file that is asked for; none: the address is no file's. Needs no token: the files hold no
/// data.
[[nodiscard]] std::optional<HttpReply> web_reply(std::span<const WebFile> files, const HttpRequest& request);

}  // namespace pf
