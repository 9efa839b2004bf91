#include "common/wire/nats/link.h"

#include <algorithm>
#include <chrono>

#include <fmt/format.h>

#include "common/wire/nats/subjects.h"

namespace pf::engine {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr std::size_t kMaxOutgoing = 4096;  // messages that wait, however small
constexpr std::size_t kMaxReports = 1000;   // on connection and problems; more get lost
constexpr int kConnectMs = 2000;            // for one try
constexpr int kPingMs = 5000;               // a connection that answers no ping for so long, twice, is dead
constexpr int kPings = 2;
constexpr int kWriteMs = 2000;  // a server that takes nothing for so long is taken for dead

struct OptionsDeleter {
  void operator()(natsOptions* options) const { natsOptions_Destroy(options); }
};
using Options = std::unique_ptr<natsOptions, OptionsDeleter>;

/// Waits between tries to come back: 50 ms, then doubling up to 2 s, less up to a quarter so that workers do not come
/// in step. Called by the client on its own thread.
int64_t reconnect_delay(natsConnection* /*connection*/, int attempts, void* /*closure*/) {
  const int64_t delay = std::min<int64_t>(2000, int64_t{50} << std::clamp(attempts - 1, 0, 6));
  return delay - nats_Now() % (delay / 4 + 1);
}

std::vector<std::string> split_urls(const std::string& urls) {
  std::vector<std::string> list;
  std::size_t begin = 0;
  while (begin <= urls.size()) {
    const std::size_t end = std::min(urls.find(',', begin), urls.size());
    if (end > begin) list.push_back(urls.substr(begin, end - begin));
    begin = end + 1;
  }
  return list;
}

/// What stands between "//" (or the last '@') and the port.
std::string host_of(const std::string& url) {
  const std::size_t scheme = url.find("//");
  std::string host = scheme == std::string::npos ? url : url.substr(scheme + 2);
  if (const std::size_t at = host.rfind('@'); at != std::string::npos) host = host.substr(at + 1);
  if (host.starts_with('[')) return host.substr(1, host.find(']') - 1);
  return host.substr(0, host.find_first_of(":/"));
}

natsStatus set_tls(natsOptions* options, const EngineOptions& wanted, const std::vector<std::string>& urls) {
  const bool secure = !wanted.ca.empty() || std::any_of(urls.begin(), urls.end(), [](const std::string& url) {
    return url.starts_with("tls://");
  });
  if (!secure) return NATS_OK;
  natsStatus status = natsOptions_SetSecure(options, true);
  if (status == NATS_OK && !wanted.ca.empty())
    status = natsOptions_LoadCATrustedCertificates(options, wanted.ca.c_str());
  if (status == NATS_OK && !wanted.certificate.empty())
    status = natsOptions_LoadCertificatesChain(options, wanted.certificate.c_str(), wanted.key.c_str());
  // One name for all servers is what the client has; without it, it takes any name that the CA signed.
  if (status == NATS_OK) status = natsOptions_SetExpectedHostname(options, host_of(urls.front()).c_str());
  return status;
}

natsStatus set_identity(natsOptions* options, const EngineOptions& wanted) {
  const std::string inbox = wanted.inbox_prefix.empty() ? inbox_prefix(wanted.name) : wanted.inbox_prefix;
  natsStatus status = natsOptions_SetName(options, wanted.name.c_str());
  if (status == NATS_OK) status = natsOptions_SetCustomInboxPrefix(options, inbox.c_str());
  if (status == NATS_OK && !wanted.user.empty())
    status = natsOptions_SetUserInfo(options, wanted.user.c_str(), wanted.password.c_str());
  if (status == NATS_OK && !wanted.credentials.empty())
    status = natsOptions_SetUserCredentialsFromFiles(options, wanted.credentials.c_str(), nullptr);
  return status;
}

natsStatus set_behaviour(natsOptions* options) {
  natsStatus status = natsOptions_SetSendAsap(options, true);  // else each request waits a millisecond
  if (status == NATS_OK) status = natsOptions_SetTimeout(options, kConnectMs);
  if (status == NATS_OK) status = natsOptions_SetMaxReconnect(options, -1);
  if (status == NATS_OK) status = natsOptions_SetCustomReconnectDelay(options, reconnect_delay, nullptr);
  if (status == NATS_OK) status = natsOptions_SetPingInterval(options, kPingMs);
  if (status == NATS_OK) status = natsOptions_SetMaxPingsOut(options, kPings);
  if (status == NATS_OK) status = natsOptions_SetWriteDeadline(options, kWriteMs);
  if (status == NATS_OK) status = natsOptions_SetFailRequestsOnDisconnect(options, true);
  return status;
}

std::string hint_for(natsStatus status) {
  switch (status) {
    case NATS_CONNECTION_AUTH_FAILED:
      return "the engine refused user or password: see --credentials";
    case NATS_SSL_ERROR:
    case NATS_SECURE_CONNECTION_WANTED:
    case NATS_SECURE_CONNECTION_REQUIRED:
      return "does the server speak TLS, and is `ca` of the credentials file the one that signed its certificate for "
             "this "
             "host name?";
    case NATS_NOT_PERMITTED:
      return "the user lacks a permission: see photonfarm farm init";
    case NATS_INSUFFICIENT_BUFFER:
    case NATS_MAX_PAYLOAD:
      return "the message is larger than the server's max_payload";
    default:
      return "is nats-server running with JetStream on, and reachable from here? photonfarm farm starts one";
  }
}

std::string text_of(natsStatus status) {
  natsStatus last = NATS_OK;
  const char* words = nats_GetLastError(&last);
  std::string text = natsStatus_GetText(status);
  if (words != nullptr && *words != '\0' && last == status) text += fmt::format(" ({})", words);
  return text;
}

}  // namespace

