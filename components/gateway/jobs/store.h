#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "components/gateway/jobs/canonical.h"
#include "components/gateway/jobs/errors.h"
#include "components/gateway/jobs/job.h"

/// The tables of jobs, results and keys.
namespace cotwin::gateway {

struct StoreLimits {
  std::size_t most_jobs, most_results;
  std::uint64_t most_result_bytes;
  double result_days, identifier_days;
};

struct StoreTotals {
  std::int64_t state[7] = {};  // jobs, by JobState; [0]: removed
  std::int64_t results = 0, reply_bytes = 0;
};

/// Where a result comes from: what must be equal for one to be used again.
struct Origin {
  std::string robot_hash, producer;
};

/// Jobs in an SQLite database. Functions that change something are one transaction each; they throw DatabaseError and have then
/// changed nothing. What clients order is durable; ends of jobs survive the end of the process at once and a loss of power only
/// after the next order: such a job runs again, with the same result. Not thread-safe.
class JobStore {
 public:
  JobStore(const std::filesystem::path& file, StoreLimits limits);

  /// Jobs that were Running when the last owner ended without close() get one more restart; beyond `most` they are Aborted.
  void recover(int most, UtcTime now);
  /// The owner ends in order: its jobs are not the reason.
  void close() { write_closed(true); }

  struct Insertion {
    JobReply reply;
    std::optional<Job> job;  // the new one
  };
  /// Stores an order. Without `origin` no earlier result is taken.
  Insertion insert(const JobOrder& order, const CanonicalRequest& request, const StoreOptions& options,
                   const std::optional<Origin>& origin, UtcTime now);
  /// Writes state, order and all that a job can change, with a new version.
  void save(Job& job, bool durable);
  /// Ends a running job, whose end and busy_s are set, with a reply, and keeps the reply: Aborted where its verdict is worse than the request
  /// requires. Returns whether it differs from an earlier reply of the same origin.
  bool complete(Job& job, std::string_view reply, const Origin& origin);
  /// Keeps the reply to a step of a chain, and saves the chain. `step`: the chain's identifier with the request of the step.
  bool complete_step(Job& job, const Job& step, std::string_view reply, const Origin& origin);
  /// The reply to a step that the chain has already, or with `reuse` that of an earlier equal request, which then is kept for the chain, too.
  std::optional<std::string> answer_of_step(const Job& step, const Origin& origin, bool reuse);
  /// Ends a running job with the reply of an earlier one to an equal request, if there is one.
  bool reuse(Job& job, const Origin& origin, UtcTime now);
  /// Frees the job's data and keeps its identifier reserved.
  void remove(Job& job, const std::string& reason, UtcTime now);
  void mark_read(Job& job);

  std::optional<Job> find(const std::string& id);
  /// The next one to run: Running without a worker (not in `busy`), then AllowedToStart, in order.
  std::optional<Job> next(const std::set<std::int64_t>& busy, UtcTime now);
  /// Not done after its deadline.
  std::optional<Job> overdue(UtcTime now);
  /// The earliest deadline or start time in the future.
  std::optional<UtcTime> next_time(UtcTime now);
  JobPage list(const JobFilter& filter, std::string_view cursor, std::size_t limit);

  std::optional<Result> result(std::int64_t number);
  ResultPage results(const ResultFilter& filter, std::string_view cursor, std::size_t limit);

  /// Removes what is beyond the limits and may be removed, a part of it at a time. True: there is more.
  bool clean(UtcTime now, std::vector<Job>& removed);
  StoreTotals totals();

 private:
  void write_closed(bool closed);
  std::int64_t next_version();
  /// The number of the answer, and whether it differs from an earlier one.
  std::pair<std::int64_t, bool> keep_answer(const Job& job, std::string_view reply, const Origin& origin);
  /// State, result, light and reason by the verdict of the answer.
  void end_with_answer(Job& job, std::int64_t answer);
  std::int64_t keep_result(const Job& job, const Origin& origin, std::int64_t answer, std::uint64_t bytes, bool reused);
  bool restore_earlier(Job& job, const Origin& origin, UtcTime now);
  void remove_row(Job& job, const std::string& reason, UtcTime now);
  std::optional<std::string> full();
  bool remove_result(std::string_view condition, std::int64_t value);

  StoreLimits limits_;
  database::Database database_;
};

}  // namespace cotwin::gateway
