#include "coordinator/http/server.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <thread>

#include "common/base/atomic_file.h"
#include "coordinator/http/connection_threads.h"
#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

class HttpServerTest : public HttpTest {
 protected:
  [[nodiscard]] std::string state(const char* name) const { return read_file(temp_ / name, 4096).value(); }
};

TEST_F(HttpServerTest, WritesUrlAndASecretToken) {
  EXPECT_EQ(state("url"), server_->url() + "\n");
  EXPECT_EQ(state("token"), server_->token() + "\n");
  EXPECT_EQ(server_->token().size(), 67U) << "pf_ and 32 bytes";
  struct ::stat status = {};
  ASSERT_EQ(::stat((temp_ / "token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
}

TEST_F(HttpServerTest, KeepsTokenAndPortOverRestarts) {
  const std::string token = server_->token(), url = server_->url();
  std::filesystem::permissions(temp_ / "token", std::filesystem::perms(0644));
  start();
  EXPECT_EQ(server_->token(), token);
  EXPECT_EQ(server_->url(), url);
  struct ::stat status = {};
  ASSERT_EQ(::stat((temp_ / "token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U) << "a mode that somebody loosened is mended";
}

TEST_F(HttpServerTest, RefusesABrokenTokenFileAndABusyPort) {
  HttpServerOptions options = options_;
  options.config.http.port = std::stoi(server_->url().substr(server_->url().rfind(':') + 1));
  const auto second = HttpServer::start(options, service_, log_);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().kind, ErrorKind::kUnavailable);
  std::ofstream(temp_ / "token") << "short\n";
  const auto broken = HttpServer::start(options_, service_, log_);
  ASSERT_FALSE(broken);
  EXPECT_NE(broken.error().message.find("remove it"), std::string::npos);
}

TEST_F(HttpServerTest, AGivenTokenIsTheOneThatCounts) {
  options_.token = "0123456789abcdef-given";
  start();
  EXPECT_EQ(server_->token(), options_.token);
  EXPECT_EQ(get("/v1/jobs").status, 200);
}

TEST_F(HttpServerTest, FilesComeInRanges) {
  service_.put(FakeJobService::running("glass-1"));
  std::string content;
  for (int i = 0; i < 100'000; ++i) content += std::to_string(i);
  file(Artifact::kExr, content);
  const std::string path = "/v1/jobs/glass-1/image.exr";
  const RawReply whole = get(path);
  EXPECT_EQ(whole.status, 200);
  EXPECT_EQ(whole.body, content);
  EXPECT_EQ(whole.headers.at("content-type"), "image/x-exr");
  EXPECT_EQ(whole.headers.at("accept-ranges"), "bytes");
  const std::string etag = whole.headers.at("etag");
  const std::size_t n = content.size();
  const auto part = [&](const std::string& range, std::size_t offset, std::size_t bytes) {
    const RawReply reply = get(path, {{"Range", range}});
    EXPECT_EQ(reply.status, 206) << range;
    EXPECT_EQ(reply.body, content.substr(offset, bytes)) << range;
    EXPECT_EQ(reply.headers.at("content-range"),
              "bytes " + std::to_string(offset) + "-" + std::to_string(offset + bytes - 1) + "/" + std::to_string(n));
  };
  part("bytes=0-0", 0, 1);
  part("bytes=1000-", 1000, n - 1000);
  part("bytes=-5", n - 5, 5);
  part("bytes=-99999999", 0, n);
  part("bytes=10-99999999", 10, n - 10);
  EXPECT_EQ(get(path, {{"Range", "bytes=" + std::to_string(n) + "-"}}).status, 416);
  EXPECT_EQ(get(path, {{"Range", "bytes=0-1,5-6"}}).body, content) << "several ranges at once are not served";
  const RawReply resumed = get(path, {{"Range", "bytes=7-"}, {"If-Range", etag}});
  EXPECT_EQ(resumed.status, 206);
  EXPECT_EQ(get(path, {{"If-None-Match", etag}}).status, 304);
  const RawReply only_head = call("HEAD", path);
  EXPECT_EQ(only_head.headers.at("content-length"), std::to_string(n));
  EXPECT_TRUE(only_head.body.empty());
}

TEST_F(HttpServerTest, AReplacedFileIsSentWhole) {
  service_.put(FakeJobService::running("glass-1"));
  file(Artifact::kPng, "old content");
  const std::string etag = get("/v1/jobs/glass-1/image.png").headers.at("etag");
  std::filesystem::remove(service_.artifacts[Artifact::kPng]);
  file(Artifact::kPng, "new content!");
  const RawReply reply = get("/v1/jobs/glass-1/image.png", {{"Range", "bytes=4-"}, {"If-Range", etag}});
  EXPECT_EQ(reply.status, 200);
  EXPECT_EQ(reply.body, "new content!");
}

TEST_F(HttpServerTest, MissingFilesAreConflictsAndEmptyOnesAreEmpty) {
  service_.put(FakeJobService::running("glass-1"));
  EXPECT_EQ(get("/v1/jobs/glass-1/figures.json").status, 409);
  service_.artifacts[Artifact::kJson] = temp_ / "gone";
  EXPECT_EQ(get("/v1/jobs/glass-1/figures.json").status, 409);
  service_.artifacts[Artifact::kJson] = temp_.path();
  EXPECT_EQ(get("/v1/jobs/glass-1/figures.json").status, 409) << "a folder is no file";
  file(Artifact::kCheckpoint, "");
  const RawReply empty = get("/v1/jobs/glass-1/checkpoint");
  EXPECT_EQ(empty.status, 200);
  EXPECT_EQ(empty.headers.at("content-length"), "0");
}

TEST_F(HttpServerTest, OddRangeHeadersDoNoHarm) {
  service_.put(FakeJobService::running("glass-1"));
  file(Artifact::kPng, "content");
  std::string many = "bytes=0-0";
  while (many.size() < 3900) many += ",0-0";
  for (const std::string& range :
       {many, std::string("bytes="), std::string("bytes=-"), std::string("bytes=5-2"), std::string("bytes=a-b"),
        std::string("lines=1-2"), std::string("bytes=99999999999999999999-"), std::string("bytes=-0")}) {
    const int status = get("/v1/jobs/glass-1/image.png", {{"Range", range}}).status;
    EXPECT_TRUE(status == 200 || status == 416) << range.substr(0, 40) << " " << status;
  }
}

TEST_F(HttpServerTest, HeadsAreBounded) {
  const std::string line = "GET /v1/health HTTP/1.1\r\n";
  const RawReply refused = raw("GET /" + std::string(5000, 'a') + " HTTP/1.1\r\n\r\n");
  EXPECT_EQ(refused.status, 431);
  EXPECT_EQ(nlohmann::json::parse(refused.body).value("type", ""), "urn:photonfarm:problem:head-too-large");
  EXPECT_EQ(raw(line + "X: " + std::string(5000, 'a') + "\r\n\r\n").status, 431);
  EXPECT_EQ(raw(std::string(100'000, 'a')).status, 431) << "a line without an end";
  std::string many = line;
  for (int i = 0; i < 2000; ++i) many += "X-" + std::to_string(i) + ": a\r\n";
  EXPECT_EQ(raw(many + "\r\n").status, 431);
  EXPECT_EQ(raw(line + "\r\n").status, 200);
}

TEST_F(HttpServerTest, RubbishIsRefusedAndTheServerLives) {
  for (const std::string& bytes :
       {std::string("\r\n\r\n"), std::string("GET\r\n\r\n"), std::string("GET / HTTP/9.9\r\n\r\n"),
        std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 15),
        std::string("GET /v1/jobs HTTP/1.1\r\nno colon\r\n\r\n"), std::string(300, '\0') + "\r\n\r\n",
        std::string("POST /v1/jobs HTTP/1.1\r\nContent-Length: 5\r\n\r\n")}) {
    RawConnection connection(server_->url());
    connection.send(bytes);
    ::shutdown(connection.descriptor(), SHUT_WR);
    static_cast<void>(connection.receive());
    EXPECT_EQ(get("/v1/health").status, 200);
  }
}

TEST_F(HttpServerTest, SlowClientsAreCutOff) {
  options_.limits.head_seconds = 0.2;
  options_.limits.stall_seconds = 0.2;
  start();
  RawConnection silent(server_->url());
  EXPECT_TRUE(silent.receive().starts_with("HTTP/1.1 408"));
  RawConnection half(server_->url());
  half.send("GET /v1/hea");
  EXPECT_TRUE(half.receive().starts_with("HTTP/1.1 408"));
  RawConnection body(server_->url());
  body.send(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Length", "100"}}) + "{");
  EXPECT_TRUE(body.receive().starts_with("HTTP/1.1 408"));
}

TEST_F(HttpServerTest, ReadersThatStallAreCutOffAndHoldNobodyUp) {
  options_.limits.stall_seconds = 0.2;
  options_.max_connections = 1;
  start();
  service_.put(FakeJobService::running("glass-1"));
  file(Artifact::kExr, std::string(64 << 20, 'x'));
  RawConnection stalled(server_->url());
  stalled.send(head("GET", "/v1/jobs/glass-1/image.exr", {}));
  stalled.receive("\r\n\r\n");
  EXPECT_EQ(get("/v1/health").status, 200) << "served once the only thread has cut the other one off";
}

TEST_F(HttpServerTest, BeyondItsConnectionsItSaysSoAtOnce) {
  options_.max_connections = 2;
  start();
  service_.put(FakeJobService::running("glass-1"));
  std::vector<std::unique_ptr<RawConnection>> held;
  for (int i = 0; i < 2; ++i) {
    held.push_back(std::make_unique<RawConnection>(server_->url()));
    held.back()->send(head("GET", "/v1/jobs/glass-1/events", {}));
    held.back()->receive("event: job");
  }
  for (int i = 0; i < 2; ++i) {  // these wait
    held.push_back(std::make_unique<RawConnection>(server_->url()));
    held.back()->send(head("GET", "/v1/jobs", {}));
  }
  EXPECT_TRUE(RawConnection(server_->url()).receive().starts_with("HTTP/1.1 503"));
  JobView job = FakeJobService::running("glass-1");
  job.state = JobState::kDone;
  service_.put(job);
  EXPECT_TRUE(held[2]->receive().starts_with("HTTP/1.1 200")) << "and are served when a thread comes free";
}

TEST_F(HttpServerTest, ManyClientsAtOnceAreAllAnswered) {
  service_.put(FakeJobService::running("glass-1"));
  std::vector<std::thread> clients;
  std::atomic<int> good{0};
  for (int i = 0; i < 32; ++i) {
    clients.emplace_back([&] {
      for (int k = 0; k < 20; ++k) good += get("/v1/jobs/glass-1").status == 200 ? 1 : 0;
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(good, 32 * 20);
}

TEST(ConnectionThreads, RunsEverythingThatItTook) {
  std::atomic<int> runs{0};
  int taken = 0;
  {
    ConnectionThreads threads(3);
    for (int i = 0; i < 1000; ++i) taken += threads.add([&] { ++runs; }) ? 1 : 0;
  }
  EXPECT_EQ(runs, taken);
  EXPECT_GE(taken, 3);
}

}  // namespace
}  // namespace pf::test
