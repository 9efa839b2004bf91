#include "tests/farm/api_requests.h"

#include <algorithm>
#include <cctype>
#include <functional>

#include <fmt/format.h>

#include "tests/support/json_schema.h"

namespace pf::farm_test {

using nlohmann::json;

namespace {

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_' || c == '.') {
      out += c;
    } else {
      out += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
  }
  return out;
}

/// All values within a document, itself included.
void collect(json& value, std::vector<json*>& all) {
  all.push_back(&value);
  if (!value.is_structured()) return;
  for (auto& member : value) collect(member, all);
}

}  // namespace

std::string ApiRequest::text() const {
  std::string text = method + " " + target + " HTTP/1.1\r\nHost: test\r\n";
  for (const auto& [name, value] : headers) text += name + ": " + value + "\r\n";
  return text + "\r\n" + body;
}

ApiRequests::ApiRequests(json document, std::uint64_t seed) : document_(std::move(document)), random_(seed) {
  for (const auto& [path, methods] : document_.at("paths").items()) {
    for (const auto& [method, description] : methods.items()) operations_.push_back({upper(method), path, description});
  }
}

json ApiRequests::value_of(const json& given, const std::string& name) {
  if (const auto known = known_.find(name); known != known_.end()) return one_of(known->second);
  const json& schema = test::resolve(document_, given);
  if (schema.contains("enum")) return schema.at("enum").at(below(schema.at("enum").size()));
  const std::string type = schema.value("type", "");
  if (type.empty() && schema.contains("anyOf"))
    return value_of(schema.at("anyOf").at(below(schema.at("anyOf").size())), name);
  if (type == "object") return object_of(schema);
  if (type == "array") {
    json items = json::array();
    if (schema.contains("anyOf")) return items;  // numbers of a fixed count, or none
    for (std::uint64_t i = 1 + below(2); i > 0; --i) items.push_back(value_of(schema.at("items"), ""));
    return items;
  }
  if (type == "boolean") return chance(0.5);
  if (type == "integer" || type == "number") {
    const double low = schema.value("minimum", schema.value("exclusiveMinimum", 0.0)),
                 high = schema.value("maximum", 1000.0);
    const double value = low + (std::min(high, low + 1000.0) - low) * static_cast<double>(1 + below(1000)) / 1000.0;
    return type == "integer" ? json(static_cast<std::int64_t>(value)) : json(value);
  }
  return type == "null" ? json() : json("fuzz");
}

json ApiRequests::object_of(const json& schema) {
  json object = json::object();
  const json required = schema.value("required", json::array());
  const json properties = schema.value("properties", json::object());
  for (const auto& [name, member] : properties.items()) {
    const bool needed = std::find(required.begin(), required.end(), name) != required.end();
    if (needed || chance(0.3)) object[name] = value_of(member, name);
  }
  // One at least, where the document asks for it.
  if (object.empty() && !properties.empty())
    object[properties.begin().key()] = value_of(properties.begin().value(), properties.begin().key());
  return object;
}

std::string ApiRequests::text_of(const json& value) const {
  return value.is_string() ? value.get<std::string>() : value.dump();
}

ApiRequest ApiRequests::right(const Operation& operation) {
  ApiRequest request;
  request.method = operation.method;
  request.documented = operation.path;
  request.target = operation.path;
  std::string query;
  for (const json& parameter : operation.description.value("parameters", json::array())) {
    const std::string name = parameter.at("name"), in = parameter.at("in");
    if (in != "path" && !chance(0.5)) continue;
    const std::string value = text_of(value_of(parameter.at("schema"), name));
    if (in == "path") request.target.replace(request.target.find("{" + name + "}"), name.size() + 2, escaped(value));
    if (in == "query") query += (query.empty() ? "?" : "&") + name + "=" + escaped(value);
    if (in == "header") request.headers.emplace_back(name, fmt::format("key-{}", below(1000)));
  }
  request.target += query;
  const json body = operation.description.value("requestBody", json());
  if (body.is_object() && (body.value("required", false) || chance(0.5))) {
    const json& content = body.at("content");
    const std::string type = content.begin().key();
    request.headers.emplace_back("Content-Type", type);
    request.body = type == "application/json" ? value_of(content.begin().value().at("schema"), "").dump()
                                              : text_of(one_of(known_.at("*")));
  }
  if (operation.method != "GET" && operation.method != "HEAD")
    request.headers.emplace_back("Content-Length", std::to_string(request.body.size()));
  return request;
}

