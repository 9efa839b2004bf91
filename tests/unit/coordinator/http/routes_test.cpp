#include <sys/stat.h>

#include <filesystem>
#include <string>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

class HttpRoutesTest : public HttpTest {};

std::string submission(const std::string& files = "[]") {
  return R"({"spec": {"spec_version": 1, "job": {"name": "glass"}}, "files": )" + files + "}";
}

TEST_F(HttpRoutesTest, HealthNeedsNoToken) {
  const RawReply reply = call("GET", "/v1/health", {}, {}, false);
  EXPECT_EQ(reply.status, 200);
  EXPECT_EQ(json::parse(reply.body)["status"], "ok");
  EXPECT_FALSE(json::parse(reply.body)["build_id"].get<std::string>().empty());
}

TEST_F(HttpRoutesTest, EverythingElseNeedsTheToken) {
  for (const char* path : {"/v1/jobs", "/v1/jobs/glass-1a2b", "/v1/workers", "/v1/jobs/x/image.exr", "/nowhere"}) {
    const RawReply reply = call("GET", path, {}, {}, false);
    EXPECT_EQ(reply.status, 401) << path;
    EXPECT_NE(problem(reply).find("token"), std::string::npos);
    EXPECT_EQ(reply.headers.at("www-authenticate"), "Bearer realm=\"photonfarm\"");
  }
  for (const std::string& given : {std::string("Bearer "), std::string("Bearer wrong"), "Basic " + server_->token(),
                                   "Bearer " + server_->token() + "0", server_->token()}) {
    EXPECT_EQ(call("GET", "/v1/jobs", {{"Authorization", given}}, {}, false).status, 401) << given;
  }
  EXPECT_EQ(call("POST", "/v1/jobs", {{"Content-Type", "application/json"}}, submission(), false).status, 401);
  EXPECT_EQ(call("PUT", "/v1/blobs/" + sha256_hex(std::string_view("x")), {}, "x", false).status, 401);
  EXPECT_TRUE(service_.submissions.empty());
}

TEST_F(HttpRoutesTest, SubmitHandsSpecFilesAndKeyOver) {
  const std::string hash = sha256_hex(std::string_view("abc"));
  const RawReply reply =
      call("POST", "/v1/jobs", {{"Content-Type", "application/json; charset=utf-8"}, {"Idempotency-Key", "k-1"}},
           submission(R"([{"path": "scenes/a.gltf", "sha256": ")" + hash + R"(", "bytes": 3}])"));
  EXPECT_EQ(reply.status, 201);
  EXPECT_EQ(reply.headers.at("location"), "/v1/jobs/glass-1a2b");
  EXPECT_EQ(json::parse(reply.body)["id"], "glass-1a2b");
  ASSERT_EQ(service_.submissions.size(), 1U);
  EXPECT_EQ(service_.submissions[0].idempotency_key, "k-1");
  EXPECT_EQ(json::parse(service_.submissions[0].spec_json)["job"]["name"], "glass");
  ASSERT_EQ(service_.submissions[0].files.size(), 1U);
  EXPECT_EQ(service_.submissions[0].files[0].first, "scenes/a.gltf");
  EXPECT_EQ(service_.submissions[0].files[0].second, (BlobId{hash, 3}));
}

TEST_F(HttpRoutesTest, PlacesInTheSpecArePlacesOfTheBody) {
  service_.submit_error = Error{ErrorKind::kInvalidSpec, "request:3:12: unknown key 'photon'; expected 'photons'"};
  const RawReply reply = post("/v1/jobs", "{\"files\": [],\n \"spec\":\n  {\"a\": 1,\n   \"b\": 2}\n}");
  EXPECT_EQ(reply.status, 422);
  EXPECT_EQ(problem(reply, "place"), "request:3:12");
  EXPECT_EQ(problem(reply, "type"), "urn:photonfarm:problem:invalid-spec");
  EXPECT_EQ(service_.submissions.at(0).spec_json, "             \n        \n  {\"a\": 1,\n   \"b\": 2}\n");
}

