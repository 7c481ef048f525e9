#pragma once
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "components/gateway/jobs/jobs.h"
#include "components/gateway/jobs/notifier.h"
#include "components/gateway/jobs/store.h"

namespace cotwin::gateway {

/// What the verbs and the scheduler share.
struct JobsCore {
  explicit JobsCore(JobsOptions chosen)
      : options(std::move(chosen)),
        owner(options.database),
        store(options.database, {options.most_jobs, options.most_results, options.most_result_bytes, options.result_days,
                                 options.identifier_days}) {
    store.recover(options.restarts, now());
  }

  UtcTime now() const {
    return options.now ? options.now() : std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
  }
  /// Throws Error for an unknown robot. Call it without the mutex: it may read files.
  Origin origin_of(const std::string& robot) const {
    return {options.robot_hash ? options.robot_hash(robot) : "none", options.producer};
  }
  /// nullopt: of a chain, whose steps have robots of their own.
  std::optional<Origin> origin_of(const CanonicalRequest& request) const {
    if (request.service != kChain) return origin_of(request.robot);
    if (!options.chains.next) throw Error("/steps", "is given, but this queue has no chains, expected one request");
    return std::nullopt;
  }
  /// After a transaction, with the mutex.
  void publish(JobChange::Kind kind, const Job& job) {
    notifier.publish(kind, job);
    if (kind == JobChange::Kind::kRemoved || is_done(job.state)) done.notify_all();
  }

  JobsOptions options;
  database::OwnerLock owner;
  std::mutex mutex;              // of all that follows
  std::condition_variable done;  // a job is done or removed
  JobStore store;
  std::string database_trouble, worker_trouble;
  std::uint64_t lost_workers = 0, differing_replies = 0;
  Notifier notifier;
};

/// Ends a job without a reply; the caller saves it.
inline void end_job(Job& job, JobState state, const std::string& reason, UtcTime now) {
  job.state = state;
  job.result = JobResult::kUnsuccessful;
  job.reason = reason;
  job.ended = now;
}

}  // namespace cotwin::gateway
