// What a worker's password is good for, asked of a real nats-server by a client that keeps to nothing.

#include <gtest/gtest.h>

#include <sys/stat.h>

#include <string>
#include <vector>

#include <nats/nats.h>

#include <fmt/format.h>

#include "tests/farm/engine_fixture.h"

namespace pf::farm_test {
namespace {

/// A client of the NATS library alone.
class RawClient {
 public:
  explicit RawClient(const EngineOptions& who) {
    natsOptions* options = nullptr;
    natsOptions_Create(&options);
    natsOptions_SetURL(options, who.url.c_str());
    natsOptions_SetUserInfo(options, who.user.c_str(), who.password.c_str());
    natsOptions_SetCustomInboxPrefix(options, ("_INBOX." + who.name).c_str());
    if (!who.ca.empty()) {
      natsOptions_SetSecure(options, true);
      natsOptions_LoadCATrustedCertificates(options, who.ca.c_str());
    }
    status_ = natsConnection_Connect(&connection_, options);
    natsOptions_Destroy(options);
  }
  ~RawClient() {
    for (natsSubscription* subscription : subscriptions_) natsSubscription_Destroy(subscription);
    natsConnection_Destroy(connection_);
  }
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  [[nodiscard]] natsStatus status() const { return status_; }
  /// True when the server called it a violation.
  bool is_refused_to_publish(const std::string& subject, const std::string& bytes,
                             const std::string& reply = "_INBOX.worker-1.answer") {
    return is_refused(subject, [&] {
      natsConnection_PublishRequest(connection_, subject.c_str(), reply.c_str(), bytes.data(),
                                    static_cast<int>(bytes.size()));
    });
  }
  bool is_refused_to_listen(const std::string& subject) {
    return is_refused(subject, [&] {
      natsSubscription* subscription = nullptr;
      natsConnection_SubscribeSync(&subscription, connection_, subject.c_str());
      subscriptions_.push_back(subscription);
    });
  }

 private:
  /// The server's complaint, which names the subject, comes before its answer to the flush.
  template <typename Act>
  bool is_refused(const std::string& subject, const Act& act) {
    act();
    EXPECT_EQ(natsConnection_FlushTimeout(connection_, 10000), NATS_OK);
    const char* words = nullptr;
    const natsStatus last = natsConnection_GetLastError(connection_, &words);
    return last == NATS_NOT_PERMITTED && words != nullptr &&
           std::string(words).find('"' + subject + '"') != std::string::npos;
  }

