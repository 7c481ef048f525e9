#pragma once

namespace cotwin::gateway {

inline constexpr int kApplication = 0x43774a62;  // "CwJb"
inline constexpr int kSchemaVersion = 2;

// Times are UTC in ms. AUTOINCREMENT: numbers are never used again. State 0: removed, the identifier stays reserved.
// The triggers keep totals, so that limits are checked without counting rows.
inline constexpr const char* kSchema = R"(
CREATE TABLE totals(name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;
INSERT INTO totals VALUES ('version', 0), ('state0', 0), ('state1', 0), ('state2', 0), ('state3', 0), ('state4', 0), ('state5', 0),
  ('state6', 0), ('results', 0), ('reply_bytes', 0);

CREATE TABLE jobs(
  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, version INTEGER NOT NULL, state INTEGER NOT NULL,
  result INTEGER NOT NULL, service TEXT NOT NULL, robot TEXT NOT NULL, request TEXT NOT NULL, request_hash TEXT NOT NULL,
  description TEXT NOT NULL, comment TEXT NOT NULL, priority INTEGER NOT NULL, start_time INTEGER, end_time INTEGER,
  deadline INTEGER, time_limit_s REAL NOT NULL, reuse INTEGER NOT NULL, reason TEXT NOT NULL, progress REAL NOT NULL,
  progress_message TEXT NOT NULL, retries INTEGER NOT NULL, restarts INTEGER NOT NULL, stored INTEGER NOT NULL,
  started INTEGER, ended INTEGER, removed INTEGER, busy_s REAL NOT NULL, result_number INTEGER, problem TEXT NOT NULL,
  read INTEGER NOT NULL, light TEXT);
CREATE INDEX jobs_queue ON jobs(priority DESC, ifnull(deadline, 9223372036854775807), sequence) WHERE state = 2;
CREATE INDEX jobs_running ON jobs(priority DESC, ifnull(deadline, 9223372036854775807), sequence) WHERE state = 3;
CREATE INDEX jobs_deadline ON jobs(deadline) WHERE deadline IS NOT NULL AND state BETWEEN 1 AND 4;
CREATE INDEX jobs_start ON jobs(start_time) WHERE start_time IS NOT NULL AND state = 2;
CREATE INDEX jobs_state ON jobs(state, sequence);
CREATE INDEX jobs_cleared ON jobs(ended) WHERE read = 1 AND state >= 5;
CREATE INDEX jobs_removed ON jobs(removed) WHERE state = 0;
CREATE TRIGGER jobs_stored AFTER INSERT ON jobs BEGIN
  UPDATE totals SET value = value + 1 WHERE name = 'state' || new.state; END;
CREATE TRIGGER jobs_changed AFTER UPDATE OF state ON jobs WHEN old.state <> new.state BEGIN
  UPDATE totals SET value = value - 1 WHERE name = 'state' || old.state;
  UPDATE totals SET value = value + 1 WHERE name = 'state' || new.state; END;
CREATE TRIGGER jobs_deleted AFTER DELETE ON jobs BEGIN
  UPDATE totals SET value = value - 1 WHERE name = 'state' || old.state; END;

CREATE TABLE keys(owner TEXT NOT NULL, key TEXT NOT NULL, fingerprint TEXT NOT NULL, job_id TEXT NOT NULL, used INTEGER NOT NULL,
  PRIMARY KEY(owner, key)) WITHOUT ROWID;
CREATE INDEX keys_used ON keys(used);

CREATE TABLE answers(
  number INTEGER PRIMARY KEY AUTOINCREMENT, request_hash TEXT NOT NULL, robot_hash TEXT NOT NULL, producer TEXT NOT NULL,
  request TEXT NOT NULL, reply TEXT NOT NULL, busy_s REAL NOT NULL);
CREATE INDEX answers_identity ON answers(request_hash, robot_hash, producer);
CREATE TRIGGER answers_stored AFTER INSERT ON answers BEGIN
  UPDATE totals SET value = value + length(CAST(new.reply AS BLOB)) WHERE name = 'reply_bytes'; END;
CREATE TRIGGER answers_deleted AFTER DELETE ON answers BEGIN
  UPDATE totals SET value = value - length(CAST(old.reply AS BLOB)) WHERE name = 'reply_bytes'; END;

CREATE TABLE results(
  number INTEGER PRIMARY KEY AUTOINCREMENT, job_id TEXT NOT NULL, service TEXT NOT NULL, robot TEXT NOT NULL,
  request_hash TEXT NOT NULL, robot_hash TEXT NOT NULL, producer TEXT NOT NULL, stored INTEGER NOT NULL, busy_s REAL NOT NULL,
  reused INTEGER NOT NULL, answer INTEGER NOT NULL REFERENCES answers, bytes INTEGER NOT NULL, removable INTEGER NOT NULL);
CREATE INDEX results_job ON results(job_id);
CREATE INDEX results_request ON results(request_hash);
CREATE INDEX results_robot ON results(robot, stored);
CREATE INDEX results_stored ON results(stored);
CREATE INDEX results_answer ON results(answer);
CREATE INDEX results_removable ON results(number) WHERE removable = 1;
CREATE TRIGGER results_stored_total AFTER INSERT ON results BEGIN
  UPDATE totals SET value = value + 1 WHERE name = 'results'; END;
CREATE TRIGGER results_deleted_total AFTER DELETE ON results BEGIN
  UPDATE totals SET value = value - 1 WHERE name = 'results'; END;
)";

/// From version 1, whose jobs have no light.
inline constexpr const char* kUpgrade = "ALTER TABLE jobs ADD COLUMN light TEXT";

}  // namespace cotwin::gateway
