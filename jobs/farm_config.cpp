#include "jobs/farm_config.h"

#include <sys/random.h>

#include <array>
#include <cerrno>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/wire/limits.h"
#include "common/wire/nats/subjects.h"

namespace pf {
namespace {

Result<std::string> random_password() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return fail(ErrorKind::kInternal,
                fmt::format("no random numbers for passwords: {}", std::generic_category().message(errno)));
  }
  std::string text;
  for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

/// A string of the server's configuration (and of TOML) in double quotes.
std::string in_quotes(std::string_view text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + '"';
}

std::string list(const std::vector<std::string>& subjects) {
  std::vector<std::string> all;
  all.reserve(subjects.size());
  for (const std::string& subject : subjects) all.push_back(in_quotes(subject));
  return fmt::format("[{}]", fmt::join(all, ", "));
}

std::vector<std::string> may_publish(const std::string& name) {
  const std::string stream = engine::kStream;
  const std::string consumer = stream + "." + engine::kConsumer;
  if (name != kCoordinatorUser) {
    return {engine::to_coordinator(name), engine::kNextTask, std::string(engine::kAckPrefix) + ">"};
  }
  return {engine::kTaskSubject,
          engine::to_worker("*"),
          engine::kAllWorkers,
          "$JS.API.STREAM.CREATE." + stream,
          "$JS.API.STREAM.UPDATE." + stream,
          "$JS.API.STREAM.INFO." + stream,
          "$JS.API.STREAM.PURGE." + stream,
          "$JS.API.CONSUMER.INFO." + consumer,
          "$JS.API.CONSUMER.DURABLE.CREATE." + consumer};
}

std::vector<std::string> may_subscribe(const std::string& name) {
  const std::string inbox = engine::inbox_prefix(name) + ".>";
  if (name == kCoordinatorUser) return {engine::kFromWorkers, inbox};
  return {engine::to_worker(name), engine::kAllWorkers, inbox};
}

}  // namespace

Result<std::vector<EngineUser>> make_users(int workers) {
  std::vector<EngineUser> users;
  for (int number = 0; number <= workers; ++number) {
    Result<std::string> password = random_password();
    if (!password) return tl::unexpected(password.error());
    users.push_back({number == 0 ? std::string(kCoordinatorUser) : worker_name(number), std::move(*password)});
  }
  return users;
}

std::string nats_config_text(const NatsConfig& config) {
  std::string text =
      "# nats-server of a photonfarm; made by photonfarm farm. Holds passwords: keep its mode at 0600.\n";
  text += fmt::format("listen: {}\n", in_quotes(fmt::format("{}:{}", config.host, config.port)));
  text += "server_name: photonfarm\n";
  text += fmt::format("max_payload: {}\n", kMaxMessageBytes);
  // What the server holds for a client that reads slowly, before it cuts it off.
  text += "max_pending: 268435456\nwrite_deadline: \"20s\"\n";
  if (!config.pid_file.empty()) text += fmt::format("pid_file: {}\n", in_quotes(config.pid_file));
  text += fmt::format("jetstream {{\n  store_dir: {}\n  max_memory_store: 67108864\n  max_file_store: 1073741824\n}}\n",
                      in_quotes(config.jetstream));
  if (!config.certificate.empty()) {
    // A busy machine may need seconds for a handshake.
    text += fmt::format("tls {{\n  cert_file: {}\n  key_file: {}\n  timeout: 10\n}}\n", in_quotes(config.certificate),
                        in_quotes(config.key));
  }
  text += "authorization {\n  timeout: 20\n  users: [\n";
  for (const EngineUser& user : config.users) {
    text += fmt::format(
        "    {{ user: {}, password: {}, permissions: {{\n        publish: {{ allow: {} }}\n"
        "        subscribe: {{ allow: {} }} }} }}\n",
        in_quotes(user.name), in_quotes(user.password), list(may_publish(user.name)), list(may_subscribe(user.name)));
  }
  return text + "  ]\n}\n";
}

std::string credentials_text(const std::string& url, const EngineUser& user, const std::string& ca) {
  std::string text = "# For --credentials of a photonfarm process. Holds a password: keep its mode at 0600.\n";
  text += fmt::format("url = {}\nname = {}\nuser = {}\npassword = {}\n", in_quotes(url), in_quotes(user.name),
                      in_quotes(user.name), in_quotes(user.password));
  if (!ca.empty()) text += fmt::format("ca = {}\n", in_quotes(ca));
  return text;
}

std::string service_config_text() {
  return "# For --config of photonfarm-coordinator and photonfarm farm; coordinator/README.md has every key.\n"
         "[http]\nhost = \"0.0.0.0\"\ncertificate = \"server.pem\"\nkey = \"server-key.pem\"\nca = \"ca.pem\"\n";
}

std::filesystem::path credentials_file(const std::filesystem::path& folder, std::string_view name) {
  return folder / fmt::format("{}.toml", name);
}

std::string worker_name(int number) { return fmt::format("worker-{}", number); }

}  // namespace pf