  natsConnection* connection_ = nullptr;
  natsStatus status_ = NATS_ERR;
  std::vector<natsSubscription*> subscriptions_;
};

class EngineSecurity : public EngineTest, public ::testing::WithParamInterface<Tls> {
 protected:
  void SetUp() override {
    if (find_nats_server().empty()) FAIL() << "no nats-server here; deploy/install brings it";
    start_server(GetParam());
  }
};
INSTANTIATE_TEST_SUITE_P(Engine, EngineSecurity, ::testing::Values(Tls::kOff, Tls::kOn),
                         [](const auto& chosen) { return chosen.param == Tls::kOn ? "Tls" : "Plain"; });

TEST_P(EngineSecurity, TheWorkOfAFarmNeedsNoMoreThanIsAllowed) {
  Coordinator coordinator(options_of("coordinator"));
  Worker worker(options_of("worker-1"));
  ASSERT_TRUE(coordinator->publish_task("1", "one"));
  const auto task = worker.task();
  ASSERT_TRUE(task);
  worker->in_progress(task->handle);
  worker->give_back(task->handle);
  const auto again = worker.task();
  ASSERT_TRUE(again);
  worker->acknowledge(again->handle);
  worker->send("result");
  EXPECT_EQ(coordinator.next<MessageArrived>()->bytes, "result");
  coordinator->send("worker-1", "accepted");
  EXPECT_EQ(worker.next<MessageArrived>()->bytes, "accepted");
  coordinator->send("", "to all");
  EXPECT_EQ(worker.next<MessageArrived>()->bytes, "to all");
  ASSERT_TRUE(coordinator->publish_task("2", "two"));
  ASSERT_TRUE(coordinator->purge_tasks());
  worker->fetch_task(0.5);
  EXPECT_TRUE(worker.next<NoTask>());
  // A refusal would have been a problem for the log.
  EXPECT_FALSE(worker.next<EngineProblem>(0.0));
  EXPECT_FALSE(coordinator.next<EngineProblem>(0.0));
}

TEST_P(EngineSecurity, AWorkerCanPublishNothingButItsOwnResults) {
  Coordinator coordinator(options_of("coordinator"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  RawClient worker(options_of("worker-1"));
  ASSERT_EQ(worker.status(), NATS_OK);
  const char* const forbidden[] = {
      "photonfarm.task",
      "photonfarm.coordinator.worker-2",
      "photonfarm.worker.worker-1",
      "photonfarm.worker.worker-2",
      "photonfarm.workers",
      "_INBOX.worker-2.task.1",
      "$JS.API.INFO",
      "$JS.API.STREAM.NAMES",
      "$JS.API.STREAM.CREATE.OTHER",
      "$JS.API.STREAM.INFO.PHOTONFARM_TASKS",
      "$JS.API.STREAM.UPDATE.PHOTONFARM_TASKS",
      "$JS.API.STREAM.DELETE.PHOTONFARM_TASKS",
      "$JS.API.STREAM.PURGE.PHOTONFARM_TASKS",
      "$JS.API.STREAM.MSG.DELETE.PHOTONFARM_TASKS",
      "$JS.API.STREAM.MSG.GET.PHOTONFARM_TASKS",
      "$JS.API.STREAM.SNAPSHOT.PHOTONFARM_TASKS",
      "$JS.API.DIRECT.GET.PHOTONFARM_TASKS",
      "$JS.API.CONSUMER.CREATE.PHOTONFARM_TASKS",
      "$JS.API.CONSUMER.DURABLE.CREATE.PHOTONFARM_TASKS.mine",
      "$JS.API.CONSUMER.DURABLE.CREATE.PHOTONFARM_TASKS.workers",
      "$JS.API.CONSUMER.DELETE.PHOTONFARM_TASKS.workers",
      "$JS.API.CONSUMER.MSG.NEXT.PHOTONFARM_TASKS.mine",
      "$JS.ACK.OTHER.workers.1.1.1.1.1",
      "$SYS.REQ.SERVER.PING",
  };
  for (const char* subject : forbidden) EXPECT_TRUE(worker.is_refused_to_publish(subject, "{}")) << subject;
  EXPECT_FALSE(worker.is_refused_to_publish("photonfarm.coordinator.worker-1", "mine"));

  const auto message = coordinator.next<MessageArrived>();
  ASSERT_TRUE(message);
  EXPECT_EQ(message->worker, "worker-1");
  EXPECT_EQ(message->bytes, "mine");
  Worker honest(options_of("worker-2"));
  const auto task = honest.task();
  ASSERT_TRUE(task) << "the queue is as it was";
  EXPECT_EQ(task->bytes, "task");
}

TEST_P(EngineSecurity, AWorkerCanListenToNothingButWhatIsMeantForIt) {
  RawClient worker(options_of("worker-1"));
  ASSERT_EQ(worker.status(), NATS_OK);
  const char* const forbidden[] = {
      ">",
      "*.*.*",
      "photonfarm.>",
      "photonfarm.task",
      "photonfarm.worker.*",
      "photonfarm.worker.worker-2",
      "photonfarm.coordinator.*",
      "photonfarm.coordinator.worker-2",
      "_INBOX.>",
      "_INBOX.*.>",
      "_INBOX.worker-2.>",
      "_INBOX.coordinator.>",
      "$JS.>",
      "$JS.API.>",
      "$JS.ACK.>",
      "$JS.EVENT.ADVISORY.>",
      "$SYS.>",
  };
  for (const char* subject : forbidden) EXPECT_TRUE(worker.is_refused_to_listen(subject)) << subject;
  EXPECT_FALSE(worker.is_refused_to_listen("photonfarm.worker.worker-1"));
  EXPECT_FALSE(worker.is_refused_to_listen("photonfarm.workers"));
  EXPECT_FALSE(worker.is_refused_to_listen("_INBOX.worker-1.>"));
}

TEST_P(EngineSecurity, AWorkerThatBorrowsANameReachesNobody) {
  Coordinator coordinator(options_of("coordinator"));
  EngineOptions thief = options_of("worker-1");
  thief.name = "worker-2";
  Worker worker(thief);
  worker->send("forged");
  const auto problem = worker.next<EngineProblem>();
  ASSERT_TRUE(problem) << "its own log says why";
  Worker honest(options_of("worker-2"));
  honest->send("true");
  EXPECT_EQ(coordinator.next<MessageArrived>()->bytes, "true");
}

TEST_P(EngineSecurity, ATaskThatNobodyAskedForGoesBack) {
  Coordinator coordinator(options_of("coordinator"));
  Worker victim(options_of("worker-1"));
  Worker other(options_of("worker-2"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  RawClient attacker(options_of("worker-3"));
  // The reply of a request is not checked by the server: a worker can have a task sent to another's inbox.
  EXPECT_FALSE(attacker.is_refused_to_publish("$JS.API.CONSUMER.MSG.NEXT.PHOTONFARM_TASKS.workers", "1",
                                              "_INBOX.worker-1.task.1"));
  EXPECT_TRUE(other.task());
  EXPECT_FALSE(victim.next<TaskDelivered>(0.0));
}

TEST_P(EngineSecurity, NobodyEntersWithoutAPassword) {
  EngineOptions nobody = options_of("worker-1");
  nobody.password.clear();
  EXPECT_EQ(RawClient(nobody).status(), NATS_CONNECTION_AUTH_FAILED);
  nobody.user = "coordinator";
  EXPECT_EQ(RawClient(nobody).status(), NATS_CONNECTION_AUTH_FAILED);
}

TEST_P(EngineSecurity, FilesWithPasswordsAreForTheirOwnerAlone) {
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "engine")) {
    if (entry.path().extension() != ".toml" && entry.path().extension() != ".conf") continue;
    EXPECT_EQ(entry.status().permissions(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write)
        << entry.path();
  }
  const std::filesystem::path file = server_->credentials("worker-1");
  ASSERT_EQ(chmod(file.c_str(), 0644), 0);
  const auto options = load_credentials(file);
  ASSERT_FALSE(options);
  EXPECT_NE(options.error().message.find("chmod 600"), std::string::npos) << options.error().message;
}

class EngineTls : public EngineTest {
 protected:
  void SetUp() override {
    if (find_nats_server().empty()) FAIL() << "no nats-server here; deploy/install brings it";
    start_server(Tls::kOn);
  }
};

TEST_F(EngineTls, AServerOfAnotherAuthorityIsNotTrusted) {
  EngineOptions options = options_of("worker-1");
  const Result<Certificates> other = make_certificates({});
  ASSERT_TRUE(other);
  const std::filesystem::path ca = folder_.path() / "other-ca.pem";
  ASSERT_TRUE(write_file_atomically(ca, other->ca));
  options.ca = ca;
  const auto port = NatsWorkerPort::connect(options, [](EngineEvent) {});
  ASSERT_FALSE(port);
  EXPECT_EQ(port.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(port.error().message.find("`ca`"), std::string::npos) << port.error().message;
}

TEST_F(EngineTls, AServerUnderAnotherNameIsNotTrusted) {
  EngineOptions options = options_of("worker-1");
  options.url = fmt::format("tls://127.1:{}", server_->port());  // the same address, spelt as no certificate has it
  const auto port = NatsWorkerPort::connect(options, [](EngineEvent) {});
  ASSERT_FALSE(port);
  EXPECT_NE(port.error().message.find("for this host name"), std::string::npos) << port.error().message;
  options.url = fmt::format("tls://localhost:{}", server_->port());
  EXPECT_TRUE(NatsWorkerPort::connect(options, [](EngineEvent) {}));
}

TEST_F(EngineTls, AClientWithoutTlsIsRefused) {
  EngineOptions options = options_of("worker-1");
  options.url = fmt::format("nats://127.0.0.1:{}", server_->port());
  options.ca.clear();
  const auto port = NatsWorkerPort::connect(options, [](EngineEvent) {});
  ASSERT_FALSE(port);
  EXPECT_NE(port.error().message.find("TLS"), std::string::npos) << port.error().message;
}

}  // namespace
}  // namespace pf::farm_test
