#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <google/protobuf/descriptor.h>

namespace pf {

/// Walks a serialised message without making anything of it, and says what is wrong, naming the field
/// (nothing: well-formed). What passes costs the parser at most a fixed multiple of its bytes: no repeated
/// field of messages or texts holds more than kMaxUnits elements, no other one stands twice, nesting follows
/// the schema, texts are valid UTF-8, and fields that this version does not know are few. They are allowed at
/// all so that a peer of another build can be told so by name.
[[nodiscard]] std::optional<std::string> scan_message(const google::protobuf::Descriptor& schema,
                                                      std::string_view bytes);

/// Well-formed UTF-8 [RFC 3629]: no overlong forms, surrogates or code points beyond U+10FFFF.
[[nodiscard]] bool is_utf8(std::string_view text);

}  // namespace pf
