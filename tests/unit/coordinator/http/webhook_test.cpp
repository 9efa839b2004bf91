#include "coordinator/http/webhook.h"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "tests/support/fake_job_service.h"
#include "tests/support/stub_http.h"
#include "tests/support/temp_folder.h"

namespace pf::test {
namespace {

JobView ended(const std::string& id, std::int64_t when, JobState state = JobState::kDone) {
  JobView job = FakeJobService::running(id);
  job.state = state;
  job.ended_unix_ms = when;
  return job;
}

class NotifierTest : public testing::Test {
 protected:
  [[nodiscard]] Notifier open() {
    auto notifier = Notifier::open(temp_ / "notify.json", [this] { return now_; });
    EXPECT_TRUE(notifier) << notifier.error().message;
    return std::move(*notifier);
  }
  TempFolder temp_;
  std::int64_t now_ = 1'000'000;
};

TEST_F(NotifierTest, EachEndIsToldOnceAndOldOnesNever) {
  Notifier notifier = open();
  now_ += 1000;
  const JobView old = ended("old-1", 999'999), job = ended("glass-1", 1'000'500);
  ASSERT_TRUE(notifier.look({old, job, FakeJobService::running("pool-2")}));
  const auto delivery = notifier.due();
  ASSERT_TRUE(delivery);
  EXPECT_EQ(delivery->id, "glass-1-1000500");
  EXPECT_EQ(nlohmann::json::parse(delivery->body)["job"]["state"], "done");
  EXPECT_TRUE(notifier.tried(delivery->id, true).value());
  ASSERT_TRUE(notifier.look({old, job}));
  EXPECT_FALSE(notifier.due());
  ASSERT_TRUE(notifier.look({ended("glass-1", 1'000'900)})) << "extended, and ended again";
  EXPECT_TRUE(notifier.due());
}

TEST_F(NotifierTest, TriesAgainEverLaterAndGivesUpAtLast) {
  Notifier notifier = open();
  ASSERT_TRUE(notifier.look({ended("glass-1", now_)}));
  std::int64_t expected = Notifier::kFirstPause;
  for (int attempt = 1; attempt < Notifier::kMostAttempts; ++attempt) {
    const auto delivery = notifier.due();
    ASSERT_TRUE(delivery) << attempt;
    EXPECT_TRUE(notifier.tried(delivery->id, false).value());
    EXPECT_FALSE(notifier.due());
    now_ += expected - 1;
    EXPECT_FALSE(notifier.due()) << attempt;
    now_ += 1;
    expected = std::min(2 * expected, Notifier::kLongestPause);
  }
  EXPECT_FALSE(notifier.tried(notifier.due()->id, false).value());
  EXPECT_EQ(notifier.pending(), 0U);
}

TEST_F(NotifierTest, ARestartGoesOnWhereItWas) {
  {
    Notifier notifier = open();
    ASSERT_TRUE(notifier.look({ended("glass-1", now_), ended("pool-2", now_)}));
    EXPECT_TRUE(notifier.tried("glass-1-1000000", true).value());
    EXPECT_TRUE(notifier.tried("pool-2-1000000", false).value());
  }
  Notifier notifier = open();
  EXPECT_FALSE(notifier.due());
  now_ += Notifier::kFirstPause;
  ASSERT_TRUE(notifier.look({ended("glass-1", 1'000'000), ended("pool-2", 1'000'000)}));
  ASSERT_TRUE(notifier.due());
  EXPECT_EQ(notifier.due()->id, "pool-2-1000000");
  std::ofstream(temp_ / "notify.json") << "{";
  EXPECT_FALSE(Notifier::open(temp_ / "notify.json", [] { return std::int64_t{1}; }));
}

TEST(WebhookSignature, IsHmacSha256OverTimeAndBody) {
  // printf '1700000000.{"a": 1}' | openssl dgst -sha256 -hmac 0123456789abcdef
  EXPECT_EQ(webhook_signature("0123456789abcdef", 1'700'000'000, R"({"a": 1})"),
            "t=1700000000,v1=09f4bb04e8cba11aeb0d90ffdd73e38a83be1c59cd0408c683d80645ea8dd3d1");
}

TEST(WebhookTest, TellsAReceiverThatFailsAtFirst) {
  TempFolder temp;
  ASSERT_TRUE(write_file_atomically(temp / "secret", "a-secret-of-the-operator\n", FileAccess::kOwnerOnly));
  FakeJobService service;
  const Log log(LogLevel::kOff);
  // Five seconds of backoff are not waited for: a state file says that one failed attempt is long past.
  {
    auto notifier = Notifier::open(temp / "notify.json", [] { return std::int64_t{1}; });
    ASSERT_TRUE(notifier && notifier->look({ended("glass-1", 5)}));
    ASSERT_TRUE(notifier->tried("glass-1-5", false).value()) << "the first failure";
  }
  int failures = 1;
  StubServer receiver([&](const StubRequest& request) {
    return StubReply{request.path == "/hook?farm=1" && failures-- > 0 ? 500 : 204, ""};
  });
  CoordinatorConfig::Notify config{receiver.url() + "/hook?farm=1", temp / "secret", {}};
  service.put(ended("glass-1", 5));
  const auto wait_for = [&](std::size_t requests) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (receiver.requests().size() < requests && std::chrono::steady_clock::now() < deadline)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return receiver.requests().size() >= requests;
  };
  {
    auto webhook = Webhook::start(config, temp.path(), service, log);
    ASSERT_TRUE(webhook) << webhook.error().message;
    ASSERT_TRUE(wait_for(1)) << "the second failure";
  }
  // The coordinator starts anew, later.
  std::string text = read_file(temp / "notify.json", 1 << 20).value_or("");
  auto state = nlohmann::json::parse(text);
  ASSERT_EQ(state["pending"]["glass-1-5"]["attempts"], 2);
  state["pending"]["glass-1-5"]["next_unix_ms"] = 1;
  ASSERT_TRUE(write_file_atomically(temp / "notify.json", state.dump(), FileAccess::kOwnerOnly));
  auto webhook = Webhook::start(config, temp.path(), service, log);
  ASSERT_TRUE(webhook) << webhook.error().message;
  ASSERT_TRUE(wait_for(2));
  const StubRequest last = receiver.requests().back();
  EXPECT_EQ(last.method, "POST");
  EXPECT_NE(last.head.find("Photonfarm-Delivery: glass-1-5\r\n"), std::string::npos) << last.head;
  const std::size_t at = last.head.find("Photonfarm-Signature: t=") + 24;
  const std::int64_t seconds = std::stoll(last.head.substr(at));
  EXPECT_NE(last.head.find(webhook_signature("a-secret-of-the-operator", seconds, last.body)), std::string::npos);
  EXPECT_EQ(receiver.requests()[0].body, last.body);
}

TEST(WebhookTest, ASecretThatIsNoneIsRefused) {
  TempFolder temp;
  FakeJobService service;
  const Log log(LogLevel::kOff);
  CoordinatorConfig::Notify config{"http://127.0.0.1:1/", temp / "secret", {}};
  EXPECT_FALSE(Webhook::start(config, temp.path(), service, log)) << "missing";
  ASSERT_TRUE(write_file_atomically(temp / "secret", "short", FileAccess::kOwnerOnly));
  EXPECT_FALSE(Webhook::start(config, temp.path(), service, log));
  ASSERT_TRUE(write_file_atomically(temp / "secret", "long-enough-for-a-secret", FileAccess::kOwnerOnly));
  std::filesystem::permissions(temp / "secret", std::filesystem::perms(0644));
  EXPECT_FALSE(Webhook::start(config, temp.path(), service, log));
}

}  // namespace
}  // namespace pf::test