std::string ApiRequests::bad_segment() {
  static const std::vector<std::string> kBad = {"..",
                                                ".",
                                                "%2e%2e",
                                                "..%2f..%2ftoken",
                                                "..%5c..%5ctoken",
                                                "%252e%252e%252ftoken",
                                                "%00",
                                                "token%00.png",
                                                "%",
                                                "%zz",
                                                "%ff%fe",
                                                "%c3%28",
                                                "%f0%9f%94%a5",
                                                "'%3b%20DROP%20TABLE%20jobs%3b--",
                                                "%25s%25n",
                                                "%20",
                                                "",
                                                "-",
                                                "*",
                                                "~root",
                                                "99999999999999999999",
                                                "NaN",
                                                "\xc3\xbc",
                                                "a%0d%0aSet-Cookie:x=1",
                                                "%2f",
                                                "a?b",
                                                "a;b",
                                                "a&b",
                                                "{id}",
                                                "con",
                                                "jobs"};
  switch (below(3)) {
    case 0:
      return std::string(1 + below(3000), static_cast<char>('a' + below(26)));
    case 1: {
      std::string junk;
      for (std::uint64_t i = below(30); i > 0; --i) junk += fmt::format("%{:02x}", below(256));
      return junk;
    }
    default:
      return one_of(kBad);
  }
}

std::string ApiRequests::bad_query_value() {
  static const std::vector<std::string> kBad = {"-1",
                                                "0",
                                                "1.5",
                                                "1e999",
                                                "nan",
                                                "inf",
                                                "99999999999999999999999",
                                                "18446744073709551615",
                                                "-9223372036854775809",
                                                "0x10",
                                                "",
                                                "%00",
                                                "%ff",
                                                "%",
                                                "true",
                                                "null",
                                                "[]",
                                                "..%2f..",
                                                "a&a=b",
                                                "%26",
                                                "+1",
                                                " 1",
                                                "1%201"};
  return chance(0.2) ? std::string(1 + below(3000), '9') : one_of(kBad);
}

json ApiRequests::odd_value() {
  static const std::vector<json> kOdd = {nullptr,
                                         true,
                                         false,
                                         0,
                                         -1,
                                         1.5,
                                         -0.0,
                                         1e308,
                                         -1e308,
                                         1e-320,
                                         18446744073709551615U,
                                         INT64_MIN,
                                         INT64_MAX,
                                         4294967296,
                                         "",
                                         "x",
                                         "..",
                                         "../../token",
                                         "/etc/passwd",
                                         "a\\b",
                                         std::string("nul\0in it", 9),
                                         "\xef\xbf\xbf",
                                         json::array(),
                                         json::object(),
                                         json::array({json::array({json::object()})}),
                                         {{"a", 1}},
                                         "queued",
                                         "admin",
                                         std::string(64, 'a'),
                                         std::string(64, 'A')};
  if (chance(0.1)) return std::string(1 + below(100000), 'x');
  if (chance(0.05)) return json(std::vector<int>(1 + below(20000), 7));
  return one_of(kOdd);
}

void ApiRequests::spoil(json& document) {
  std::vector<json*> places;
  collect(document, places);
  json& place = *one_of(places);
  if (place.is_object() && !place.empty() && chance(0.4)) {
    auto it = place.begin();
    std::advance(it, static_cast<long>(below(place.size())));
    place.erase(it);
  } else if (place.is_object() && chance(0.5)) {
    place[chance(0.5) ? std::string("surplus") : std::string(1 + below(300), 'k')] = odd_value();
  } else if (place.is_array() && chance(0.5)) {
    place.push_back(place.empty() ? odd_value() : json(place.front()));  // twice the same, too
  } else {
    place = odd_value();
  }
}

void ApiRequests::spoil_text(std::string& body) {
  switch (below(8)) {
    case 0:
      body.resize(below(body.size() + 1));
      break;
    case 1:
      if (!body.empty()) body[below(body.size())] = static_cast<char>(below(256));
      break;
    case 2:
      body.insert(below(body.size() + 1),
                  one_of(std::vector<std::string>{"\xff", "\xc3\x28", std::string(1, '\0'), "\xed\xa0\x80", "NaN", "//",
                                                  ",", "}", "\"", "\\u0000", "1e9999"}));
      break;
    case 3:
      body = std::string(1 + below(200000), chance(0.5) ? '[' : '{');
      break;
    case 4: {
      std::string nested = "1";
      for (std::uint64_t i = below(2000); i > 0; --i) nested = "{\"spec\":[" + nested + "]}";
      body = nested;
      break;
    }
    case 5:
      body = "\xef\xbb\xbf" + body;
      break;
    case 6:
      body += body;
      break;
    default:
      body = one_of(std::vector<std::string>{"null", "[]", "0", "\"\"", "{}", " ", "{\"spec\": 1, \"spec\": {}}",
                                             "true", "{\"\":{}}"});
  }
}

