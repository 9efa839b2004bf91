#include "coordinator/store/job_store.h"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "coordinator/store/schema.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr std::string_view kColumns =
    "id, spec, bundle_sha256, bundle_bytes, idempotency_key, submitted_by, paused_by, max_workers, run, extended, "
    "expired, state, "
    "message, end_state, submitted_unix_ms, started_unix_ms, ended_unix_ms, scene_hash, plan, image_hash, warnings, "
    "estimated_error, passes, rounds, rays, photon_paths, seconds, units_done, units_repeated, bytes_received, "
    "merge_seconds, number";

/// Texts come from scenes and workers: whatever bytes they hold, the record can be written.
std::string text_of(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

std::vector<std::string> texts_of(const std::string& text) {
  const json value = json::parse(text, nullptr, false);
  std::vector<std::string> texts;
  if (!value.is_array()) return texts;
  for (const json& item : value) {
    if (item.is_string()) texts.push_back(item.get<std::string>());
  }
  return texts;
}

Result<JobRecord> record_of(const Statement& row) {
  JobRecord r;
  int c = 0;
  r.id = row.text(c++);
  auto spec = parse_job_json(row.text(c++), r.id);
  if (!spec) return tl::unexpected(spec.error());
  r.spec = std::move(*spec);
  r.bundle.sha256 = row.text(c++);
  r.bundle.bytes = row.count(c++);
  for (std::string* text : {&r.idempotency_key, &r.submitted_by, &r.paused_by}) *text = row.text(c++);
  r.max_workers = static_cast<int>(row.integer(c++));
  r.run = row.count(c++);
  r.extended = static_cast<int>(row.integer(c++));
  r.expired = texts_of(row.text(c++));
  const std::string state = row.text(c++);
  r.message = row.text(c++);
  const std::string end_state = row.text(c++);
  for (std::int64_t* time : {&r.submitted_unix_ms, &r.started_unix_ms, &r.ended_unix_ms}) *time = row.integer(c++);
  for (std::string* text : {&r.scene_hash, &r.plan, &r.image_hash}) *text = row.text(c++);
  r.warnings = texts_of(row.text(c++));
  r.estimated_error = row.real(c++);
  for (std::uint64_t* count : {&r.figures.passes, &r.figures.rounds, &r.figures.rays, &r.figures.photon_paths})
    *count = row.count(c++);
  r.figures.seconds = row.real(c++);
  for (std::uint64_t* count : {&r.figures.units_done, &r.figures.units_repeated, &r.figures.bytes_received})
    *count = row.count(c++);
  r.figures.merge_seconds = row.real(c++);
  r.number = row.count(c++);
  const auto known = job_state_of(state), known_end = job_state_of(end_state);
  if (!known || !known_end)
    return fail(ErrorKind::kInternal, fmt::format("no job state is called \"{}\"", known ? end_state : state));
  r.state = *known;
  r.end_state = *known_end;
  return r;
}

/// `take` sees each row until it returns false.
template <typename Take>
Result<void> for_rows(Statement& statement, const Take& take) {
  while (true) {
    const auto row = statement.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row || !take(statement)) break;
  }
  statement.reset();
  return {};
}

/// A statement without rows.
template <typename... Values>
Result<void> run(const Database& database, std::string_view sql, const Values&... values) {
  auto statement = database.prepare(sql);
  if (!statement) return tl::unexpected(statement.error());
  return statement->bind_all(values...).run();
}

std::optional<WorkerVerb> worker_verb_of(std::string_view name) {
  for (const WorkerVerb verb : {WorkerVerb::kDrain, WorkerVerb::kDisable}) {
    if (to_string(verb) == name) return verb;
  }
  return std::nullopt;
}

}  // namespace

std::string_view to_string(WorkerVerb verb) {
  switch (verb) {
    case WorkerVerb::kDrain:
      return "drain";
    case WorkerVerb::kDisable:
      return "disable";
    case WorkerVerb::kEnable:
      return "enable";
  }
  return "enable";
}

