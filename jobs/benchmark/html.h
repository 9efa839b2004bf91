#pragma once

#include <string>
#include <string_view>

namespace pf::bench {

/// Text as HTML shows it unchanged, in attributes too.
[[nodiscard]] std::string escaped(std::string_view text);
/// An error with three digits; a dash where there is none.
[[nodiscard]] std::string error_text(double error);

}  // namespace pf::bench
