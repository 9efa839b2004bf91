-- A database of schema version 1: sqlite3 FILE .dump of one with a job that is done, one that runs and one that was deleted.
PRAGMA foreign_keys=OFF;
PRAGMA user_version=1;
BEGIN TRANSACTION;
CREATE TABLE blobs (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  sha256 TEXT NOT NULL, bytes INTEGER NOT NULL,
  PRIMARY KEY (job, sha256)
) WITHOUT ROWID;
INSERT INTO "blobs" VALUES(1,'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',123);
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
INSERT INTO "jobs" VALUES(1,'glass-1','{"job":{"name":"glass"},"scene":{"file":"glass.glb"}}','aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',123,'key-1','ada','',0,0,0,'[]','done','','done',1700000000000,1700000001000,1700000060000,'scene','sppm','image','[]',0.25,64,9,64000,32000,60.0,2,0,1000,0.5);
INSERT INTO "jobs" VALUES(2,'glass-2','{"job":{"name":"glass"},"scene":{"file":"glass.glb"}}','aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',123,'key-2','ada','',0,0,0,'[]','running','','done',1700000000000,1700000001000,0,'scene','sppm','','[]',0.25,10,9,64000,32000,60.0,2,0,1000,0.5);
CREATE TABLE results (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  number INTEGER NOT NULL,                    -- ascending within a job
  worker TEXT NOT NULL, seconds REAL NOT NULL, passes INTEGER NOT NULL, sums_hash TEXT NOT NULL,
  PRIMARY KEY (job, number)
) WITHOUT ROWID;
INSERT INTO "results" VALUES(1,1,'worker-1',30.0,64,'00000000000000000000000000000000');
CREATE TABLE transitions (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  number INTEGER NOT NULL,                    -- ascending within a job
  unix_ms INTEGER NOT NULL, event TEXT NOT NULL, from_state TEXT NOT NULL, to_state TEXT NOT NULL, caused_by TEXT NOT NULL,
  PRIMARY KEY (job, number)
) WITHOUT ROWID;
INSERT INTO "transitions" VALUES(1,1,1700000001000,'prepare','queued','preparing','');
INSERT INTO "transitions" VALUES(1,2,1700000001001,'run','preparing','running','');
INSERT INTO "transitions" VALUES(1,3,1700000001002,'finish','running','finishing','');
CREATE TABLE units (
  job INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
  first INTEGER NOT NULL, count INTEGER NOT NULL, attempts INTEGER NOT NULL, result INTEGER NOT NULL,
  PRIMARY KEY (job, first)
) WITHOUT ROWID;
INSERT INTO "units" VALUES(1,0,32,1,1);
INSERT INTO "units" VALUES(1,32,32,2,1);
CREATE UNIQUE INDEX jobs_by_key ON jobs (idempotency_key) WHERE idempotency_key <> '';
CREATE INDEX blobs_by_hash ON blobs (sha256);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('jobs',3);
COMMIT;
