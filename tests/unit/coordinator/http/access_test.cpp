// Who may do what, how often, and how large: tokens with roles, rates, limits.

#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "common/base/atomic_file.h"
#include "coordinator/http/tls.h"
#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

class HttpAccess : public HttpTest {
 protected:
  /// A new token of this role.
  [[nodiscard]] std::string token(const std::string& name, const std::string& role) const {
    const RawReply reply = post("/v1/tokens", json{{"name", name}, {"role", role}}.dump());
    EXPECT_EQ(reply.status, 201) << reply.body;
    return json::parse(reply.body).value("token", "");
  }
  [[nodiscard]] int status(const std::string& bearer, const std::string& method, const std::string& path) const {
    HeaderList headers = {{"Authorization", "Bearer " + bearer}};
    if (method != "GET" && method != "HEAD")
      headers.insert(headers.end(), {{"Content-Type", "application/json"}, {"Content-Length", "18"}});
    return raw(head(method, path, headers, false) + (method == "GET" || method == "HEAD" ? "" : "{\"discard\": false}"))
        .status;
  }
  [[nodiscard]] std::string submission(int width, std::uint64_t bytes) const {
    const json file = {{"path", "a.gltf"}, {"sha256", std::string(64, 'a')}, {"bytes", bytes}};
    return json{{"spec", {{"image", {{"width", width}, {"height", 100}}}}}, {"files", {file}}}.dump();
  }
};

TEST_F(HttpAccess, EachRoleMayDoItsOwnAndWhatIsBelow) {
  service_.put(FakeJobService::running("glass-1"));
  const std::string read = token("viewer", "read"), submit = token("anna", "submit"), admin = token("boss", "admin");
  EXPECT_EQ(status(read, "GET", "/v1/jobs"), 200);
  EXPECT_EQ(status(read, "POST", "/v1/jobs/glass-1/cancel"), 403);
  EXPECT_EQ(status(read, "PUT", "/v1/blobs/" + std::string(64, 'a')), 403);
  EXPECT_EQ(status(submit, "GET", "/v1/jobs"), 200);
  EXPECT_EQ(status(submit, "POST", "/v1/jobs/glass-1/cancel"), 200);
  EXPECT_EQ(status(submit, "GET", "/v1/tokens"), 403);
  EXPECT_EQ(status(submit, "DELETE", "/v1/jobs/glass-1"), 403);
  EXPECT_EQ(status(submit, "POST", "/v1/workers/w/drain"), 403);
  EXPECT_EQ(status(admin, "GET", "/v1/tokens"), 200);
  EXPECT_EQ(status(admin, "POST", "/v1/jobs/glass-1/cancel"), 200);
}

