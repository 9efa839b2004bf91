#include "coordinator/http/openapi.h"

#include <array>
#include <sstream>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "build_id.h"
#include "common/spec/job_spec.h"
#include "coordinator/job_state.h"

namespace pf {
namespace {

using nlohmann::json;

/// Fields of an object as `name:type` with blanks between. Types: string, integer, number, boolean, or a schema's name;
/// `[]` behind it: an array, `?`: or null.
struct ObjectSchema {
  std::string_view name, fields;
};
constexpr std::array kObjects{
    ObjectSchema{"Health", "status:string version:string build_id:string"},
    ObjectSchema{
        "Job",
        "id:string name:string state:JobState message:string priority:integer max_workers:integer submitted_by:string "
        "paused_by:string extended:integer expired:string[] algorithm:string width:integer height:integer "
        "passes_done:integer "
        "passes_wanted:integer stop_seconds:number stop_error:number rounds:integer estimated_error:number? "
        "seconds:number "
        "seconds_left:number? rays:integer photon_paths:integer rays_per_second:number passes_per_second:number "
        "workers:integer units_done:integer units_repeated:integer bytes_received:integer merge_seconds:number "
        "image_hash:string scene_hash:string spec_hash:string warnings:string[] submitted_unix_ms:integer "
        "started_unix_ms:integer ended_unix_ms:integer"},
    ObjectSchema{"JobList", "jobs:Job[] before:string?"},
    ObjectSchema{"Validation", "valid:boolean spec:JobModel warnings:string[]"},
    ObjectSchema{"Unit",
                 "first:integer count:integer part:integer[]? state:string attempts:integer worker:string "
                 "seconds:number result:integer "
                 "sums_hash:string"},
    ObjectSchema{"UnitPage", "units:Unit[] after:integer?"},
    ObjectSchema{"Point", "seconds:number passes:integer rounds:integer rays:integer estimated_error:number?"},
    ObjectSchema{"Convergence", "points:Point[]"},
    ObjectSchema{"Range", "low:number likely:number high:number"},
    ObjectSchema{"PilotPoint", "passes:number seconds:number estimated_error:number?"},
    ObjectSchema{
        "Estimate",
        "job:string passes:number seconds:Range? memory_bytes:Range? network_bytes:Range? estimated_error:Range? "
        "passes_to_error:Range? workers:integer pilot:PilotPoint[]"},
    ObjectSchema{"Layers", "layers:string[] channels:LayerChannels width:integer height:integer"},
    ObjectSchema{"Worker",
                 "name:string host:string process:integer state:string message:string job_id:string units_held:integer "
                 "rays:integer "
                 "sub_passes:integer seconds_since_heard:number?"},
    ObjectSchema{"WorkerList", "workers:Worker[]"},
    ObjectSchema{"LogEntry", "number:integer unix_ms:integer level:string source:string text:string"},
    ObjectSchema{"Token", "name:string role:Role created_unix_ms:integer"},
    ObjectSchema{"TokenList", "tokens:Token[]"},
    ObjectSchema{"NewToken", "name:string role:Role created_unix_ms:integer token:string"},
    ObjectSchema{"TokenWish", "name:string role:Role"},
    ObjectSchema{"File", "path:string sha256:string bytes:integer"},
    ObjectSchema{"Submission", "spec:JobModel files:File[]"},
};
/// The same of objects whose members may all be left out.
constexpr std::array kChanges{
    ObjectSchema{"Cancel", "discard:boolean"},
    ObjectSchema{"Stops", "passes:integer seconds:number error:number"},
    ObjectSchema{"Change", "priority:integer max_workers:integer"},
};

struct Parameter {
  std::string_view name, type, what;
};
constexpr std::array kParameters{
    Parameter{"state", "JobState", "only jobs in this state"},
    Parameter{"name", "string", "only jobs of this name"},
    Parameter{"limit", "integer", "the latest so many: 1 to 1000"},
    Parameter{"before", "string", "id: only jobs submitted before this one"},
    Parameter{"after", "integer", "only what comes after this one: a log entry's number, a unit's first sub-pass"},
    Parameter{"layer", "string", "as /layers names it; else beauty"},
    Parameter{"max_width", "integer", "of the pixels sent: 1 to 2048, else 960"},
    Parameter{"seconds", "number", "after which the pilot stops: 0.1 to 86400, else 10"},
    Parameter{"passes", "number", "to predict for: 1 to 1e12; else what the error needs, else the job's own"},
    Parameter{"error", "number", "estimated relative error aimed at: 1e-9 to 1e6; else the job's own"},
    Parameter{"follow", "integer", "1: go on until the job has ended"},
};

constexpr std::string_view kJson = "application/json";

struct Operation {
  std::string_view method, path, id, summary;
  std::string_view role;         ///< that a token must have; empty: none is needed
  std::string_view query = {};   ///< names of parameters, blanks between
  std::string_view body = {};    ///< schema of the JSON body, `?` behind it when it may be left out; `*`: any bytes
  std::string_view answer = {};  ///< schema of the answer; empty: bytes, or nothing at all
  int status = 200;
  std::string_view type = kJson;  ///< of the answer; empty: there is none
};
constexpr std::array kOperations{
    Operation{"GET", "/v1/health", "health", "Whether it lives, and of which build it is", "", "", "", "Health"},
    Operation{"GET", "/v1/openapi.json", "openapi", "This document", "read"},
    Operation{"POST", "/v1/jobs", "submit",
              "Submit a job whose files are uploaded already; a repetition with the same Idempotency-Key returns the "
              "first job",
              "submit", "", "Submission", "Job", 201},
    Operation{"GET", "/v1/jobs", "list", "Jobs by time of submission, the latest 1000 unless asked otherwise", "read",
              "state name limit before", "", "JobList"},
    Operation{"POST", "/v1/jobs/validate", "validate", "Check a job without submitting it; files may be left out",
              "submit", "", "Submission", "Validation"},
    Operation{"GET", "/v1/jobs/{id}", "show", "A job", "read", "", "", "Job"},
    Operation{"PATCH", "/v1/jobs/{id}", "change", "Change priority (0 to 100) or the most workers (0: no bound)",
              "submit", "", "Change", "Job"},
    Operation{"DELETE", "/v1/jobs/{id}", "delete", "Remove a job that has ended, and all that only it needs", "admin",
              "", "", "", 204, ""},
    Operation{"POST", "/v1/jobs/{id}/pause", "pause", "Stand still; units that are out are taken back", "submit", "",
              "", "Job"},
    Operation{"POST", "/v1/jobs/{id}/resume", "resume", "Go on, to the same bits", "submit", "", "", "Job"},
    Operation{"POST", "/v1/jobs/{id}/retry", "retry", "Start a failed or cancelled job again from its checkpoint",
              "submit", "", "", "Job"},
    Operation{"POST", "/v1/jobs/{id}/cancel", "cancel", "End a job; the image so far is kept unless discard is true",
              "submit", "", "Cancel?", "Job"},
    Operation{"POST", "/v1/jobs/{id}/extend", "extend",
              "New stops; a job that is done goes on, to the bits of one long run", "submit", "", "Stops", "Job"},
    Operation{"GET", "/v1/jobs/{id}/units", "units", "Who traced which sub-passes, at most 1000 at a time", "read",
              "after", "", "UnitPage"},
    Operation{"GET", "/v1/jobs/{id}/convergence", "convergence", "How far the job was when", "read", "", "",
              "Convergence"},
    Operation{"POST", "/v1/estimates", "submit-pilot",
              "Submit a job that stops after some seconds, so that its estimate can be asked for; extended, it goes on "
              "to be the job itself",
              "submit", "seconds", "Submission", "Job", 201},
    Operation{"GET", "/v1/jobs/{id}/estimate", "estimate",
              "What all of a job is going to cost on this farm, with ranges, from the sub-passes that it has done",
              "read", "passes error", "", "Estimate"},
    Operation{"GET", "/v1/jobs/{id}/events", "events", "The job at once and after every change, as events `job`",
              "read", "", "", "", 200, "text/event-stream"},
    Operation{"GET", "/v1/jobs/{id}/logs", "logs", "Log entries, a line of JSON each", "read", "after follow", "",
              "LogEntry", 200, "application/x-ndjson"},
    Operation{"GET", "/v1/jobs/{id}/image.exr", "image-exr", "The image with all layers", "read", "", "", "", 200,
              "image/x-exr"},
    Operation{"GET", "/v1/jobs/{id}/image.png", "image-png", "The image, tone-mapped", "read", "", "", "", 200,
              "image/png"},
    Operation{"GET", "/v1/jobs/{id}/figures.json", "figures", "What the rendering took", "read"},
    Operation{"GET", "/v1/jobs/{id}/checkpoint", "checkpoint", "The film's latest checkpoint", "read", "", "", "", 200,
              "application/octet-stream"},
    Operation{"GET", "/v1/jobs/{id}/preview.png", "preview", "The image so far", "read", "", "", "", 200, "image/png"},
    Operation{"GET", "/v1/jobs/{id}/layers", "layers", "The layers of the image so far", "read", "", "", "Layers"},
    Operation{"GET", "/v1/jobs/{id}/pixels", "pixels",
              "A layer for a screen: half floats, RGB, row by row, little-endian; the headers tell its size", "read",
              "layer max_width", "", "", 200, "application/octet-stream"},
    Operation{"GET", "/v1/workers", "workers", "All workers that were heard", "read", "", "", "WorkerList"},
    Operation{"POST", "/v1/workers/{name}/drain", "drain", "Let a worker finish what it has and take no more", "admin",
              "", "", "Worker"},
    Operation{"POST", "/v1/workers/{name}/disable", "disable", "The same, and what it has goes to others at once",
              "admin", "", "", "Worker"},
    Operation{"POST", "/v1/workers/{name}/enable", "enable", "Let it work again; also ends a quarantine", "admin", "",
              "", "Worker"},
    Operation{"HEAD", "/v1/blobs/{sha256}", "has-blob", "Whether a file is here", "read", "", "", "", 200, ""},
    Operation{"GET", "/v1/blobs/{sha256}", "fetch-blob", "A file of this hash", "read", "", "", "", 200,
              "application/octet-stream"},
    Operation{"PUT", "/v1/blobs/{sha256}", "upload", "Upload a file of this hash", "submit", "", "*", "", 201, ""},
    Operation{"GET", "/v1/metrics", "metrics", "Metrics for Prometheus", "read", "", "", "", 200,
              "text/plain; version=0.0.4; charset=utf-8"},
    Operation{"GET", "/v1/tokens", "tokens", "Names and roles of the tokens", "admin", "", "", "TokenList"},
    Operation{"POST", "/v1/tokens", "create-token", "Make a token; it is shown this once", "admin", "", "TokenWish",
              "NewToken", 201},
    Operation{"DELETE", "/v1/tokens/{name}", "revoke-token", "Let a token open nothing any more", "admin", "", "", "",
              204, ""},
};

json reference(std::string_view schema) { return {{"$ref", fmt::format("#/components/schemas/{}", schema)}}; }

json schema_of_type(std::string_view type) {
  if (type.ends_with('?')) {
    return {{"anyOf", {schema_of_type(type.substr(0, type.size() - 1)), {{"type", "null"}}}}};
  }
  if (type.ends_with("[]")) return {{"type", "array"}, {"items", schema_of_type(type.substr(0, type.size() - 2))}};
  if (type == "string" || type == "integer" || type == "number" || type == "boolean") return {{"type", type}};
  return reference(type);
}

json schema_of_object(std::string_view fields, bool all_required) {
  json properties = json::object(), required = json::array();
  std::istringstream words{std::string(fields)};
  for (std::string word; words >> word;) {
    const std::size_t colon = word.find(':');
    properties[word.substr(0, colon)] = schema_of_type(std::string_view(word).substr(colon + 1));
    required.push_back(word.substr(0, colon));
  }
  json schema = {{"type", "object"}, {"properties", std::move(properties)}, {"additionalProperties", false}};
  if (all_required) schema["required"] = std::move(required);
  return schema;
}

json schemas() {
  json all = json::object();
  for (const ObjectSchema& object : kObjects) all[std::string(object.name)] = schema_of_object(object.fields, true);
  for (const ObjectSchema& object : kChanges) {
    json& schema = all[std::string(object.name)] = schema_of_object(object.fields, false);
    schema["minProperties"] = 1;
  }
  all["Submission"]["required"] = {"spec", "files"};
  json states = json::array();
  for (const JobState state : all_job_states()) states.push_back(to_string(state));
  all["JobState"] = {{"type", "string"}, {"enum", std::move(states)}};
  all["Role"] = {{"type", "string"}, {"enum", {"read", "submit", "admin"}}};
  all["LayerChannels"] = {{"type", "object"}, {"additionalProperties", schema_of_type("string[]")}};
  all["JobModel"] = json::parse(job_json_schema());
  all["Problem"] = {{"type", "object"},
                    {"description", "RFC 9457"},
                    {"properties",
                     {{"type", {{"type", "string"}}},
                      {"title", {{"type", "string"}}},
                      {"status", {{"type", "integer"}}},
                      {"detail", {{"type", "string"}}},
                      {"place", {{"type", "string"}, {"description", "request:line:column in the body"}}}}},
                    {"required", {"type", "title", "status", "detail"}}};
  return all;
}

json parameters_of(const Operation& operation) {
  json parameters = json::array();
  for (std::size_t open = operation.path.find('{'); open != std::string_view::npos;
       open = operation.path.find('{', open + 1)) {
    const std::string_view name = operation.path.substr(open + 1, operation.path.find('}', open) - open - 1);
    parameters.push_back({{"name", name}, {"in", "path"}, {"required", true}, {"schema", {{"type", "string"}}}});
  }
  std::istringstream names{std::string(operation.query)};
  for (std::string name; names >> name;) {
    for (const Parameter& p : kParameters) {
      if (p.name == name)
        parameters.push_back(
            {{"name", name}, {"in", "query"}, {"description", p.what}, {"schema", schema_of_type(p.type)}});
    }
  }
  if (operation.id.starts_with("submit")) {
    parameters.push_back(
        {{"name", "Idempotency-Key"}, {"in", "header"}, {"schema", {{"type", "string"}, {"maxLength", 128}}}});
  }
  return parameters;
}

json operation_of(const Operation& operation) {
  json result = {{"operationId", operation.id}, {"summary", operation.summary}};
  if (json parameters = parameters_of(operation); !parameters.empty()) result["parameters"] = std::move(parameters);
  if (operation.body == "*") {
    result["requestBody"] = {{"required", true}, {"content", {{"application/octet-stream", json::object()}}}};
  } else if (!operation.body.empty()) {
    const bool optional = operation.body.ends_with('?');
    const std::string_view name = operation.body.substr(0, operation.body.size() - (optional ? 1 : 0));
    result["requestBody"] = {{"required", !optional},
                             {"content", {{std::string(kJson), {{"schema", reference(name)}}}}}};
  }
  json answer = {{"description", operation.type.empty() ? "Done" : "The answer"}};
  if (!operation.type.empty()) {
    json content = json::object();
    if (!operation.answer.empty()) content["schema"] = reference(operation.answer);
    answer["content"] = {{std::string(operation.type), std::move(content)}};
  }
  result["responses"] = {{std::to_string(operation.status), std::move(answer)},
                         {"default",
                          {{"description", "A problem"},
                           {"content", {{"application/problem+json", {{"schema", reference("Problem")}}}}}}}};
  if (operation.role.empty()) {
    result["security"] = json::array();
  } else {
    result["x-role"] = operation.role;
  }
  return result;
}

}  // namespace

json openapi_document() {
  json paths = json::object();
  for (const Operation& operation : kOperations) {
    std::string method(operation.method);
    for (char& c : method) c = static_cast<char>(c - 'A' + 'a');
    paths[std::string(operation.path)][method] = operation_of(operation);
  }
  return {{"openapi", "3.1.0"},
          {"info",
           {{"title", "photonfarm"},
            {"version", std::string(kVersion)},
            {"description",
             "Submit, watch, steer and fetch photon-mapped images. x-role is what a token must be allowed: read, "
             "submit or admin."}}},
          {"paths", std::move(paths)},
          {"components",
           {{"schemas", schemas()}, {"securitySchemes", {{"token", {{"type", "http"}, {"scheme", "bearer"}}}}}}},
          {"security", json::array({{{"token", json::array()}}})}};
}

}  // namespace pf
