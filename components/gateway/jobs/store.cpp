#include "components/gateway/jobs/store.h"

#include <nlohmann/json.hpp>
#include <random>
#include <tuple>

#include "components/gateway/jobs/jobs.h"
#include "components/gateway/jobs/schema.h"
#include "components/gateway/jobs/store_rows.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

using Json = nlohmann::json;

std::string new_identifier() {
  std::random_device device;
  std::string id = "job-";
  for (int i = 0; i < 24; ++i) id += "0123456789abcdef"[device() & 15];
  return id;
}

/// Of all that a client sent: an idempotency key stands for this.
std::string fingerprint_of(const JobOrder& order, const CanonicalRequest& request, bool start) {
  const auto time = [](const std::optional<UtcTime>& t) { return t ? Json(t->time_since_epoch().count()) : Json(); };
  const Json all = {order.id,
                    order.asked.empty() ? request.hash : sha256(canonical_json(order.asked)),
                    start,
                    texts_to_json(order.description),
                    order.priority,
                    time(order.start_time),
                    time(order.end_time),
                    time(order.deadline),
                    order.time_limit_s,
                    order.reuse};
  return sha256(all.dump());
}

JobReply refused(ReturnStatus status, const std::string& id, const std::string& message) {
  return {status, id, message, false};
}

}  // namespace

JobStore::JobStore(const std::filesystem::path& file, StoreLimits limits)
    : limits_(limits), database_(file, {kApplication, "one of jobs", kSchemaVersion, kSchema, kUpgrade}) {}

std::int64_t JobStore::next_version() {
  Statement next = database_.query("UPDATE totals SET value = value + 1 WHERE name = 'version' RETURNING value");
  const std::int64_t version = next.step() ? next.integer(0) : 0;
  while (next.step()) continue;  // the statement takes effect when it is done
  return version;
}

void JobStore::recover(int most, UtcTime now) {
  bool in_order = false;
  {
    Statement closed = database_.query("SELECT value FROM totals WHERE name = 'closed'");
    in_order = closed.step() && closed.integer(0) == 1;
  }
  write_closed(false);
  std::vector<Job> running;
  {
    Statement rows = database_.query(kSelectJob + "WHERE state IN (3, 4) ORDER BY sequence");
    while (rows.step()) running.push_back(job_of(rows));
  }
  for (Job& job : running) {
    if (!in_order && job.state == JobState::kRunning) ++job.restarts;
    job.progress = 0;
    job.progress_message.clear();
    job.reason = "the gateway ended during the job, which runs again from its beginning";
    if (job.restarts > most) {
      job.state = JobState::kAborted;
      job.result = JobResult::kUnsuccessful;
      job.ended = now;
      job.reason = "the gateway ended " + text::counted(job.restarts, "time") + " during the job";
    }
    save(job, false);
  }
}

void JobStore::write_closed(bool closed) {
  Transaction transaction(database_, true);
  database_.run("INSERT OR REPLACE INTO totals VALUES ('closed', ?)", closed ? 1 : 0);
  transaction.commit();
}

std::optional<std::string> JobStore::full() {
  const StoreTotals now = totals();
  const auto beyond = [](std::int64_t n, std::uint64_t most) { return n >= 0 && static_cast<std::uint64_t>(n) >= most; };
  if (beyond(now.state[1] + now.state[2] + now.state[3] + now.state[4], limits_.most_jobs))
    return std::to_string(limits_.most_jobs) + " job orders are stored and not done, which is the limit";
  const auto unread = [&](const std::string& what) {
    return what + " of jobs are kept, which is the limit: read or clear them";
  };
  if (beyond(now.results, limits_.most_results)) return unread(std::to_string(now.results) + " results");
  if (beyond(now.reply_bytes, limits_.most_result_bytes)) return unread(std::to_string(now.reply_bytes) + " bytes of results");
  if (beyond(now.state[5] + now.state[6], limits_.most_results))
    return unread(std::to_string(now.state[5] + now.state[6]) + " ends");
  return std::nullopt;
}

