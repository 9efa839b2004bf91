#include <string>

#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

class VerbRoutes : public HttpTest {
 protected:
  void SetUp() override {
    HttpTest::SetUp();
    service_.put(FakeJobService::running("glass-1"));
  }
  [[nodiscard]] RawReply patch(const std::string& path, const std::string& body) const {
    return call("PATCH", path, {{"Content-Type", "application/json"}, {"Content-Length", std::to_string(body.size())}},
                body);
  }
};

TEST_F(VerbRoutes, PauseResumeAndRetryReachTheService) {
  EXPECT_EQ(json::parse(call("POST", "/v1/jobs/glass-1/pause").body)["state"], "paused");
  EXPECT_EQ(json::parse(get("/v1/jobs/glass-1").body)["paused_by"], "bootstrap");
  EXPECT_EQ(json::parse(raw(head("POST", "/v1/jobs/glass-1/resume", {})).body)["state"], "queued");
  const RawReply refused = call("POST", "/v1/jobs/glass-1/retry");
  EXPECT_EQ(refused.status, 409);
  EXPECT_EQ(problem(refused, "type"), "urn:photonfarm:problem:conflict");
  EXPECT_EQ(call("POST", "/v1/jobs/other/pause").status, 404);
  EXPECT_EQ(call("GET", "/v1/jobs/glass-1/pause").status, 405);
}

TEST_F(VerbRoutes, CancelKeepsOrDiscards) {
  EXPECT_EQ(post("/v1/jobs/glass-1/cancel", "{\"discard\": 1}").status, 422);
  EXPECT_EQ(post("/v1/jobs/glass-1/cancel", "{\"keep\": true}").status, 422);
  EXPECT_EQ(post("/v1/jobs/glass-1/cancel", "{\"discard\": true}").status, 200);
  service_.put(FakeJobService::running("glass-2"));
  EXPECT_EQ(post("/v1/jobs/glass-2/cancel", "{\"discard\": false}").status, 200);
  ASSERT_EQ(service_.acts.size(), 2U);
  EXPECT_EQ(service_.acts[0], "discard glass-1 by bootstrap");
  EXPECT_EQ(service_.acts[1], "cancel glass-2 by bootstrap");
}

TEST_F(VerbRoutes, APilotIsTheJobWithAnEarlyStopAndItsEstimateComesLater) {
  const std::string body = R"({"spec": {"job": {"name": "glass"}, "scene": {"file": "a.glb"}}, "files": []})";
  const RawReply taken = post("/v1/estimates?seconds=2.5", body);
  ASSERT_EQ(taken.status, 201) << taken.body;
  EXPECT_EQ(taken.headers.at("location"), "/v1/jobs/" + json::parse(taken.body)["id"].get<std::string>() + "/estimate");
  EXPECT_EQ(post("/v1/estimates", body).status, 201);
  ASSERT_EQ(service_.submissions.size(), 2U);
  EXPECT_EQ(service_.submissions[0].pilot_seconds, 2.5);
  EXPECT_EQ(service_.submissions[1].pilot_seconds, 10);
  for (const char* seconds : {"0", "-1", "nan", "inf", "1e9", "0x5", "ten", "1e999"})
    EXPECT_EQ(post(std::string("/v1/estimates?seconds=") + seconds, body).status, 400) << seconds;

  const RawReply early = get("/v1/jobs/glass-1/estimate");
  EXPECT_EQ(early.status, 409);
  EXPECT_EQ(problem(early, "type"), "urn:photonfarm:problem:not-yet");
  service_.pilot = {.points = {{1, 0.5, 0.4}, {2, 0.5, 0.3}, {4, 1.0, 0.2}}, .peak_bytes = 1000};
  const json estimate = json::parse(get("/v1/jobs/glass-1/estimate?passes=100&error=0.1").body);
  EXPECT_EQ(estimate["job"], "glass-1");
  EXPECT_EQ(estimate["passes"], 100);
  EXPECT_EQ(estimate["workers"], 2);
  EXPECT_EQ(estimate["pilot"].size(), 3U);
  for (const char* range : {"seconds", "memory_bytes", "estimated_error", "passes_to_error"}) {
    EXPECT_LE(estimate[range]["low"], estimate[range]["likely"]) << range;
    EXPECT_LE(estimate[range]["likely"], estimate[range]["high"]) << range;
  }
  EXPECT_TRUE(estimate["network_bytes"].is_null()) << "nothing is known of it";
  for (const char* query : {"passes=0", "passes=1e13", "passes=x", "error=-1", "error=0", "error=nan"})
    EXPECT_EQ(get(std::string("/v1/jobs/glass-1/estimate?") + query).status, 400) << query;
}

TEST_F(VerbRoutes, ExtendAndChangeTakeWhatTheyKnowAndNothingElse) {
  const json extended =
      json::parse(post("/v1/jobs/glass-1/extend", R"({"passes": 128, "seconds": 2.5, "error": 0.01})").body);
  EXPECT_EQ(extended["passes_wanted"], 128);
  EXPECT_EQ(extended["stop_seconds"], 2.5);
  EXPECT_EQ(extended["stop_error"], 0.01);
  EXPECT_EQ(extended["extended"], 1);
  const json changed = json::parse(patch("/v1/jobs/glass-1", R"({"priority": 70, "max_workers": 3})").body);
  EXPECT_EQ(changed["priority"], 70);
  EXPECT_EQ(changed["max_workers"], 3);
  for (const char* body : {"", "{}", "[]", "{", "{\"passes\": -1}", "{\"passes\": 1.5}", "{\"passes\": \"9\"}",
                           "{\"error\": null}", "{\"seconds\": -1}", "{\"more\": 1}", "{\"passes\": 1e300}"}) {
    EXPECT_EQ(post("/v1/jobs/glass-1/extend", body).status, 422) << body;
  }
  for (const char* body : {"{}", "{\"priority\": 1.5}", "{\"max_workers\": -1}", "{\"state\": \"done\"}"}) {
    EXPECT_EQ(patch("/v1/jobs/glass-1", body).status, 422) << body;
  }
  EXPECT_EQ(service_.acts.size(), 2U);
}

