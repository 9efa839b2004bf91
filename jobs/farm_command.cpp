// photonfarm farm: a coordinator and workers, and an engine of their own unless there is one already.

#include <fcntl.h>
#include <sched.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>
#include <vector>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "common/base/atomic_file.h"
#include "common/wire/nats/subjects.h"
#include "jobs/command.h"
#include "jobs/farm_init.h"
#include "jobs/farm_supervisor.h"
#include "jobs/nats_server.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

// Order of stopping: workers give back what they hold while there is somebody to give it to.
constexpr int kWorkerStage = 0;
constexpr int kCoordinatorStage = 1;
constexpr int kEngineStage = 2;
constexpr double kWorkerSeconds = 60;
constexpr double kCoordinatorSeconds = 120;  // it writes its last checkpoints
constexpr double kEngineSeconds = 10;
constexpr int kSpareUsers = 8;  // for workers started by hand beside the farm's own
constexpr std::uintmax_t kMaxLogBytes = std::uintmax_t{64} << 20;

struct FarmOptions {
  fs::path state;
  std::string engine;
  fs::path credentials;
  std::string host;
  fs::path config;
  int workers = 0;
  int threads = 1;
  int port = 0;
  double ack_wait = 0;
};

/// The processors that this process may use.
int processors() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return 1;
  return std::max(1, CPU_COUNT(&set));
}

/// Held while the farm runs, by this process alone.
class StateLock {
 public:
  StateLock() = default;
  StateLock(StateLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  StateLock& operator=(StateLock&&) = delete;
  ~StateLock() {
    if (fd_ >= 0) close(fd_);
  }

  [[nodiscard]] static Result<StateLock> take(const fs::path& state) {
    const fs::path file = state / "farm.pid";
    StateLock lock;
    lock.fd_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (lock.fd_ < 0)
      return fail(ErrorKind::kInternal,
                  fmt::format("{}: cannot be written: {}", file.string(), std::generic_category().message(errno)));
    if (flock(lock.fd_, LOCK_EX | LOCK_NB) != 0) {
      std::string pid(32, '\0');
      pid.resize(static_cast<std::size_t>(std::max<ssize_t>(0, pread(lock.fd_, pid.data(), pid.size(), 0))));
      pid.erase(pid.find_last_not_of('\n') + 1);
      return fail(ErrorKind::kUsage,
                  fmt::format("{}: a farm runs here already, process {}; stop it or choose another --state",
                              state.string(), pid.empty() ? "?" : pid));
    }
    const std::string pid = fmt::format("{}\n", getpid());
    if (ftruncate(lock.fd_, 0) != 0 || pwrite(lock.fd_, pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size()))
      return fail(ErrorKind::kInternal,
                  fmt::format("{}: cannot be written: {}", file.string(), std::generic_category().message(errno)));
    return lock;
  }

 private:
  int fd_ = -1;
};

Result<void> make_folders(const fs::path& state) {
  for (const fs::path& folder : {state, state / "logs", state / "cache"}) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error)
      return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
  }
  chmod(state.c_str(), 0700);  // scenes, images, passwords
  return {};
}

/// A log file; one that has grown large makes room for a new one.
fs::path log_file(const fs::path& state, const std::string& name) {
  fs::path file = state / "logs" / (name + ".log");
  std::error_code ignored;
  if (fs::file_size(file, ignored) > kMaxLogBytes && !ignored) fs::rename(file, file.string() + ".1", ignored);
  return file;
}

/// Everything that the farm runs, in the order in which it starts.
class FarmPlan {
 public:
  FarmPlan(const Context& context, const FarmOptions& options) : context_(context), options_(options) {}

  [[nodiscard]] Result<std::vector<Service>> make() {
    std::vector<Service> services;
    if (options_.engine.empty() && options_.credentials.empty()) {
      if (Result<void> made = prepare_engine(); !made) return tl::unexpected(made.error());
      services.push_back({"nats-server", [this] { return server_->launch(); }, kEngineStage, kEngineSeconds, true});
    }
    services.push_back(service("coordinator", "photonfarm-coordinator", coordinator_arguments(), kCoordinatorStage,
                               kCoordinatorSeconds));
    services.back().needed = true;
    for (int number = 1; number <= options_.workers; ++number) {
      const std::string name = worker_name(number);
      services.push_back(service(name, "photonfarm-worker", worker_arguments(name), kWorkerStage, kWorkerSeconds));
    }
    return services;
  }
  [[nodiscard]] std::string engine_text() const {
    if (server_) return server_->url();
    return options_.engine.empty() ? options_.credentials.string() : options_.engine;
  }

 private:
  Result<void> prepare_engine() {
    const fs::path program = find_program("nats-server", context_.search_path + ":/usr/sbin:/usr/local/bin");
    if (program.empty()) {
      return fail(
          ErrorKind::kUnavailable,
          "nats-server was not found in PATH; install it (Debian package nats-server) or name an engine with --engine");
    }
    NatsServerOptions options;
    options.program = program;
    options.folder = options_.state / "engine";
    options.log = log_file(options_.state, "nats-server");
    options.workers = options_.workers + kSpareUsers;
    Result<NatsServer> server = NatsServer::prepare(options);
    if (!server) return tl::unexpected(server.error());
    server_.emplace(std::move(*server));
    return {};
  }

  Service service(const std::string& name, const std::string& program, std::vector<std::string> arguments, int stage,
                  double seconds) const {
    const fs::path file = context_.folder / program;
    const fs::path state = options_.state;
    return {name,
            [file, state, name, arguments = std::move(arguments)] {
              return Child::start({file, arguments, log_file(state, name)});
            },
            stage, seconds, false};
  }

