#include "coordinator/http/openapi.h"

#include <cctype>
#include <functional>
#include <set>
#include <string>

#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"
#include "tests/support/json_schema.h"
#include "tests/unit/coordinator/http/fixture.h"

namespace pf::test {
namespace {

using nlohmann::json;

const json& document() {
  static const json kDocument = openapi_document();
  return kDocument;
}

/// `{id}` and the like become `{}`.
std::string without_names(std::string path) {
  for (std::size_t open = path.find('{'); open != std::string::npos; open = path.find('{', open + 1)) {
    path.erase(open + 1, path.find('}', open) - open - 1);
  }
  return path;
}

TEST(OpenApi, HasEveryRouteAndNoOther) {
  std::set<std::string> documented, served;
  for (const auto& [path, methods] : document().at("paths").items()) {
    for (const auto& [method, operation] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      documented.insert(upper + " " + without_names(path));
    }
  }
  for (const auto& [method, pattern] : HttpRoutes::addresses()) served.insert(method + " " + pattern);
  EXPECT_EQ(documented, served);
}

TEST(OpenApi, EveryReferenceLeadsSomewhereAndEveryIdIsOneOperations) {
  std::set<std::string> ids;
  const std::function<void(const json&)> walk = [&](const json& value) {
    if (value.is_object() && value.contains("$ref") && value.at("$ref").is_string()) {
      const std::string to = value.at("$ref").get<std::string>();
      if (to.starts_with("#/components/")) {
        EXPECT_TRUE(document().contains(json::json_pointer(to.substr(1)))) << to;
      }
    }
    if (value.is_object() && value.contains("operationId")) {
      EXPECT_TRUE(ids.insert(value.at("operationId").get<std::string>()).second) << value.at("operationId");
    }
    if (value.is_structured()) {
      for (const auto& [key, member] : value.items()) walk(member);
    }
  };
  walk(document());
  EXPECT_GT(ids.size(), 20U);
}

TEST(OpenApi, NamesTheRoleThatEachOperationNeeds) {
  for (const auto& [path, methods] : document().at("paths").items()) {
    for (const auto& [method, operation] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      const auto needed = needed_role(upper, path);
      EXPECT_EQ(operation.value("x-role", ""), needed ? to_string(*needed) : "") << method << " " << path;
      EXPECT_EQ(operation.contains("security"), !needed) << method << " " << path;
    }
  }
}

class OpenApiAnswers : public HttpTest {
 protected:
  void expect_fits(const std::string& method, const std::string& path, const std::string& documented,
                   const std::string& body = {}) {
    HeaderList headers;
    if (!body.empty()) headers = {{"Content-Type", "application/json"}};
    if (method == "PATCH") headers.emplace_back("Content-Length", std::to_string(body.size()));
    const RawReply reply = call(method, path, headers, body);
    std::string lower = method;
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const json& responses = document().at("paths").at(documented).at(lower).at("responses");
    const std::string status = std::to_string(reply.status);
    const json& response = responses.contains(status) ? responses.at(status) : responses.at("default");
    ASSERT_TRUE(response.contains("content")) << method << " " << path << " " << status;
    const std::string type = reply.headers.at("content-type");
    ASSERT_TRUE(response.at("content").contains(type)) << method << " " << path << ": " << type;
    const json value = json::parse(reply.body, nullptr, false);
    ASSERT_FALSE(value.is_discarded()) << reply.body;
    if (!response.at("content").at(type).contains("schema")) return;
    EXPECT_EQ(misfit(document(), value, response.at("content").at(type).at("schema"), "answer"), "")
        << method << " " << path;
  }
};

TEST_F(OpenApiAnswers, FitTheirSchemas) {
  JobView job = FakeJobService::running("glass-1");
  job.warnings = {"w"};
  job.estimated_error = 0.5;
  service_.put(job);
  service_.put(FakeJobService::running("glass-2"));
  service_.all_units = {{0, 4, {0, 0, 16, 16}, "done", 2, "host-a-1", 1.5, 1, "aa"},
                        {4, 2, {}, "out", 1, "", 0, 0, ""}};
  service_.points = {{0.5, 2, 1, 1000, std::nullopt}, {1.0, 4, 2, 2000, 0.25}};
  expect_fits("GET", "/v1/health", "/v1/health");
  expect_fits("GET", "/v1/openapi.json", "/v1/openapi.json");
  expect_fits("GET", "/v1/jobs", "/v1/jobs");
  expect_fits("GET", "/v1/jobs?state=no", "/v1/jobs");
  expect_fits("POST", "/v1/jobs", "/v1/jobs",
              R"({"spec": {"job": {"name": "glass"}, "scene": {"file": "a.glb"}}, "files": []})");
  expect_fits("POST", "/v1/jobs", "/v1/jobs", "{}");
  expect_fits("GET", "/v1/jobs/glass-1", "/v1/jobs/{id}");
  expect_fits("GET", "/v1/jobs/glass-9", "/v1/jobs/{id}");
  expect_fits("PATCH", "/v1/jobs/glass-1", "/v1/jobs/{id}", R"({"priority": 3})");
  expect_fits("DELETE", "/v1/jobs/glass-1", "/v1/jobs/{id}");
  for (const char* verb : {"pause", "resume", "retry", "cancel"}) {
    expect_fits("POST", std::string("/v1/jobs/glass-1/") + verb, std::string("/v1/jobs/{id}/") + verb);
  }
  expect_fits("POST", "/v1/jobs/glass-2/extend", "/v1/jobs/{id}/extend", R"({"passes": 99})");
  expect_fits("GET", "/v1/jobs/glass-1/units", "/v1/jobs/{id}/units");
  expect_fits("GET", "/v1/jobs/glass-1/convergence", "/v1/jobs/{id}/convergence");
  expect_fits("POST", "/v1/estimates", "/v1/estimates",
              R"({"spec": {"job": {"name": "glass"}, "scene": {"file": "a.glb"}}, "files": []})");
  expect_fits("GET", "/v1/jobs/glass-1/estimate", "/v1/jobs/{id}/estimate");
  service_.pilot = {.points = {{1, 0.5, 0.4}, {2, 0.5, 0.3}}};
  expect_fits("GET", "/v1/jobs/glass-1/estimate?passes=100", "/v1/jobs/{id}/estimate");
  expect_fits("GET", "/v1/jobs/glass-1/image.exr", "/v1/jobs/{id}/image.exr");
  expect_fits("GET", "/v1/workers", "/v1/workers");
  expect_fits("POST", "/v1/tokens", "/v1/tokens", R"({"name": "ada", "role": "read"})");
  expect_fits("GET", "/v1/tokens", "/v1/tokens");
  for (const char* verb : {"drain", "disable", "enable"}) {
    expect_fits("POST", std::string("/v1/workers/host-a-1/") + verb, std::string("/v1/workers/{name}/") + verb);
  }
}

TEST(OpenApi, AWrongAnswerWouldBeFound) {
  json job = to_json(FakeJobService::running("glass-1"));
  const json schema = {{"$ref", "#/components/schemas/Job"}};
  EXPECT_EQ(misfit(document(), job, schema, "job"), "");
  job["more"] = 1;
  EXPECT_NE(misfit(document(), job, schema, "job"), "");
  job.erase("more");
  job["state"] = "asleep";
  EXPECT_NE(misfit(document(), job, schema, "job"), "");
  job["state"] = "done";
  job.erase("rays");
  EXPECT_NE(misfit(document(), job, schema, "job"), "");
}

}  // namespace
}  // namespace pf::test
