#include "coordinator/config.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "tests/support/temp_folder.h"

namespace pf::test {
namespace {

class CoordinatorConfiguration : public testing::Test {
 protected:
  [[nodiscard]] Result<CoordinatorConfig> load(const std::string& text) const {
    std::ofstream(temp_ / "config.toml") << text;
    return load_coordinator_config(temp_ / "config.toml");
  }
  /// What is said about it; empty: nothing.
  [[nodiscard]] std::string error(const std::string& text) const {
    const auto config = load(text);
    if (config) return {};
    EXPECT_EQ(exit_code(config.error().kind), 2);
    return config.error().message;
  }
  TempFolder temp_;
};

TEST_F(CoordinatorConfiguration, EveryKeyIsTaken) {
  const auto config = load(
      "[http]\nhost = \"0.0.0.0\"\nport = 8443\ncertificate = \"server.pem\"\nkey = \"/etc/key.pem\"\nca = "
      "\"ca.pem\"\n"
      "[limits]\nrequests_per_second = 2.5\nrequest_burst = 7\njobs_per_token = 3\njob_bytes = 1000\npixels "
      "= 100\n"
      "[notify]\nurl = \"https://example.org/hook\"\nsecret_file = \"secret\"\nca = \"/etc/ca.pem\"\n");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->http.host, "0.0.0.0");
  EXPECT_EQ(config->http.port, 8443);
  EXPECT_EQ(config->http.certificate, temp_ / "server.pem") << "beside the file";
  EXPECT_EQ(config->http.key, "/etc/key.pem");
  EXPECT_EQ(config->limits.requests_per_second, 2.5);
  EXPECT_EQ(config->limits.jobs_per_token, 3U);
  EXPECT_EQ(config->limits.pixels, 100U);
  EXPECT_EQ(config->notify.url, "https://example.org/hook");
  EXPECT_EQ(config->notify.secret_file, temp_ / "secret");
  EXPECT_TRUE(load(""));
}

TEST_F(CoordinatorConfiguration, EveryErrorNamesItsPlace) {
  EXPECT_NE(
      error("[http]\nhosts = \"a\"\n").find("config.toml:2:1: unknown key 'http.hosts'; did you mean 'http.host'?"),
      std::string::npos)
      << error("[http]\nhosts = \"a\"\n");
  EXPECT_NE(error("[limits]\npixels = \"many\"\n").find("limits.pixels is the string \"many\"; expected an integer"),
            std::string::npos);
  EXPECT_NE(error("[limits]\npixels = 1.5\n").find("an integer"), std::string::npos);
  EXPECT_NE(error("[limits]\nrequests_per_second = 0\n").find("a number from"), std::string::npos);
  EXPECT_NE(error("[limits]\nrequests_per_second = nan\n").find("a number from"), std::string::npos);
  EXPECT_NE(error("host = \"a\"\n").find("stands in no table"), std::string::npos);
  EXPECT_NE(error("[http\n").find("config.toml:1:"), std::string::npos);
  EXPECT_NE(error("[http]\ncertificate = \"a\"\n").find("belong together"), std::string::npos);
  EXPECT_NE(error("[notify]\nurl = \"https://a\"\n").find("secret_file"), std::string::npos);
  EXPECT_NE(error("[notify]\nurl = \"file:///etc/passwd\"\nsecret_file = \"a\"\n").find("expected http"),
            std::string::npos);
}

}  // namespace
}  // namespace pf::test