TEST_F(HttpRoutesTest, BadBodiesAreRefusedWithTheMember) {
  const std::string hash(64, 'a');
  const auto with_file = [&](const std::string& path, const std::string& sha256, const std::string& bytes) {
    return submission(R"([{"path": ")" + path + R"(", "sha256": ")" + sha256 + R"(", "bytes": )" + bytes + "}]");
  };
  const std::vector<std::pair<std::string, std::string>> bodies = {
      {"", "not valid JSON"},
      {"{", "not valid JSON"},
      {"[]", "not a JSON object"},
      {"null", "not a JSON object"},
      {"\"spec\"", "not a JSON object"},
      {"{\"spec\": {}, \"files\": []} x", "not valid JSON"},
      {"{\"spec\": {\"a\": \"\xff\"}, \"files\": []}", "not valid JSON"},
      {std::string("{\"spec\": {}, \"files\": []}\0", 27), "not valid JSON"},
      {std::string(200000, '['), "not valid JSON"},
      {"{}", "spec"},
      {"{\"spec\": 1, \"files\": []}", "spec"},
      {"{\"sp\\u0065c\": {}, \"files\": []}", "without escapes"},
      {"{\"spec\": {}}", "files"},
      {"{\"spec\": {}, \"files\": {}}", "files"},
      {"{\"spec\": {}, \"files\": [], \"more\": 1}", "unknown member 'more'"},
      {submission("[1]"), "files[0]"},
      {submission("[{}]"), "files[0].path"},
      {with_file("", hash, "1"), "files[0].path"},
      {with_file("/etc/passwd", hash, "1"), "files[0].path"},
      {with_file("../a", hash, "1"), "files[0].path"},
      {with_file("a/../../b", hash, "1"), "files[0].path"},
      {with_file("a\\\\b", hash, "1"), "files[0].path"},
      {with_file("a\\u0000b", hash, "1"), "files[0].path"},
      {with_file("a", "", "1"), "files[0].sha256"},
      {with_file("a", std::string(64, 'A'), "1"), "files[0].sha256"},
      {with_file("a", std::string(63, 'a') + "/", "1"), "files[0].sha256"},
      {with_file("a", hash, "-1"), "files[0].bytes"},
      {with_file("a", hash, "1.5"), "files[0].bytes"},
      {with_file("a", hash, "99999999999999999999"), "files[0].bytes"},
      {with_file("a", hash, "\"1\""), "files[0].bytes"},
  };
  for (const auto& [body, expected] : bodies) {
    const RawReply reply = post("/v1/jobs", body);
    EXPECT_EQ(reply.status, 422) << body.substr(0, 100);
    EXPECT_NE(problem(reply).find(expected), std::string::npos) << body.substr(0, 100) << "\n" << reply.body;
  }
  const std::string file = R"({"path": "a", "sha256": ")" + hash + R"(", "bytes": 1})";
  EXPECT_NE(problem(post("/v1/jobs", submission("[" + file + "," + file + "]"))).find("comes twice"),
            std::string::npos);
  EXPECT_TRUE(service_.submissions.empty());
}

TEST_F(HttpRoutesTest, OnlyJsonOfKnownAndBoundedLengthIsRead) {
  EXPECT_EQ(call("POST", "/v1/jobs", {{"Content-Type", "text/plain"}}, submission()).status, 415);
  EXPECT_EQ(call("POST", "/v1/jobs", {{"Content-Type", "multipart/form-data; boundary=x"}}, submission()).status, 415);
  EXPECT_EQ(call("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Encoding", "gzip"}}, submission())
                .status,
            415);
  EXPECT_EQ(raw(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}})).status, 411);
  EXPECT_EQ(raw(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Transfer-Encoding", "chunked"}}) +
                "2\r\n{}\r\n0\r\n\r\n")
                .status,
            411);
  for (const char* length : {"-1", "1x", "99999999999999999999999"}) {
    EXPECT_EQ(raw(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Length", length}})).status,
              411)
        << length;
  }
  EXPECT_EQ(
      raw(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Length", "9999999999"}})).status,
      413);
  EXPECT_EQ(raw(head("POST", "/v1/jobs", {{"Content-Length", "2"}, {"Content-Length", "3"}}) + "{}").status, 400);
  EXPECT_EQ(
      call("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Idempotency-Key", std::string(129, 'k')}}, "{}")
          .status,
      400);
  RawConnection cut(server_->url());
  cut.send(head("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Length", "100"}}) + "{");
  EXPECT_TRUE(service_.submissions.empty());
}

