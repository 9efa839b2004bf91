#include "jobs/state_doctor.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "common/film/film.h"
#include "common/film/render_result.h"
#include "coordinator/store/job_store.h"
#include "coordinator/store/schema.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

constexpr int kTries = 3;  // of copying a database that a farm writes to meanwhile

/// A folder that goes with this object.
class Copy {
 public:
  explicit Copy(const fs::path& temporary) {
    std::string name = (temporary / "photonfarm-doctor-XXXXXX").string();
    if (mkdtemp(name.data()) != nullptr) folder_ = name;
  }
  ~Copy() {
    std::error_code ignored;
    if (!folder_.empty()) fs::remove_all(folder_, ignored);
  }
  Copy(const Copy&) = delete;
  Copy& operator=(const Copy&) = delete;
  /// Of the database and its log.
  [[nodiscard]] std::error_code take(const fs::path& file) const {
    std::error_code error;
    if (folder_.empty()) return std::make_error_code(std::errc::io_error);
    for (const char* end : {"", "-wal"}) {
      const fs::path from = file.string() + end, to = folder_ / (file.filename().string() + end);
      fs::remove(to, error);
      if (!fs::exists(from, error)) continue;
      fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
      if (error) return error;
    }
    return {};
  }
  [[nodiscard]] fs::path path(const fs::path& file) const { return folder_ / file.filename(); }

 private:
  fs::path folder_;
};

class Examination {
 public:
  Examination(fs::path state, fs::path temporary, std::string build_id)
      : state_(std::move(state)), temporary_(std::move(temporary)), build_id_(std::move(build_id)) {}

  [[nodiscard]] std::vector<Check> run() {
    look_at_lock();
    look_at_space();
    look_at_secrets();
    const Copy copy(temporary_);
    if (open_database(copy)) {
      look_at_jobs();
      look_for_orphans();
    }
    return std::move(checks_);
  }

 private:
  void add(std::string name, Health health, std::string found, std::string hint = {}) {
    checks_.push_back({std::move(name), health, std::move(found), std::move(hint)});
  }

  void look_at_lock() {
    const fs::path file = state_ / "farm.pid";
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    runs_ = fd >= 0 && flock(fd, LOCK_SH | LOCK_NB) != 0;
    if (fd >= 0) ::close(fd);
    std::string pid = read_file(file, 64).value_or("");
    pid.erase(pid.find_last_not_of('\n') + 1);
    add("lock", Health::kOk, runs_ ? fmt::format("a farm runs here, process {}", pid) : "no farm runs here");
  }

  void look_at_space() {
    std::error_code error;
    const auto space = fs::space(state_, error);
    checks_.push_back(judge_disk(error ? 0 : space.available));
  }