TEST_F(VerbRoutes, DeleteIsForWhatHasEnded) {
  EXPECT_EQ(call("DELETE", "/v1/jobs/glass-1").status, 409);
  EXPECT_EQ(call("POST", "/v1/jobs/glass-1/cancel").status, 200);
  const RawReply gone = call("DELETE", "/v1/jobs/glass-1");
  EXPECT_EQ(gone.status, 204);
  EXPECT_EQ(gone.body, "");
  EXPECT_EQ(get("/v1/jobs/glass-1").status, 404);
}

TEST_F(VerbRoutes, UnitsAndConvergenceShowEveryField) {
  service_.all_units = {{0, 4, {0, 0, 16, 16}, "done", 2, "host-a-1", 1.5, 1, std::string(32, 'a')},
                        {4, 2, {}, "out", 1, "", 0, 0, ""}};
  service_.points = {{0.5, 2, 1, 1000, std::nullopt}, {1.0, 4, 2, 2000, 0.25}};
  const json units = json::parse(get("/v1/jobs/glass-1/units").body);
  ASSERT_EQ(units["units"].size(), 2U);
  EXPECT_EQ(units["units"][0]["part"], json({0, 0, 16, 16}));
  EXPECT_TRUE(units["units"][1]["part"].is_null());
  EXPECT_TRUE(units["after"].is_null());
  EXPECT_EQ(json::parse(get("/v1/jobs/glass-1/units?after=0").body)["units"].size(), 1U);
  EXPECT_EQ(get("/v1/jobs/glass-1/units?after=x").status, 400);
  const json points = json::parse(get("/v1/jobs/glass-1/convergence").body)["points"];
  ASSERT_EQ(points.size(), 2U);
  EXPECT_TRUE(points[0]["estimated_error"].is_null());
  EXPECT_EQ(points[1]["estimated_error"], 0.25);
  EXPECT_EQ(get("/v1/jobs/other/units").status, 404);
  EXPECT_EQ(get("/v1/jobs/other/convergence").status, 404);
}

TEST_F(VerbRoutes, ValidateAnswersWithTheModelAndKeepsNothing) {
  const RawReply reply = post("/v1/jobs/validate", R"({"spec": {"job": {"name": "glass"}}})");
  EXPECT_EQ(reply.status, 200);
  const json valid = json::parse(reply.body);
  EXPECT_EQ(valid["valid"], true);
  EXPECT_EQ(valid["spec"]["job"]["name"], "glass");
  EXPECT_EQ(valid["warnings"].size(), 1U);
  service_.submit_error = Error{ErrorKind::kInvalidSpec, "request:1:3: unknown key"};
  const RawReply wrong = post("/v1/jobs/validate", R"({"spec": {}})");
  EXPECT_EQ(wrong.status, 422);
  EXPECT_EQ(problem(wrong, "place"), "request:1:3");
}

TEST_F(VerbRoutes, WorkersAreSteeredByName) {
  EXPECT_EQ(json::parse(call("POST", "/v1/workers/host-a-1/drain").body)["state"], "draining");
  EXPECT_EQ(json::parse(call("POST", "/v1/workers/host-a-1/disable").body)["state"], "disabled");
  EXPECT_EQ(json::parse(call("POST", "/v1/workers/host-a-1/enable").body)["state"], "idle");
  EXPECT_EQ(call("POST", "/v1/workers/Other_1/drain").status, 404);
  EXPECT_EQ(service_.acts.at(0), "draining host-a-1 by bootstrap");
}

TEST_F(VerbRoutes, AFileThatExpiredIsGoneAndOneThatIsStillToComeIsNot) {
  JobView job = FakeJobService::running("old-1");
  job.state = JobState::kDone;
  job.expired = {"results"};
  service_.put(job);
  const RawReply gone = get("/v1/jobs/old-1/image.exr");
  EXPECT_EQ(gone.status, 410);
  EXPECT_EQ(problem(gone, "type"), "urn:photonfarm:problem:expired");
  EXPECT_EQ(problem(get("/v1/jobs/old-1/checkpoint"), "type"), "urn:photonfarm:problem:not-yet");
  EXPECT_EQ(problem(get("/v1/jobs/glass-1/image.exr"), "type"), "urn:photonfarm:problem:not-yet");
}

TEST_F(VerbRoutes, ListsAreCutAndGoOnWithOlderOnes) {
  for (int i = 2; i <= 5; ++i) service_.put(FakeJobService::running("glass-" + std::to_string(i)));
  const json last = json::parse(get("/v1/jobs?limit=2").body);
  ASSERT_EQ(last["jobs"].size(), 2U);
  EXPECT_EQ(last["jobs"][1]["id"], "glass-5");
  EXPECT_EQ(json::parse(get("/v1/jobs?before=glass-3").body)["jobs"].size(), 2U);
  for (const char* limit : {"0", "1001", "x", "-1"}) {
    EXPECT_EQ(get(std::string("/v1/jobs?limit=") + limit).status, 400) << limit;
  }
}

}  // namespace
}  // namespace pf::test