JobStore::Insertion JobStore::insert(const JobOrder& order, const CanonicalRequest& request, const StoreOptions& options,
                                     const std::optional<Origin>& origin, UtcTime now) {
  const std::string fingerprint = fingerprint_of(order, request, options.start);
  std::vector<Job> removed;
  Transaction transaction(database_, true);
  if (!options.idempotency_key.empty()) {
    Statement known = database_.query("SELECT fingerprint, job_id FROM keys WHERE owner = ? AND key = ?", options.owner,
                                      options.idempotency_key);
    if (known.step()) {
      if (known.text(0) != fingerprint)
        return {refused(kKeyOfAnotherRequest, known.text(1), "the idempotency key was used for another job order"), {}};
      return {{kNoError, known.text(1), "", true}, {}};
    }
  }
  if (!order.id.empty()) {
    Statement known = database_.query("SELECT state FROM jobs WHERE id = ?", order.id);
    if (known.step())
      return {refused(kInvalidJobOrderStatus, order.id,
                      known.integer(0) == 0 ? "a job order that was removed has this identifier, expected a new one"
                                            : "another job order has this identifier, expected a new one"),
              {}};
  }
  if (order.deadline && *order.deadline <= now)
    return {
        refused(kInvalidRequest, order.id, "the deadline " + to_text(*order.deadline) + " has passed: it is " + to_text(now)),
        {}};
  if (const auto why = full()) return {refused(kUnableToAccept, order.id, *why), {}};

  Job job;
  job.order = order;
  if (order.id.empty()) job.order.id = new_identifier();
  job.order.request = request.text;
  job.service = request.service;
  job.robot = request.robot;
  job.request_hash = request.hash;
  job.comment = options.comment;
  job.state = options.start ? JobState::kAllowedToStart : JobState::kNotAllowedToStart;
  job.stored = now;
  job.version = next_version();
  Statement row = database_.query(kInsertJob, job.order.id, job.version, static_cast<int>(job.state), job.service, job.robot,
                                  job.order.request, job.request_hash, now);
  while (row.step()) continue;
  job.sequence = database_.last_row();
  update_row(database_, job);
  if (!options.idempotency_key.empty())
    database_.run("INSERT INTO keys(owner, key, fingerprint, job_id, used) VALUES (?, ?, ?, ?, ?)", options.owner,
                  options.idempotency_key, fingerprint, job.order.id, now);
  const bool due = !order.start_time || *order.start_time <= now;
  if (options.start && due && order.reuse && origin) restore_earlier(job, *origin, now);
  transaction.commit();
  return {{kNoError, job.order.id, "", false}, job};
}

void JobStore::save(Job& job, bool durable) {
  Transaction transaction(database_, durable);
  Job changed = job;
  changed.version = next_version();
  update_row(database_, changed);
  transaction.commit();
  job = std::move(changed);
}

std::pair<std::int64_t, bool> JobStore::keep_answer(const Job& job, std::string_view reply, const Origin& origin) {
  std::optional<std::int64_t> equal;
  bool differs = false;
  {
    Statement earlier = database_.query(
        "SELECT number, reply = ? FROM answers WHERE request_hash = ? AND robot_hash = ? AND producer = ? ORDER BY number",
        reply, job.request_hash, origin.robot_hash, origin.producer);
    while (earlier.step()) {
      if (earlier.integer(1) == 1) {
        equal = earlier.integer(0);
      } else {
        differs = !origin.robot_hash.empty();
      }
    }
  }
  if (equal) return {*equal, false};
  database_.run("INSERT INTO answers(request_hash, robot_hash, producer, request, reply, busy_s) VALUES (?, ?, ?, ?, ?, ?)",
                job.request_hash, origin.robot_hash, origin.producer, job.order.request, reply, job.busy_s);
  return {database_.last_row(), differs};
}

void JobStore::end_with_answer(Job& job, std::int64_t answer) {
  Statement verdict = database_.query(
      "SELECT json_extract(reply, '$.verdict.light'), json_extract(reply, '$.verdict.unmet') FROM answers WHERE number = ? AND "
      "json_valid(reply)",
      answer);
  job.state = JobState::kEnded;
  job.result = JobResult::kSuccessful;
  job.progress = 1;
  if (!verdict.step()) return;
  job.light = verdict.text(0);
  if (verdict.is_null(1)) return;
  job.state = JobState::kAborted;
  job.result = JobResult::kUnsuccessful;
  job.reason = verdict.text(1);
}

