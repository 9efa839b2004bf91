#include <ostream>

#include <fmt/format.h>

#include "jobs/client_command.h"
#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

using nlohmann::json;

/// Writes entries as they come: lines for people, or the elements of one JSON array.
class LogPrinter {
 public:
  LogPrinter(std::ostream& out, bool as_json) : out_(out), json_(as_json) {}

  void read(std::string_view piece) {
    for (const char c : piece) {
      if (c != '\n') {
        line_ += c;
        continue;
      }
      print(json::parse(line_, nullptr, false));
      line_.clear();
    }
    out_ << std::flush;
  }
  void finish() {
    if (json_) out_ << (first_ ? "{\"entries\": []}\n" : "\n]}\n");
  }
  /// Number of the last entry written.
  [[nodiscard]] std::uint64_t last() const { return last_; }
  /// Drops a line that broke off.
  void restart() { line_.clear(); }

 private:
  void print(const json& entry) {
    if (!entry.is_object()) return;  // the empty lines between
    last_ = static_cast<std::uint64_t>(job_number(entry, "number"));
    if (json_) {
      out_ << (first_ ? "{\"entries\": [\n" : ",\n") << entry.dump(-1, ' ', false, json::error_handler_t::replace);
    } else {
      out_ << log_line(entry);
    }
    first_ = false;
  }

  std::ostream& out_;
  bool json_, first_ = true;
  std::string line_;
  std::uint64_t last_ = 0;
};

Result<void> print_logs(ServiceClient& client, const std::string& id, bool follow, LogPrinter& printer) {
  while (true) {
    printer.restart();
    ServiceCall call{.path = fmt::format("/v1/jobs/{}/logs?after={}&follow={}", id, printer.last(), follow ? 1 : 0)};
    call.take = [&](std::string_view piece) {
      printer.read(piece);
      return true;
    };
    const auto reply = client.try_call(call);
    if (reply && reply->status != 503) return client.check(*reply);
    const Error error = reply ? client.check(*reply).error() : reply.error();
    if (error.kind != ErrorKind::kUnavailable) return tl::unexpected(error);
    if (auto waited = client.wait_to_retry(error); !waited) return waited;
  }
}

}  // namespace

int run_logs_command(const Context& context, const Arguments& arguments) {
  std::string what;
  bool follow = false;
  ClientCommand command(context, "logs", "Prints what coordinator and workers logged about a job.");
  command.app().add_option("JOB", what, kJobHelp)->required();
  command.app().add_flag("--follow", follow, "go on until the job has ended");
  command.examples("  photonfarm logs glass-caustic\n  photonfarm logs glass-caustic --follow");
  if (const auto code = command.parse(arguments)) return *code;
  const auto job = find_job(command.client(), what, false);
  if (!job) return command.report(job.error());
  LogPrinter printer(context.out, command.json());
  const auto printed = print_logs(command.client(), job_text(*job, "id"), follow, printer);
  printer.finish();
  if (printed) return 0;
  return printed.error().kind == ErrorKind::kInterrupted ? exit_code(ErrorKind::kInterrupted)
                                                         : command.report(printed.error());
}

}  // namespace pf
