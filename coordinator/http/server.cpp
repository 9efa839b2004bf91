// The seam to cpp-httplib, which is included here only: its types become HttpRequest and HttpReply, and its
// connections run over HttpSocket.

#include "coordinator/http/server.h"

#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <exception>
#include <limits>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/base/atomic_file.h"
#include "coordinator/http/connection_threads.h"
#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"
#include "coordinator/http/state.h"
#include "coordinator/http/tls.h"

namespace pf {
namespace {

constexpr std::size_t kPieceBytes = 256 * 1024;
constexpr int kBacklog = 256;  // the library's own is 5: bursts of clients would wait for a second

class SocketStream final : public httplib::Stream {
 public:
  explicit SocketStream(HttpSocket& socket) : socket_(socket) {}
  bool is_readable() const override { return true; }
  bool is_writable() const override { return !socket_.peer_gone(); }
  ssize_t read(char* bytes, size_t count) override { return socket_.read(bytes, count); }
  ssize_t write(const char* bytes, size_t count) override { return socket_.write(bytes, count); }
  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  socket_t socket() const override { return socket_.descriptor(); }

 private:
  HttpSocket& socket_;
};

class TaskQueue final : public httplib::TaskQueue {
 public:
  explicit TaskQueue(std::size_t max_threads) : threads_(max_threads) {}
  void enqueue(std::function<void()> task) override {
    // Not taken: the accepting thread itself turns the connection away.
    if (!threads_.add(task)) task();
  }
  void shutdown() override { threads_.shut_down(); }

 private:
  ConnectionThreads threads_;
};

/// What the library would do with these by itself is done by the routes, or not at all: it reads several
/// ranges at once, packs what it sends, and matches paths by std::regex, whose recursion follows the path's
/// length.
void take_over(httplib::Request& request) {
  request.ranges.clear();
  request.headers.erase("Accept-Encoding");
  request.target = std::move(request.path);
  request.path = std::string(1, '/');
}

class Server final : public httplib::Server {
 public:
  Server(const HttpLimits& limits, std::stop_token stop, std::unique_ptr<TlsContext> tls)
      : limits_(limits), stop_(std::move(stop)), tls_(std::move(tls)) {}

  /// Port, or 0.
  int bind(const std::string& host, int former_port, int port) {
    const auto try_port = [&](int p) { return p != 0 && bind_to_port(host, p) ? p : 0; };
    int bound = try_port(port != 0 ? port : former_port);
    if (bound == 0 && port == 0) bound = std::max(0, bind_to_any_port(host));
    return bound != 0 && ::listen(svr_sock_, kBacklog) == 0 ? bound : 0;
  }

  void serve() {
    accepting_ = std::this_thread::get_id();
    listen_after_bind();
    ended_ = true;
  }
  [[nodiscard]] bool ended() const { return ended_; }

 private:
  bool process_and_close_socket(socket_t fd) override {
    HttpSocket socket(fd, limits_, stop_, tls_.get());
    if (std::this_thread::get_id() == accepting_) {
      if (tls_) return true;  // shaking hands here would make all others wait
      constexpr std::string_view kBusy =
          "HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\n"
          "Content-Length: 0\r\n\r\n";
      static_cast<void>(socket.write(kBusy.data(), kBusy.size()));
      return true;
    }
    SocketStream stream(socket);
    bool closed = false;
    // One request a connection: waiting for a next one would hold a thread.
    const bool done = process_request(stream, true, closed, take_over);
    socket.finish();
    return done;
  }

