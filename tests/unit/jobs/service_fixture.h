#pragma once

#include <filesystem>
#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "common/base/log.h"
#include "coordinator/http/server.h"
#include "jobs/command.h"
#include "tests/support/fake_job_service.h"
#include "tests/support/temp_folder.h"

namespace pf::test {

/// Client commands against a real server on loopback with a fake coordinator behind it. `options_` may be changed
/// before start().
class ServiceFixture : public testing::Test {
 protected:
  ServiceFixture() {
    options_.state = temp_ / "state";
    options_.blobs = temp_ / "blobs";
    std::filesystem::create_directory(options_.state);
  }
  void start() {
    server_.reset();
    auto server = HttpServer::start(options_, service_, log_);
    ASSERT_TRUE(server) << server.error().message;
    server_ = std::move(*server);
  }
  int run(const Arguments& arguments, const std::string& server = {}, const std::string& token = {}) {
    out_.str("");
    err_.str("");
    const Context context{temp_.path(), "/usr/bin:/bin", temp_ / "state", temp_.path(), out_, err_, server, token};
    return run_photonfarm(context, arguments);
  }

  TempFolder temp_;
  Log log_{LogLevel::kOff};
  FakeJobService service_;
  HttpServerOptions options_;
  std::unique_ptr<HttpServer> server_;
  std::ostringstream out_, err_;
};

}  // namespace pf::test