bool JobStore::complete(Job& job, std::string_view reply, const Origin& origin) {
  Transaction transaction(database_, false);
  Job changed = job;
  const auto [answer, differs] = keep_answer(changed, reply, origin);
  end_with_answer(changed, answer);
  changed.result_number = keep_result(changed, origin, answer, reply.size(), false);
  changed.version = next_version();
  update_row(database_, changed);
  transaction.commit();
  job = std::move(changed);
  return differs;
}

bool JobStore::complete_step(Job& job, const Job& step, std::string_view reply, const Origin& origin) {
  Transaction transaction(database_, false);
  Job changed = job;
  const auto [answer, differs] = keep_answer(step, reply, origin);
  keep_result(step, origin, answer, reply.size(), false);
  changed.version = next_version();
  update_row(database_, changed);
  transaction.commit();
  job = std::move(changed);
  return differs;
}

std::optional<std::string> JobStore::answer_of_step(const Job& step, const Origin& origin, bool reuse) {
  const auto first = [](Statement row) {
    return row.step() ? std::optional<std::pair<std::int64_t, std::string>>({row.integer(0), row.text(1)}) : std::nullopt;
  };
  const auto own = first(
      database_.query("SELECT answer, reply FROM results JOIN answers ON answers.number = results.answer WHERE job_id = ? AND "
                      "results.request_hash = ? AND results.robot_hash = ? AND results.producer = ?",
                      step.order.id, step.request_hash, origin.robot_hash, origin.producer));
  if (own) return own->second;
  if (!reuse || origin.robot_hash.empty()) return std::nullopt;
  const auto earlier = first(database_.query(
      "SELECT number, reply FROM answers WHERE request_hash = ? AND robot_hash = ? AND producer = ? ORDER BY number LIMIT 1",
      step.request_hash, origin.robot_hash, origin.producer));
  if (!earlier) return std::nullopt;
  Transaction transaction(database_, false);
  keep_result(step, origin, earlier->first, earlier->second.size(), true);
  transaction.commit();
  return earlier->second;
}

bool JobStore::reuse(Job& job, const Origin& origin, UtcTime now) {
  Transaction transaction(database_, false);
  Job changed = job;
  if (!restore_earlier(changed, origin, now)) return false;
  transaction.commit();
  job = std::move(changed);
  return true;
}

bool JobStore::restore_earlier(Job& job, const Origin& origin, UtcTime now) {
  if (origin.robot_hash.empty()) return false;
  Statement earlier = database_.query(
      "SELECT number, length(CAST(reply AS BLOB)), busy_s FROM answers WHERE request_hash = ? AND robot_hash = ? AND producer "
      "= ? "
      "ORDER BY number LIMIT 1",
      job.request_hash, origin.robot_hash, origin.producer);
  if (!earlier.step()) return false;
  job.reason = "an earlier result of the same request, robot and build was taken";
  end_with_answer(job, earlier.integer(0));
  if (!job.started) job.started = now;
  job.ended = now;
  job.busy_s = 0;
  const auto bytes = static_cast<std::uint64_t>(earlier.integer(1));
  job.result_number = keep_result(job, origin, earlier.integer(0), bytes, true);
  job.version = next_version();
  update_row(database_, job);
  return true;
}

std::int64_t JobStore::keep_result(const Job& job, const Origin& origin, std::int64_t answer, std::uint64_t bytes,
                                   bool reused) {
  database_.run(
      "INSERT INTO results(job_id, service, robot, request_hash, robot_hash, producer, stored, busy_s, reused, answer, bytes, "
      "removable) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, 0)",
      job.order.id, job.service, job.robot, job.request_hash, origin.robot_hash, origin.producer, job.ended, job.busy_s, reused,
      answer, static_cast<std::int64_t>(bytes));
  return database_.last_row();
}

void JobStore::remove(Job& job, const std::string& reason, UtcTime now) {
  Transaction transaction(database_, true);
  remove_row(job, reason, now);
  transaction.commit();
}

void JobStore::remove_row(Job& job, const std::string& reason, UtcTime now) {
  job.version = next_version();
  job.reason = reason;
  database_.run(
      "UPDATE jobs SET state = 0, version = ?, reason = ?, removed = ?, request = '', description = '[]', comment = '[]', "
      "problem = "
      "'', progress_message = '' WHERE sequence = ?",
      job.version, reason, now, job.sequence);
  database_.run("UPDATE results SET removable = 1 WHERE job_id = ?", job.order.id);
}

