#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <string>

#include "common/base/clock.h"

namespace pf {

/// One line about work that goes on, for a person: drawn again and again on a terminal, written now and then
/// elsewhere. The caller passes standard error, never standard output. Used from one thread.
class StatusLine {
 public:
  enum class Style {
    kBar,    ///< terminal: redrawn at most ten times a second
    kLines,  ///< file or pipe: at most a line each five seconds
    kSilent
  };
  /// `columns`: width of the terminal; a drawn line never wraps. The first line is due at once.
  StatusLine(const Clock& clock, std::ostream& out, Style style, int columns);

  /// True when enough time went by for a new line; then counts as shown.
  [[nodiscard]] bool due();
  void show(const std::string& text);
  /// The last line; stays on the screen.
  void finish(const std::string& text);
  [[nodiscard]] Style style() const { return style_; }

 private:
  const Clock& clock_;
  std::ostream& out_;
  Style style_;
  std::size_t columns_;
  double last_shown_;
  std::size_t drawn_ = 0;  ///< characters of the line on the screen
};

/// `[######..............] ` for a fraction in [0,1].
[[nodiscard]] std::string progress_bar(double fraction);
/// `0:07`, `12:34`, `1:02:03`.
[[nodiscard]] std::string clock_time(double seconds);
/// `950`, `3.1 k`, `12.0 M`, `1.5 G`: three digits are enough to watch.
[[nodiscard]] std::string short_number(double value);

}  // namespace pf