std::string_view data_of(const natsMsg* message) {
  return {natsMsg_GetData(message), static_cast<std::size_t>(natsMsg_GetDataLength(message))};
}

Link::Link(const EngineOptions& options, EventSink sink, std::function<void()> reconnected)
    : url_(options.url),
      sink_(std::move(sink)),
      reconnected_(std::move(reconnected)),
      max_pending_bytes_(std::min<std::size_t>(options.max_pending_bytes, 0x7fffffff)),
      outgoing_(kMaxOutgoing, options.max_outgoing_bytes),
      reports_(kMaxReports) {}

Result<std::unique_ptr<Link>> Link::open(const EngineOptions& wanted, EventSink sink,
                                         std::function<void()> reconnected) {
  const std::vector<std::string> urls = split_urls(wanted.url);
  if (urls.empty()) return fail(ErrorKind::kUsage, "engine: no URL; expected nats://HOST:PORT or tls://HOST:PORT");
  if (!is_token(wanted.name)) {
    return fail(ErrorKind::kUsage,
                fmt::format("engine: name '{}'; expected 1 to 64 letters, digits, '_' or '-'", wanted.name));
  }
  std::unique_ptr<Link> link(new Link(wanted, std::move(sink), std::move(reconnected)));
  natsOptions* raw = nullptr;
  natsStatus status = natsOptions_Create(&raw);
  const Options options(raw);
  std::vector<const char*> servers;
  servers.reserve(urls.size());
  for (const std::string& url : urls) servers.push_back(url.c_str());
  if (status == NATS_OK) status = natsOptions_SetServers(raw, servers.data(), static_cast<int>(servers.size()));
  if (status == NATS_OK) status = set_identity(raw, wanted);
  if (status == NATS_OK) status = set_behaviour(raw);
  if (status == NATS_OK) status = natsOptions_SetDisconnectedCB(raw, on_disconnected, link.get());
  if (status == NATS_OK) status = natsOptions_SetReconnectedCB(raw, on_reconnected, link.get());
  if (status == NATS_OK) status = natsOptions_SetClosedCB(raw, on_closed, link.get());
  if (status == NATS_OK) status = natsOptions_SetErrorHandler(raw, on_error, link.get());
  if (status == NATS_OK) status = set_tls(raw, wanted, urls);
  if (status != NATS_OK) return link->failure("bad options", status);
  link->up_ = true;  // before the callbacks can say otherwise
  status = natsConnection_Connect(&link->connection_, raw);
  if (status != NATS_OK) {
    link->up_ = false;
    link->connection_ = nullptr;
    return link->failure("cannot connect", status);
  }
  link->sender_ = std::thread([self = link.get()] { self->send_all(); });
  link->reporter_ = std::thread([self = link.get()] {
    while (std::optional<EngineEvent> event = self->reports_.pop()) self->sink_(std::move(*event));
  });
  return link;
}

Link::~Link() {
  outgoing_.close();
  if (sender_.joinable()) sender_.join();
  closing_ = true;
  if (connection_ == nullptr) return;
  if (up_) natsConnection_FlushTimeout(connection_, kWriteMs);
  natsConnection_Close(connection_);
  for (std::thread& thread : threads_) thread.join();
  {
    // The last thing that the client's threads do with this object.
    std::unique_lock lock(mutex_);
    closed_changed_.wait(lock, [&] { return closed_; });
  }
  reports_.close();
  reporter_.join();
  for (natsSubscription* subscription : subscriptions_) natsSubscription_Destroy(subscription);
  natsConnection_Destroy(connection_);
}

void Link::post(std::string subject, std::string_view bytes, IfDown if_down, std::string reply) {
  const bool room = outgoing_.push({std::move(subject), std::move(reply), std::string(bytes), if_down}, bytes.size(),
                                   steady_clock::now() + 1s);
  if (!room) dropped_ += 1;
}