void JobStore::mark_read(Job& job) {
  Transaction transaction(database_, false);
  database_.run("UPDATE jobs SET read = 1 WHERE sequence = ?", job.sequence);
  database_.run("UPDATE results SET removable = 1 WHERE job_id = ?", job.order.id);
  transaction.commit();
  job.read = true;
}

std::optional<Job> JobStore::find(const std::string& id) {
  return one_job(database_.query(kSelectJob + "WHERE id = ? AND state > 0", id));
}

std::optional<Job> JobStore::next(const std::set<std::int64_t>& busy, UtcTime now) {
  const std::string order = "ORDER BY priority DESC, ifnull(deadline, 9223372036854775807), sequence";
  const auto rank = [](const Job& job) {
    return std::tuple(-job.order.priority, job.order.deadline.value_or(UtcTime::max()), job.sequence);
  };
  std::optional<Job> interrupted;
  {
    Statement running = database_.query(kSelectJob + "INDEXED BY jobs_running WHERE state = 3 " + order);
    while (!interrupted && running.step()) {
      if (!busy.contains(sequence_of(running))) interrupted = job_of(running);
    }
  }
  std::optional<Job> waiting = one_job(database_.query(
      kSelectJob + "INDEXED BY jobs_queue WHERE state = 2 AND (start_time IS NULL OR start_time <= ?) " + order + " LIMIT 1",
      now));
  return interrupted && (!waiting || rank(*interrupted) < rank(*waiting)) ? interrupted : waiting;
}

std::optional<Job> JobStore::overdue(UtcTime now) {
  return one_job(database_.query(
      kSelectJob + "WHERE deadline IS NOT NULL AND state BETWEEN 1 AND 4 AND deadline <= ? ORDER BY deadline LIMIT 1", now));
}

std::optional<UtcTime> JobStore::next_time(UtcTime now) {
  std::optional<UtcTime> earliest;
  for (const char* sql :
       {"SELECT min(deadline) FROM jobs WHERE deadline IS NOT NULL AND state BETWEEN 1 AND 4 AND deadline > ?",
        "SELECT min(start_time) FROM jobs INDEXED BY jobs_start WHERE start_time IS NOT NULL AND state = 2 AND start_time > "
        "?"}) {
    Statement row = database_.query(sql, now);
    if (!row.step() || row.is_null(0)) continue;
    if (const UtcTime time = row.time(0); !earliest || time < *earliest) earliest = time;
  }
  return earliest;
}

JobPage JobStore::list(const JobFilter& filter, std::string_view cursor, std::size_t limit) {
  Conditions conditions;
  if (filter.states.empty()) {
    conditions.text = " WHERE state > 0";
  } else {
    std::set<int> states;
    for (const JobState state : filter.states) states.insert(static_cast<int>(state));
    for (const int state : states)
      conditions.text += (conditions.text.empty() ? " WHERE state IN (" : ", ") + std::to_string(state);
    conditions.text += ")";
  }
  conditions.equal("service", filter.service);
  conditions.equal("robot", filter.robot);
  conditions.times("stored", filter.stored_from, filter.stored_before);
  conditions.page("sequence", filter.newest_first, cursor);
  Statement rows = database_.query(kSelectJob + conditions.text + " LIMIT ?");
  conditions.bind(rows);
  rows.bind(static_cast<std::int64_t>(limit) + 1);
  JobPage page;
  std::uint64_t bytes = 0;
  while (rows.step()) {
    if (page.jobs.size() == limit || bytes >= kPageBytes) {
      page.next = cursor_of(filter.newest_first, page.jobs.back().sequence);
      break;
    }
    page.jobs.push_back(job_of(rows));
    bytes += bytes_of(page.jobs.back());
  }
  return page;
}

StoreTotals JobStore::totals() {
  StoreTotals totals;
  Statement rows = database_.query("SELECT name, value FROM totals");
  while (rows.step()) {
    const std::string name = rows.text(0);
    if (name.starts_with("state")) totals.state[name.back() - '0'] = rows.integer(1);
    if (name == "results") totals.results = rows.integer(1);
    if (name == "reply_bytes") totals.reply_bytes = rows.integer(1);
  }
  return totals;
}

}  // namespace cotwin::gateway
