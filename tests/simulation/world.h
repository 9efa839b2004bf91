#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <queue>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/wire/blob_store.h"
#include "coordinator/farm.h"
#include "tests/support/temp_folder.h"
#include "worker/farm/session.h"

namespace pf::test {

/// Simulated seconds that no schedule needs: beyond them something is stuck.
inline constexpr double kStuck = 5000.0;

/// How badly the world behaves. Probabilities are per message, rates per simulated second.
struct Mischief {
  double drop = 0, repeat = 0, delay = 0, corrupt_chunk = 0;
  double kill_worker = 0, stop_worker = 0, kill_coordinator = 0, kill_engine = 0;
  double lose_queue = 0;  ///< that an engine which was killed comes back without its tasks
  double fill_disk = 0;   ///< no file can grow any more, for a while
};

/// What a lying worker does with its sums.
enum class Lie { kNone, kWrongHash, kOtherSums, kNanFigures, kOtherBuild };

/// A farm in one thread with a clock of its own: the real coordinator and worker cores over an engine that loses,
/// repeats, delays and reorders messages, with processes that die and come back. One seed, one schedule.
class World {
 public:
  World(std::uint64_t seed, Mischief mischief);
  ~World();

  void add_worker(const std::string& name, Lie lie = Lie::kNone);
  /// Submits a job; its tracing is a pure function of spec, sub-pass and radii.
  std::string submit(const JobSpec& spec);
  [[nodiscard]] Submission submission(const JobSpec& spec);
  /// Runs until all jobs have ended; false when `seconds` of simulated time did not suffice.
  [[nodiscard]] bool run(double seconds);
  void run_for(double seconds);
  /// What stands where; for failures.
  [[nodiscard]] std::string describe();
  [[nodiscard]] Farm& farm() { return *farm_; }
  [[nodiscard]] double now() const { return clock_.now(); }
  [[nodiscard]] std::uint64_t traced() const { return traced_; }
  void kill_coordinator();
  void kill_worker(const std::string& name);
  /// It never comes back.
  void lose_worker(const std::string& name);
  void lose_queue() { tasks_.clear(), task_ids_.clear(); }
  void fill_disk(bool full);
  /// Of coordinators that start from now on.
  void keep(const RetentionPolicy& policy) { retention_ = policy; }
  void limit_jobs_per_token(std::uint64_t most) { jobs_per_token_ = most; }
  [[nodiscard]] const std::filesystem::path& state() const { return folder_.path(); }

 private:
  struct Process;
  struct WorkerDoor;
  struct CoordinatorDoor;
  struct FakeExecutor;
  struct Task {
    std::string bytes;
    std::string holder;  ///< empty: in the queue
    std::uint64_t holder_incarnation = 0;
    double deadline = 0;  ///< of the holder's next word
  };

  void at(double time, std::function<void()> action);
  /// Like at(), for a worker that may be stopped then, or dead: later, or never.
  void at_worker(double time, const std::string& name, std::uint64_t incarnation,
                 std::function<void(Process& process)> action);
  void step();
  void start_worker(const std::string& name);
  void start_coordinator();
  void hand_out();
  void to_coordinator(const std::string& sender, std::string bytes);
  void to_worker(const std::string& name, std::string bytes);
  void deliver(const std::function<void()>& arrive);
  void misbehave();
  [[nodiscard]] double random();
  [[nodiscard]] bool chance(double p) { return random() < p; }

  TempFolder folder_;
  FakeClock clock_;
  std::mt19937_64 rng_;
  Mischief mischief_;
  Log log_;
  struct Event {
    double time;
    std::uint64_t order;
    std::function<void()> action;
    bool operator<(const Event& other) const { return std::tie(time, order) > std::tie(other.time, other.order); }
  };
  std::priority_queue<Event> events_;
  std::uint64_t order_ = 0;
  std::map<std::uint64_t, Task> tasks_;
  std::map<std::string, double> task_ids_;
  std::uint64_t next_task_ = 1;
  bool engine_up_ = true;
  std::map<std::string, std::unique_ptr<Process>> workers_;
  std::unique_ptr<CoordinatorDoor> coordinator_door_;
  std::unique_ptr<BlobStore> blobs_;
  std::unique_ptr<Farm> farm_;
  std::uint64_t incarnation_ = 1;
  std::uint64_t traced_ = 0;
  bool disk_full_ = false;
  RetentionPolicy retention_;
  std::uint64_t jobs_per_token_ = FarmOptions().jobs_per_token;
};

/// Adds what the pretended algorithm finds in the sub-passes.
void pretend_to_trace(const JobSpec& spec, std::uint64_t first, std::uint64_t count,
                      const std::vector<ProgressivePixel>& state, Statistics& sums);
[[nodiscard]] FilmOptions pretended_film(const JobSpec& spec);
[[nodiscard]] std::vector<ProgressivePixel> pretended_radii(const JobSpec& spec);
/// Hash of the image that one undisturbed machine makes.
[[nodiscard]] std::string hash_of_single_node(const JobSpec& spec);

/// A job of 5x3 pixels for the simulated farm.
[[nodiscard]] JobSpec job_of(const std::string& name, IntegratorType type, ProgressiveMode mode, int passes);

}  // namespace pf::test
