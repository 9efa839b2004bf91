// photonfarm-coordinator: parses, wires, exits.

#include <malloc.h>

#include <atomic>
#include <csignal>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <random>
#include <string>

#include <CLI/CLI.hpp>

#include "build_id.h"
#include "common/base/log.h"
#include "coordinator/config.h"
#include "coordinator/farm_process.h"
#include "coordinator/http/server.h"
#include "coordinator/http/webhook.h"
#include "coordinator/web/web_files.h"

namespace {

// A signal handler can reach nothing but this.
std::atomic<bool> interrupted{false};

void on_interrupt(int signal) {
  interrupted.store(true);
  std::signal(signal, SIG_DFL);  // a second one ends the process at once
}

struct Options {
  std::string state, engine, credentials, config, host;
  int port = 0;
  double ack_wait = 10;
};

int report_error(const pf::Error& error) {
  std::cerr << "photonfarm-coordinator: " << error.message << '\n';
  return pf::exit_code(error.kind);
}

/// The file of --config, or config.toml of the state folder where there is one; then what the command line
/// says.
pf::Result<pf::CoordinatorConfig> read_config(const Options& options) {
  const auto file = options.config.empty() ? std::filesystem::path(options.state) / "config.toml"
                                           : std::filesystem::path(options.config);
  std::error_code ignored;
  pf::Result<pf::CoordinatorConfig> config;
  if (!options.config.empty() || std::filesystem::exists(file, ignored)) config = pf::load_coordinator_config(file);
  if (!config) return config;
  if (!options.host.empty()) config->http.host = options.host;
  if (options.port != 0) config->http.port = options.port;
  return config;
}

int serve(const Options& options) {
  const auto config = read_config(options);
  if (!config) return report_error(config.error());
  pf::FarmProcess::Options farm;
  if (!options.credentials.empty()) {
    auto credentials = pf::load_credentials(options.credentials);
    if (!credentials) return report_error(credentials.error());
    farm.engine = std::move(*credentials);
  }
  if (!options.engine.empty()) farm.engine.url = options.engine;
  if (farm.engine.name.empty()) farm.engine.name = "coordinator";
  farm.engine.ack_wait_seconds = options.ack_wait;
  farm.state = options.state;
  farm.retention = config->keep;
  farm.jobs_per_token = config->limits.jobs_per_token;
  std::random_device random;
  farm.incarnation = (std::uint64_t{random()} << 32) | random();
  const pf::Log log;
  pf::Metrics metrics;
  farm.metrics = &metrics;
  auto process = pf::FarmProcess::open(farm, log);
  if (!process) return report_error(process.error());
  pf::HttpServerOptions http;
  http.config = *config;
  http.metrics = &metrics;
  http.state = options.state;
  http.blobs = farm.state / "blobs";
  http.web = pf::web_files();
  auto server = pf::HttpServer::start(http, **process, log);
  if (!server) return report_error(server.error());
  log.info("listening", {{"url", (*server)->url()}, {"build", pf::kBuildId}});
  std::unique_ptr<pf::Webhook> webhook;
  if (!config->notify.url.empty()) {
    auto started = pf::Webhook::start(config->notify, options.state, **process, log);
    if (!started) return report_error(started.error());
    webhook = std::move(*started);
  }
  const auto ended = (*process)->run(interrupted);
  (*process)->close();  // who waits for its answers goes on
  return ended ? 0 : report_error(ended.error());
}

}  // namespace

int main(int argc, char** argv) {
  // Chunks come on one thread and go on another. Left to itself, glibc soon takes them from its heaps, which
  // several megabytes of holes then keep for good; mapped, they go back at once.
  constexpr int kMappedBytes = 256 * 1024;
  mallopt(M_MMAP_THRESHOLD, kMappedBytes);  // NOLINT(concurrency-mt-unsafe): no thread has been started yet
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is an error like a full disk
  Options options;
  CLI::App app{"Cuts jobs into work units, merges their results, serves the HTTP API.", "photonfarm-coordinator"};
  app.set_version_flag("--version", std::string("photonfarm-coordinator ") + pf::kBuildId);
  app.add_option("--state", options.state, "folder for jobs, scenes, url and token")->required();
  app.add_option("--engine", options.engine,
                 "NATS server: nats://HOST:PORT or tls://HOST:PORT; by default the credentials' one");
  app.add_option("--credentials", options.credentials, "file that photonfarm farm init made for the coordinator");
  app.add_option("--config", options.config,
                 "the operator's settings: TLS, limits, notifications; by default config.toml of the state folder");
  app.add_option("--host", options.host, "address that the HTTP API listens on; by default 127.0.0.1; others need TLS");
  app.add_option("--port", options.port, "port of the HTTP API; 0: the former one, else any")
      ->check(CLI::Range(0, 65535));
  app.add_option("--ack-wait", options.ack_wait, "seconds after which a silent worker's units go to others")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 3600.0));
  app.footer("Example:\n  photonfarm-coordinator --state /var/lib/photonfarm --credentials coordinator.toml");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : pf::exit_code(pf::ErrorKind::kUsage);
  }
  try {
    return serve(options);
  } catch (const std::exception& error) {
    std::cerr << "photonfarm-coordinator: " << error.what() << '\n';
    return pf::exit_code(pf::ErrorKind::kInternal);
  }
}
