// What steers jobs and workers, against a stub of the service: each verb's request and what it makes of the
// reply.

#include <cstdlib>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "jobs/command.h"
#include "jobs/process.h"
#include "tests/support/stub_http.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

using nlohmann::json;
using test::StubReply;
using test::StubRequest;
using test::StubServer;

class SteerCommands : public testing::Test {
 protected:
  StubReply answer(const StubRequest& request) {
    if (request.path == "/v1/jobs")
      return {200, json{{"jobs",
                         {{{"id", "glass-1"}, {"name", "glass"}, {"state", "done"}},
                          {{"id", "glass-2"}, {"name", "glass"}, {"state", "running"}, {"submitted_unix_ms", 5}},
                          {{"id", "pool-3"}, {"name", "pool"}, {"state", "failed"}}}}}
                       .dump()};
    if (request.method == "DELETE") return {204, ""};
    if (request.path == "/v1/jobs/glass-2/units") return {200, page({{0, "aa"}, {4, "bb"}})};
    if (request.path == "/v1/jobs/glass-2/units?after=4") return {200, page({{8, "cc"}})};
    if (request.path.find("/units?after=8") != std::string::npos) return {200, R"({"units": []})"};
    if (request.path == "/v1/jobs/validate") return {200, R"({"valid": true, "spec": {}, "warnings": ["odd"]})"};
    if (request.path.starts_with("/v1/workers/")) return {200, json{{"name", "w"}, {"state", "draining"}}.dump()};
    if (request.path == "/v1/jobs/pool-3/resume")
      return {
          409,
          R"({"type": "urn:photonfarm:problem:conflict", "status": 409, "detail": "pool-3 is failed, not paused"})"};
    return {200, json{{"id", "glass-2"}, {"state", "paused"}}.dump()};
  }
  static std::string page(const std::vector<std::pair<int, std::string>>& units) {
    json list = json::array();
    for (const auto& [first, hash] : units)
      list.push_back({{"first", first},
                      {"count", 4},
                      {"part", 0},
                      {"state", "done"},
                      {"attempts", 1},
                      {"worker", "w-1"},
                      {"seconds", 1.5},
                      {"sums_hash", hash}});
    return json{{"units", list}}.dump();
  }
  int run(const Arguments& arguments) {
    out_.str("");
    err_.str("");
    const Context context{temp_.path(), "/usr/bin:/bin", temp_ / "state", temp_.path(), out_,
                          err_,         server_.url(),   "token"};
    return run_photonfarm(context, arguments);
  }
  /// METHOD PATH BODY of the last request.
  [[nodiscard]] std::string last() const {
    const StubRequest request = server_.requests().back();
    return request.method + " " + request.path + " " + request.body;
  }

  TempFolder temp_;
  StubServer server_{[this](const StubRequest& request) { return answer(request); }};
  std::ostringstream out_, err_;
};

TEST_F(SteerCommands, EachVerbAsksForWhatItSays) {
  const std::pair<Arguments, const char*> cases[] = {
      {{"pause", "glass"}, "POST /v1/jobs/glass-2/pause "},
      {{"resume", "glass-2"}, "POST /v1/jobs/glass-2/resume "},
      {{"retry", "pool"}, "POST /v1/jobs/pool-3/retry "},
      {{"cancel", "glass-2"}, "POST /v1/jobs/glass-2/cancel "},
      {{"cancel", "glass-2", "--discard"}, "POST /v1/jobs/glass-2/cancel {\"discard\": true}"},
      {{"extend", "glass-1", "--passes", "1024"}, "POST /v1/jobs/glass-1/extend {\"passes\":1024}"},
      {{"extend", "glass-1", "--error", "0.5", "--seconds", "60"},
       "POST /v1/jobs/glass-1/extend {\"error\":0.5,\"seconds\":60.0}"},
      {{"set", "glass-2", "--priority", "80", "--max-workers", "0"},
       "PATCH /v1/jobs/glass-2 {\"max_workers\":0,\"priority\":80}"},
      {{"remove", "glass-1"}, "DELETE /v1/jobs/glass-1 "},
      {{"workers", "drain", "w-1"}, "POST /v1/workers/w-1/drain "},
      {{"workers", "disable", "w-1", "W_2"}, "POST /v1/workers/W_2/disable "},
      {{"workers", "enable", "w-1", "--json"}, "POST /v1/workers/w-1/enable "}};
  for (const auto& [arguments, request] : cases) {
    EXPECT_EQ(run(arguments), 0) << err_.str();
    EXPECT_EQ(last(), request);
    Arguments with_json = arguments;
    with_json.emplace_back("--json");
    if (arguments.back() != "--json") {
      EXPECT_EQ(run(with_json), 0) << err_.str();
      EXPECT_TRUE(json::accept(out_.str())) << out_.str();
    }
  }
}

TEST_F(SteerCommands, WhatCannotBeDoneIsSaidWithTheRightCode) {
  EXPECT_EQ(run({"resume", "pool-3"}), 5);
  EXPECT_NE(err_.str().find("is failed, not paused"), std::string::npos) << err_.str();
  EXPECT_EQ(run({"extend", "glass-1"}), 2);
  EXPECT_EQ(run({"set", "glass-1"}), 2);
  EXPECT_EQ(run({"set", "glass-1", "--priority", "101"}), 2);
  EXPECT_EQ(run({"pause"}), 2);
  EXPECT_EQ(run({"pause", "nobody"}), 2);
  EXPECT_EQ(run({"workers", "drain"}), 2);
  EXPECT_EQ(run({"workers", "drain", "../jobs"}), 2);
  EXPECT_EQ(run({"workers", "dance"}), 2);
}

