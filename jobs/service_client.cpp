// The seam to cpp-httplib, which is included here only.

#include "jobs/service_client.h"

#include <fmt/format.h>
#include <httplib.h>

#include <algorithm>
#include <cctype>
#include <condition_variable>
#include <exception>
#include <fstream>
#include <mutex>
#include <stop_token>
#include <system_error>
#include <thread>

#include "jobs/service_address.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr double kConnectSeconds = 5;
constexpr double kReadSeconds = 60;  // streams show each 15 s that they live
constexpr double kWriteSeconds = 60;
constexpr double kFirstPause = 0.05, kLongestPause = 1.0;
constexpr double kLookSeconds = 0.05;  // how late an interrupt may be noticed
constexpr std::size_t kPieceBytes = 256 * 1024;
constexpr std::size_t kMostBody = 256 << 20;

using Headers = std::map<std::string, std::string>;

Headers lower_case(const httplib::Headers& headers) {
  Headers result;
  for (const auto& [name, value] : headers) {
    std::string lower = name;
    std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    result.emplace(std::move(lower), value);
  }
  return result;
}

/// Breaks a client's connection when the user asks to stop, while it lives.
class InterruptWatch {
 public:
  InterruptWatch(const std::atomic<bool>* interrupted, httplib::Client& client) {
    if (interrupted == nullptr) return;
    thread_ = std::jthread([interrupted, &client](const std::stop_token& stop) {
      std::mutex mutex;
      std::condition_variable_any end;
      std::unique_lock lock(mutex);
      while (!stop.stop_requested()) {
        // Again and again: it may just be connecting.
        if (interrupted->load()) client.stop();
        end.wait_for(lock, stop, std::chrono::duration<double>(kLookSeconds), [] { return false; });
      }
    });
  }

 private:
  std::jthread thread_;
};

std::string describe(httplib::Error error) {
  switch (error) {
    case httplib::Error::Connection:
      return "it cannot be reached";
    case httplib::Error::ConnectionTimeout:
      return "it does not answer";
    case httplib::Error::Read:
      return "it did not answer to the end";
    case httplib::Error::Write:
      return "it did not take all";
    case httplib::Error::SSLConnection:
    case httplib::Error::SSLServerVerification:
      return "its certificate is not trusted, or it speaks no TLS; --ca names a file of the certificates to trust";
    case httplib::Error::SSLLoadingCerts:
      return "the file of --ca holds no certificate";
    default:
      return httplib::to_string(error);
  }
}

httplib::Headers to_headers(const ServiceCall& call) {
  httplib::Headers headers;
  for (const auto& [name, value] : call.headers) headers.emplace(name, value);
  return headers;
}

/// Sends a file in pieces; one that was cut meanwhile breaks the request off.
httplib::Result put_file(httplib::Client& client, const ServiceCall& call) {
  const auto file = std::make_shared<std::ifstream>(call.file, std::ios::binary);  // shared: the library copies
  std::error_code error;
  const std::uint64_t bytes = std::filesystem::file_size(call.file, error);
  return client.Put(
      call.path, to_headers(call), error ? 0 : bytes,
      [file](size_t offset, size_t length, httplib::DataSink& sink) {
        std::string piece(std::min(length, kPieceBytes), '\0');
        file->seekg(static_cast<std::streamoff>(offset));
        file->read(piece.data(), static_cast<std::streamsize>(piece.size()));
        const auto got = static_cast<std::size_t>(file->gcount());
        return got > 0 && sink.write(piece.data(), got);
      },
      "application/octet-stream");
}

httplib::Result send(httplib::Client& client, const ServiceCall& call, ServiceReply& head) {
  if (!call.file.empty()) return put_file(client, call);
  httplib::Request request;
  request.method = call.method;
  request.path = call.path;
  request.headers = to_headers(call);
  request.body = call.body;
  if (!call.body.empty()) request.set_header("Content-Type", "application/json");
  if (call.method == "HEAD") return client.send(request);
  bool streamed = false;
  request.response_handler = [&](const httplib::Response& response) {
    head.status = response.status;
    head.headers = lower_case(response.headers);
    streamed = call.take && (response.status == 200 || response.status == 206);
    return !streamed || !call.begin || call.begin(head);
  };
  request.content_receiver = [&](const char* bytes, size_t count, uint64_t, uint64_t) {
    const std::string_view piece(bytes, count);
    if (streamed) return call.take(piece);
    head.body += piece;
    return head.body.size() <= kMostBody;
  };
  return client.send(request);
}

}  // namespace

