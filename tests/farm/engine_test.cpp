// The ports of common/wire/nats against a real nats-server: what the farm builds on.

#include <gtest/gtest.h>

#include <sys/wait.h>

#include <csignal>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <thread>

#include <fmt/format.h>

#include "tests/farm/engine_fixture.h"

namespace pf::farm_test {
namespace {

using Engine = EngineTest;

EngineOptions with_ack_wait(EngineOptions options, double seconds) {
  options.ack_wait_seconds = seconds;
  return options;
}

TEST_F(Engine, HandsEachTaskToExactlyOneWorker) {
  Coordinator coordinator(options_of("coordinator"));
  Worker a(options_of("worker-1"));
  Worker b(options_of("worker-2"));
  std::set<std::string> sent;
  for (int i = 0; i < 20; ++i) {
    sent.insert(fmt::format("task {}", i));
    ASSERT_TRUE(coordinator->publish_task(fmt::format("id-{}", i), fmt::format("task {}", i)));
  }
  std::multiset<std::string> taken;
  for (int i = 0; i < 10; ++i) {
    for (Worker* worker : {&a, &b}) {
      const auto task = worker->task();
      ASSERT_TRUE(task);
      taken.insert(task->bytes);
      (*worker)->acknowledge(task->handle);
    }
  }
  EXPECT_EQ(std::set<std::string>(taken.begin(), taken.end()), sent);
  EXPECT_EQ(taken.size(), sent.size());
  a->fetch_task(0.0);
  EXPECT_TRUE(a.next<NoTask>());
}

TEST_F(Engine, DropsARepetitionOfATask) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(coordinator->publish_task("same-id", "task"));
  const auto task = worker.task();
  ASSERT_TRUE(task);
  worker->acknowledge(task->handle);
  worker->fetch_task(0.2);
  EXPECT_TRUE(worker.next<NoTask>());
}

TEST_F(Engine, AnswersARequestWithoutTasksWithinItsTime) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  for (const double seconds : {0.0, 0.3, 1.0}) {
    const auto start = steady_clock::now();
    worker->fetch_task(seconds);
    ASSERT_TRUE(worker.next<NoTask>());
    EXPECT_GE(seconds_since(start), seconds - 0.3);
    EXPECT_LT(seconds_since(start), seconds + 2.0);
  }
}

TEST_F(Engine, AWorkerMayAskBeforeTheQueueExists) {
  Worker worker(options_of("worker-1"));
  worker->fetch_task(10.0);
  Coordinator coordinator(options_of("coordinator"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  const auto task = worker.next<TaskDelivered>();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->delivery.bytes, "task");
}

TEST_F(Engine, DeliversATaskAgainWhenItsWorkerVanished) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 1.0));
  Worker other(options_of("worker-2"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  auto vanishing = std::make_unique<Worker>(options_of("worker-1"));
  ASSERT_TRUE(vanishing->task());
  const auto start = steady_clock::now();
  vanishing.reset();
  const auto again = other.task();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->bytes, "task");
  EXPECT_GT(seconds_since(start), 0.5);
  EXPECT_LT(seconds_since(start), 5.0);
}

TEST_F(Engine, KeepsATaskWithAWorkerThatReportsProgress) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 1.0));
  Worker holder(options_of("worker-1"));
  Worker other(options_of("worker-2"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  const auto task = holder.task();
  ASSERT_TRUE(task);
  const auto start = steady_clock::now();
  while (seconds_since(start) < 3.0) {
    holder->in_progress(task->handle);
    other->fetch_task(0.3);
    const auto answer = other.next<NoTask>();
    ASSERT_TRUE(answer) << "the other worker got the task after " << seconds_since(start) << " s";
  }
  EXPECT_TRUE(other.task()) << "without further reports it goes to the other";
}

TEST_F(Engine, DeliversATaskAgainAtOnceWhenItIsGivenBack) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 300.0));
  Worker a(options_of("worker-1"));
  Worker b(options_of("worker-2"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  const auto task = a.task();
  ASSERT_TRUE(task);
  const auto start = steady_clock::now();
  a->give_back(task->handle);
  ASSERT_TRUE(b.task());
  EXPECT_LT(seconds_since(start), 3.0);
}

TEST_F(Engine, GivesBackWhatAWorkerStillHasToSayWhenItLeaves) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 300.0));
  Worker b(options_of("worker-2"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  {
    Worker leaving(options_of("worker-1"));
    const auto task = leaving.task();
    ASSERT_TRUE(task);
    leaving->give_back(task->handle);
  }
  EXPECT_TRUE(b.task());
}

TEST_F(Engine, PurgesWaitingTasksAndGoesOn) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 1.0));
  Worker worker(options_of("worker-1"));
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(coordinator->publish_task(fmt::format("a{}", i), "old"));
  const auto held = worker.task();
  ASSERT_TRUE(held);
  ASSERT_TRUE(coordinator->purge_tasks());
  worker->fetch_task(2.0);
  EXPECT_TRUE(worker.next<NoTask>()) << "nothing is left, and what was held is not delivered again";
  worker->acknowledge(held->handle);
  ASSERT_TRUE(coordinator->publish_task("b", "new"));
  const auto task = worker.task();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->bytes, "new");
}

