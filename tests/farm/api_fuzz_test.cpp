// The API against its own description: every route of the OpenAPI document that the coordinator serves, asked
// rightly and in every wrong way that a seed finds (PF_FUZZ_SEED, PF_FUZZ_ROUNDS). Nothing breaks it, every
// error is a problem document, and no job is lost.

#include <sys/socket.h>

#include <algorithm>
#include <fstream>
#include <set>

#include <fmt/format.h>

#include "common/base/hash.h"
#include "tests/farm/api_requests.h"
#include "tests/farm/farm_fixture.h"
#include "tests/support/json_schema.h"
#include "tests/support/raw_http.h"

namespace pf::farm_test {
namespace {

using nlohmann::json;
using test::RawReply;

std::uint64_t setting(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::stoull(text);
}

/// As much of a request as a failure needs to show.
std::string shown(const ApiRequest& request) {
  std::string text = request.documented + " asked by:\n";
  for (const char c : request.text().substr(0, 1500)) {
    text += c == '\n' || (c >= ' ' && c <= '~') ? std::string(1, c)
                                                : fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
  }
  return text;
}

class ApiFuzz : public FarmFaults {
 protected:
  void SetUp() override {
    FarmFaults::SetUp();
    if (HasFatalFailure()) return;
    std::ofstream(state_ / "config.toml") << "[limits]\nrequests_per_second = 1000000\nrequest_burst = 1000000\n";
    start_farm(1);
    token_ = first_line("token");
    url_ = first_line("url");
  }
  [[nodiscard]] std::string first_line(const char* name) const {
    const std::string text = read_file(state_ / name, 4096).value_or("");
    return text.substr(0, text.find('\n'));
  }
  RawReply send(ApiRequest request) const {
    const auto has = [&](const char* name) {
      return std::any_of(request.headers.begin(), request.headers.end(),
                         [&](const auto& header) { return header.first == name; });
    };
    if (!has("Authorization")) request.headers.emplace_back("Authorization", "Bearer " + token_);
    // Announced bodies alone are answered twice: with 100, and then.
    if (request.body.empty())
      std::erase_if(request.headers, [](const auto& header) { return header.first == "Expect"; });
    test::RawConnection connection(url_);
    connection.send(request.text());
    // A body that is announced and does not come would be waited for.
    if (!request.right) ::shutdown(connection.descriptor(), SHUT_WR);
    const std::string head = connection.receive("\r\n\r\n");
    const bool is_stream =
        head.find("text/event-stream") != std::string::npos || head.find("application/x-ndjson") != std::string::npos;
    if (is_stream) return test::parse_reply(head.substr(0, head.find("\r\n\r\n") + 4));
    const std::string all = connection.receive();
    constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    return test::parse_reply(all.starts_with(kContinue) ? all.substr(kContinue.size()) : all);
  }
  void expect_problem(const ApiRequest& request, const RawReply& reply) const {
    EXPECT_LT(reply.status, 500) << shown(request) << reply.body;
    if (request.method == "HEAD") return;
    const auto type = reply.headers.find("content-type");
    ASSERT_TRUE(type != reply.headers.end()) << shown(request) << "\n-> " << reply.status;
    EXPECT_EQ(type->second, "application/problem+json") << shown(request) << "\n-> " << reply.status << reply.body;
    const json problem = json::parse(reply.body, nullptr, false);
    EXPECT_EQ(test::misfit(document_, problem, {{"$ref", "#/components/schemas/Problem"}}, "problem"), "")
        << shown(request) << reply.body;
    if (problem.is_object()) {
      EXPECT_EQ(problem.value("status", 0), reply.status) << shown(request);
    }
    if (reply.status == 405) {
      EXPECT_EQ(reply.headers.count("allow"), 1u) << shown(request) << reply.body;
    }
  }
  void expect_documented(const ApiRequest& request, const RawReply& reply) const {
    const json& operations = document_.at("paths").at(request.documented);
    std::string method = request.method == "HEAD" && !operations.contains("head") ? "get" : request.method;
    for (char& c : method) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (!operations.contains(method)) return;  // another route of the same shape
    const json& responses = operations.at(method).at("responses");
    const bool of_a_file = reply.status == 206 || reply.status == 304;
    const std::string status = of_a_file ? "200" : std::to_string(reply.status);
    EXPECT_TRUE(responses.contains(status)) << shown(request) << "\n-> " << reply.status;
    if (of_a_file || !request.right || request.method == "HEAD" || !responses.contains(status)) return;
    const json content = responses.at(status).value("content", json::object());
    if (!content.contains("application/json") || !content.at("application/json").contains("schema")) return;
    const json answer = json::parse(reply.body, nullptr, false);
    EXPECT_EQ(test::misfit(document_, answer, content.at("application/json").at("schema"), "answer"), "")
        << shown(request);
  }
  /// Sends it, looks at the answer, and keeps the book of jobs.
  void ask_with(const ApiRequest& request) {
    RawReply reply;
    ASSERT_NO_THROW(reply = send(request)) << shown(request);
    const bool made_token = request.documented == "/v1/tokens" && reply.status == 201;
    EXPECT_TRUE(made_token || reply.body.find(token_) == std::string::npos) << shown(request);
    EXPECT_GE(reply.status, 200) << shown(request);
    if (reply.status >= 400) return expect_problem(request, reply);
    expect_documented(request, reply);
    ++answered_[request.method + " " + request.documented];
    const std::string_view path = std::string_view(request.target).substr(0, request.target.find('?'));
    if (request.method == "POST" && (path == "/v1/jobs" || path == "/v1/estimates") && reply.status == 201)
      jobs_.insert(json::parse(reply.body).at("id"));
    if (request.method == "DELETE" && path.starts_with("/v1/jobs/") && reply.status == 204)
      jobs_.erase(std::string(path.substr(9)));
  }
  [[nodiscard]] std::set<std::string> listed() {
    std::set<std::string> ids;
    const json answer = ask("/v1/jobs");
    for (const json& job : answer.at("jobs")) ids.insert(job.at("id"));
    return ids;
  }
  void know_jobs(ApiRequests& requests) const {
    std::vector<json> ids(jobs_.begin(), jobs_.end());
    ids.emplace_back("nobody-1");
    requests.know("id", ids);
    requests.know("before", ids);
  }