Result<ServiceReply> ServiceClient::try_call(const ServiceCall& call) {
  if (interrupted()) return fail(ErrorKind::kInterrupted, "interrupted");
  const auto address = find_service(options_.server, options_.token, options_.ca);
  if (!address) return tl::unexpected(address.error());
  url_ = address->url;
  token_origin_ = address->origin;
  ServiceReply reply;
  try {
    httplib::Client client(address->url);
    client.set_connection_timeout(std::chrono::duration<double>(kConnectSeconds));
    client.set_read_timeout(std::chrono::duration<double>(kReadSeconds));
    client.set_write_timeout(std::chrono::duration<double>(kWriteSeconds));
    client.set_bearer_token_auth(address->token);
    client.set_decompress(false);
    if (!address->ca.empty()) client.set_ca_cert_path(address->ca.c_str());
    const InterruptWatch watch(options_.interrupted, client);
    const httplib::Result result = send(client, call, reply);
    if (result || reply.status != 0) {
      answered_ = true;
      away_ = false;
    }
    if (!result) {
      if (interrupted()) return fail(ErrorKind::kInterrupted, "interrupted");
      return fail(ErrorKind::kUnavailable,
                  fmt::format("{}: {}; {}", url_, describe(result.error()), start_hint(options_.server)));
    }
    reply.status = result->status;
    reply.headers = lower_case(result->headers);
    if (reply.body.empty()) reply.body = result->body;
  } catch (const std::exception& error) {
    return fail(ErrorKind::kUnavailable, fmt::format("{}: {}; {}", url_, error.what(), start_hint(options_.server)));
  }
  return reply;
}

bool ServiceClient::pause(double seconds) const {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  while (Clock::now() < end) {
    if (interrupted()) return false;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(kLookSeconds, seconds)));
  }
  return !interrupted();
}

Result<void> ServiceClient::wait_to_retry(const Error& last) {
  using Clock = std::chrono::steady_clock;
  if (!away_) {
    away_ = true;
    away_since_ = Clock::now();
    pause_seconds_ = kFirstPause;
    const double patience = answered_ ? options_.retry_seconds : options_.first_seconds;
    if (patience > 0 && options_.notice) {
      options_.notice(fmt::format("{}: not reachable; trying again for {:.0f} s", url_, patience));
    }
  }
  const auto seconds_since = [](Clock::time_point t) {
    return std::chrono::duration<double>(Clock::now() - t).count();
  };
  if (seconds_since(away_since_) >= (answered_ ? options_.retry_seconds : options_.first_seconds))
    return tl::unexpected(last);
  if (!pause(pause_seconds_)) return fail(ErrorKind::kInterrupted, "interrupted");
  pause_seconds_ = std::min(2 * pause_seconds_, kLongestPause);
  return {};
}

Result<ServiceReply> ServiceClient::call(const ServiceCall& call) {
  while (true) {
    const bool was_away = away_;
    auto reply = try_call(call);
    const bool too_often = reply && reply->status == 429 && reply->headers.contains("retry-after");
    if (reply && reply->status != 503 && !too_often) return reply;
    if (!reply && reply.error().kind != ErrorKind::kUnavailable) return reply;
    // A folder without a farm will not get one by waiting.
    if (!reply && url_.empty()) return reply;
    if (reply) away_ = was_away;
    const Error error = reply ? check(*reply).error() : reply.error();
    if (auto waited = wait_to_retry(error); !waited) return tl::unexpected(waited.error());
  }
}

Result<void> ServiceClient::check(const ServiceReply& reply) const {
  if (reply.status >= 200 && reply.status < 300) return {};
  if (reply.status == 401) {
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}: refuses the token of {}; expected the one in the file 'token' of "
                            "the service's state folder",
                            url_, token_origin_));
  }
  const json problem = json::parse(reply.body, nullptr, false);
  constexpr std::string_view kPrefix = "urn:photonfarm:problem:";
  std::string type, detail;
  if (problem.is_object()) {
    type = problem.value("type", json()).is_string() ? problem["type"].get<std::string>() : "";
    detail = problem.value("detail", json()).is_string() ? problem["detail"].get<std::string>() : "";
  }
  if (!type.starts_with(kPrefix)) {
    const auto kind = reply.status == 503 ? ErrorKind::kUnavailable : ErrorKind::kInternal;
    return fail(kind, fmt::format("{}: answers with status {}", url_, reply.status));
  }
  type.erase(0, kPrefix.size());
  ErrorKind kind = ErrorKind::kInternal;
  if (type == "invalid-spec") kind = ErrorKind::kInvalidSpec;
  if (type == "invalid-input") kind = ErrorKind::kInvalidInput;
  if (type == "too-large") kind = ErrorKind::kInvalidInput;
  if (type == "not-found" || type == "forbidden" || type == "too-many-jobs") kind = ErrorKind::kUsage;
  if (type == "unavailable" || type == "too-many-requests") kind = ErrorKind::kUnavailable;
  return fail(kind, fmt::format("{} ({})", detail, url_));
}

Result<json> ServiceClient::ask(const ServiceCall& call, bool patient) {
  const auto reply = patient ? this->call(call) : try_call(call);
  if (!reply) return tl::unexpected(reply.error());
  if (auto checked = check(*reply); !checked) return tl::unexpected(checked.error());
  auto document = json::parse(reply->body, nullptr, false);
  if (!document.is_object()) {
    return fail(ErrorKind::kUnavailable, fmt::format("{}: answers in no JSON; is it a photonfarm service?", url_));
  }
  return document;
}

}  // namespace pf
