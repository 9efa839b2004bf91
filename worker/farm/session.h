#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/blob_store.h"
#include "common/wire/messages.h"
#include "common/wire/ports.h"
#include "worker/farm/executor.h"

namespace pf {

struct SessionOptions {
  std::string name;
  std::string host;
  std::uint64_t process = 0;
  std::uint64_t incarnation = 1;  ///< random: another process of the same name is another incarnation
  std::uint32_t threads = 1;
  std::string build_id;
  std::filesystem::path cache;  ///< bundles are laid out below it
};

/// A worker's part in the farm without its surroundings: takes units, fetches what they need, has them traced, merges
/// units of one round, sends the sums and holds on to its tasks until the coordinator has taken them in. All calls come
/// from one thread.
class Session {
 public:
  Session(SessionOptions options, WorkerPort& port, Executor& executor, BlobStore& blobs, const Clock& clock,
          const Log& log);

  void start();
  void on_task(const Delivery& delivery);
  void on_no_task();
  void on_message(std::string_view bytes);
  void on_done(WorkDone done);
  void tick();
  /// Takes no more work; ends when what it has is handed in.
  void drain();
  /// True when there is nothing left to do: after drain(), or when the coordinator does not want this worker
  /// (ended_badly).
  [[nodiscard]] bool finished() const { return finished_; }
  [[nodiscard]] const std::optional<Error>& ended_badly() const { return fatal_; }
  /// Gives back to the queue whatever is not handed in; for an end that cannot wait.
  void abandon();

 private:
  struct Held {  ///< traced units of one round, merged
    std::string job;
    std::uint64_t run = 0;
    std::uint64_t round_begin = 0;
    std::vector<wire::Unit> units;
    std::vector<std::uint64_t> handles;
    std::shared_ptr<Statistics> sums;
    double trace_seconds = 0;
    double since = 0;
  };
  struct Outgoing {  ///< a result on its way to the coordinator
    wire::ResultManifest manifest;
    std::uint64_t run = 0;
    std::vector<std::string> chunks;
    std::vector<std::uint64_t> handles;
    double started = 0;
    double last_word = 0;  ///< sent or heard
  };
  struct Current {  ///< the task in hand
    wire::Task task;
    std::vector<std::uint64_t> handles;
    bool working = false;
    bool dropped = false;  ///< its job ended while it was being worked on
  };
  struct Fetch {  ///< a blob on its way here
    BlobId blob;
    double asked = 0;
  };

  void want_work();
  void advance();
  [[nodiscard]] bool have(const BlobId& blob);
  [[nodiscard]] Result<bool> have_bundle(const wire::Task& task);
  void ask_for_blob();
  void on_blob_part(const wire::BlobPart& part);
  void on_reply(const wire::ResultReply& reply);
  void on_welcome(const wire::Welcome& welcome);
  void on_job_ended(const wire::JobEnded& ended);
  void begin_work();
  [[nodiscard]] Result<void> load_state(const wire::Task& task);
  [[nodiscard]] bool fits_held(const wire::Task& task) const;
  [[nodiscard]] bool is_mine_already(const wire::Task& task, std::uint64_t handle);
  void keep_units();
  void send_prepared(const PreparedScene& prepared);
  bool flush();
  void send_result(Outgoing outgoing);
  void announce_first();
  void let_first_go();
  void fail_current(const Error& error, bool permanent);
  /// Where a bundle is laid out on this worker.
  [[nodiscard]] std::filesystem::path folder_of(const wire::Task& task) const;
  /// `text` with paths as the bundle has them: where this worker keeps it helps nobody else.
  [[nodiscard]] std::string as_in_bundle(std::string text, const wire::Task& task) const;
  void hand_back_current(const Error& error);
  void acknowledge(const std::vector<std::uint64_t>& handles);
  void send_heartbeat();
  void send(wire::FromWorker& message);
  [[nodiscard]] double hold_seconds() const;
  void end_if_drained();

  SessionOptions options_;
  WorkerPort& port_;
  Executor& executor_;
  BlobStore& blobs_;
  const Clock& clock_;
  const Log& log_;
  std::optional<Current> current_;
  std::optional<Held> held_;
  std::deque<Outgoing> outgoing_;  ///< the first is on its way, the others wait for it
  std::optional<Fetch> fetch_;
  std::map<std::string, JobSpec> bundles_;  ///< laid out already
  std::string state_hash_;                  ///< of state_radii_
  std::shared_ptr<const std::vector<ProgressivePixel>> state_radii_;
  std::map<std::string, std::uint64_t> ended_runs_;  ///< of the latest few jobs
  std::optional<Error> fatal_;
  bool welcomed_ = false, told_to_idle_ = false, fetching_ = false, draining_ = false, finished_ = false;
  std::uint64_t next_result_ = 1;
  double ack_wait_ = 30, last_in_progress_ = 0, last_heartbeat_ = 0, last_transfer_ = 0, drain_since_ = 0,
         paused_until_ = 0;
  std::uint64_t rays_ = 0, photon_paths_ = 0, sub_passes_ = 0;
  double trace_seconds_ = 0;
};

}  // namespace pf