TEST_F(Engine, CarriesMessagesToWhomTheyAreMeantFor) {
  Coordinator coordinator(options_of("coordinator"));
  Worker a(options_of("worker-1"));
  Worker b(options_of("worker-2"));
  a->send("from a");
  const auto from_a = coordinator.next<MessageArrived>();
  ASSERT_TRUE(from_a);
  EXPECT_EQ(from_a->worker, "worker-1");
  EXPECT_EQ(from_a->bytes, "from a");
  coordinator->send("worker-2", "to b");
  coordinator->send("", "to all");
  EXPECT_EQ(a.next<MessageArrived>()->bytes, "to all");
  const std::set<std::string> got = {b.next<MessageArrived>()->bytes, b.next<MessageArrived>()->bytes};
  EXPECT_EQ(got, (std::set<std::string>{"to b", "to all"}));
}

TEST_F(Engine, CarriesAMessageOfTheLargestSizeAndRefusesALargerOne) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  const std::string largest(1024 * 1024, 'x');
  worker->send(largest);
  const auto arrived = coordinator.next<MessageArrived>();
  ASSERT_TRUE(arrived);
  EXPECT_EQ(arrived->bytes.size(), largest.size());
  worker->send(largest + "x");
  const auto problem = worker.next<EngineProblem>();
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->text.find("max_payload"), std::string::npos) << problem->text;
  worker->send("small");
  EXPECT_EQ(coordinator.next<MessageArrived>()->bytes, "small") << "the connection lives on";
  EXPECT_FALSE(coordinator->publish_task("big", largest + "x"));
  EXPECT_TRUE(coordinator->publish_task("small", "x"));
}

TEST_F(Engine, LosesNothingOfABurstToACoordinatorThatIsSlow) {
  constexpr int kMessages = 20000;
  // Room for 64 events: the rest waits in the client and, beyond, with the sender.
  Coordinator coordinator(options_of("coordinator"), 64);
  Worker a(options_of("worker-1"));
  Worker b(options_of("worker-2"));
  const auto send_all = [](Worker& worker) {
    for (int i = 0; i < kMessages; ++i) worker->send(fmt::format("{:06} {}", i, std::string(1000, 'x')));
  };
  {
    std::jthread first(send_all, std::ref(a));
    std::jthread second(send_all, std::ref(b));
  }
  EXPECT_LE(coordinator.waiting(), 64U);
  std::map<std::string, int> next;
  for (int i = 0; i < 2 * kMessages; ++i) {
    const auto message = coordinator.next<MessageArrived>();
    ASSERT_TRUE(message) << i;
    ASSERT_EQ(std::stoi(message->bytes), next[message->worker]++) << message->worker;
  }
  EXPECT_EQ(a->counters().dropped + b->counters().dropped, 0U);
}

TEST_F(Engine, CountsAndReportsWhatItCouldNotKeep) {
  EngineOptions options = options_of("coordinator");
  options.max_pending_bytes = 1 << 20;
  Coordinator coordinator(options, 4);
  Worker worker(options_of("worker-1"));
  for (int i = 0; i < 100; ++i) worker->send(std::string(100 * 1000, 'x'));
  // The engine answers each connection in order: afterwards all messages have come to the coordinator's.
  worker->fetch_task(0.0);
  ASSERT_TRUE(worker.next<NoTask>());
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  const auto problem = coordinator.next<EngineProblem>();
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->text.find("dropped"), std::string::npos) << problem->text;
}

TEST_F(Engine, GoesOnAfterTheServerWasKilledAndStartedAgain) {
  Coordinator coordinator(with_ack_wait(options_of("coordinator"), 2.0));
  Worker worker(options_of("worker-1"));
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(coordinator->publish_task(fmt::format("{}", i), fmt::format("{}", i)));
  const auto held = worker.task();
  ASSERT_TRUE(held);
  server_->child()->signal(SIGKILL);
  ASSERT_TRUE(coordinator.wait_for_connection(false));
  ASSERT_TRUE(worker.wait_for_connection(false));

  const auto start = steady_clock::now();
  const Result<void> refused = coordinator->publish_task("later", "later");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(refused.error().message.find("is nats-server running"), std::string::npos) << refused.error().message;
  for (int i = 0; i < 1000; ++i) worker->send(std::string(10000, 'x'));
  coordinator->send("worker-1", "lost");
  worker->fetch_task(10.0);
  worker->acknowledge(held->handle);  // kept until the connection is back
  EXPECT_LT(seconds_since(start), 2.0) << "nobody may wait for a server that is gone";

  ASSERT_TRUE(server_->start());
  ASSERT_TRUE(coordinator.wait_for_connection(true));
  std::set<std::string> done = {held->bytes};
  auto task = worker.next<TaskDelivered>();
  ASSERT_TRUE(task) << "the request from before is asked again";
  done.insert(task->delivery.bytes);
  worker->acknowledge(task->delivery.handle);
  while (done.size() < 50) {
    const auto next = worker.task();
    ASSERT_TRUE(next) << done.size();
    EXPECT_TRUE(done.insert(next->bytes).second) << next->bytes << " came twice";
    worker->acknowledge(next->handle);
  }
  worker->send("hello");
  EXPECT_EQ(coordinator.next<MessageArrived>()->bytes, "hello");
  coordinator->send("worker-1", "hello back");
  EXPECT_EQ(worker.next<MessageArrived>()->bytes, "hello back");
}

