// The client commands against a real server on loopback with a fake coordinator behind it.

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/hash.h"
#include "coordinator/http/file.h"
#include "tests/unit/jobs/service_fixture.h"

namespace pf {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::FakeJobService;

class ClientCommands : public test::ServiceFixture {
 protected:
  void SetUp() override {
    fs::create_directory(temp_ / "job");
    std::ofstream(temp_ / "job" / "glass.toml")
        << "spec_version = 1\n[job]\nname = \"glass\"\n[scene]\nfile = \"a.gltf\"\n";
    std::ofstream(temp_ / "job" / "a.gltf")
        << R"({"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 5}]})";
    std::ofstream(temp_ / "job" / "a.bin") << "12345";
    start();
  }
  [[nodiscard]] std::string job_file() const { return (temp_ / "job" / "glass.toml").string(); }
  [[nodiscard]] std::string out_folder() const { return (temp_ / "out").string(); }
  void artifacts() {
    write(Artifact::kExr, std::string(3'000'000, 'e') + "exr");
    write(Artifact::kPng, "png");
    write(Artifact::kJson, "{\"passes\": 64}\n");
  }
  void write(Artifact kind, const std::string& content) {
    const fs::path path = temp_ / ("artifact" + std::to_string(static_cast<int>(kind)));
    std::ofstream(path, std::ios::binary) << content;
    service_.artifacts[kind] = path;
  }
  void end_job(JobState state, const std::string& message = {}) {
    JobView job = FakeJobService::running("glass-1a2b");
    job.state = state;
    job.message = message;
    job.passes_done = 64;
    job.seconds = 12;
    service_.put(job);
  }
  [[nodiscard]] json output() const {
    const json document = json::parse(out_.str(), nullptr, false);
    EXPECT_FALSE(document.is_discarded()) << out_.str();
    return document;
  }
};

TEST_F(ClientCommands, SubmitUploadsEveryFileAndHandsTheSpecOver) {
  ASSERT_EQ(run({"submit", job_file(), "--set", "stop.passes=7"}), 0) << err_.str();
  EXPECT_EQ(out_.str(), "glass-1a2b\n");
  ASSERT_EQ(service_.submissions.size(), 1U);
  const Submission& submission = service_.submissions[0];
  EXPECT_EQ(submission.idempotency_key.size(), 32U);
  EXPECT_EQ(json::parse(submission.spec_json)["stop"]["passes"], 7);
  ASSERT_EQ(submission.files.size(), 2U);
  for (const auto& [path, id] : submission.files) {
    EXPECT_EQ(id.sha256, sha256_hex_of_file(temp_ / "job" / path).value());
    EXPECT_TRUE(fs::exists(temp_ / "blobs" / id.sha256.substr(0, 2) / id.sha256)) << path;
  }
}

TEST_F(ClientCommands, ASecondSubmissionHasAnotherKey) {
  ASSERT_EQ(run({"submit", job_file()}), 0) << err_.str();
  ASSERT_EQ(run({"submit", job_file(), "--json"}), 0) << err_.str();
  EXPECT_EQ(output()["name"], "glass");
  EXPECT_NE(service_.submissions.at(0).idempotency_key, service_.submissions.at(1).idempotency_key);
}

TEST_F(ClientCommands, DryRunListsFilesAndSendsNothing) {
  server_.reset();
  ASSERT_EQ(run({"submit", job_file(), "--dry-run", "--json"}), 0) << err_.str();
  EXPECT_EQ(output()["files"].size(), 2U);
  EXPECT_EQ(output()["spec"]["job"]["name"], "glass");
  ASSERT_EQ(run({"submit", job_file(), "--dry-run"}), 0);
  EXPECT_NE(out_.str().find("a.bin"), std::string::npos);
  EXPECT_TRUE(service_.submissions.empty());
}

TEST_F(ClientCommands, BadSpecsAndScenesFailBeforeAnythingIsSent) {
  EXPECT_EQ(run({"submit", job_file(), "--set", "stop.pases=7"}), 2);
  EXPECT_NE(err_.str().find("passes"), std::string::npos);
  fs::remove(temp_ / "job" / "a.bin");
  EXPECT_EQ(run({"submit", job_file()}), 3);
  EXPECT_NE(err_.str().find("a.bin"), std::string::npos);
  EXPECT_EQ(run({"submit"}), 2);
  EXPECT_TRUE(service_.submissions.empty());
}

