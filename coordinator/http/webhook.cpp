// Includes cpp-httplib as a client; server.cpp is the seam to it as a server.

#include "coordinator/http/webhook.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <utility>

#include <fmt/format.h>
#include <httplib.h>

#include "common/base/atomic_file.h"

namespace pf {
namespace {

constexpr double kLookSeconds = 1.0;  // between two looks at the jobs
constexpr std::chrono::seconds kPatience{10};
constexpr std::size_t kLeastSecret = 16;

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Status, or 0 when there was no reply.
int post(const CoordinatorConfig::Notify& config, const Notice& delivery, const std::string& signature) {
  const std::size_t slash = config.url.find('/', config.url.find("://") + 3);
  httplib::Client client(config.url.substr(0, slash));
  client.set_connection_timeout(kPatience);
  client.set_read_timeout(kPatience);
  client.set_write_timeout(kPatience);
  client.set_follow_location(false);
  if (!config.ca.empty()) client.set_ca_cert_path(config.ca.c_str());
  httplib::Request request;
  request.method = "POST";
  request.path = slash == std::string::npos ? "/" : config.url.substr(slash);
  request.body = delivery.body;
  request.headers = {{"Content-Type", "application/json"},
                     {"User-Agent", "photonfarm"},
                     {"Photonfarm-Delivery", delivery.id},
                     {"Photonfarm-Signature", signature}};
  int status = 0;
  request.response_handler = [&](const httplib::Response& response) {
    status = response.status;
    return false;  // the head is all that counts
  };
  static_cast<void>(client.send(request));
  return status;
}

}  // namespace

Webhook::Webhook(CoordinatorConfig::Notify config, std::string secret, Notifier notifier, JobService& service,
                 const Log& log)
    : config_(std::move(config)),
      secret_(std::move(secret)),
      notifier_(std::move(notifier)),
      service_(service),
      log_(log),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

Result<std::unique_ptr<Webhook>> Webhook::start(const CoordinatorConfig::Notify& config,
                                                const std::filesystem::path& state, JobService& service,
                                                const Log& log) {
  if (auto mode = check_secret_mode(config.secret_file); !mode) return tl::unexpected(mode.error());
  auto secret = read_file(config.secret_file, 4096, ErrorKind::kUsage);
  if (!secret) return tl::unexpected(secret.error());
  while (!secret->empty() && (secret->back() == '\n' || secret->back() == '\r')) secret->pop_back();
  if (secret->size() < kLeastSecret) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: holds a secret of {} characters; expected at least {}: openssl rand -hex 32",
                            config.secret_file.string(), secret->size(), kLeastSecret));
  }
  auto notifier = Notifier::open(state / "notify.json", unix_ms);
  if (!notifier) return tl::unexpected(notifier.error());
  return std::unique_ptr<Webhook>(new Webhook(config, std::move(*secret), std::move(*notifier), service, log));
}

void Webhook::deliver() {
  const auto delivery = notifier_.due();
  if (!delivery) return;
  int status = 0;
  try {
    status = post(config_, *delivery, webhook_signature(secret_, unix_ms() / 1000, delivery->body));
  } catch (const std::exception& error) {
    log_.warning("webhook", {{"delivery", delivery->id}, {"error", error.what()}});
  }
  const bool arrived = status >= 200 && status < 300;
  const auto goes_on = notifier_.tried(delivery->id, arrived);
  if (arrived) {
    log_.info("webhook told", {{"delivery", delivery->id}});
  } else if (!goes_on || *goes_on) {
    log_.warning("webhook not reached; tries again", {{"delivery", delivery->id}, {"status", status}});
  } else {
    log_.error("webhook given up", {{"delivery", delivery->id}, {"status", status}});
  }
  if (!goes_on) log_.error("webhook", {{"error", goes_on.error().message}});
}

void Webhook::run(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  while (!stop.stop_requested()) {
    if (auto looked = notifier_.look(service_.list()); !looked)
      log_.error("webhook", {{"error", looked.error().message}});
    deliver();
    never.wait_for(lock, stop, std::chrono::duration<double>(notifier_.due() ? 0.0 : kLookSeconds),
                   [] { return false; });
  }
}

}  // namespace pf
