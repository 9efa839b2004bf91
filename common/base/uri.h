#pragma once

#include <string>
#include <string_view>

namespace pf {

/// What a URI's %XX stand for [RFC 3986, 2.1]; a lone '%' stays, as exporters write it unescaped.
[[nodiscard]] std::string percent_decoded(std::string_view uri);
/// Whether a URI begins with a scheme such as "https:" [RFC 3986, 3.1].
[[nodiscard]] bool has_scheme(std::string_view uri);

}  // namespace pf