TEST_F(ClientCommands, ErrorsOfTheServiceKeepTheirExitCodes) {
  service_.submit_error = Error{ErrorKind::kInvalidSpec, "request:1:20: too many passes; expected at most 10"};
  EXPECT_EQ(run({"submit", job_file()}), 2);
  EXPECT_NE(err_.str().find("too many passes"), std::string::npos);
  EXPECT_NE(err_.str().find(server_->url()), std::string::npos);
  service_.submit_error = Error{ErrorKind::kInvalidInput, "blobs are missing"};
  EXPECT_EQ(run({"submit", job_file()}), 3);
  service_.submit_error = Error{ErrorKind::kUnavailable, "the token 'anna' has 2 jobs that have not ended"};
  EXPECT_EQ(run({"submit", job_file()}), 2) << "at once: nobody knows when a job ends";
  EXPECT_NE(err_.str().find("2 jobs that have not ended"), std::string::npos);
  service_.submit_error = Error{ErrorKind::kInternal, "the disk is full"};
  EXPECT_EQ(run({"submit", job_file()}), 5);
}

TEST_F(ClientCommands, SubmitWaitFetchesTheThreeFilesByteForByte) {
  artifacts();
  std::thread farm([this] {
    EXPECT_TRUE(service_.wait_for_submission());
    end_job(JobState::kDone);
  });
  EXPECT_EQ(run({"submit", job_file(), "--wait", "--out", out_folder(), "--json"}), 0) << err_.str();
  farm.join();
  EXPECT_EQ(output()["job"]["state"], "done");
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.exr"), bytes_of(service_.artifacts[Artifact::kExr]));
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.png"), "png");
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.json"), "{\"passes\": 64}\n");
  EXPECT_NE(err_.str().find("done in 0:12"), std::string::npos) << err_.str();
  EXPECT_EQ(std::distance(fs::directory_iterator(temp_ / "out"), fs::directory_iterator()), 3);
}

TEST_F(ClientCommands, SubmitWaitGoesOnOverARestartOfTheServer) {
  artifacts();
  std::thread farm([this] {
    EXPECT_TRUE(service_.wait_for_submission());
    EXPECT_TRUE(service_.wait_for_watcher());
    server_.reset();
    options_.config.http.port = 0;
    std::ofstream(temp_ / "state" / "url") << "http://127.0.0.1:1\n";  // the new one listens elsewhere
    start();
    EXPECT_TRUE(service_.wait_for_watcher());
    end_job(JobState::kDone);
  });
  EXPECT_EQ(run({"submit", job_file(), "--wait", "--out", out_folder()}), 0) << err_.str();
  farm.join();
  EXPECT_EQ(service_.submissions.size(), 1U);
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.png"), "png");
  EXPECT_NE(err_.str().find("trying again"), std::string::npos) << err_.str();
}

TEST_F(ClientCommands, CancelledAndFailedJobsGiveFive) {
  for (const JobState state : {JobState::kCancelled, JobState::kFailed}) {
    service_.put(FakeJobService::running("glass-1a2b"));
    std::thread farm([this, state] {
      EXPECT_TRUE(service_.wait_for_watcher());
      end_job(state, "out of luck");
    });
    EXPECT_EQ(run({"watch", "glass-1a2b"}), 5);
    farm.join();
    EXPECT_NE(err_.str().find("out of luck"), std::string::npos);
    EXPECT_NE(err_.str().find("photonfarm logs glass-1a2b"), std::string::npos);
  }
}

TEST_F(ClientCommands, CtrlCLeavesTheJobRunningAndSaysHowToGoOn) {
  service_.put(FakeJobService::running("glass-1a2b"));
  std::thread user([this] {
    EXPECT_TRUE(service_.wait_for_watcher());
    std::raise(SIGINT);
  });
  EXPECT_EQ(run({"watch", "glass"}), 130);
  user.join();
  EXPECT_NE(err_.str().find("photonfarm watch glass-1a2b"), std::string::npos) << err_.str();
  EXPECT_EQ(service_.show("glass-1a2b")->state, JobState::kRunning);
}