TEST_F(HttpAccess, TokensAreHashedAtRestAndSurviveARestart) {
  const std::string given = token("anna", "read");
  const std::string kept = read_file(temp_ / "tokens.json", 1 << 20).value_or("");
  EXPECT_EQ(kept.find(given), std::string::npos);
  EXPECT_NE(kept.find("anna"), std::string::npos);
  EXPECT_EQ(kept.find(server_->token()), std::string::npos);
  struct ::stat info = {};
  ASSERT_EQ(::stat((temp_ / "tokens.json").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
  start();
  EXPECT_EQ(status(given, "GET", "/v1/jobs"), 200);
  EXPECT_EQ(status(given + "0", "GET", "/v1/jobs"), 401);
}

TEST_F(HttpAccess, ARevokedTokenOpensNothing) {
  const std::string given = token("anna", "admin");
  EXPECT_EQ(status(given, "GET", "/v1/jobs"), 200);
  EXPECT_EQ(call("DELETE", "/v1/tokens/anna").status, 204);
  EXPECT_EQ(status(given, "GET", "/v1/jobs"), 401);
  EXPECT_EQ(call("DELETE", "/v1/tokens/anna").status, 404);
  EXPECT_EQ(call("DELETE", "/v1/tokens/bootstrap").status, 422);
  const json tokens = json::parse(get("/v1/tokens").body)["tokens"];
  ASSERT_EQ(tokens.size(), 1U);
  EXPECT_EQ(tokens[0]["name"], "bootstrap");
  EXPECT_FALSE(tokens[0].contains("sha256"));
}

TEST_F(HttpAccess, BadTokensAreNotMade) {
  for (const char* body : {"", "[]", "{}", R"({"name": "a"})", R"({"name": "a", "role": "root"})",
                           R"({"name": "../a", "role": "read"})", R"({"name": "A", "role": "read"})",
                           R"({"name": "bootstrap", "role": "read"})", R"({"name": "a", "role": "read", "more": 1})"}) {
    EXPECT_EQ(post("/v1/tokens", body).status, 422) << body;
  }
  static_cast<void>(token("anna", "read"));
  const RawReply twice = post("/v1/tokens", R"({"name": "anna", "role": "read"})");
  EXPECT_EQ(twice.status, 422);
  EXPECT_NE(problem(twice).find("revoke it first"), std::string::npos);
}

TEST_F(HttpAccess, ABrokenFileOfTokensStopsTheStart) {
  for (const char* text : {"{", "{}", R"({"tokens": [{"name": "a", "role": "king", "sha256": "x"}]})"}) {
    std::ofstream(temp_ / "tokens.json") << text;
    const auto broken = HttpServer::start(options_, service_, log_);
    ASSERT_FALSE(broken) << text;
    EXPECT_EQ(broken.error().kind, ErrorKind::kInvalidInput);
  }
}

TEST_F(HttpAccess, ATokenHasARateAndOthersAreNotHeldUp) {
  const FakeClock clock;
  options_.config.limits.requests_per_second = 2;
  options_.config.limits.request_burst = 5;
  options_.clock = &clock;
  start();
  const std::string anna = token("anna", "read");
  for (int i = 0; i < 5; ++i) EXPECT_EQ(status(anna, "GET", "/v1/jobs"), 200);
  const RawReply refused = raw(head("GET", "/v1/jobs", {{"Authorization", "Bearer " + anna}}, false));
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(refused.headers.at("retry-after"), "1");
  EXPECT_EQ(get("/v1/jobs").status, 200) << "another token";
  const_cast<FakeClock&>(clock).advance(0.5);
  EXPECT_EQ(status(anna, "GET", "/v1/jobs"), 200);
  EXPECT_EQ(status(anna, "GET", "/v1/jobs"), 429);
  const_cast<FakeClock&>(clock).advance(1e6);
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(status(anna, "GET", "/v1/jobs"), 200) << "a long rest saves up no more than the burst";
  EXPECT_EQ(status(anna, "GET", "/v1/jobs"), 429);
}

TEST_F(HttpAccess, JobsBeyondTheLimitsAreNotTaken) {
  options_.config.limits.pixels = 1000 * 100;
  options_.config.limits.job_bytes = 5000;
  start();
  EXPECT_EQ(post("/v1/jobs", submission(1000, 5000)).status, 201);
  EXPECT_EQ(post("/v1/jobs", submission(1001, 5000)).status, 413);
  EXPECT_EQ(post("/v1/jobs", submission(1000, 5001)).status, 413);
  EXPECT_EQ(post("/v1/jobs", R"({"spec": {"image": {"width": 100000}}, "files": []})").status, 413)
      << "the other side's default counts";
  EXPECT_EQ(service_.submissions.size(), 1U);
}

TEST_F(HttpAccess, OneJobTooManyIsAProblemOfItsOwn) {
  service_.submit_error = Error{ErrorKind::kUnavailable, "the token 'anna' has 2 jobs that have not ended"};
  const RawReply refused = post("/v1/jobs", submission(10, 10));
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(problem(refused, "type"), "urn:photonfarm:problem:too-many-jobs");
  EXPECT_EQ(refused.headers.count("retry-after"), 0U) << "nobody knows when a job ends";
}

TEST_F(HttpAccess, NobodyElseReachesAPlainService) {
  for (const char* host : {"0.0.0.0", "::", "10.1.2.3", "example.org"}) {
    options_.config.http.host = host;
    const auto refused = HttpServer::start(options_, service_, log_);
    ASSERT_FALSE(refused) << host;
    EXPECT_EQ(exit_code(refused.error().kind), 2);
    EXPECT_NE(refused.error().message.find("http.certificate"), std::string::npos);
  }
  for (const char* host : {"127.0.0.1", "127.8.9.1", "::1", "localhost"}) EXPECT_TRUE(is_loopback(host)) << host;
  for (const char* host : {"127.0.0.1.evil.org", "128.0.0.1", "", "::2"}) EXPECT_FALSE(is_loopback(host)) << host;
}

TEST_F(HttpAccess, NoAddressLeadsOutOfItsFolder) {
  service_.put(FakeJobService::running("glass-1"));
  std::ofstream(temp_ / "secret") << "secret";
  for (const char* path :
       {"/v1/jobs/../secret", "/v1/jobs/%2e%2e/checkpoint", "/v1/jobs/..%2f..%2fsecret/checkpoint",
        "/v1/blobs/../token", "/v1/blobs/%2e%2e%2ftoken", "/v1/tokens/../token", "/v1/jobs/glass-1/../../token",
        "//token", "/../token", "/v1/jobs/glass-1%00/checkpoint", "/assets/../token", "/assets/%2e%2e/token"}) {
    const RawReply reply = get(path);
    EXPECT_TRUE(reply.status == 404 || reply.status == 400 || reply.status == 405) << path << " " << reply.status;
    EXPECT_EQ(reply.body.find(server_->token()), std::string::npos) << path;
  }
}

TEST_F(HttpAccess, NothingIsUnpacked) {
  // A megabyte of zeros packs into a thousand bytes, and a terabyte into a megabyte: what comes packed is not
  // taken.
  for (const char* encoding : {"gzip", "deflate", "br", "zstd", "identity, gzip"}) {
    const RawReply reply =
        call("POST", "/v1/jobs", {{"Content-Type", "application/json"}, {"Content-Encoding", encoding}}, "bomb");
    EXPECT_EQ(reply.status, 415) << encoding;
  }
  EXPECT_TRUE(service_.submissions.empty());
}

}  // namespace
}  // namespace pf::test
