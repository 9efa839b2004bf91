#include "jobs/client_command.h"

#include <algorithm>
#include <memory>
#include <ostream>
#include <utility>

#include <fmt/format.h>

#include "jobs/job_text.h"
#include "jobs/remote_jobs.h"

namespace pf {
namespace {

constexpr double kFirstSeconds = 5;  // a farm that was just started may not listen yet

}  // namespace

ClientCommand::ClientCommand(const Context& context, std::string name, const std::string& summary)
    : context_(context), name_(std::move(name)), app_(summary, "photonfarm " + name_) {
  app_.add_option("--server", server_,
                  "URL of the service (its token in PHOTONFARM_TOKEN) or a farm's state folder; default "
                  "PHOTONFARM_SERVER, else " +
                      context.state.string());
  app_.add_option("--ca", ca_,
                  "certificates (PEM) that an https service is checked by; default: the state folder's ca.pem, else "
                  "the system's");
  app_.add_option("--retry", retry_seconds_, "seconds to keep trying while the service is away")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app_.add_flag("--json", json_, "one JSON document on standard output, and nothing else there");
}

std::optional<int> ClientCommand::parse(const Arguments& arguments) {
  if (const auto code = parse_arguments(app_, context_, arguments)) return code;
  ServiceOptions options;
  options.server = !server_.empty() ? server_ : !context_.server.empty() ? context_.server : context_.state.string();
  options.token = context_.token;
  options.ca = ca_;
  options.retry_seconds = retry_seconds_;
  options.first_seconds = std::min(kFirstSeconds, retry_seconds_);
  options.interrupted = &interrupts_.flag();
  options.notice = [this](const std::string& text) { note(text); };
  client_ = std::make_unique<ServiceClient>(std::move(options));
  return std::nullopt;
}

int ClientCommand::print(const nlohmann::json& document) const {
  context_.out << document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
  return 0;
}

int ClientCommand::report(const Error& error) const {
  note(error.message);
  return exit_code(error.kind);
}

void ClientCommand::note(std::string_view text) const {
  context_.err << fmt::format("photonfarm {}: {}\n", name_, text) << std::flush;
}

int ClientCommand::watch(nlohmann::json& job) {
  const std::string id = job_text(job, "id");
  const auto style = context_.terminal ? StatusLine::Style::kBar : StatusLine::Style::kLines;
  StatusLine line(clock_, context_.err, style, context_.columns);
  std::string state;
  const auto ended = watch_job(client(), id, [&](const nlohmann::json& now) {
    // Elsewhere than on a terminal a new state is worth a line of its own.
    const bool changed = style == StatusLine::Style::kLines && job_text(now, "state") != state && !job_has_ended(now);
    if (line.due() || changed) line.show(job_line(now, style));
    state = job_text(now, "state");
    job = now;
  });
  if (!ended) {
    if (style == StatusLine::Style::kBar) context_.err << '\n';
    if (ended.error().kind != ErrorKind::kInterrupted) return report(ended.error());
    note(fmt::format("the job goes on; 'photonfarm watch {0}' shows it again, 'photonfarm cancel {0}' ends it", id));
    return exit_code(ErrorKind::kInterrupted);
  }
  line.finish(job_line(*ended, style));
  for (const auto& warning : ended->value("warnings", nlohmann::json::array())) {
    if (warning.is_string()) context_.err << "warning: " << warning.get<std::string>() << '\n';
  }
  const std::string end = job_text(*ended, "state"), message = job_text(*ended, "message");
  if (end == "done") return 0;
  note(fmt::format("{} {}{}{}; 'photonfarm logs {}' says more", id, end == "failed" ? "failed" : "was cancelled",
                   message.empty() ? "" : ": ", message, id));
  return exit_code(ErrorKind::kInternal);
}

}  // namespace pf