  /// --engine and --credentials for one process.
  void add_engine(std::vector<std::string>& arguments, const std::string& name) const {
    const std::string url = server_ ? server_->url() : options_.engine;
    if (!url.empty()) arguments.insert(arguments.end(), {"--engine", url});
    fs::path file = server_ ? server_->credentials(name) : options_.credentials;
    if (!server_ && fs::is_directory(file)) file = credentials_file(file, name);
    if (!file.empty()) arguments.insert(arguments.end(), {"--credentials", file.string()});
  }

  std::vector<std::string> coordinator_arguments() const {
    std::vector<std::string> arguments = {"--state", options_.state.string()};
    add_engine(arguments, std::string(kCoordinatorUser));
    if (options_.port != 0) arguments.insert(arguments.end(), {"--port", std::to_string(options_.port)});
    if (!options_.host.empty()) arguments.insert(arguments.end(), {"--host", options_.host});
    if (!options_.config.empty()) arguments.insert(arguments.end(), {"--config", options_.config.string()});
    if (options_.ack_wait > 0) arguments.insert(arguments.end(), {"--ack-wait", fmt::format("{}", options_.ack_wait)});
    return arguments;
  }

  std::vector<std::string> worker_arguments(const std::string& name) const {
    std::vector<std::string> arguments = {"serve"};
    add_engine(arguments, name);
    arguments.insert(arguments.end(), {"--name", name, "--threads", std::to_string(options_.threads), "--cache",
                                       (options_.state / "cache").string()});
    return arguments;
  }

  const Context& context_;
  const FarmOptions& options_;
  std::optional<NatsServer> server_;
};

Result<void> run_farm(const Context& context, const FarmOptions& options) {
  if (Result<void> made = make_folders(options.state); !made) return made;
  const Result<StateLock> lock = StateLock::take(options.state);
  if (!lock) return tl::unexpected(lock.error());
  FarmPlan plan(context, options);
  Result<std::vector<Service>> services = plan.make();
  if (!services) return tl::unexpected(services.error());

  const fs::path url = options.state / "url";
  const auto say = [&](const std::string& line) { context.err << "photonfarm farm: " << line << std::endl; };
  Supervisor::Options run;
  run.services = std::move(*services);
  run.watched = url;
  const auto line_of = [](const fs::path& file) {
    std::string text = read_file(file, 4096).value_or("?");
    text.erase(text.find_last_not_of('\n') + 1);
    return text;
  };
  run.appeared = [&] {
    const std::string text = line_of(url);
    say(fmt::format("ready: {}, engine {}, {} workers of {} threads, state and logs in {}", text, plan.engine_text(),
                    options.workers, options.threads, options.state.string()));
    // For the one who sits there: a log is no place for a token.
    if (context.terminal) say(fmt::format("dashboard: {}/#token={}", text, line_of(options.state / "token")));
  };
  run.say = say;
  Supervisor supervisor(std::move(run));
  Result<void> ended = supervisor.run();
  if (ended) say("stopped");
  return ended;
}

int report(const Context& context, const Error& error) {
  context.err << "photonfarm farm: " << error.message << '\n';
  return exit_code(error.kind);
}

}  // namespace

int run_farm_command(const Context& context, const Arguments& arguments) {
  if (!arguments.empty() && arguments.front() == "init")
    return run_farm_init_command(context, Arguments(arguments.begin() + 1, arguments.end()));
  FarmOptions options;
  options.state = context.state;
  options.workers = processors();
  CLI::App app(
      "Runs a farm on this machine: coordinator, workers, and a private nats-server unless --engine names one.\n"
      "Starts again what dies. Ctrl-C or SIGTERM stops it: workers finish or give back what they hold; a second "
      "one kills.\nphotonfarm farm init makes certificates, users and settings for a farm of several machines.",
      "photonfarm farm");
  app.add_option("--workers", options.workers, "number of workers")->capture_default_str()->check(CLI::Range(0, 4096));
  app.add_option("--threads", options.threads, "threads of each; 0: all")
      ->capture_default_str()
      ->check(CLI::Range(0, 1024));
  app.add_option("--state", options.state, "folder for jobs, images, logs, url and token")->capture_default_str();
  app.add_option("--engine", options.engine, "an engine that runs already: nats://HOST:PORT or tls://HOST:PORT");
  app.add_option("--credentials", options.credentials,
                 "folder that farm init made (its coordinator.toml, worker-1.toml ...), or one file for all processes")
      ->check(CLI::ExistingPath);
  app.add_option("--port", options.port, "port of the HTTP API; 0: the former one, else any")
      ->check(CLI::Range(0, 65535));
  app.add_option("--host", options.host,
                 "address that the HTTP API listens on; by default this machine alone; others need TLS");
  app.add_option("--config", options.config,
                 "settings of the service: TLS, limits, notifications; by default config.toml of the state folder")
      ->check(CLI::ExistingFile);
  app.add_option("--ack-wait", options.ack_wait, "seconds after which a silent worker's units go to others")
      ->check(CLI::Range(0.5, 3600.0));
  app.footer(
      "Exit codes: 0 stopped; 2 usage, or a farm runs in this folder; 4 engine not to be had; 5 failed.\n\n"
      "Examples:\n  photonfarm farm --workers 4\n"
      "  photonfarm farm --workers 2 --state /var/lib/photonfarm --credentials /etc/photonfarm");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  if (options.state.empty())
    return report(context, {ErrorKind::kUsage, "no home folder to keep state in; expected --state DIR"});
  options.state = fs::absolute(options.state);
  if (!options.config.empty()) options.config = fs::absolute(options.config);
  if (!options.credentials.empty()) options.credentials = fs::absolute(options.credentials);
  const Result<void> ended = run_farm(context, options);
  return ended ? 0 : report(context, ended.error());
}

}  // namespace pf
