// Client commands over TLS, and with tokens of less than every right.

#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "jobs/farm_certificates.h"
#include "tests/support/raw_http.h"
#include "tests/unit/jobs/service_fixture.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class SecureService : public test::ServiceFixture {
 protected:
  void SetUp() override {
    const auto made = make_certificates({"127.0.0.1"});
    ASSERT_TRUE(made);
    const auto write = [&](const char* name, const std::string& text) {
      ASSERT_TRUE(write_file_atomically(temp_ / name, text, FileAccess::kOwnerOnly));
    };
    write("ca.pem", made->ca);
    write("server.pem", made->server);
    write("server-key.pem", made->server_key);
    options_.config.http.certificate = temp_ / "server.pem";
    options_.config.http.key = temp_ / "server-key.pem";
    options_.config.http.ca = temp_ / "ca.pem";
    service_.put(test::FakeJobService::running("glass-1"));
  }
};

TEST_F(SecureService, CommandsFindCertificateAndTokenInTheStateFolder) {
  start();
  EXPECT_TRUE(server_->url().starts_with("https://127.0.0.1:"));
  ASSERT_EQ(run({"list"}), 0) << err_.str();
  EXPECT_NE(out_.str().find("glass-1"), std::string::npos);
  ASSERT_EQ(run({"list", "--ca", (temp_ / "ca.pem").string()}, server_->url(), server_->token()), 0) << err_.str();
}

TEST_F(SecureService, AServiceThatNobodyVouchesForIsNotSpokenTo) {
  start();
  EXPECT_EQ(run({"list", "--retry", "0"}, server_->url(), server_->token()), 4);
  EXPECT_NE(err_.str().find("not trusted"), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("--ca"), std::string::npos);
  const auto other = make_certificates({});
  ASSERT_TRUE(other && write_file_atomically(temp_ / "other.pem", other->ca));
  EXPECT_EQ(run({"list", "--retry", "0", "--ca", (temp_ / "other.pem").string()}), 4);
  EXPECT_EQ(run({"list", "--ca", (temp_ / "absent.pem").string()}), 2);
  const std::string plain = "http" + server_->url().substr(5);
  EXPECT_EQ(run({"list", "--retry", "0"}, plain, server_->token()), 4);
}

TEST_F(SecureService, ASilentHandshakeIsCutOff) {
  options_.limits.head_seconds = 0.1;
  start();
  const test::RawConnection connection(server_->url());
  EXPECT_EQ(const_cast<test::RawConnection&>(connection).receive(), "") << "closed without a word";
  EXPECT_EQ(run({"list"}), 0) << err_.str();
}

TEST_F(SecureService, ALargeFileComesWhole) {
  std::ofstream(temp_ / "image", std::ios::binary) << std::string(5'000'000, 'x') + "end";
  for (const Artifact kind : {Artifact::kExr, Artifact::kPng, Artifact::kJson})
    service_.artifacts[kind] = temp_ / "image";
  start();
  ASSERT_EQ(run({"download", "glass-1", "--out", (temp_ / "out").string()}), 0) << err_.str();
  EXPECT_EQ(fs::file_size(temp_ / "out" / "glass.exr"), 5'000'003U);
}

TEST_F(SecureService, OthersReachItOnlyThen) {
  options_.config.http.host = "0.0.0.0";
  start();
  EXPECT_EQ(run({"list"}), 0) << err_.str();
  EXPECT_TRUE(fs::exists(temp_ / "state" / "ca.pem"));
  options_.config.http = {};
  start();
  EXPECT_FALSE(fs::exists(temp_ / "state" / "ca.pem"));
  EXPECT_EQ(run({"list"}), 0) << err_.str();
}

TEST_F(SecureService, AKeyThatOthersReadOrThatDoesNotFitIsRefused) {
  fs::permissions(temp_ / "server-key.pem", fs::perms(0644));
  const auto read_by_all = HttpServer::start(options_, service_, log_);
  ASSERT_FALSE(read_by_all);
  EXPECT_NE(read_by_all.error().message.find("chmod 600"), std::string::npos);
  const auto other = make_certificates({});
  ASSERT_TRUE(other && write_file_atomically(temp_ / "server-key.pem", other->server_key, FileAccess::kOwnerOnly));
  const auto unfit = HttpServer::start(options_, service_, log_);
  ASSERT_FALSE(unfit);
  EXPECT_EQ(exit_code(unfit.error().kind), 2);
  EXPECT_NE(unfit.error().message.find("private key"), std::string::npos) << unfit.error().message;
}

TEST_F(SecureService, TokensAreMadeListedAndRevoked) {
  start();
  ASSERT_EQ(run({"token", "create", "anna", "--role", "read"}), 0) << err_.str();
  std::string token = out_.str();
  ASSERT_TRUE(token.ends_with('\n') && token.starts_with("pf_"));
  token.pop_back();
  const auto as_anna = [&](Arguments arguments) {
    arguments.insert(arguments.end(), {"--ca", (temp_ / "ca.pem").string()});
    return run(arguments, server_->url(), token);
  };
  EXPECT_EQ(as_anna({"list"}), 0) << err_.str();
  EXPECT_EQ(as_anna({"cancel", "glass-1"}), 2);
  EXPECT_NE(err_.str().find("has the role read; this needs submit"), std::string::npos) << err_.str();
  ASSERT_EQ(run({"token", "list", "--json"}), 0);
  EXPECT_EQ(nlohmann::json::parse(out_.str())["tokens"].size(), 2U);
  ASSERT_EQ(run({"token", "revoke", "anna"}), 0) << err_.str();
  EXPECT_EQ(as_anna({"list"}), 4);
  EXPECT_EQ(run({"token", "revoke", "anna"}), 2);
  EXPECT_EQ(run({"token", "revoke", "../jobs"}), 2);
  EXPECT_EQ(run({"token"}), 2);
  EXPECT_EQ(run({"token", "create", "--help"}), 0);
  EXPECT_NE(out_.str().find("Example"), std::string::npos);
}

}  // namespace
}  // namespace pf
