#include "jobs/farm_init.h"

#include <sys/stat.h>

#include <ostream>
#include <utility>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "common/base/atomic_file.h"
#include "jobs/farm_certificates.h"
#include "jobs/farm_config.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

Result<void> make_empty_folder(const fs::path& folder) {
  std::error_code error;
  if (fs::exists(folder, error) && (!fs::is_directory(folder, error) || !fs::is_empty(folder, error))) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: is there already; expected a new or empty folder, for nothing is overwritten",
                            folder.string()));
  }
  fs::create_directories(folder, error);
  if (error) return fail(ErrorKind::kInternal, fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
  if (chmod(folder.c_str(), 0700) != 0) return fail(ErrorKind::kInternal, folder.string() + ": its mode cannot be set");
  return {};
}

}  // namespace

Result<void> make_farm_folder(const FarmInitOptions& options) {
  const Result<Certificates> certificates = make_certificates(options.hosts);
  if (!certificates) return tl::unexpected(certificates.error());
  Result<std::vector<EngineUser>> users = make_users(options.workers);
  if (!users) return tl::unexpected(users.error());
  if (Result<void> made = make_empty_folder(options.folder); !made) return made;

  NatsConfig config;
  config.host = "0.0.0.0";
  config.port = options.port;
  // Relative to where the server is started: the folder may be moved to the machine that runs it.
  config.jetstream = "jetstream";
  config.certificate = "server.pem";
  config.key = "server-key.pem";
  config.users = std::move(*users);
  const std::string url =
      fmt::format("tls://{}:{}", options.hosts.empty() ? "localhost" : options.hosts.front(), options.port);

  std::vector<std::pair<std::string, std::string>> files = {{"ca.pem", certificates->ca},
                                                            {"ca-key.pem", certificates->ca_key},
                                                            {"server.pem", certificates->server},
                                                            {"server-key.pem", certificates->server_key},
                                                            {"nats-server.conf", nats_config_text(config)}};
  files.emplace_back("config.toml", service_config_text());
  for (const EngineUser& user : config.users)
    files.emplace_back(user.name + ".toml", credentials_text(url, user, "ca.pem"));
  for (const auto& [name, text] : files) {
    const bool secret = name != "ca.pem" && name != "server.pem";
    Result<void> written =
        write_file_atomically(options.folder / name, text, secret ? FileAccess::kOwnerOnly : FileAccess::kByUmask);
    if (!written) return written;
  }
  return {};
}

int run_farm_init_command(const Context& context, const Arguments& arguments) {
  FarmInitOptions options;
  CLI::App app(
      "Makes what a farm of several machines needs: a certificate authority, TLS certificate, users with random\n"
      "passwords and the least permissions, nats-server.conf, and a credentials file for each process.",
      "photonfarm farm init");
  app.add_option("--dir", options.folder, "folder to make; nothing that exists is overwritten")->required();
  app.add_option("--hosts", options.hosts, "names or addresses of the server's machine, separated by commas")
      ->delimiter(',');
  app.add_option("--workers", options.workers, "number of workers that get a user")
      ->capture_default_str()
      ->check(CLI::Range(1, 4096));
  app.add_option("--port", options.port, "port of the server")->capture_default_str()->check(CLI::Range(1, 65535));
  app.footer(
      "Passwords stand in the files as they are; all but ca.pem and server.pem are for their owner alone (0600).\n\n"
      "Example:\n  photonfarm farm init --dir /etc/photonfarm --hosts render1.example.org --workers 32");
  if (const std::optional<int> code = parse_arguments(app, context, arguments)) return *code;
  if (const Result<void> made = make_farm_folder(options); !made) {
    context.err << "photonfarm farm init: " << made.error().message << '\n';
    return exit_code(made.error().kind);
  }
  const std::string folder = options.folder.string();
  context.out << fmt::format(
      "{0}: certificates, users for a coordinator and {1} workers, settings. Next:\n"
      "  on the server:       cd {0} && nats-server -c nats-server.conf\n"
      "  the coordinator:     photonfarm-coordinator --state DIR --credentials {0}/coordinator.toml --config "
      "{0}/config.toml\n"
      "  each worker:         photonfarm-worker serve --credentials worker-I.toml   (copy it and ca.pem there, mode "
      "0600)\n"
      "  all on one machine:  photonfarm farm --credentials {0} --config {0}/config.toml\n"
      "  the command:         photonfarm list --server https://HOST:PORT --ca {0}/ca.pem   (PHOTONFARM_TOKEN: see "
      "'photonfarm token create')\n"
      "Keep ca-key.pem away from the others: whoever has it can pretend to be the server.\n",
      folder, options.workers);
  return 0;
}

}  // namespace pf