  const HttpLimits limits_;
  const std::stop_token stop_;
  const std::unique_ptr<TlsContext> tls_;
  std::thread::id accepting_;
  std::atomic<bool> ended_{false};
};

HttpRequest to_request(const httplib::Request& from, const httplib::ContentReader* reader) {
  HttpRequest request;
  request.method = from.method;
  request.path = from.target;
  request.params = from.params;
  for (const auto& [name, value] : from.headers) {
    std::string lower = name;
    std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    request.headers.emplace(std::move(lower), value);
  }
  request.read_body = [&from, reader](const std::function<bool(std::string_view)>& take) {
    // The library would unpack, take apart or read without end what these headers announce.
    if (reader == nullptr || from.is_multipart_form_data()) return false;
    return (*reader)([&](const char* bytes, size_t count) { return take(std::string_view(bytes, count)); });
  };
  return request;
}

void send_file(const FileSlice& slice, const std::string& type, httplib::Response& to) {
  if (slice.bytes == 0) return to.set_content("", type);
  to.set_content_provider(slice.bytes, type, [slice](size_t offset, size_t length, httplib::DataSink& sink) {
    const std::string piece = slice.file->read(slice.offset + offset, std::min(length, kPieceBytes));
    return !piece.empty() && sink.write(piece.data(), piece.size());
  });
}

void send_shared(const SharedBytes& shared, const std::string& type, httplib::Response& to) {
  if (shared.bytes.empty()) return to.set_content("", type);
  to.set_content_provider(shared.bytes.size(), type, [shared](size_t offset, size_t length, httplib::DataSink& sink) {
    return sink.write(shared.bytes.data() + offset, length);
  });
}

void send_stream(NextPiece next, const std::string& type, httplib::Response& to) {
  to.set_header("Cache-Control", "no-store");
  to.set_chunked_content_provider(type, [next = std::move(next)](size_t, httplib::DataSink& sink) {
    if (!sink.is_writable()) return false;
    std::string piece;
    const bool more = next(piece);
    if (!piece.empty() && !sink.write(piece.data(), piece.size())) return false;
    if (!more) sink.done();
    return true;
  });
}

void send(HttpReply reply, httplib::Response& to) {
  to.status = reply.status;
  to.set_header("X-Content-Type-Options", "nosniff");
  for (const auto& [name, value] : reply.headers) to.set_header(name, value);
  if (auto* text = std::get_if<std::string>(&reply.body)) {
    to.set_content(*text, reply.content_type);
  } else if (auto* slice = std::get_if<FileSlice>(&reply.body)) {
    send_file(*slice, reply.content_type, to);
  } else if (auto* shared = std::get_if<SharedBytes>(&reply.body)) {
    send_shared(*shared, reply.content_type, to);
  } else {
    send_stream(std::move(std::get<NextPiece>(reply.body)), reply.content_type, to);
  }
}

/// Errors that the routes cannot see, or empty.
std::optional<HttpReply> refusal(const httplib::Request& request) {
  if (request.get_header_value_count("Content-Length") > 1 || request.get_header_value_count("Authorization") > 1) {
    return problem(400, "bad-request", "a header comes twice: Content-Length or Authorization");
  }
  if (request.has_header("Transfer-Encoding")) {
    return problem(411, "length-required", "expected a Content-Length, no Transfer-Encoding");
  }
  if (request.has_header("Content-Encoding")) {
    return problem(415, "unsupported-media-type", "expected a body without Content-Encoding");
  }
  static constexpr std::array<std::string_view, 7> kMethods = {"GET",   "HEAD",   "POST",   "PUT",
                                                               "PATCH", "DELETE", "OPTIONS"};
  if (std::ranges::find(kMethods, request.method) == kMethods.end()) {
    HttpReply reply = problem(405, "method-not-allowed", "expected GET, HEAD, POST, PUT, PATCH or DELETE");
    reply.headers.emplace_back("Allow", "GET, HEAD, POST, PUT, PATCH, DELETE");
    return reply;
  }
  return std::nullopt;
}

void connect_routes(Server& server, HttpRoutes& routes, const Log& log) {
  const auto plain = [&routes](const httplib::Request& request, httplib::Response& response) {
    send(routes.answer(to_request(request, nullptr)), response);
  };
  const auto with_body = [&routes](const httplib::Request& request, httplib::Response& response,
                                   const httplib::ContentReader& reader) {
    send(routes.answer(to_request(request, &reader)), response);
  };
  // Every method that may carry a body has a reader: else the library would read all of it into memory first.
  server.Get("/", plain).Options("/", plain);
  server.Post("/", with_body).Put("/", with_body).Patch("/", with_body).Delete("/", with_body);
  server.Delete("/", plain);
  server.set_pre_routing_handler([](const httplib::Request& request, httplib::Response& response) {
    auto refused = refusal(request);
    if (!refused) return httplib::Server::HandlerResponse::Unhandled;
    send(std::move(*refused), response);
    return httplib::Server::HandlerResponse::Handled;
  });
  // What the library refuses before any of that.
  server.set_error_handler([](const httplib::Request&, httplib::Response& response) {
    if (response.body.empty() && !response.content_provider_) {
      response.set_content(problem_json(response.status, "bad-request", "the request is malformed"),
                           "application/problem+json");
    }
  });
  server.set_exception_handler(
      [&log](const httplib::Request& request, httplib::Response& response, const std::exception_ptr& error) {
        std::string what = "unknown exception";
        try {
          std::rethrow_exception(error);
        } catch (const std::exception& e) {
          what = e.what();
        } catch (...) {
        }
        log.error("http request failed", {{"method", request.method}, {"path", request.target}, {"error", what}});
        send(problem(500, "internal", "the coordinator failed; its log says more"), response);
      });
  server.set_payload_max_length(std::numeric_limits<size_t>::max());  // the routes bound each kind of body
}

std::string url_of(std::string_view scheme, const std::string& host, int port) {
  if (host.find(':') != std::string::npos)
    return fmt::format("{}://[{}]:{}", scheme, host == "::" ? "::1" : host, port);
  return fmt::format("{}://{}:{}", scheme, host == "0.0.0.0" ? "127.0.0.1" : host, port);
}

/// The certificate, when there is one; nothing for plain HTTP on this machine alone.
Result<std::unique_ptr<TlsContext>> tls_for(const CoordinatorConfig::Http& http, const std::string& host,
                                            const std::filesystem::path& state) {
  if (http.certificate.empty()) {
    if (!is_loopback(host)) {
      return fail(
          ErrorKind::kUsage,
          fmt::format("{}: others reach this address, and tokens would cross the network in the clear; expected "
                      "127.0.0.1, or http.certificate and http.key in the configuration ('photonfarm farm init' makes "
                      "both)",
                      host));
    }
    if (auto kept = keep_ca(state, ""); !kept) return tl::unexpected(kept.error());
    return std::unique_ptr<TlsContext>();
  }
  auto tls = TlsContext::load(http.certificate, http.key);
  if (!tls) return tls;
  constexpr std::uint64_t kMaxPemBytes = 1 << 20;
  const auto ca = read_file(http.ca.empty() ? http.certificate : http.ca, kMaxPemBytes, ErrorKind::kUsage);
  if (!ca) return tl::unexpected(ca.error());
  if (auto kept = keep_ca(state, *ca); !kept) return tl::unexpected(kept.error());
  return tls;
}

}  // namespace

struct HttpServer::Parts {
  std::stop_source stop;
  std::unique_ptr<HttpRoutes> routes;
  std::unique_ptr<Server> server;
  std::thread thread;

