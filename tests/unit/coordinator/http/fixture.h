#pragma once

#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "common/base/log.h"
#include "coordinator/http/server.h"
#include "tests/support/fake_job_service.h"
#include "tests/support/raw_http.h"
#include "tests/support/temp_folder.h"

namespace pf::test {

using HeaderList = std::vector<std::pair<std::string, std::string>>;

/// A real server on loopback in front of a fake coordinator.
class HttpTest : public testing::Test {
 protected:
  void SetUp() override {
    options_.state = temp_.path();
    options_.blobs = temp_ / "blobs";
    start();
  }
  void start() {
    server_.reset();
    auto server = HttpServer::start(options_, service_, log_);
    ASSERT_TRUE(server) << server.error().message;
    server_ = std::move(*server);
  }
  [[nodiscard]] std::string head(const std::string& method, const std::string& path, const HeaderList& headers,
                                 bool with_token = true) const {
    std::string text = method + " " + path + " HTTP/1.1\r\nHost: test\r\n";
    if (with_token) text += "Authorization: Bearer " + server_->token() + "\r\n";
    for (const auto& [name, value] : headers) text += name + ": " + value + "\r\n";
    return text + "\r\n";
  }
  [[nodiscard]] RawReply call(const std::string& method, const std::string& path, const HeaderList& headers = {},
                              const std::string& body = {}, bool with_token = true) const {
    HeaderList all = headers;
    if (method == "POST" || method == "PUT") all.emplace_back("Content-Length", std::to_string(body.size()));
    return raw(head(method, path, all, with_token) + body);
  }
  [[nodiscard]] RawReply get(const std::string& path, const HeaderList& headers = {}) const {
    return call("GET", path, headers);
  }
  [[nodiscard]] RawReply post(const std::string& path, const std::string& body) const {
    return call("POST", path, {{"Content-Type", "application/json"}}, body);
  }
  [[nodiscard]] RawReply raw(const std::string& bytes) const {
    RawConnection connection(server_->url());
    connection.send(bytes);
    return parse_reply(connection.receive());
  }
  /// The member of a problem document; fails the test when the reply is none.
  [[nodiscard]] static std::string problem(const RawReply& reply, const std::string& member = "detail") {
    EXPECT_EQ(reply.headers.at("content-type"), "application/problem+json");
    const auto json = nlohmann::json::parse(reply.body, nullptr, false);
    EXPECT_TRUE(json.is_object()) << reply.body;
    EXPECT_EQ(json.value("status", 0), reply.status);
    EXPECT_TRUE(json.value("type", "").starts_with("urn:photonfarm:problem:")) << reply.body;
    return json.value(member, "");
  }
  void file(Artifact kind, const std::string& content) {
    const auto path = temp_ / ("artifact" + std::to_string(static_cast<int>(kind)));
    std::ofstream(path, std::ios::binary) << content;
    service_.artifacts[kind] = path;
  }

  TempFolder temp_;
  Log log_{LogLevel::kOff};
  FakeJobService service_;
  HttpServerOptions options_;
  std::unique_ptr<HttpServer> server_;
};

}  // namespace pf::test
