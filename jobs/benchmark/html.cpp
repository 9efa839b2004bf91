#include "jobs/benchmark/html.h"

#include <cmath>

#include <fmt/format.h>

namespace pf::bench {

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string error_text(double error) { return !std::isfinite(error) ? "–" : fmt::format("{:.2e}", error); }

}  // namespace pf::bench