TEST_F(ClientCommands, NoServiceGivesFourAndAHint) {
  const std::string url = server_->url();
  server_.reset();
  for (const Arguments& arguments : {Arguments{"list"},
                                     {"workers"},
                                     {"show", "x"},
                                     {"cancel", "x"},
                                     {"logs", "x"},
                                     {"submit", job_file(), "--retry", "0"},
                                     {"watch", "x", "--retry", "0"},
                                     {"download", "x", "--retry", "0.1"}}) {
    EXPECT_EQ(run(arguments), 4) << arguments[0];
    EXPECT_NE(err_.str().find("photonfarm farm"), std::string::npos) << err_.str();
    EXPECT_NE(err_.str().find(url), std::string::npos) << err_.str();
    EXPECT_TRUE(out_.str().empty());
  }
  fs::remove(temp_ / "state" / "url");
  EXPECT_EQ(run({"submit", job_file()}), 4) << "without a farm there is nothing to wait for";
  EXPECT_NE(err_.str().find("photonfarm farm --state " + (temp_ / "state").string()), std::string::npos) << err_.str();
}

TEST_F(ClientCommands, TheServiceIsFoundByOptionVariableOrUrl) {
  const std::string token = server_->token(), url = server_->url(), state = (temp_ / "state").string();
  EXPECT_EQ(run({"list", "--server", state}, "/nowhere"), 0) << err_.str();
  EXPECT_EQ(run({"list"}, state), 0);
  EXPECT_EQ(run({"list"}, url, token), 0) << err_.str();
  EXPECT_EQ(run({"list", "--server", url + "/"}, "", token), 0);
  EXPECT_EQ(run({"list"}, url), 2);
  EXPECT_NE(err_.str().find("PHOTONFARM_TOKEN"), std::string::npos);
  EXPECT_EQ(run({"list"}, url, "wrong"), 4);
  EXPECT_NE(err_.str().find("PHOTONFARM_TOKEN"), std::string::npos);
  EXPECT_EQ(run({"list"}, "/nowhere"), 4);
  for (const char* wrong : {"ftp://x", "http://", "http://a/b", "://", "http://a b"})
    EXPECT_EQ(run({"list"}, wrong, token), 2) << wrong;
}

TEST_F(ClientCommands, ListShowAndWorkersForPeopleAndMachines) {
  EXPECT_EQ(run({"list"}), 0);
  EXPECT_EQ(out_.str(), "no jobs\n");
  JobView job = FakeJobService::running("glass-1a2b");
  job.message = "tab\there\x1b[31m";
  job.warnings = {"a warning"};
  service_.put(job);
  EXPECT_EQ(run({"list"}), 0);
  EXPECT_NE(out_.str().find("glass-1a2b  glass  running  25 %  16/64"), std::string::npos) << out_.str();
  EXPECT_EQ(run({"list", "--state", "done", "--json"}), 0);
  EXPECT_TRUE(output()["jobs"].empty());
  EXPECT_EQ(run({"list", "--state", "gone"}), 2);
  EXPECT_EQ(run({"show", "glass"}), 0);
  EXPECT_NE(out_.str().find("a warning"), std::string::npos) << out_.str();
  EXPECT_EQ(out_.str().find('\x1b'), std::string::npos) << "text from elsewhere does not steer the terminal";
  EXPECT_EQ(run({"show", "glass", "--json"}), 0);
  EXPECT_EQ(output()["passes_done"], 16);
  EXPECT_EQ(run({"workers"}), 0);
  EXPECT_NE(out_.str().find("host-a-1"), std::string::npos);
  EXPECT_EQ(run({"workers", "--json"}), 0);
  EXPECT_EQ(output()["workers"][0]["process"], 4711);
}

TEST_F(ClientCommands, AJobIsMeantByIdNameOrPrefix) {
  JobView old_job = FakeJobService::running("abc-1"), new_job = FakeJobService::running("abd-2");
  old_job.submitted_unix_ms = 1;
  new_job.submitted_unix_ms = 2;
  service_.put(old_job);
  service_.put(new_job);
  const auto id_of = [&](const std::string& what) {
    return run({"show", what, "--json"}) == 0 ? output()["id"].get<std::string>() : "";
  };
  EXPECT_EQ(id_of("abc-1"), "abc-1");
  EXPECT_EQ(id_of("abc"), "abc-1");
  EXPECT_EQ(id_of("glass"), "abd-2") << "of several with that name the latest";
  EXPECT_EQ(run({"show", "ab"}), 2);
  EXPECT_NE(err_.str().find("2 jobs"), std::string::npos);
  EXPECT_EQ(run({"show", "glas2"}), 2);
  EXPECT_NE(err_.str().find("did you mean 'glass'?"), std::string::npos) << err_.str();
  EXPECT_EQ(run({"show", ""}), 2);
}

