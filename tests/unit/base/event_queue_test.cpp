#include "common/base/event_queue.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <memory>
#include <thread>
#include <vector>

namespace pf {
namespace {

using std::chrono::steady_clock;

steady_clock::time_point now() { return steady_clock::now(); }
/// Far enough that only a hanging test meets it.
steady_clock::time_point late() { return now() + std::chrono::seconds(30); }

TEST(EventQueue, GivesEventsInTheirOrder) {
  EventQueue<std::unique_ptr<int>> queue(4);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(queue.push(std::make_unique<int>(i)));
  for (int i = 0; i < 4; ++i) EXPECT_EQ(**queue.pop(late()), i);
  EXPECT_FALSE(queue.pop(now()));
}

TEST(EventQueue, RefusesWhatDoesNotFit) {
  EventQueue<int> queue(2, 100);
  EXPECT_TRUE(queue.try_push(1, 60));
  EXPECT_FALSE(queue.try_push(2, 41)) << "too many bytes";
  EXPECT_TRUE(queue.try_push(3, 40));
  EXPECT_FALSE(queue.try_push(4, 0)) << "too many events";
  EXPECT_FALSE(queue.push(5, 0, now()));
  EXPECT_EQ(queue.pop(now()), 1);
  EXPECT_TRUE(queue.try_push(6, 60));
  EXPECT_EQ(queue.size(), 2U);
}

TEST(EventQueue, TakesAnEventLargerThanItsBoundWhenEmpty) {
  EventQueue<int> queue(8, 100);
  EXPECT_TRUE(queue.try_push(1, 1000));
  EXPECT_FALSE(queue.try_push(2, 1));
  EXPECT_EQ(queue.pop(now()), 1);
  EXPECT_TRUE(queue.try_push(2, 1));
}

TEST(EventQueue, HoldsProducersUpUntilThereIsRoom) {
  EventQueue<int> queue(1);
  EXPECT_TRUE(queue.push(1));
  auto pushed = std::async(std::launch::async, [&] { return queue.push(2, 0, late()); });
  EXPECT_EQ(queue.pop(late()), 1);
  EXPECT_TRUE(pushed.get());
  EXPECT_EQ(queue.pop(late()), 2);
}

TEST(EventQueue, LosesNothingBetweenThreads) {
  constexpr int kThreads = 4;
  constexpr int kEach = 2000;
  EventQueue<int> queue(16, 64);
  std::vector<std::jthread> producers;
  for (int thread = 0; thread < kThreads; ++thread) {
    producers.emplace_back([&queue, thread] {
      for (int i = 0; i < kEach; ++i) ASSERT_TRUE(queue.push(thread * kEach + i, static_cast<std::size_t>(i % 20)));
    });
  }
  std::vector<int> last(kThreads, -1);
  for (int i = 0; i < kThreads * kEach; ++i) {
    const std::optional<int> event = queue.pop(late());
    ASSERT_TRUE(event);
    int& before = last[static_cast<std::size_t>(*event / kEach)];
    EXPECT_LT(before, *event) << "a producer's own events keep their order";
    before = *event;
  }
  EXPECT_FALSE(queue.pop(now()));
}

TEST(EventQueue, GivesWhatIsLeftAfterClosingAndWakesWhoWaits) {
  EventQueue<int> queue(1);
  EXPECT_TRUE(queue.push(1));
  auto pushed = std::async(std::launch::async, [&] { return queue.push(2); });
  queue.close();
  EXPECT_FALSE(pushed.get());
  EXPECT_TRUE(queue.closed());
  EXPECT_FALSE(queue.try_push(3));
  EXPECT_EQ(queue.pop(), 1);
  EXPECT_FALSE(queue.pop());

  EventQueue<int> empty(1);
  auto popped = std::async(std::launch::async, [&] { return empty.pop(); });
  empty.close();
  EXPECT_FALSE(popped.get());
}

}  // namespace
}  // namespace pf
