#include "tests/farm/farm_fixture.h"

#include <iostream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/spec/job_spec.h"
#include "jobs/submission.h"
#include "tests/support/paths.h"

namespace pf::farm_test {

namespace fs = std::filesystem;

namespace {

constexpr int kUsers = 6;                 // worker-1 ... worker-6 have passwords
constexpr std::size_t kLastBytes = 6000;  // of a process's output, when a test fails
const fs::path kJob = test::source_dir() / "jobs" / "peer-box.toml";
const fs::path kBin = test::bin_dir();

fs::path find_server() {
  const char* path = std::getenv("PATH");
  return find_program("nats-server", std::string(path == nullptr ? "" : path) + ":/usr/sbin");
}

}  // namespace

std::vector<std::string> TestJob::settings() const {
  std::vector<std::string> all = {fmt::format("job.name={}", name),
                                  fmt::format("job.priority={}", priority),
                                  "image.width=48",
                                  "image.height=48",
                                  fmt::format("integrator.photons={}", photons),
                                  fmt::format("integrator.type={}", type),
                                  fmt::format("integrator.mode={}", mode),
                                  fmt::format("stop.passes={}", passes),
                                  fmt::format("checkpoint.seconds={}", checkpoint_seconds)};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

void FarmFaults::SetUp() {
  if (find_server().empty()) FAIL() << "no nats-server here; deploy/install brings it";
  if (!fs::exists(kBin / "photonfarm-worker")) FAIL() << "photonfarm-worker has not been built";
  state_ = folder_.path() / "state";
  fs::create_directories(state_);
}

void FarmFaults::TearDown() {
  workers_.clear();
  coordinator_.reset();
  engine_.reset();
  if (!HasFailure()) return;
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    if (entry.path().extension() != ".log") continue;
    const std::string text = text_of(entry.path().stem().string());
    std::cerr << "--- " << entry.path().filename().string() << '\n'
              << text.substr(text.size() - std::min(text.size(), kLastBytes)) << '\n';
  }
}

Child FarmFaults::start(const fs::path& program, const std::vector<std::string>& arguments, const std::string& log) {
  auto child = Child::start({program, arguments, folder_.path() / (log + ".log")});
  if (!child) throw std::runtime_error(child.error().message);
  return std::move(*child);
}

std::string FarmFaults::engine_url() const {
  return fmt::format("nats://{}:{}", address_.empty() ? "127.0.0.1" : address_, server_->port());
}

void FarmFaults::start_farm(int workers) {
  NatsServerOptions options;
  options.program = find_server();
  options.folder = folder_.path() / "engine";
  options.log = folder_.path() / "nats-server.log";
  options.workers = kUsers;
  auto prepared = NatsServer::prepare(options);
  ASSERT_TRUE(prepared) << prepared.error().message;
  server_.emplace(std::move(*prepared));
  if (!address_.empty()) {
    // The farm's own server listens on loopback alone; this one stands between hosts.
    const fs::path file = options.folder / "nats-server.conf";
    std::string text = read_file(file, 1 << 20).value_or("");
    const std::size_t place = text.find("127.0.0.1:");
    ASSERT_NE(place, std::string::npos);
    text.replace(place, std::string("127.0.0.1").size(), "0.0.0.0");
    ASSERT_TRUE(write_file_atomically(file, text, FileAccess::kOwnerOnly));
  }
  start_engine();
  start_coordinator();
  for (int number = 1; number <= workers; ++number) start_worker(number);
}

void FarmFaults::start_engine() {
  engine_.reset();
  auto child = server_->launch();
  ASSERT_TRUE(child) << child.error().message;
  engine_.emplace(std::move(*child));
}

void FarmFaults::start_coordinator() {
  coordinator_.reset();
  coordinator_.emplace(start(kBin / "photonfarm-coordinator",
                             {"--state", state_.string(), "--credentials", server_->credentials("coordinator").string(),
                              "--engine", engine_url(), "--ack-wait", fmt::format("{}", ack_wait_)},
                             "coordinator"));
  ASSERT_TRUE(wait_until([&] { return fs::exists(state_ / "url"); }, kPatience));
}

void FarmFaults::start_worker(int number) {
  workers_.erase(number);
  std::vector<std::string> words = worker_prefix_;
  const std::string name = worker_name(number);
  for (const std::string& word :
       {(kBin / "photonfarm-worker").string(), std::string("serve"), std::string("--credentials"),
        server_->credentials(name).string(), std::string("--engine"), engine_url(), std::string("--threads"),
        std::string("1"), std::string("--cache"), (folder_.path() / "cache").string()}) {
    words.push_back(word);
  }
  const std::string program = words.front();
  words.erase(words.begin());
  workers_.emplace(number, start(program, words, name));
}

ServiceClient& FarmFaults::client() {
  if (!client_) {
    ServiceOptions options;
    options.server = state_.string();
    options.retry_seconds = options.first_seconds = kStuck;
    client_ = std::make_unique<ServiceClient>(options);
  }
  return *client_;
}

std::string FarmFaults::submit(const TestJob& job) {
  const auto spec = load_job(kJob, job.settings());
  EXPECT_TRUE(spec) << spec.error().message;
  const auto files = hash_files(*spec);
  EXPECT_TRUE(files) << files.error().message;
  const auto submitted = submit_job(client(), *spec, *files);
  if (!submitted) throw std::runtime_error(submitted.error().message);
  return submitted->at("id").get<std::string>();
}

nlohmann::json FarmFaults::ask(const std::string& path) {
  auto answer = client().ask({.path = path}, true);
  if (!answer) throw std::runtime_error(answer.error().message);
  return *answer;
}

nlohmann::json FarmFaults::show(const std::string& id) { return ask("/v1/jobs/" + id); }

bool FarmFaults::has_ended(const std::string& id) {
  const std::string state = show(id).value("state", "failed");
  return state == "done" || state == "failed" || state == "cancelled";
}

void FarmFaults::cancel(const std::string& id) {
  const auto answer = client().ask({.method = "POST", .path = "/v1/jobs/" + id + "/cancel"}, true);
  EXPECT_TRUE(answer) << answer.error().message;
}

nlohmann::json FarmFaults::farm_workers() { return ask("/v1/workers").at("workers"); }

std::string FarmFaults::job_log(const std::string& id) {
  const auto reply = client().call({.path = "/v1/jobs/" + id + "/logs?after=0"});
  EXPECT_TRUE(reply) << reply.error().message;
  return reply ? reply->body : std::string();
}

bool FarmFaults::wait_until(const std::function<bool()>& condition, double seconds) {
  const auto deadline = in(seconds);
  while (!condition()) {
    if (steady_clock::now() > deadline) return false;
    wait_readable(-1, in(0.02));
  }
  return true;
}

void FarmFaults::wait_for_passes(const std::string& id, int passes) {
  ASSERT_TRUE(wait_until([&] { return passes_done(id) >= passes; })) << show(id).dump(2);
}

void FarmFaults::expect_the_single_nodes_image(const std::string& id, const TestJob& job, double seconds) {
  EXPECT_TRUE(wait_until([&] { return has_ended(id); }, seconds)) << "stuck: " << show(id).dump(2) << job_log(id);
  const nlohmann::json view = show(id);
  EXPECT_EQ(view.value("state", ""), "done") << view.dump(2);
  EXPECT_EQ(view.value("passes_done", 0), job.passes);
  EXPECT_EQ(view.value("image_hash", ""), hash_of_single_node(job)) << view.dump(2);
}

std::string FarmFaults::hash_of_single_node(const TestJob& job) {
  std::string& hash = hashes_[fmt::format("{}", fmt::join(job.settings(), " "))];
  if (!hash.empty()) return hash;
  const fs::path out = folder_.path() / "single" / job.name;
  std::vector<std::string> words = {"render", kJob.string(), "--threads", "1", "--out", out.string()};
  for (const std::string& setting : job.settings()) {
    words.push_back("--set");
    words.push_back(setting);
  }
  Child render = start(kBin / "photonfarm-worker", words, "single");
  const auto end = render.wait(in(kStuck));
  EXPECT_TRUE(end && end->signal == 0 && end->exit_code == 0) << text_of("single");
  const auto json = nlohmann::json::parse(read_file(out / (job.name + ".json"), 1 << 20).value_or(""), nullptr, false);
  if (json.is_object()) hash = json.value("image_hash", "none");
  return hash;
}

std::string FarmFaults::text_of(const std::string& log) const {
  return read_file(folder_.path() / (log + ".log"), std::uint64_t{1} << 28).value_or("");
}

HandledWorker::Options FarmFaults::handled(int number, HandledWorker::Handle handle) const {
  HandledWorker::Options options;
  auto engine = load_credentials(server_->credentials(worker_name(number)));
  EXPECT_TRUE(engine) << engine.error().message;
  if (engine) options.engine = *engine;
  options.cache = folder_.path() / "handled";
  options.handle = std::move(handle);
  return options;
}

}  // namespace pf::farm_test
