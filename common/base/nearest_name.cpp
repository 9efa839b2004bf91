#include "common/base/nearest_name.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace pf {
namespace {

constexpr std::size_t kMaxLength = 100;  // longer names are no typing errors, and the distance costs length squared

char fold(char c) {
  if (c == '-') return '_';
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

std::size_t distance(std::string_view a, std::string_view b) {
  // Rows of the dynamic programme: the one before the last, the last, the one being filled.
  std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const bool same = fold(a[i - 1]) == fold(b[j - 1]);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (same ? 0 : 1)});
      const bool swapped = i > 1 && j > 1 && fold(a[i - 1]) == fold(b[j - 2]) && fold(a[i - 2]) == fold(b[j - 1]);
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

template <typename Name>
std::optional<std::string_view> nearest(std::string_view name, std::span<const Name> valid) {
  if (name.size() > kMaxLength) return std::nullopt;
  std::optional<std::string_view> best;
  // About a third of the letters may be wrong.
  std::size_t best_distance = std::max<std::size_t>(1, (name.size() + 1) / 3) + 1;
  for (const std::string_view candidate : valid) {
    if (candidate.size() > kMaxLength) continue;
    const std::size_t d = distance(name, candidate);
    if (d < best_distance && d < candidate.size()) {
      best = candidate;
      best_distance = d;
    }
  }
  return best;
}

}  // namespace

std::optional<std::string_view> nearest_name(std::string_view name, std::span<const std::string_view> valid) {
  return nearest(name, valid);
}
std::optional<std::string_view> nearest_name(std::string_view name, std::span<const std::string> valid) {
  return nearest(name, valid);
}

}  // namespace pf
