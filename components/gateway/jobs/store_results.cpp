#include <algorithm>

#include "components/gateway/jobs/jobs.h"
#include "components/gateway/jobs/store.h"
#include "components/gateway/jobs/store_rows.h"

namespace cotwin::gateway {

namespace {

constexpr int kPart = 200;  // rows that are removed in one transaction

std::string select_results(bool with_reply) {
  return std::string(
             "SELECT results.number, job_id, service, robot, results.request_hash, results.robot_hash, results.producer, "
             "stored, "
             "results.busy_s, reused, bytes, request, ") +
         (with_reply ? "reply" : "''") + " FROM results JOIN answers ON answers.number = results.answer";
}

Result result_of(const Statement& row) {
  Result r;
  int c = 0;
  r.number = row.integer(c++);
  r.job_id = row.text(c++);
  r.service = row.text(c++);
  r.robot = row.text(c++);
  r.request_hash = row.text(c++);
  r.robot_hash = row.text(c++);
  r.producer = row.text(c++);
  r.stored = row.time(c++);
  r.busy_s = row.real(c++);
  r.reused = row.integer(c++) != 0;
  r.bytes = static_cast<std::uint64_t>(row.integer(c++));
  r.request = row.text(c++);
  r.reply = row.text(c++);
  return r;
}

UtcTime days_before(UtcTime now, double days) {
  return now - std::chrono::milliseconds(static_cast<std::int64_t>(std::min(days, 1e6) * 86400e3));
}

}  // namespace

std::optional<Result> JobStore::result(std::int64_t number) {
  Statement row = database_.query(select_results(true) + " WHERE results.number = ?", number);
  if (!row.step()) return std::nullopt;
  return result_of(row);
}

ResultPage JobStore::results(const ResultFilter& filter, std::string_view cursor, std::size_t limit) {
  Conditions conditions;
  conditions.equal("job_id", filter.job_id);
  conditions.equal("results.request_hash", filter.request_hash);
  if (!filter.request.empty()) conditions.equal("results.request_hash", sha256(canonical_json(filter.request)));
  conditions.equal("service", filter.service);
  conditions.equal("robot", filter.robot);
  conditions.equal("results.robot_hash", filter.robot_hash);
  conditions.times("stored", filter.stored_from, filter.stored_before);
  conditions.page("results.number", filter.newest_first, cursor);
  Statement rows = database_.query(select_results(filter.with_reply) + conditions.text + " LIMIT ?");
  conditions.bind(rows);
  rows.bind(static_cast<std::int64_t>(limit) + 1);
  ResultPage page;
  std::uint64_t bytes = 0;
  while (rows.step()) {
    if (page.results.size() == limit || bytes >= kPageBytes) {
      page.next = cursor_of(filter.newest_first, page.results.back().number);
      break;
    }
    page.results.push_back(result_of(rows));
    bytes += page.results.back().request.size() + page.results.back().reply.size();
  }
  return page;
}

/// Removes the oldest result that may be removed and meets the condition, and its answer if no other result has it.
bool JobStore::remove_result(std::string_view condition, std::int64_t value) {
  std::int64_t number = 0, answer = 0;
  {
    Statement oldest = database_.query(
        "SELECT number, answer FROM results WHERE removable = 1 AND " + std::string(condition) + " ORDER BY number LIMIT 1",
        value);
    if (!oldest.step()) return false;
    number = oldest.integer(0);
    answer = oldest.integer(1);
  }
  database_.run("DELETE FROM results WHERE number = ?", number);
  database_.run("DELETE FROM answers WHERE number = ?1 AND NOT EXISTS (SELECT 1 FROM results WHERE answer = ?1)", answer);
  return true;
}

bool JobStore::clean(UtcTime now, std::vector<Job>& removed) {
  int parts = 0;
  Transaction transaction(database_, false);
  const std::int64_t result_limit = days_before(now, limits_.result_days).time_since_epoch().count();
  const UtcTime identifier_limit = days_before(now, limits_.identifier_days);
  while (parts < kPart && remove_result("stored < ?", result_limit)) ++parts;
  for (StoreTotals t = totals(); parts < kPart; t = totals()) {
    const bool many = static_cast<std::uint64_t>(t.results) >= limits_.most_results;
    const bool large = static_cast<std::uint64_t>(t.reply_bytes) >= limits_.most_result_bytes;
    if ((!many && !large) || !remove_result("number >= ?", 0)) break;
    ++parts;
  }
  const StoreTotals t = totals();
  const std::uint64_t done = static_cast<std::uint64_t>(t.state[5] + t.state[6]);
  const std::uint64_t beyond = done >= limits_.most_results ? done - limits_.most_results + 1 : 0;
  for (std::uint64_t i = 0; parts < kPart; ++i, ++parts) {
    auto job =
        one_job(database_.query(kSelectJob + "WHERE read = 1 AND state >= 5 AND ended < ? ORDER BY ended LIMIT 1",
                                i < beyond ? now + std::chrono::days(366) : UtcTime(std::chrono::milliseconds(result_limit))));
    if (!job) break;
    remove_row(*job, "cleared by the gateway after the response was read", now);
    removed.push_back(std::move(*job));
  }
  database_.run("DELETE FROM keys WHERE used < ? AND NOT EXISTS (SELECT 1 FROM jobs WHERE id = job_id AND state > 0)",
                identifier_limit);
  database_.run("DELETE FROM jobs INDEXED BY jobs_removed WHERE state = 0 AND removed < ?", identifier_limit);
  transaction.commit();
  database_.run("PRAGMA incremental_vacuum(1000)");
  return parts == kPart;
}

}  // namespace cotwin::gateway
