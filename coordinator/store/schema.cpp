#include "coordinator/store/schema.h"

#include <array>
#include <string_view>

#include <fmt/format.h>

namespace pf {
namespace {

/// Step i brings version i to i + 1. Steps are never changed once they have been in use: add another one.
constexpr std::array<std::string_view, 2> kSteps{
    // Jobs, what became of them, which blobs they need, and which units count.
    R"(
CREATE TABLE jobs (
  number INTEGER PRIMARY KEY AUTOINCREMENT,   -- never used twice: it is in the id
  id TEXT NOT NULL UNIQUE,
  spec TEXT NOT NULL,                         -- canonical JSON
  bundle_sha256 TEXT NOT NULL, bundle_bytes INTEGER NOT NULL,
  idempotency_key TEXT NOT NULL, submitted_by TEXT NOT NULL, paused_by TEXT NOT NULL,
  max_workers INTEGER NOT NULL, run INTEGER NOT NULL, extended INTEGER NOT NULL, expired TEXT NOT NULL,
  state TEXT NOT NULL, message TEXT NOT NULL, end_state TEXT NOT NULL,
  submitted_unix_ms INTEGER NOT NULL, started_unix_ms INTEGER NOT NULL, ended_unix_ms INTEGER NOT NULL,
  scene_hash TEXT NOT NULL, plan TEXT NOT NULL, image_hash TEXT NOT NULL, warnings TEXT NOT NULL,
  estimated_error REAL NOT NULL,
  passes INTEGER NOT NULL, rounds INTEGER NOT NULL, rays INTEGER NOT NULL, photon_paths INTEGER NOT NULL, seconds REAL NOT NULL,
  units_done INTEGER NOT NULL, units_repeated INTEGER NOT NULL, bytes_received INTEGER NOT NULL, merge_seconds REAL NOT NULL
);
CREATE UNIQUE INDEX jobs_by_key ON jobs (idempotency_key) WHERE idempotency_key <> '';
CREATE TABLE transitions (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  number INTEGER NOT NULL,                    -- ascending within a job
  unix_ms INTEGER NOT NULL, event TEXT NOT NULL, from_state TEXT NOT NULL, to_state TEXT NOT NULL, caused_by TEXT NOT NULL,
  PRIMARY KEY (job, number)
) WITHOUT ROWID;
CREATE TABLE blobs (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  sha256 TEXT NOT NULL, bytes INTEGER NOT NULL,
  PRIMARY KEY (job, sha256)
) WITHOUT ROWID;
CREATE INDEX blobs_by_hash ON blobs (sha256);
CREATE TABLE results (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  number INTEGER NOT NULL,                    -- ascending within a job
  worker TEXT NOT NULL, seconds REAL NOT NULL, passes INTEGER NOT NULL, sums_hash TEXT NOT NULL,
  PRIMARY KEY (job, number)
) WITHOUT ROWID;
CREATE TABLE units (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  first INTEGER NOT NULL, count INTEGER NOT NULL, attempts INTEGER NOT NULL, result INTEGER NOT NULL,
  PRIMARY KEY (job, first)
) WITHOUT ROWID;
)",
    // How images converged; workers that were drained or disabled.
    R"(
CREATE TABLE convergence (
  job INTEGER PRIMARY KEY REFERENCES jobs (number) ON DELETE CASCADE,
  points TEXT NOT NULL                        -- JSON: [[seconds, passes, rounds, rays, error or null], ...]
);
CREATE TABLE workers (name TEXT PRIMARY KEY, verb TEXT NOT NULL, caused_by TEXT NOT NULL) WITHOUT ROWID;
)"};

}  // namespace

int schema_version() { return static_cast<int>(kSteps.size()); }

Result<void> migrate(const Database& database) {
  const auto version = database.number("PRAGMA user_version");
  if (!version) return tl::unexpected(version.error());
  if (*version > schema_version()) {
    return fail(ErrorKind::kUsage,
                fmt::format("{}: its schema is version {}, this program knows up to {}; expected a photonfarm as new "
                            "as the one that wrote it",
                            database.name(), *version, schema_version()));
  }
  for (auto step = static_cast<std::size_t>(*version); step < kSteps.size(); ++step) {
    auto transaction = Database::Transaction::begin(database);
    if (!transaction) return tl::unexpected(transaction.error());
    auto done = database.execute(std::string(kSteps[step]) + fmt::format("PRAGMA user_version = {};", step + 1));
    if (done) done = transaction->commit();
    if (!done) return done;
  }
  return {};
}

}  // namespace pf
