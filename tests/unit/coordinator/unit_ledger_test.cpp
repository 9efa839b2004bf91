#include "coordinator/unit_ledger.h"

#include <random>
#include <set>

#include <gtest/gtest.h>

namespace pf {
namespace {

TEST(UnitLedger, IssuesEverySubPassOnceUpToTheLimit) {
  UnitLedger ledger;
  EXPECT_EQ(ledger.issue(3, 5, 0.0), (UnitRange{0, 3}));
  EXPECT_EQ(ledger.issue(3, 5, 0.0), (UnitRange{3, 2}));
  EXPECT_FALSE(ledger.issue(3, 5, 0.0));
  EXPECT_EQ(ledger.queued(), 2u);
}

TEST(UnitLedger, CountsWhatIsDoneWithoutGapsAndBeyond) {
  UnitLedger ledger;
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(ledger.issue(2, 100, 0.0));
  ledger.finish({2, 2});
  ledger.finish({6, 2});
  EXPECT_EQ(ledger.done_below(), 0u);
  EXPECT_EQ(ledger.done_beyond(), (std::vector<UnitRange>{{2, 2}, {6, 2}}));
  ledger.finish({0, 2});
  EXPECT_EQ(ledger.done_below(), 4u);
  EXPECT_TRUE(ledger.is_done({1, 3}));
  EXPECT_FALSE(ledger.is_done({3, 2}));
  EXPECT_FALSE(ledger.is_out({4, 1})) << "only the whole unit is out";
  EXPECT_TRUE(ledger.is_out({4, 2}));
}

TEST(UnitLedger, ARepeatedUnitIsInTheQueueAgainWithItsNextAttempt) {
  UnitLedger ledger;
  ASSERT_TRUE(ledger.issue(1, 10, 0.0));
  ledger.find(0)->holder = "worker-1";
  EXPECT_EQ(ledger.queued(), 0u);
  ledger.reissue(0, 5.0);
  EXPECT_EQ(ledger.queued(), 1u);
  EXPECT_EQ(ledger.find(0)->attempt, 2u);
  EXPECT_EQ(ledger.find(0)->since, 5.0);
}

TEST(UnitLedger, SkipsAfterARestartWhatWasDoneBeyondTheGap) {
  UnitLedger ledger;
  ledger.restore(2, {{4, 2}, {9, 1}});
  EXPECT_EQ(ledger.issue(5, 12, 0.0), (UnitRange{2, 2}));
  EXPECT_EQ(ledger.issue(5, 12, 0.0), (UnitRange{6, 3}));
  EXPECT_EQ(ledger.issue(5, 12, 0.0), (UnitRange{10, 2}));
  EXPECT_FALSE(ledger.issue(5, 12, 0.0));
}

TEST(UnitLedger, ASubPassThatComesUnaskedJoinsItsNeighbourAndIsNotIssued) {
  UnitLedger ledger;
  ledger.restore(8, {});
  ASSERT_EQ(ledger.issue(1, 20, 0.0), (UnitRange{8, 1}));
  ASSERT_EQ(ledger.issue(1, 20, 0.0), (UnitRange{9, 1}));
  ASSERT_TRUE(ledger.is_free({10, 1}));
  ledger.finish({10, 1});  // a result of before the restart
  ledger.finish({9, 1});
  EXPECT_EQ(ledger.issue(1, 20, 0.0), (UnitRange{11, 1}));
}

TEST(UnitLedger, AgreesWithASetOfSubPassesWhateverHappens) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    std::mt19937 rng(seed);
    const auto below = [&](unsigned n) { return static_cast<std::uint64_t>(rng() % n); };
    UnitLedger ledger;
    std::set<std::uint64_t> out, done;
    constexpr std::uint64_t kLimit = 60;
    for (int step = 0; step < 300; ++step) {
      const UnitRange any{below(kLimit), 1 + below(4)};
      bool free = true;
      for (std::uint64_t s = any.first; s < any.end(); ++s) free = free && !out.contains(s) && !done.contains(s);
      ASSERT_EQ(ledger.is_free(any), free) << "seed " << seed;
      if (const auto what = below(4); what == 0) {
        if (const auto unit = ledger.issue(1 + below(4), kLimit, 0.0)) {
          for (std::uint64_t s = unit->first; s < unit->end(); ++s) {
            ASSERT_FALSE(done.contains(s)) << "seed " << seed;
            ASSERT_TRUE(out.insert(s).second) << "seed " << seed;
          }
        }
      } else if (what == 1 && free && any.end() <= kLimit) {
        ledger.finish(any);
        for (std::uint64_t s = any.first; s < any.end(); ++s) done.insert(s);
      } else if (what == 2 && !ledger.out().empty()) {
        const UnitRange unit =
            std::next(ledger.out().begin(), static_cast<long>(below(static_cast<unsigned>(ledger.out().size()))))
                ->second.range;
        ledger.finish(unit);
        for (std::uint64_t s = unit.first; s < unit.end(); ++s) out.erase(s), done.insert(s);
      } else if (what == 3 && below(20) == 0) {
        ledger.restore(ledger.done_below(), ledger.done_beyond());
        out.clear();
      }
      std::uint64_t gapless = 0;
      while (done.contains(gapless)) ++gapless;
      ASSERT_EQ(ledger.done_below(), gapless) << "seed " << seed;
    }
  }
}

}  // namespace
}  // namespace pf