void Link::send_all() {
  while (const std::optional<Outgoing> next = outgoing_.pop()) {
    if (!up_ && next->if_down == IfDown::kDrop) {
      dropped_ += 1;
      continue;
    }
    const char* reply = next->reply.empty() ? nullptr : next->reply.c_str();
    const int size = static_cast<int>(next->bytes.size());
    const natsStatus status =
        reply == nullptr
            ? natsConnection_Publish(connection_, next->subject.c_str(), next->bytes.data(), size)
            : natsConnection_PublishRequest(connection_, next->subject.c_str(), reply, next->bytes.data(), size);
    count_sent(status, next->bytes.size());
    if (status == NATS_MAX_PAYLOAD) report(EngineProblem{describe("message dropped", status)});
  }
}

void Link::count_sent(natsStatus status, std::size_t bytes) {
  if (status != NATS_OK) {
    dropped_ += 1;
    return;
  }
  sent_ += 1;
  sent_bytes_ += bytes;
}

EngineCounters Link::counters() const {
  return {sent_, sent_bytes_, dropped_, received_, received_bytes_, reconnects_};
}

Result<void> Link::listen(const std::string& subject, std::function<void(Message)> taken, std::function<void()> idle,
                          int idle_milliseconds) {
  natsSubscription* subscription = nullptr;
  natsStatus status = natsConnection_SubscribeSync(&subscription, connection_, subject.c_str());
  if (status != NATS_OK) return failure("cannot listen", status);
  subscriptions_.push_back(subscription);
  status = natsSubscription_SetPendingLimits(subscription, -1, static_cast<int>(max_pending_bytes_));
  if (status != NATS_OK) return failure("cannot listen", status);
  threads_.emplace_back([this, subscription, taken = std::move(taken), idle = std::move(idle), idle_milliseconds] {
    for (;;) {
      natsMsg* raw = nullptr;
      const natsStatus got = natsSubscription_NextMsg(&raw, subscription, idle_milliseconds);
      Message message(raw);
      if (got == NATS_OK) {
        received_ += 1;
        received_bytes_ += static_cast<std::uint64_t>(natsMsg_GetDataLength(message.get()));
        taken(std::move(message));
      } else if (got != NATS_TIMEOUT && got != NATS_SLOW_CONSUMER) {
        return;  // closed
      }
      if (idle) idle();
    }
  });
  return {};
}

Result<void> Link::flush() {
  const natsStatus status = natsConnection_FlushTimeout(connection_, kConnectMs);
  if (status != NATS_OK) return failure("no answer", status);
  return {};
}

void Link::report(EngineEvent event) { reports_.try_push(std::move(event)); }

std::string Link::describe(std::string_view what, natsStatus status) const {
  return fmt::format("engine {}: {}: {}; {}", url_, what, text_of(status), hint_for(status));
}

tl::unexpected<Error> Link::failure(std::string_view what, natsStatus status) const {
  return fail(ErrorKind::kUnavailable, describe(what, status));
}

void Link::on_disconnected(natsConnection* connection, void* closure) {
  Link& self = *static_cast<Link*>(closure);
  self.up_ = false;
  if (self.closing_) return;
  const char* words = nullptr;
  const natsStatus status = natsConnection_GetLastError(connection, &words);
  self.report(ConnectionChanged{false, false,
                                fmt::format("engine {}: connection lost: {}", self.url_, natsStatus_GetText(status))});
}

void Link::on_reconnected(natsConnection* /*connection*/, void* closure) {
  Link& self = *static_cast<Link*>(closure);
  self.up_ = true;
  self.reconnects_ += 1;
  if (self.reconnected_) self.reconnected_();
  self.report(ConnectionChanged{true, false, fmt::format("engine {}: connected again", self.url_)});
}

void Link::on_closed(natsConnection* connection, void* closure) {
  Link& self = *static_cast<Link*>(closure);
  self.up_ = false;
  if (!self.closing_) {
    const char* words = nullptr;
    const natsStatus status = natsConnection_GetLastError(connection, &words);
    self.report(ConnectionChanged{false, true, self.describe("connection given up", status)});
  }
  const std::lock_guard lock(self.mutex_);
  self.closed_ = true;
  self.closed_changed_.notify_all();
}

void Link::on_error(natsConnection* connection, natsSubscription* subscription, natsStatus status, void* closure) {
  Link& self = *static_cast<Link*>(closure);
  if (self.closing_) return;
  const char* words = nullptr;
  natsConnection_GetLastError(connection, &words);
  std::string text = fmt::format("engine {}: {}", self.url_, natsStatus_GetText(status));
  if (status == NATS_SLOW_CONSUMER) {
    text += fmt::format(": messages to {} were dropped, more than {} bytes were waiting",
                        natsSubscription_GetSubject(subscription), self.max_pending_bytes_);
  } else if (words != nullptr && *words != '\0') {
    text += fmt::format(" ({})", words);
  }
  self.report(EngineProblem{std::move(text)});
}

}  // namespace pf::engine