TEST_F(HttpRoutesTest, ListsJobsByStateAndName) {
  service_.put(FakeJobService::running("glass-1"));
  JobView done = FakeJobService::running("pool-1");
  done.name = "pool";
  done.state = JobState::kDone;
  service_.put(done);
  const auto ids = [&](const std::string& query) {
    std::string text;
    const json reply = json::parse(get("/v1/jobs" + query).body);
    for (const json& job : reply["jobs"]) text += job["id"].get<std::string>() + " ";
    return text;
  };
  EXPECT_EQ(ids(""), "glass-1 pool-1 ");
  EXPECT_EQ(ids("?state=done"), "pool-1 ");
  EXPECT_EQ(ids("?name=glass"), "glass-1 ");
  EXPECT_EQ(ids("?name=glass&state=done"), "");
  const RawReply wrong = get("/v1/jobs?state=runing");
  EXPECT_EQ(wrong.status, 400);
  EXPECT_NE(problem(wrong).find("did you mean running?"), std::string::npos);
}

TEST_F(HttpRoutesTest, ShowsEveryFieldOfAJobAndNullForWhatIsUnknown) {
  JobView view = FakeJobService::running("glass-1");
  view.warnings = {"a", "b"};
  service_.put(view);
  const json job = json::parse(get("/v1/jobs/glass-1").body);
  EXPECT_EQ(job["state"], "running");
  EXPECT_EQ(job["passes_done"], 16);
  EXPECT_EQ(job["seconds_left"], 30.0);
  EXPECT_TRUE(job["estimated_error"].is_null());
  EXPECT_EQ(job["warnings"].size(), 2U);
  EXPECT_EQ(job.size(), 37U);
  const RawReply absent = get("/v1/jobs/other");
  EXPECT_EQ(absent.status, 404);
  EXPECT_EQ(problem(absent, "type"), "urn:photonfarm:problem:not-found");
}

TEST_F(HttpRoutesTest, CancelsWithoutABody) {
  service_.put(FakeJobService::running("glass-1"));
  const RawReply reply = raw(head("POST", "/v1/jobs/glass-1/cancel", {}));
  EXPECT_EQ(reply.status, 200);
  EXPECT_EQ(json::parse(reply.body)["state"], "cancelled");
  EXPECT_EQ(call("POST", "/v1/jobs/other/cancel").status, 404);
}

TEST_F(HttpRoutesTest, ListsWorkers) {
  const json workers = json::parse(get("/v1/workers").body)["workers"];
  ASSERT_EQ(workers.size(), 1U);
  EXPECT_EQ(workers[0]["name"], "host-a-1");
  EXPECT_EQ(workers[0].size(), 10U);
}

TEST_F(HttpRoutesTest, ErrorKindsBecomeStatusCodes) {
  const std::vector<std::pair<ErrorKind, int>> table = {{ErrorKind::kUsage, 404},        {ErrorKind::kInvalidSpec, 422},
                                                        {ErrorKind::kInvalidInput, 422}, {ErrorKind::kUnavailable, 429},
                                                        {ErrorKind::kTimeout, 503},      {ErrorKind::kInternal, 500}};
  for (const auto& [kind, status] : table) {
    service_.submit_error = Error{kind, "why \xff"};
    const RawReply reply = post("/v1/jobs", submission());
    EXPECT_EQ(reply.status, status);
    EXPECT_EQ(problem(reply), "why \uFFFD");
  }
}

TEST_F(HttpRoutesTest, WrongMethodsAndAddressesAreNamed) {
  const RawReply reply = call("POST", "/v1/workers", {}, "");
  EXPECT_EQ(reply.status, 405);
  EXPECT_EQ(reply.headers.at("allow"), "GET");
  EXPECT_EQ(call("PUT", "/v1/jobs", {}, "x").headers.at("allow"), "POST, GET");
  EXPECT_EQ(call("DELETE", "/v1/blobs/" + std::string(64, 'a')).status, 405);
  for (const char* method : {"PATCH", "DELETE", "OPTIONS", "TRACE", "PRI", "CONNECT", "BREW"}) {
    const int status = call(method, "/v1/jobs").status;
    EXPECT_TRUE(status == 405 || status == 400) << method << " " << status;
  }
  EXPECT_EQ(get("/v2/jobs").status, 404);
  EXPECT_EQ(get("/v1/jobs/").status, 404);
  EXPECT_EQ(get("/v1//jobs").status, 404);
}