Result<JobStore> JobStore::open(const std::filesystem::path& file) {
  auto database = Database::open(file);
  if (!database) return tl::unexpected(database.error());
  if (auto migrated = migrate(*database); !migrated) return tl::unexpected(migrated.error());
  return JobStore(std::move(*database));
}

Result<JobStore::Loaded> JobStore::load() const {
  auto statement = database_.prepare(fmt::format("SELECT {} FROM jobs ORDER BY number", kColumns));
  if (!statement) return tl::unexpected(statement.error());
  Loaded loaded;
  auto read = for_rows(*statement, [&](const Statement& row) {
    auto record = record_of(row);
    if (record) {
      loaded.records.push_back(std::move(*record));
    } else {
      loaded.broken.emplace_back(row.text(0), record.error().message);
    }
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return loaded;
}

Result<bool> JobStore::has(const std::string& id) const {
  auto statement = database_.prepare("SELECT 1 FROM jobs WHERE id = ?1");
  if (!statement) return tl::unexpected(statement.error());
  return statement->bind_all(id).step();
}

Result<std::uint64_t> JobStore::next_number() const {
  const auto last = database_.number("SELECT coalesce(max(seq), 0) FROM sqlite_sequence WHERE name = 'jobs'");
  if (!last) return tl::unexpected(last.error());
  return static_cast<std::uint64_t>(*last) + 1;
}

Result<std::optional<std::string>> JobStore::job_with_key(const std::string& idempotency_key) const {
  auto statement = database_.prepare("SELECT id FROM jobs WHERE idempotency_key = ?1 AND idempotency_key <> ''");
  if (!statement) return tl::unexpected(statement.error());
  const auto row = statement->bind_all(idempotency_key).step();
  if (!row) return tl::unexpected(row.error());
  return *row ? std::optional(statement->text(0)) : std::nullopt;
}

Result<void> JobStore::write(const JobRecord& r) const {
  // 0: the database gives the number.
  static const std::string kSql = fmt::format(
      "INSERT INTO jobs ({0}) VALUES "
      "(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,?16,?17,?18,?19,?20,?21,?22,?23,?24,?25,?26,"
      "?27,?28,?29,?30,?31,nullif(?32,0)) ON CONFLICT (number) DO UPDATE SET ({0}) = "
      "(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,"
      "?15,?16,?17,?18,?19,?20,?21,?22,?23,?24,?25,?26,?27,?28,?29,?30,?31,?32)",
      kColumns);
  const JobRecord::Figures& f = r.figures;
  const double estimated_error =
      std::isnan(r.estimated_error) ? -1.0 : r.estimated_error;  // a database takes NaN for nothing
  return run(database_, kSql, r.id, canonical_json(r.spec), r.bundle.sha256, r.bundle.bytes, r.idempotency_key,
             r.submitted_by, r.paused_by, r.max_workers, r.run, r.extended, text_of(r.expired), to_string(r.state),
             r.message, to_string(r.end_state), r.submitted_unix_ms, r.started_unix_ms, r.ended_unix_ms, r.scene_hash,
             r.plan, r.image_hash, text_of(r.warnings), estimated_error, f.passes, f.rounds, f.rays, f.photon_paths,
             f.seconds, f.units_done, f.units_repeated, f.bytes_received, f.merge_seconds, r.number);
}

Result<void> JobStore::insert(JobRecord& record, std::span<const BlobId> blobs) {
  auto transaction = Database::Transaction::begin(database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (auto written = write(record); !written) return written;
  const auto number = database_.number("SELECT last_insert_rowid()");
  if (!number) return tl::unexpected(number.error());
  for (const BlobId& blob : blobs) {
    auto added = run(database_, "INSERT OR IGNORE INTO blobs (job, sha256, bytes) VALUES (?1, ?2, ?3)", *number,
                     blob.sha256, blob.bytes);
    if (!added) return added;
  }
  if (auto committed = transaction->commit(); !committed) return committed;
  record.number = static_cast<std::uint64_t>(*number);
  return {};
}

Result<void> JobStore::save(const JobRecord& record, std::span<const Transition> transitions) {
  auto transaction = Database::Transaction::begin(database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (auto written = write(record); !written) return written;
  for (const Transition& t : transitions) {
    auto added =
        run(database_,
            "INSERT INTO transitions (job, number, unix_ms, event, from_state, to_state, caused_by) SELECT ?1, "
            "coalesce(max(number), 0) + 1, ?2, ?3, ?4, ?5, ?6 FROM transitions WHERE job = ?1",
            record.number, t.unix_ms, to_string(t.event), to_string(t.from), to_string(t.to), t.by);
    if (!added) return added;
  }
  return transaction->commit();
}

Result<void> JobStore::checkpoint(const JobRecord& record, std::span<const CountedResult> results,
                                  const std::vector<ConvergencePoint>& points) {
  auto transaction = Database::Transaction::begin(database_);
  if (!transaction) return tl::unexpected(transaction.error());
  if (auto written = write(record); !written) return written;
  auto result = database_.prepare(
      "INSERT OR REPLACE INTO results (job, number, worker, seconds, passes, sums_hash) VALUES (?1, ?2, ?3, ?4, ?5, "
      "?6)");
  auto unit = database_.prepare(
      "INSERT OR REPLACE INTO units (job, first, count, attempts, result) VALUES (?1, ?2, ?3, ?4, ?5)");
  if (!result) return tl::unexpected(result.error());
  if (!unit) return tl::unexpected(unit.error());
  for (const CountedResult& r : results) {
    auto done = result->bind_all(record.number, r.number, r.worker, r.seconds, r.passes(), r.sums_hash).run();
    for (std::size_t i = 0; done && i < r.units.size(); ++i) {
      done =
          unit->bind_all(record.number, r.units[i].range.first, r.units[i].range.count, r.units[i].attempts, r.number)
              .run();
    }
    if (!done) return done;
  }
  json list = json::array();
  for (const ConvergencePoint& p : points) {
    list.push_back({p.seconds, p.passes, p.rounds, p.rays, p.estimated_error ? json(*p.estimated_error) : json()});
  }
  auto written =
      run(database_, "INSERT OR REPLACE INTO convergence (job, points) VALUES (?1, ?2)", record.number, text_of(list));
  if (!written) return written;
  return transaction->commit();
}

Result<void> JobStore::forget_results(std::uint64_t job, std::uint64_t from) {
  auto transaction = Database::Transaction::begin(database_);
  if (!transaction) return tl::unexpected(transaction.error());
  auto done = run(database_, "DELETE FROM units WHERE job = ?1 AND result >= ?2", job, from);
  if (done) done = run(database_, "DELETE FROM results WHERE job = ?1 AND number >= ?2", job, from);
  return done ? transaction->commit() : done;
}

Result<void> JobStore::remove(std::uint64_t job) { return run(database_, "DELETE FROM jobs WHERE number = ?1", job); }

Result<std::vector<UnitView>> JobStore::units(std::uint64_t job, std::uint64_t from, std::size_t most) const {
  auto statement = database_.prepare(
      "SELECT first, count, attempts, result, worker, seconds * count / passes, sums_hash FROM units JOIN results ON "
      "results.job = units.job "
      "AND results.number = units.result WHERE units.job = ?1 AND first >= ?2 ORDER BY first LIMIT ?3");
  if (!statement) return tl::unexpected(statement.error());
  statement->bind_all(job, from, most);
  std::vector<UnitView> units;
  auto read = for_rows(*statement, [&](const Statement& row) {
    UnitView& unit = units.emplace_back();
    unit.first = row.count(0);
    unit.count = row.count(1);
    unit.state = "done";
    unit.attempts = static_cast<std::uint32_t>(row.integer(2));
    unit.result = row.count(3);
    unit.worker = row.text(4);
    unit.seconds = row.real(5);
    unit.sums_hash = row.text(6);
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return units;
}

Result<JobStore::Results> JobStore::results(std::uint64_t job) const {
  auto statement = database_.prepare("SELECT worker, count(*) FROM results WHERE job = ?1 GROUP BY worker");
  if (!statement) return tl::unexpected(statement.error());
  Results results;
  auto read = for_rows(statement->bind_all(job), [&](const Statement& row) {
    results.workers.insert(row.text(0));
    results.count += row.count(1);
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return results;
}

Result<std::vector<ConvergencePoint>> JobStore::convergence(std::uint64_t job) const {
  auto statement = database_.prepare("SELECT points FROM convergence WHERE job = ?1");
  if (!statement) return tl::unexpected(statement.error());
  std::vector<ConvergencePoint> points;
  auto read = for_rows(statement->bind_all(job), [&](const Statement& row) {
    const json list = json::parse(row.text(0), nullptr, false);
    for (const json& p : list.is_array() ? list : json::array()) {
      if (!p.is_array() || p.size() != 5) continue;
      points.push_back({p[0].get<double>(), p[1].get<std::uint64_t>(), p[2].get<std::uint64_t>(),
                        p[3].get<std::uint64_t>(),
                        p[4].is_number() ? std::optional(p[4].get<double>()) : std::nullopt});
    }
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return points;
}

Result<std::vector<Transition>> JobStore::transitions(std::uint64_t job) const {
  auto statement = database_.prepare(
      "SELECT unix_ms, event, from_state, to_state, caused_by FROM transitions WHERE job = ?1 ORDER BY number");
  if (!statement) return tl::unexpected(statement.error());
  std::vector<Transition> found;
  std::optional<Error> nonsense;
  auto read = for_rows(statement->bind_all(job), [&](const Statement& row) {
    const auto event = job_event_of(row.text(1));
    const auto from = job_state_of(row.text(2)), to = job_state_of(row.text(3));
    if (event && from && to) {
      found.push_back({row.integer(0), *event, *from, *to, row.text(4)});
    } else {
      nonsense = Error{ErrorKind::kInvalidInput,
                       fmt::format("no such transition: {} from {} to {}", row.text(1), row.text(2), row.text(3))};
    }
    return !nonsense;
  });
  if (!read) return tl::unexpected(read.error());
  if (nonsense) return tl::unexpected(*nonsense);
  return found;
}

Result<std::vector<BlobId>> JobStore::own_blobs(std::uint64_t job) const {
  auto statement = database_.prepare(
      "SELECT sha256, bytes FROM blobs AS mine WHERE job = ?1 AND NOT EXISTS "
      "(SELECT 1 FROM blobs WHERE blobs.sha256 = mine.sha256 AND blobs.job <> ?1)");
  if (!statement) return tl::unexpected(statement.error());
  std::vector<BlobId> blobs;
  auto read = for_rows(statement->bind_all(job), [&](const Statement& row) {
    blobs.push_back({row.text(0), row.count(1)});
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return blobs;
}

Result<void> JobStore::release_blobs(std::uint64_t job) {
  return run(database_, "DELETE FROM blobs WHERE job = ?1", job);
}

Result<std::map<std::string, std::uint64_t>> JobStore::all_blobs() const {
  auto statement = database_.prepare("SELECT DISTINCT sha256, bytes FROM blobs");
  if (!statement) return tl::unexpected(statement.error());
  std::map<std::string, std::uint64_t> blobs;
  auto read = for_rows(*statement, [&](const Statement& row) {
    blobs[row.text(0)] = row.count(1);
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return blobs;
}

Result<std::vector<JobStore::SteeredWorker>> JobStore::workers() const {
  auto statement = database_.prepare("SELECT name, verb, caused_by FROM workers ORDER BY name");
  if (!statement) return tl::unexpected(statement.error());
  std::vector<SteeredWorker> found;
  auto read = for_rows(*statement, [&](const Statement& row) {
    if (const auto verb = worker_verb_of(row.text(1))) found.push_back({row.text(0), row.text(2), *verb});
    return true;
  });
  if (!read) return tl::unexpected(read.error());
  return found;
}

Result<void> JobStore::save_worker(const SteeredWorker& worker) {
  if (worker.verb == WorkerVerb::kEnable) return run(database_, "DELETE FROM workers WHERE name = ?1", worker.name);
  return run(database_, "INSERT OR REPLACE INTO workers (name, verb, caused_by) VALUES (?1, ?2, ?3)", worker.name,
             to_string(worker.verb), worker.by);
}

}  // namespace pf