TEST_F(Engine, MakesTheQueueAgainForAServerThatLostItsFiles) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  ASSERT_TRUE(coordinator->publish_task("1", "lost"));
  server_->child()->signal(SIGKILL);
  ASSERT_TRUE(coordinator.wait_for_connection(false));
  std::filesystem::remove_all(folder_.path() / "engine" / "jetstream");
  ASSERT_TRUE(server_->start());
  ASSERT_TRUE(coordinator.wait_for_connection(true));
  ASSERT_TRUE(coordinator->publish_task("2", "new"));
  const auto task = worker.task();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->bytes, "new");
}

TEST_F(Engine, NeverWaitsLongForAServerThatHangs) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  server_->child()->signal(SIGSTOP);
  ::siginfo_t stopped{};
  ASSERT_EQ(::waitid(P_PID, server_->child()->pid(), &stopped, WSTOPPED | WNOWAIT), 0) << std::strerror(errno);
  // Without our bound of a second the client's own default is five.
  constexpr double kBounded = 4.0;
  const auto start = steady_clock::now();
  EXPECT_FALSE(coordinator->publish_task("1", "task"));
  EXPECT_LT(seconds_since(start), kBounded);
  // More than the kernel's buffers take: the client's write blocks, the sender must not for more than its second.
  double longest = 0.0;
  for (int i = 0; i < 40; ++i) {
    const auto before = steady_clock::now();
    worker->send(std::string(1000 * 1000, 'x'));
    longest = std::max(longest, seconds_since(before));
  }
  EXPECT_LT(longest, kBounded);
  ASSERT_TRUE(worker.wait_for_connection(false, 60.0));
  server_->child()->signal(SIGCONT);
  ASSERT_TRUE(worker.wait_for_connection(true, 60.0));
  const auto deadline = in(kPatience);
  while (!coordinator->publish_task("2", "after")) ASSERT_LT(steady_clock::now(), deadline);
  ASSERT_TRUE(worker.task());
}

TEST_F(Engine, ADeadEngineIsAnErrorWithAHint) {
  EngineOptions options = options_of("worker-1");
  server_->stop();
  const auto start = steady_clock::now();
  const auto port = NatsWorkerPort::connect(options, [](EngineEvent) {});
  ASSERT_FALSE(port);
  EXPECT_EQ(port.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(port.error().message.find("is nats-server running"), std::string::npos) << port.error().message;
  EXPECT_LT(seconds_since(start), 5.0);
}

TEST_F(Engine, AWrongPasswordIsAnErrorThatSaysSo) {
  EngineOptions options = options_of("worker-1");
  options.password = "wrong";
  for (int i = 0; i < 5; ++i) {
    const auto port = NatsWorkerPort::connect(options, [](EngineEvent) {});
    ASSERT_FALSE(port);
    EXPECT_NE(port.error().message.find("refused user or password"), std::string::npos) << port.error().message;
  }
}

TEST_F(Engine, OptionsThatCannotBeAreRefused) {
  EngineOptions options = options_of("worker-1");
  options.name = "a.b";
  EXPECT_EQ(NatsWorkerPort::connect(options, [](EngineEvent) {}).error().kind, ErrorKind::kUsage);
  options = options_of("worker-1");
  options.url = "";
  EXPECT_EQ(NatsWorkerPort::connect(options, [](EngineEvent) {}).error().kind, ErrorKind::kUsage);
}

TEST_F(Engine, ASecondCoordinatorTakesTheQueueOverAndMayChangeItsAckWait) {
  Worker worker(options_of("worker-1"));
  Worker other(options_of("worker-2"));
  {
    Coordinator first(with_ack_wait(options_of("coordinator"), 300.0));
    ASSERT_TRUE(first->publish_task("1", "task"));
  }
  Coordinator second(with_ack_wait(options_of("coordinator"), 1.0));
  ASSERT_TRUE(worker.task());
  EXPECT_TRUE(other.task()) << "after the new AckWait";
}

}  // namespace
}  // namespace pf::farm_test