TEST_F(HttpRoutesTest, NoPathLeadsOutOfTheApi) {
  service_.put(FakeJobService::running("glass-1"));
  std::ofstream(temp_ / "secret") << "secret";
  for (const char* path :
       {"/v1/jobs/../secret", "/v1/jobs/..%2Fsecret", "/v1/jobs/%2e%2e/image.exr", "/v1/jobs/glass-1/../../secret",
        "/v1/blobs/..%2f..%2fsecret", "/v1/blobs/%00", "/v1/jobs/a%00b", "/v1/jobs/%ff%fe", "/../../etc/passwd",
        "//etc/passwd", "/v1/jobs/GLASS-1", "/v1/jobs/%0d%0aX-Evil:1", "*", "/v1/jobs/a%20b"}) {
    for (const char* method : {"GET", "HEAD"}) {
      const RawReply reply = call(method, path);
      EXPECT_TRUE(reply.status == 404 || reply.status == 400) << method << " " << path << " " << reply.status;
      EXPECT_EQ(reply.headers.count("x-evil"), 0U);
    }
  }
}

TEST_F(HttpRoutesTest, PreviewIsPngOrNotYet) {
  service_.put(FakeJobService::running("glass-1"));
  const RawReply none = get("/v1/jobs/glass-1/preview.png");
  EXPECT_EQ(none.status, 409);
  EXPECT_EQ(problem(none, "type"), "urn:photonfarm:problem:not-yet");
  service_.preview = std::string("\x89PNG\0\n", 6);
  const RawReply reply = get("/v1/jobs/glass-1/preview.png");
  EXPECT_EQ(reply.headers.at("content-type"), "image/png");
  EXPECT_EQ(reply.body, service_.preview);
}

TEST_F(HttpRoutesTest, BlobsAreStoredUnderTheirHashOnly) {
  const std::string content = std::string(3'000'000, 'x') + "end", name = sha256_hex(content);
  EXPECT_EQ(call("HEAD", "/v1/blobs/" + name).status, 404);
  EXPECT_EQ(call("PUT", "/v1/blobs/" + name, {}, content).status, 201);
  EXPECT_EQ(call("HEAD", "/v1/blobs/" + name).status, 200);
  EXPECT_EQ(call("PUT", "/v1/blobs/" + name, {}, content).status, 201) << "a second time does no harm";

  const std::string other = sha256_hex(std::string_view("other"));
  const RawReply wrong = call("PUT", "/v1/blobs/" + other, {}, "content");
  EXPECT_EQ(wrong.status, 422);
  EXPECT_NE(problem(wrong).find(sha256_hex(std::string_view("content"))), std::string::npos);
  EXPECT_EQ(call("HEAD", "/v1/blobs/" + other).status, 404);
  EXPECT_EQ(call("HEAD", "/v1/blobs/" + sha256_hex(std::string_view("content"))).status, 404);
  EXPECT_EQ(call("PUT", "/v1/blobs/abc", {}, "x").status, 400);
  EXPECT_EQ(raw(head("PUT", "/v1/blobs/" + other, {})).status, 411);
  EXPECT_EQ(raw(head("PUT", "/v1/blobs/" + other, {{"Content-Length", "99999999999999"}})).status, 413);
  EXPECT_EQ(call("PUT", "/v1/blobs/" + sha256_hex(std::string_view("")), {}, "").status, 201)
      << "the empty file is a file";
}

TEST_F(HttpRoutesTest, AnUploadThatBreaksOffLeavesNothing) {
  const std::string content(1'000'000, 'y'), name = sha256_hex(content);
  {
    RawConnection connection(server_->url());
    connection.send(head("PUT", "/v1/blobs/" + name, {{"Content-Length", "1000000"}}) + content.substr(0, 500'000));
  }
  EXPECT_EQ(call("PUT", "/v1/blobs/" + name, {}, content).status, 201);
  EXPECT_EQ(call("HEAD", "/v1/blobs/" + name).status, 200);
}

}  // namespace
}  // namespace pf::test