  std::string token_, url_;
  json document_;
  std::set<std::string> jobs_;           ///< that there are
  std::map<std::string, int> answered_;  ///< how often an operation did what it is for
};

TEST_F(ApiFuzz, NothingThatIsAskedBreaksTheServerOrLosesAJob) {
  TestJob small;
  small.passes = 3;
  small.photons = 1000;
  const std::string done = submit(small);
  ASSERT_TRUE(wait_until([&] { return has_ended(done); })) << show(done).dump(2);
  jobs_.insert(done);
  workers_.clear();  // known, and gone: what is submitted from now on waits

  document_ = ask("/v1/openapi.json");
  const std::uint64_t seed = setting("PF_FUZZ_SEED", 1), rounds = setting("PF_FUZZ_ROUNDS", 8);
  SCOPED_TRACE(fmt::format("PF_FUZZ_SEED={}", seed));
  ApiRequests requests(document_, seed);
  const std::string file = "a scene, as far as the coordinator knows";
  requests.know("*", {file});
  requests.know("sha256", {sha256_hex(file)});
  requests.know("bytes", {file.size()});
  for (const char* name : {"path", "file"}) requests.know(name, {"scene.glb"});
  requests.know("environment", {""});
  requests.know("spec_version", {1});
  requests.know("name", {"worker-1", "fuzz-a", "fuzz-b", "fuzz-c"});
  requests.know("layer", {"beauty"});
  requests.know("follow", {0, 1});
  requests.know("limit", {1, 1000});
  for (std::uint64_t round = 0; round < rounds; ++round) {
    for (const ApiRequests::Operation& operation : requests.operations()) {
      know_jobs(requests);
      ask_with(requests.right(operation));
      for (int i = 0; i < 3; ++i) ask_with(requests.wrong(operation));
      if (HasFatalFailure()) return;
    }
  }
  EXPECT_FALSE(coordinator_->end()) << "the same process still answers";
  EXPECT_EQ(listed(), jobs_);
  std::string never;
  for (const ApiRequests::Operation& operation : requests.operations()) {
    if (answered_[operation.method + " " + operation.path] == 0)
      never += operation.method + " " + operation.path + "\n";
  }
  EXPECT_LE(std::count(never.begin(), never.end(), '\n'), 12) << "asked rightly, and yet never answered:\n" << never;

  coordinator_->signal(SIGKILL);
  ASSERT_TRUE(coordinator_->wait(in(kPatience)));
  start_coordinator();
  EXPECT_EQ(listed(), jobs_) << "after kill -9 too";
  for (const std::string& id : jobs_) {
    if (!has_ended(id)) cancel(id);
  }
  start_worker(2);
  const std::string last = submit(small);
  ASSERT_TRUE(wait_until([&] { return has_ended(last); })) << show(last).dump(2);
  EXPECT_EQ(show(last)["image_hash"], hash_of_single_node(small)) << "and still renders";
}

}  // namespace
}  // namespace pf::farm_test