TEST_F(ClientCommands, CancelSaysWhatBecameOfTheJob) {
  service_.put(FakeJobService::running("glass-1a2b"));
  EXPECT_EQ(run({"cancel", "glass"}), 0) << err_.str();
  EXPECT_EQ(out_.str(), "glass-1a2b cancelled\n");
  EXPECT_EQ(run({"cancel", "glass", "--json"}), 0);
  EXPECT_EQ(output()["state"], "cancelled");
}

TEST_F(ClientCommands, LogsArePrintedAndFollowed) {
  service_.put(FakeJobService::running("glass-1a2b"));
  service_.log("first");
  EXPECT_EQ(run({"logs", "glass"}), 0) << err_.str();
  EXPECT_EQ(out_.str(), "2023-11-14 22:13:20  info     coordinator  first\n");
  std::thread farm([this] {
    EXPECT_TRUE(service_.wait_for_watcher(0));
    service_.log("second");
    end_job(JobState::kDone);
  });
  EXPECT_EQ(run({"logs", "glass", "--follow", "--json"}), 0) << err_.str();
  farm.join();
  EXPECT_EQ(output()["entries"].size(), 2U);
}

TEST_F(ClientCommands, DownloadResumesWhatAnEarlierTryLeft) {
  artifacts();
  end_job(JobState::kDone);
  const fs::path exr = service_.artifacts[Artifact::kExr];
  const std::string content = bytes_of(exr), etag = OpenFile::open(exr)->etag();
  const std::string part = fmt::format(".glass.exr.{:016x}.part", xxh3_64("glass-1a2b\n" + etag));
  fs::create_directory(temp_ / "out");
  // Other bytes than the server's show that these were not fetched again.
  std::ofstream(temp_ / "out" / part) << std::string(1'000'000, 'Z');
  ASSERT_EQ(run({"download", "glass", "--out", out_folder()}), 0) << err_.str();
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.exr"), std::string(1'000'000, 'Z') + content.substr(1'000'000));
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.png"), "png");
}

TEST_F(ClientCommands, DownloadDropsPartsOfOtherContentAndPartsThatAreTooLong) {
  artifacts();
  end_job(JobState::kDone);
  const fs::path exr = service_.artifacts[Artifact::kExr];
  const std::string etag = OpenFile::open(exr)->etag();
  fs::create_directory(temp_ / "out");
  std::ofstream(temp_ / "out" / ".glass.exr.0123456789abcdef.part") << "of another content";
  std::ofstream(temp_ / "out" / fmt::format(".glass.exr.{:016x}.part", xxh3_64("glass-1a2b\n" + etag)))
      << std::string(4'000'000, 'Z');
  ASSERT_EQ(run({"download", "glass", "--out", out_folder(), "--json"}), 0) << err_.str();
  EXPECT_EQ(output()["exr"], (temp_ / "out" / "glass.exr").string());
  EXPECT_EQ(bytes_of(temp_ / "out" / "glass.exr"), bytes_of(exr));
  EXPECT_EQ(std::distance(fs::directory_iterator(temp_ / "out"), fs::directory_iterator()), 3);
}

TEST_F(ClientCommands, DownloadWithoutAnImageYetGivesFive) {
  service_.put(FakeJobService::running("glass-1a2b"));
  EXPECT_EQ(run({"download", "glass", "--out", out_folder()}), 5);
  EXPECT_NE(err_.str().find("no image yet"), std::string::npos) << err_.str();
}

TEST_F(ClientCommands, ADownloadToAFullOrForbiddenPlaceIsNamed) {
  artifacts();
  end_job(JobState::kDone);
  EXPECT_EQ(run({"download", "glass", "--out", "/proc/photonfarm"}), 5);
  EXPECT_NE(err_.str().find("/proc/photonfarm"), std::string::npos);
}

TEST_F(ClientCommands, EveryClientCommandHasHelpWithExamples) {
  for (const char* name : {"submit", "list", "show", "watch", "logs", "cancel", "download", "workers"}) {
    EXPECT_EQ(run({name, "--help"}), 0);
    EXPECT_NE(out_.str().find(std::string("photonfarm ") + name), std::string::npos) << name;
    EXPECT_NE(out_.str().find("Example"), std::string::npos) << name;
    EXPECT_NE(out_.str().find("--json"), std::string::npos) << name;
  }
}

}  // namespace
}  // namespace pf
