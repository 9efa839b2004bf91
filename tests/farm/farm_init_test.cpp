// photonfarm farm init: what it makes is what a real server and real clients take.

#include <gtest/gtest.h>

#include <map>

#include <fmt/format.h>

#include "jobs/farm_init.h"
#include "tests/farm/engine_fixture.h"

namespace pf::farm_test {
namespace {

namespace fs = std::filesystem;

/// Name -> content.
std::map<std::string, std::string> files_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::directory_iterator(folder))
    files[entry.path().filename().string()] = read_file(entry.path(), 1 << 20).value_or("?");
  return files;
}

TEST(FarmInit, MakesAllFilesAndKeepsSecretsToTheirOwner) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary.path() / "farm";
  ASSERT_TRUE(make_farm_folder({folder, {"render.example.org", "10.0.0.7"}, 3, 4333}));
  const auto files = files_of(folder);
  for (const char* name : {"ca.pem", "ca-key.pem", "server.pem", "server-key.pem", "nats-server.conf",
                           "coordinator.toml", "config.toml", "worker-1.toml", "worker-2.toml", "worker-3.toml"}) {
    EXPECT_TRUE(files.contains(name)) << name;
  }
  EXPECT_EQ(files.size(), 10U);
  for (const auto& [name, text] : files) {
    const bool open =
        (fs::status(folder / name).permissions() & (fs::perms::group_all | fs::perms::others_all)) != fs::perms::none;
    EXPECT_EQ(open, name == "ca.pem" || name == "server.pem") << name;
  }
  const auto options = load_credentials(folder / "worker-2.toml");
  ASSERT_TRUE(options) << options.error().message;
  EXPECT_EQ(options->url, "tls://render.example.org:4333");
  EXPECT_EQ(options->name, "worker-2");
  EXPECT_EQ(options->ca, folder / "ca.pem");
  EXPECT_NE(options->password, load_credentials(folder / "worker-1.toml")->password);
}

TEST(FarmInit, OverwritesNothing) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary.path() / "farm";
  ASSERT_TRUE(make_farm_folder({folder, {}, 1, 4222}));
  const auto before = files_of(folder);
  const auto again = make_farm_folder({folder, {}, 1, 4222});
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().kind, ErrorKind::kUsage);
  EXPECT_EQ(files_of(folder), before);
}

TEST(FarmInit, RefusesAHostThatIsNone) {
  const TemporaryFolder temporary;
  for (const char* host : {"", "a b", "host:4222", "x,IP:1.2.3.4", "a\nb"}) {
    const auto made = make_farm_folder({temporary.path() / "farm", {host}, 1, 4222});
    ASSERT_FALSE(made) << host;
    EXPECT_EQ(made.error().kind, ErrorKind::kUsage);
    EXPECT_FALSE(fs::exists(temporary.path() / "farm"));
  }
}

class FarmInitServer : public EngineTest {
 protected:
  void SetUp() override {
    if (find_nats_server().empty()) FAIL() << "no nats-server here; deploy/install brings it";
    NatsServerOptions unused;
    unused.folder = folder_.path() / "unused";
    const auto prepared = NatsServer::prepare(unused);
    ASSERT_TRUE(prepared);
    made_ = folder_.path() / "farm";
    ASSERT_TRUE(make_farm_folder({made_, {}, 2, prepared->port()}));
    // As the command's own text says.
    const std::string command =
        fmt::format("cd '{}' && exec '{}' -c nats-server.conf", made_.string(), find_nats_server().string());
    auto child = Child::start({"/bin/sh", {"-c", command}, folder_.path() / "log"});
    ASSERT_TRUE(child);
    running_.emplace(std::move(*child));
    const auto deadline = in(kPatience);
    while (!NatsCoordinatorPort::connect(*load_credentials(made_ / "coordinator.toml"), [](EngineEvent) {})) {
      ASSERT_FALSE(running_->wait(in(0.02))) << read_file(folder_.path() / "log", 1 << 20).value_or("");
      ASSERT_LT(steady_clock::now(), deadline);
    }
  }
  fs::path made_;
  std::optional<Child> running_;
};

TEST_F(FarmInitServer, TakesWhatInitMade) {
  Coordinator coordinator(*load_credentials(made_ / "coordinator.toml"));
  Worker worker(*load_credentials(made_ / "worker-2.toml"));
  ASSERT_TRUE(coordinator->publish_task("1", "task"));
  const auto task = worker.task();
  ASSERT_TRUE(task);
  worker->acknowledge(task->handle);
  worker->send("done");
  EXPECT_EQ(coordinator.next<MessageArrived>()->worker, "worker-2");
}

}  // namespace
}  // namespace pf::farm_test