  void look_at_secrets() {
    struct stat found {};
    const fs::path token = state_ / "token";
    if (::stat(token.c_str(), &found) != 0) {
      add("token", Health::kNote, "there is none", "the farm makes one when it starts");
    } else if ((found.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
      add("token", Health::kBad, "others may read it",
          fmt::format("chmod 600 {}; if they may have, remove it and start the farm again", token.string()));
    } else {
      add("token", Health::kOk, "only its owner may read it");
    }
  }

  [[nodiscard]] bool open_database(const Copy& copy) {
    const fs::path file = state_ / JobStore::kFileName;
    std::error_code ignored;
    if (!fs::exists(file, ignored)) {
      add("database", Health::kNote, fmt::format("{} does not exist", file.string()),
          "the farm makes it when it starts, and takes in jobs of before");
      return false;
    }
    std::string why;
    ErrorKind kind = ErrorKind::kInternal;
    for (int i = 0; i < (runs_ ? kTries : 1); ++i) {
      if (const auto error = copy.take(file)) {
        add("database", Health::kBad, fmt::format("cannot be copied to {}: {}", temporary_.string(), error.message()),
            "make space there, or set TMPDIR");
        return false;
      }
      const auto whole = check_integrity(copy.path(file));
      if (whole) return true;
      why = whole.error().message;
      kind = whole.error().kind;
    }
    const std::string_view hint = kind == ErrorKind::kUsage ? "use the photonfarm that wrote it, or a newer one"
                                  : kind == ErrorKind::kInvalidInput
                                      ? "stop the farm, move farm.sqlite and farm.sqlite-wal away and put a backup "
                                        "there; `sqlite3 farm.sqlite .recover` saves "
                                        "what can be read; images stay in jobs/"
                                      : "the disk may be failing: see the system's log";
    add("database", Health::kBad, why, std::string(hint));
    return false;
  }

  [[nodiscard]] Result<void> check_integrity(const fs::path& file) {
    std::int64_t version = 0;
    {
      const auto database = Database::open(file);
      if (!database) return tl::unexpected(database.error());
      auto statement = database->prepare("PRAGMA integrity_check");
      if (!statement) return tl::unexpected(statement.error());
      const auto row = statement->step();
      if (!row) return tl::unexpected(row.error());
      if (statement->text(0) != "ok") return fail(ErrorKind::kInvalidInput, "damaged: " + statement->text(0));
      auto loose = database->prepare("PRAGMA foreign_key_check");
      if (!loose) return tl::unexpected(loose.error());
      const auto first = loose->step();
      if (!first) return tl::unexpected(first.error());
      if (*first)
        return fail(ErrorKind::kInvalidInput,
                    fmt::format("damaged: {} holds rows of a job that is not there", loose->text(0)));
      version = database->number("PRAGMA user_version").value_or(0);
    }
    auto store = JobStore::open(file);  // the copy is migrated too: what would fail then is found now
    if (!store) return tl::unexpected(store.error());
    store_.emplace(std::move(*store));
    if (version == schema_version()) {
      add("database", Health::kOk, fmt::format("whole, schema version {}", version));
    } else {
      add("database", Health::kNote, fmt::format("whole, schema version {}", version),
          fmt::format("the farm brings it to version {} when it starts", schema_version()));
    }
    return {};
  }

  void look_at_jobs() {
    const auto loaded = store_->load();
    if (!loaded) return add("jobs", Health::kBad, loaded.error().message);
    for (const auto& [id, why] : loaded->broken) {
      ids_.insert(id);
      add(id, Health::kBad, "its record cannot be used: " + why,
          "the farm leaves it out; a newer photonfarm may have written it");
    }
    const std::size_t before = checks_.size();
    for (const JobRecord& job : loaded->records) {
      ids_.insert(job.id);
      look_at_job(job);
    }
    add("jobs", Health::kOk,
        fmt::format("{} in the database, {} findings", loaded->records.size() + loaded->broken.size(),
                    checks_.size() - before + loaded->broken.size()));
  }

  void look_at_job(const JobRecord& job) {
    const fs::path folder = state_ / "jobs" / job.id;
    const auto history = store_->transitions(job.number);
    if (!history) {
      add(job.id, Health::kBad, history.error().message, "the image is not touched by this; report it");
    } else if (!history->empty() && history->back().to != job.state) {
      add(job.id, Health::kBad,
          fmt::format("is {}, but its last transition led to {}", to_string(job.state), to_string(history->back().to)),
          "the image is not touched by this; report it");
    }
    if (job.bundle.bytes > 0) look_at_blobs(job);
    look_at_checkpoint(job, folder / "film.checkpoint");
    const bool expired = std::find(job.expired.begin(), job.expired.end(), "results") != job.expired.end();
    if (job.state != JobState::kDone || expired) return;
    const OutputPaths paths(folder, job.spec.job.name);
    std::error_code ignored;
    for (const fs::path& file : {paths.exr, paths.png, paths.json}) {
      if (fs::exists(file, ignored)) continue;
      add(job.id, Health::kBad, fmt::format("{} is missing", file.string()),
          "extend the job by a pass: it is written again");
    }
  }

  void look_at_checkpoint(const JobRecord& job, const fs::path& file) {
    std::error_code ignored;
    const bool expired = std::find(job.expired.begin(), job.expired.end(), "checkpoint") != job.expired.end();
    const bool discarded = job.bundle.bytes == 0;
    if (!fs::exists(file, ignored)) {
      const bool expected = job.figures.passes > 0 && !expired && !discarded;
      if (!expected) return;
      if (has_ended(job.state))
        return add(job.id, Health::kNote, "its checkpoint is missing",
                   "it cannot be extended; the image is not touched by this");
      return add(job.id, Health::kBad, fmt::format("{} is missing", file.string()),
                 "the job starts from the beginning when the farm starts");
    }
    std::string attachment;
    const auto film = Film::load(file, checkpoint_identity(job, build_id_), &attachment);
    if (film) {
      if (const auto note = CheckpointNote::from_json(attachment); !note)
        add(job.id, Health::kBad, note.error().message, "retry the job");
      return;
    }
    // A farm that runs may have replaced it just now, and ended the job with it.
    const bool damaged = film.error().message.find("not a whole checkpoint") != std::string::npos;
    if (damaged) {
      add(job.id, Health::kBad, film.error().message,
          has_ended(job.state) ? "it cannot be extended; the image is not touched by this"
                               : "retry the job: it starts from the beginning");
    } else if (!has_ended(job.state)) {
      add(job.id, Health::kNote, film.error().message,
          "an image's bits depend on the build: only the one that wrote it can go on");
    }
  }

  void look_at_blobs(const JobRecord& job) {
    Statement rows = std::move(*store_->database().prepare("SELECT sha256, bytes FROM blobs WHERE job = ?1"));
    rows.bind_all(job.number);
    while (true) {
      const auto row = rows.step();
      if (!row || !*row) return;
      const std::string sha256 = rows.text(0);
      const std::string& verdict = verdict_on({sha256, rows.count(1)});
      if (verdict.empty()) continue;
      add(job.id, has_ended(job.state) ? Health::kNote : Health::kBad,
          fmt::format("its file {} {}", sha256.substr(0, 12), verdict), "submit the same job again: that uploads it");
    }
  }

  /// Empty: it is there and whole. Each is read once, whichever jobs need it.
  const std::string& verdict_on(const BlobId& blob) {
    const auto [place, is_new] = verdicts_.try_emplace(blob.sha256);
    if (!is_new) return place->second;
    const fs::path file = state_ / "blobs" / blob.sha256.substr(0, 2) / blob.sha256;
    const auto hash = sha256_hex_of_file(file);
    if (!hash) {
      place->second = "is missing";
    } else if (*hash != blob.sha256) {
      place->second = "is damaged";
    }
    return place->second;
  }

  void look_for_orphans() {
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(state_ / "jobs", ignored)) {
      const std::string id = entry.path().filename().string();
      if (ids_.contains(id)) continue;
      const bool old = fs::exists(entry.path() / "job.json", ignored);
      add(id, Health::kNote, old ? "is of before the database" : "is a folder of no job",
          old ? "the farm takes it in when it starts"
              : fmt::format("nothing needs it: rm -r {}", entry.path().string()));
    }
    const auto needed = store_->all_blobs();
    if (!needed) return;
    std::uint64_t bytes = 0, count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(state_ / "blobs", ignored)) {
      if (!entry.is_regular_file(ignored) || entry.path().filename().string().size() != 64) continue;
      if (needed->contains(entry.path().filename().string())) continue;
      ++count;
      bytes += entry.file_size(ignored);
    }
    if (count > 0) {
      add("blobs", Health::kNote, fmt::format("{} files of {} bytes are needed by no job", count, bytes),
          "uploads that were never submitted, or a round's radii: the farm removes those that are older than a day");
    }
  }

  fs::path state_, temporary_;
  std::string build_id_;
  bool runs_ = false;
  std::vector<Check> checks_;
  std::optional<JobStore> store_;
  std::set<std::string> ids_;
  std::map<std::string, std::string> verdicts_;  ///< by hash
};

}  // namespace

Result<std::vector<Check>> examine_state(const fs::path& state, const fs::path& temporary,
                                         const std::string& build_id) {
  std::error_code ignored;
  if (!fs::is_directory(state / "jobs", ignored) && !fs::exists(state / JobStore::kFileName, ignored)) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: no farm has worked here; expected the folder given to photonfarm farm --state",
                            state.string()));
  }
  return Examination(state, temporary, build_id).run();
}

}  // namespace pf
