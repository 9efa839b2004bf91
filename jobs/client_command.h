#pragma once

#include <string>
#include <string_view>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "common/base/clock.h"
#include "common/base/result.h"
#include "common/base/status_line.h"
#include "jobs/command.h"
#include "jobs/interrupt.h"
#include "jobs/service_client.h"

namespace pf {

inline constexpr const char* kJobHelp = "the job: its id, the begin of it, or its name (the one submitted last)";

/// What every command that speaks to a service has in common: its options, its client, how it reports.
class ClientCommand {
 public:
  ClientCommand(const Context& context, std::string name, const std::string& summary);

  /// For the command's own arguments; --server, --ca, --json and --retry are there.
  [[nodiscard]] CLI::App& app() { return app_; }
  void examples(const std::string& text) { app_.footer("Examples:\n" + text); }
  /// As parse_arguments; afterwards client() may be used.
  [[nodiscard]] std::optional<int> parse(const Arguments& arguments);

  [[nodiscard]] const Context& context() const { return context_; }
  [[nodiscard]] ServiceClient& client() { return *client_; }
  [[nodiscard]] bool json() const { return json_; }

  /// Writes one JSON document.
  int print(const nlohmann::json& document) const;
  /// Writes the error to standard error; returns its exit code.
  int report(const Error& error) const;
  /// A line to standard error.
  void note(std::string_view text) const;

  /// Shows a job until it has ended. Exit code 0 when it is done, 5 when it failed or was cancelled (said on
  /// standard error); interrupted: says that it goes on, 130. `job` becomes the last view.
  [[nodiscard]] int watch(nlohmann::json& job);

 private:
  const Context& context_;
  std::string name_;
  CLI::App app_;
  InterruptGuard interrupts_;
  SystemClock clock_;
  std::string server_, ca_;
  double retry_seconds_ = 60;
  bool json_ = false;
  std::unique_ptr<ServiceClient> client_;
};

}  // namespace pf