  ~Parts() {
    stop.request_stop();
    if (server) server->stop();
    if (thread.joinable()) thread.join();
  }
};

HttpServer::HttpServer(std::unique_ptr<Parts> parts, std::string url, std::string token)
    : parts_(std::move(parts)), url_(std::move(url)), token_(std::move(token)) {}

HttpServer::~HttpServer() = default;

Result<std::unique_ptr<HttpServer>> HttpServer::start(const HttpServerOptions& options, JobService& service,
                                                      const Log& log) {
  const CoordinatorConfig::Http& http = options.config.http;
  const std::string host = http.host.empty() ? "127.0.0.1" : http.host;
  auto tls = tls_for(http, host, options.state);
  if (!tls) return tl::unexpected(tls.error());
  const std::string_view scheme = *tls ? "https" : "http";
  auto token = keep_token(options.state, options.token);
  if (!token) return tl::unexpected(token.error());
  auto parts = std::make_unique<Parts>();
  auto routes = HttpRoutes::make({.token = *token,
                                  .state = options.state,
                                  .limits = options.config.limits,
                                  .clock = options.clock,
                                  .metrics = options.metrics,
                                  .blobs = options.blobs,
                                  .max_streams = options.max_streams,
                                  .heartbeat_seconds = options.heartbeat_seconds,
                                  .web = options.web},
                                 service, log, parts->stop.get_token());
  if (!routes) return tl::unexpected(routes.error());
  parts->routes = std::move(*routes);
  parts->server = std::make_unique<Server>(options.limits, parts->stop.get_token(), std::move(*tls));
  connect_routes(*parts->server, *parts->routes, log);
  const auto max_threads = static_cast<std::size_t>(std::max(1, options.max_connections));
  parts->server->new_task_queue = [max_threads] { return new TaskQueue(max_threads); };
  // The library's default, SO_REUSEPORT, would let two coordinators share a port without an error.
  parts->server->set_socket_options([](socket_t socket) {
    const int yes = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  const int port = parts->server->bind(host, former_port(options.state), http.port);
  if (port == 0) {
    return fail(ErrorKind::kUnavailable,
                fmt::format("{}:{}: cannot listen; expected an address of this machine and a free port (0: any)", host,
                            http.port));
  }
  const std::string url = url_of(scheme, host, port);
  parts->thread = std::thread([server = parts->server.get()] { server->serve(); });
  while (!parts->server->is_running() && !parts->server->ended()) std::this_thread::yield();
  if (auto written = write_url(options.state, url); !written) return tl::unexpected(written.error());
  log.info("http listening", {{"url", url}});
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(parts), url, std::move(*token)));
}

}  // namespace pf
