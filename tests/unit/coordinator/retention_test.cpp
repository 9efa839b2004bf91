#include "coordinator/retention.h"

#include <gtest/gtest.h>

namespace pf {
namespace {

constexpr std::int64_t kDay = 86400000;

std::string told(const std::vector<Expiry>& expired) {
  std::string text;
  for (const Expiry& e : expired) text += e.job + (e.results ? " results, " : " checkpoint, ");
  return text;
}

TEST(Retention, KeepsEverythingUnlessToldOtherwise) {
  EXPECT_TRUE(RetentionPolicy{}.keeps_all());
  EXPECT_EQ(told(what_expires({}, {{"a", 0, 1000, 1000}}, 1000 * kDay)), "");
}

TEST(Retention, CheckpointsAndResultsExpireAfterTheirDays) {
  const RetentionPolicy policy{.result_days = 30, .checkpoint_days = 7, .bytes = 0};
  EXPECT_EQ(told(what_expires(policy, {{"a", 0, 10, 10}}, 7 * kDay - 1)), "");
  EXPECT_EQ(told(what_expires(policy, {{"a", 0, 10, 10}}, 7 * kDay)), "a checkpoint, ");
  EXPECT_EQ(told(what_expires(policy, {{"a", 0, 10, 0}}, 7 * kDay)), "") << "it went already";
  EXPECT_EQ(told(what_expires(policy, {{"b", 5 * kDay, 10, 10}, {"a", 0, 10, 10}}, 31 * kDay)),
            "a checkpoint, a results, b checkpoint, ");
}

TEST(Retention, BeyondTheBytesTheOldestCheckpointsGoFirstThenTheOldestResults) {
  RetentionPolicy policy{.result_days = 0, .checkpoint_days = 0, .bytes = 35};
  const std::vector<KeptFiles> kept{{"new", 3, 10, 10}, {"old", 1, 10, 10}, {"mid", 2, 10, 10}};
  EXPECT_EQ(told(what_expires(policy, kept, 4)), "old checkpoint, mid checkpoint, new checkpoint, ");
  policy.bytes = 60;
  EXPECT_EQ(told(what_expires(policy, kept, 4)), "");
  policy.bytes = 15;
  EXPECT_EQ(told(what_expires(policy, kept, 4)),
            "old checkpoint, mid checkpoint, new checkpoint, old results, mid results, ");
}

TEST(Retention, WhatWentByAgeIsNotCountedNorNamedAgain) {
  const RetentionPolicy policy{.result_days = 0, .checkpoint_days = 1, .bytes = 15};
  EXPECT_EQ(told(what_expires(policy, {{"a", 0, 10, 10}, {"b", 2 * kDay, 5, 10}}, 2 * kDay)),
            "a checkpoint, b checkpoint, ");
}

}  // namespace
}  // namespace pf
