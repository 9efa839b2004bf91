#include "coordinator/unit_ledger.h"

#include <algorithm>

namespace pf {

void UnitLedger::restore(std::uint64_t done_below, const std::vector<UnitRange>& done) {
  out_.clear();
  done_.clear();
  done_below_ = done_below;
  issued_below_ = done_below;
  for (const UnitRange& range : done) finish(range);
}

std::optional<UnitRange> UnitLedger::issue(std::uint64_t count, std::uint64_t limit, double now) {
  // After a restart, sub-passes that were never issued by this process may be done already.
  if (const auto after = done_.upper_bound(issued_below_); after != done_.begin()) {
    issued_below_ = std::max(issued_below_, std::prev(after)->second);
  }
  if (issued_below_ >= limit || count == 0) return std::nullopt;
  const auto next_done = done_.lower_bound(issued_below_);
  const std::uint64_t bound = next_done == done_.end() ? limit : std::min(limit, next_done->first);
  const UnitRange range{issued_below_, std::min(count, bound - issued_below_)};
  issued_below_ = range.end();
  out_[range.first] = Out{.range = range, .attempt = 1, .since = now, .holder = {}, .failures = 0};
  return range;
}

void UnitLedger::reissue(std::uint64_t first, double now) {
  Out* unit = find(first);
  if (unit == nullptr) return;
  ++unit->attempt;
  unit->since = now;
  unit->holder.clear();
}

const UnitLedger::Out* UnitLedger::find(std::uint64_t first) const {
  const auto it = out_.find(first);
  return it == out_.end() ? nullptr : &it->second;
}
UnitLedger::Out* UnitLedger::find(std::uint64_t first) {
  const auto it = out_.find(first);
  return it == out_.end() ? nullptr : &it->second;
}

bool UnitLedger::is_out(const UnitRange& range) const {
  const Out* unit = find(range.first);
  return unit != nullptr && unit->range == range;
}

bool UnitLedger::is_done(const UnitRange& range) const {
  if (range.end() <= done_below_) return true;
  auto it = done_.upper_bound(range.first);
  if (it == done_.begin()) return false;
  --it;
  return it->first <= range.first && range.end() <= it->second;
}

bool UnitLedger::is_free(const UnitRange& range) const {
  const auto meets = [&](const auto& map, const auto& end_of) {
    auto it = map.lower_bound(range.end());
    return it != map.begin() && end_of(*std::prev(it)) > range.first;
  };
  return range.first >= done_below_ && !meets(done_, [](const auto& e) { return e.second; }) &&
         !meets(out_, [](const auto& e) { return e.second.range.end(); });
}

void UnitLedger::finish(const UnitRange& range) {
  out_.erase(range.first);
  issued_below_ = std::max(issued_below_, done_below_);
  std::uint64_t first = range.first;
  std::uint64_t end = range.end();
  if (end <= done_below_) return;
  // Joined with its neighbours.
  auto next = done_.lower_bound(first);
  if (next != done_.begin()) {
    const auto before = std::prev(next);
    if (before->second >= first) {
      first = before->first;
      end = std::max(end, before->second);
      done_.erase(before);
    }
  }
  while (next != done_.end() && next->first <= end) {
    end = std::max(end, next->second);
    next = done_.erase(next);
  }
  if (first <= done_below_) {
    done_below_ = end;
    issued_below_ = std::max(issued_below_, done_below_);
  } else {
    done_[first] = end;
  }
}

std::size_t UnitLedger::queued() const {
  return static_cast<std::size_t>(
      std::count_if(out_.begin(), out_.end(), [](const auto& entry) { return entry.second.holder.empty(); }));
}

std::vector<UnitRange> UnitLedger::done_beyond() const {
  std::vector<UnitRange> ranges;
  for (const auto& [first, end] : done_) ranges.push_back({first, end - first});
  return ranges;
}

}  // namespace pf
