#include <chrono>
#include <thread>

#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

class HttpStreamsTest : public HttpTest {};

TEST_F(HttpStreamsTest, EventsShowEveryChangeAndEndWithTheJob) {
  service_.put(FakeJobService::running("glass-1"));
  RawConnection connection(server_->url());
  connection.send(head("GET", "/v1/jobs/glass-1/events", {}));
  EXPECT_NE(connection.receive("\"passes_done\":16").find("text/event-stream"), std::string::npos);
  JobView job = FakeJobService::running("glass-1");
  job.passes_done = 32;
  service_.put(job);
  connection.receive("\"passes_done\":32");
  job.state = JobState::kDone;
  service_.put(job);
  const std::string body = parse_reply(connection.receive()).body;
  EXPECT_TRUE(body.starts_with("event: job\ndata: {")) << body;
  EXPECT_NE(body.find("\"state\":\"done\""), std::string::npos);
  EXPECT_TRUE(body.ends_with("}\n\n"));
}

TEST_F(HttpStreamsTest, WhatDoesNotConcernAJobIsNoEventOfIt) {
  service_.put(FakeJobService::running("glass-1"));
  RawConnection connection(server_->url());
  connection.send(head("GET", "/v1/jobs/glass-1/events", {}));
  connection.receive("\"passes_done\":16");
  service_.put(FakeJobService::running("other-1"));
  ASSERT_TRUE(service_.wait_for_watcher());
  JobView job = FakeJobService::running("glass-1");
  job.state = JobState::kFailed;
  service_.put(job);
  const std::string body = parse_reply(connection.receive()).body;
  std::size_t events = 0;
  for (std::size_t at = body.find("event: job"); at != std::string::npos; at = body.find("event: job", at + 1))
    ++events;
  EXPECT_EQ(events, 2U) << body;
}

TEST_F(HttpStreamsTest, SilentStreamsShowThatTheyLive) {
  options_.heartbeat_seconds = 0.01;
  start();
  service_.put(FakeJobService::running("glass-1"));
  RawConnection events(server_->url());
  events.send(head("GET", "/v1/jobs/glass-1/events", {}));
  events.receive("\n: still here\n\n");
  RawConnection logs(server_->url());
  logs.send(head("GET", "/v1/jobs/glass-1/logs?follow=1", {}));
  logs.receive("\r\n\r\n1\r\n\n\r\n");
}

TEST_F(HttpStreamsTest, LogsAreLinesOfJsonAfterANumber) {
  service_.put(FakeJobService::running("glass-1"));
  for (int i = 0; i < 2500; ++i) service_.log("entry " + std::to_string(i));
  const RawReply all = get("/v1/jobs/glass-1/logs");
  EXPECT_EQ(all.headers.at("content-type"), "application/x-ndjson");
  EXPECT_EQ(std::count(all.body.begin(), all.body.end(), '\n'), 2500);
  const std::string last = get("/v1/jobs/glass-1/logs?after=2499").body;
  EXPECT_EQ(json::parse(last)["text"], "entry 2499");
  EXPECT_EQ(json::parse(last)["number"], 2500);
  EXPECT_EQ(get("/v1/jobs/glass-1/logs?after=x").status, 400);
  EXPECT_EQ(get("/v1/jobs/glass-1/logs?follow=yes").status, 400);
  EXPECT_EQ(get("/v1/jobs/other/logs").status, 404);
}

TEST_F(HttpStreamsTest, FollowedLogsEndWithTheJobAndMissNothing) {
  service_.put(FakeJobService::running("glass-1"));
  service_.log("first");
  RawConnection connection(server_->url());
  connection.send(head("GET", "/v1/jobs/glass-1/logs?follow=1", {}));
  connection.receive("first");
  service_.log("second");
  connection.receive("second");
  service_.log("last");
  JobView job = FakeJobService::running("glass-1");
  job.state = JobState::kDone;
  service_.put(job);
  EXPECT_NE(parse_reply(connection.receive()).body.find("last"), std::string::npos);
}

TEST_F(HttpStreamsTest, TheServerStopsAtOnceWhileClientsWatch) {
  service_.put(FakeJobService::running("glass-1"));
  std::vector<std::unique_ptr<RawConnection>> watchers;
  for (int i = 0; i < 20; ++i) {
    watchers.push_back(std::make_unique<RawConnection>(server_->url()));
    watchers.back()->send(head("GET", i % 2 == 0 ? "/v1/jobs/glass-1/events" : "/v1/jobs/glass-1/logs?follow=1", {}));
    watchers.back()->receive("\r\n\r\n");
  }
  RawConnection silent(server_->url()), half(server_->url());
  half.send("GET /v1/jobs HT");
  const auto from = std::chrono::steady_clock::now();
  server_.reset();
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count(), 3.0);
}

TEST_F(HttpStreamsTest, WatchersAreBoundedAndLeaveTheirPlaces) {
  options_.max_streams = 2;
  start();
  service_.put(FakeJobService::running("glass-1"));
  const std::string request = head("GET", "/v1/jobs/glass-1/events", {});
  {
    RawConnection a(server_->url()), b(server_->url());
    a.send(request);
    b.send(request);
    a.receive("event: job");
    b.receive("event: job");
    EXPECT_EQ(raw(request).status, 503);
    EXPECT_EQ(get("/v1/jobs").status, 200);
  }
  // They are gone: their places come free within a watcher's wait.
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  bool free = false;
  while (!free && std::chrono::steady_clock::now() < deadline) {
    RawConnection next(server_->url());
    next.send(request);
    free = next.receive("\r\n\r\n").starts_with("HTTP/1.1 200");
  }
  EXPECT_TRUE(free);
}

}  // namespace
}  // namespace pf::test