TEST_F(SteerCommands, UnitsComePageByPage) {
  ASSERT_EQ(run({"units", "glass-2", "--json"}), 0) << err_.str();
  const json units = json::parse(out_.str())["units"];
  ASSERT_EQ(units.size(), 3U);
  EXPECT_EQ(units[2]["sums_hash"], "cc");
  ASSERT_EQ(run({"units", "glass-2"}), 0);
  EXPECT_NE(out_.str().find("FIRST"), std::string::npos);
}

TEST_F(SteerCommands, ListsAreFiltered) {
  const auto ids = [&](const Arguments& arguments) {
    EXPECT_EQ(run(arguments), 0) << err_.str();
    std::string text;
    const json answer = json::parse(out_.str());
    for (const json& job : answer["jobs"]) text += job["id"].get<std::string>() + " ";
    return text;
  };
  EXPECT_EQ(ids({"list", "--json"}), "glass-1 glass-2 pool-3 ");
  EXPECT_EQ(ids({"list", "--json", "--active"}), "glass-2 ");
  EXPECT_EQ(ids({"list", "--json", "--name", "glass"}), "glass-1 glass-2 ");
  EXPECT_EQ(ids({"list", "--json", "--last", "2"}), "glass-2 pool-3 ");
}

TEST_F(SteerCommands, AJobFileIsCheckedHereAndThere) {
  std::ofstream(temp_ / "glass.toml") << "spec_version = 1\n[job]\nname = \"glass\"\n[scene]\nfile = \"a.gltf\"\n";
  std::ofstream(temp_ / "a.gltf") << R"({"asset": {"version": "2.0"}})";
  ASSERT_EQ(run({"validate", (temp_ / "glass.toml").string()}), 0) << err_.str();
  EXPECT_NE(out_.str().find("valid"), std::string::npos);
  EXPECT_NE(err_.str().find("warning: odd"), std::string::npos);
  const json body = json::parse(server_.requests().back().body);
  EXPECT_EQ(body["spec"]["job"]["name"], "glass");
  EXPECT_EQ(body["files"].size(), 1U);
  EXPECT_EQ(run({"validate", (temp_ / "glass.toml").string(), "--set", "stop.pases=1"}), 2);
}

TEST_F(SteerCommands, EveryCommandHasExamplesInItsHelp) {
  for (const Command& command : commands()) {
    if (command.name == "render" || command.name == "plan") continue;  // the worker's
    EXPECT_EQ(run({std::string(command.name), "--help"}), 0) << command.name;
    EXPECT_NE(out_.str().find("Example"), std::string::npos) << command.name;
    EXPECT_NE(out_.str().find(std::string("photonfarm ") + std::string(command.name)), std::string::npos)
        << command.name;
  }
}

/// What bash would offer for the last of these words.
std::string offered(const std::filesystem::path& script, const std::vector<std::string>& words) {
  std::string quoted;
  for (const std::string& word : words) quoted += "'" + word + "' ";
  const auto run = run_and_capture(
      "/bin/bash",
      {"-c", "source '" + script.string() + "'; COMP_WORDS=(photonfarm " + quoted +
                 "); COMP_CWORD=" + std::to_string(words.size()) + "; _photonfarm; echo \"${COMPREPLY[*]}\""},
      20);
  return run && run->end.exit_code == 0 ? run->output : "failed";
}

TEST_F(SteerCommands, BashCompletesWhatTheParsersTake) {
  ASSERT_EQ(run({"completion", "bash"}), 0) << err_.str();
  std::ofstream(temp_ / "script") << out_.str();
  EXPECT_EQ(offered(temp_ / "script", {"submi"}), "submit\n");
  EXPECT_EQ(offered(temp_ / "script", {"submit", "--dry"}), "--dry-run\n");
  EXPECT_EQ(offered(temp_ / "script", {"list", "--state", "pr"}), "preparing\n");
  EXPECT_EQ(offered(temp_ / "script", {"workers", "dr"}), "drain\n");
  EXPECT_EQ(offered(temp_ / "script", {"token", "create", "--ro"}), "--role\n");
  EXPECT_EQ(offered(temp_ / "script", {"token", "create", "--role", "ad"}), "admin\n");
  EXPECT_EQ(offered(temp_ / "script", {"farm", "init", "--ho"}), "--hosts\n");
  EXPECT_EQ(offered(temp_ / "script", {"extend", "--pa"}), "--passes\n");
}

TEST_F(SteerCommands, EveryShellGetsEveryCommand) {
  for (const char* shell : {"bash", "zsh", "fish"}) {
    ASSERT_EQ(run({"completion", shell}), 0) << err_.str();
    for (const Command& command : commands())
      EXPECT_NE(out_.str().find(command.name), std::string::npos) << shell << command.name;
    EXPECT_NE(out_.str().find(std::string(shell) == "fish" ? "-l discard" : "--discard"), std::string::npos) << shell;
  }
  EXPECT_EQ(run({"completion", "tcsh"}), 2);
}

}  // namespace
}  // namespace pf
