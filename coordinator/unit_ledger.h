#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace pf {

/// Sub-passes first .. first + count - 1.
struct UnitRange {
  std::uint64_t first = 0;
  std::uint64_t count = 0;
  [[nodiscard]] std::uint64_t end() const { return first + count; }
  friend bool operator==(const UnitRange&, const UnitRange&) = default;
};

/// Which sub-passes of a job are done, which are out as units, and which may go out next. Every sub-pass counts once: a
/// unit is out or done, never both, and two units never overlap.
class UnitLedger {
 public:
  struct Out {
    UnitRange range;
    std::uint32_t attempt = 1;
    double since = 0;    ///< when this attempt was published or last seen with a worker
    std::string holder;  ///< worker that has it; empty: still in the queue, as far as is known
    std::uint32_t failures = 0;
  };

  /// Starts over: sub-passes below `done_below` are done, and those in `done` beyond it.
  void restore(std::uint64_t done_below, const std::vector<UnitRange>& done);

  /// The next unit of at most `count` sub-passes below `limit`, now out; empty when there is none.
  [[nodiscard]] std::optional<UnitRange> issue(std::uint64_t count, std::uint64_t limit, double now);
  /// The unit goes out again: its next attempt.
  void reissue(std::uint64_t first, double now);

  [[nodiscard]] const Out* find(std::uint64_t first) const;
  [[nodiscard]] Out* find(std::uint64_t first);
  /// True when the unit is out, exactly so.
  [[nodiscard]] bool is_out(const UnitRange& range) const;
  [[nodiscard]] bool is_done(const UnitRange& range) const;
  /// True when none of its sub-passes is out or done.
  [[nodiscard]] bool is_free(const UnitRange& range) const;
  void finish(const UnitRange& range);

  [[nodiscard]] const std::map<std::uint64_t, Out>& out() const { return out_; }
  [[nodiscard]] std::size_t queued() const;
  /// All sub-passes below are done.
  [[nodiscard]] std::uint64_t done_below() const { return done_below_; }
  /// First sub-pass never issued.
  [[nodiscard]] std::uint64_t issued_below() const { return issued_below_; }
  /// Done beyond done_below(), ascending; for a checkpoint.
  [[nodiscard]] std::vector<UnitRange> done_beyond() const;

 private:
  std::map<std::uint64_t, Out> out_;             ///< by first sub-pass
  std::map<std::uint64_t, std::uint64_t> done_;  ///< beyond done_below_: first -> end
  std::uint64_t done_below_ = 0;
  std::uint64_t issued_below_ = 0;
};

}  // namespace pf