void ApiRequests::spoil_path(ApiRequest& request, const Operation& operation) {
  std::vector<std::string> names;
  for (const json& parameter : operation.description.value("parameters", json::array())) {
    if (parameter.at("in") == "path") names.push_back(parameter.at("name"));
  }
  if (names.empty()) {
    request.target += chance(0.5) ? "/" + bad_segment() : std::string("/");
    return;
  }
  const std::size_t open = operation.path.find('{');
  const std::size_t end = std::min(request.target.find_first_of("/?", open), request.target.size());
  request.target.replace(open, end - open, bad_segment());
}

void ApiRequests::spoil_query(ApiRequest& request) {
  static const std::vector<std::string> kNames = {"state", "name",      "limit",  "before",  "after",
                                                  "layer", "max_width", "follow", "seconds", "passes",
                                                  "error", "surplus",   "",       "%00"};
  for (std::uint64_t i = 1 + below(3); i > 0; --i) {
    request.target += request.target.find('?') == std::string::npos ? '?' : '&';
    request.target += one_of(kNames) + (chance(0.9) ? "=" : "") + bad_query_value();
  }
}

void ApiRequests::spoil_headers(ApiRequest& request) {
  static const std::vector<std::pair<std::string, std::string>> kBad = {
      {"Content-Type", "text/plain"},
      {"Content-Type", "application/json; charset=utf-16"},
      {"Content-Type", "multipart/form-data; boundary=x"},
      {"Content-Type", ""},
      {"Content-Encoding", "gzip"},
      {"Transfer-Encoding", "chunked"},
      {"Content-Length", "99999999999999999999"},
      {"Content-Length", "-1"},
      {"Content-Length", "x"},
      {"Content-Length", "17179869185"},
      {"Authorization", "Basic eDp5"},
      {"Authorization", "Bearer "},
      {"Authorization", "Bearer \xff\xff"},
      {"Range", "bytes=0-"},
      {"Range", "bytes=-0"},
      {"Range", "bytes=18446744073709551615-"},
      {"Range", "bytes=5-1,2-3"},
      {"Range", "lines=1"},
      {"If-Range", "\"x\""},
      {"If-None-Match", "*"},
      {"Expect", "100-continue"},
      {"Accept-Encoding", "gzip, br"},
      {"Connection", "upgrade"},
      {"X-HTTP-Method-Override", "DELETE"},
      {"Idempotency-Key", std::string(129, 'k')},
      {"Idempotency-Key", "a b"},
      {"Idempotency-Key", "\xc3\xbc"},
      {"Cookie", "a=b"}};
  const auto& [name, value] = one_of(kBad);
  if (chance(0.8)) std::erase_if(request.headers, [&name = name](const auto& header) { return header.first == name; });
  request.headers.emplace_back(name, value);
}

void ApiRequests::spoil_body(ApiRequest& request) {
  json document = json::parse(request.body, nullptr, false);
  if (document.is_discarded() || chance(0.3)) {
    spoil_text(request.body);
  } else {
    for (std::uint64_t i = 1 + below(2); i > 0; --i) spoil(document);
    request.body = document.dump(-1, ' ', false, json::error_handler_t::replace);
  }
  for (auto& [name, value] : request.headers) {
    if (name == "Content-Length") value = std::to_string(request.body.size());
  }
}

ApiRequest ApiRequests::wrong(const Operation& operation) {
  static const std::vector<std::string> kMethods = {"GET",    "HEAD",    "POST",  "PUT",      "PATCH",
                                                    "DELETE", "OPTIONS", "TRACE", "PROPFIND", "get"};
  ApiRequest request = right(operation);
  request.right = false;
  switch (below(request.body.empty() ? 4 : 8)) {
    case 0:
      spoil_path(request, operation);
      break;
    case 1:
      spoil_query(request);
      break;
    case 2:
      spoil_headers(request);
      break;
    case 3:
      request.method = one_of(kMethods);
      break;
    default:
      spoil_body(request);
  }
  return request;
}

}  // namespace pf::farm_test
