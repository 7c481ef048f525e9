#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/gateway/jobs/errors.h"
#include "components/gateway/jobs/job.h"

namespace cotwin::gateway {

/// Chains of requests: what the answers to earlier steps make of later ones. All texts are JSON.
struct Chains {
  /// The request of the step after those that have replies; "": there is none. Throws Error.
  std::function<std::string(const std::string& chain, const std::vector<std::string>& replies)> next;
  std::function<std::string(const std::string& chain, const std::vector<std::string>& replies)> reply;
  /// The problem of a step as that of the chain.
  std::function<std::string(const std::string& chain, std::size_t step, const std::string& problem)> problem;
  /// Of an error of next().
  std::function<std::string(const std::exception& error)> problem_of;
};

struct JobsOptions {
  std::filesystem::path database;  ///< SQLite file, created if it is missing; beside it <file>.owner, <file>-wal, <file>-shm
  std::vector<std::string>
      command;      ///< worker: program (absolute path) and arguments, e.g. {"/usr/bin/cotwin", "ask", "--worker"}
  int workers = 1;  ///< processes that compute at the same time, 1 to 256
  int paused = 8;   ///< further processes that are stopped by Pause
  int nice = 10;    ///< added to the nice level of this process, 0 to 19
  std::uint64_t memory = std::uint64_t{4} << 30;  ///< of a worker, bytes
  std::uint64_t line = std::uint64_t{64} << 20;   ///< longest line of a worker, bytes
  double time_limit_s = 600;                      ///< of running, s, for orders without one
  int retries = 1;                                ///< workers that a job may lose and is tried again
  int restarts = 20;                              ///< ends of the gateway without close() that a running job survives
  double back_off_s = 0.25;  ///< wait before a failed worker is started again, s; doubles up to 30 s until a job succeeds
  std::string producer;      ///< version of this build, part of the identity of a result
  /// Hash of the files of a robot, "": the one of requests that name none; throws Error for an unknown robot. Called on several
  /// threads. Empty: results are reused whatever the files of the robot.
  std::function<std::string(const std::string& robot)> robot_hash;
  std::function<UtcTime()> now;  ///< UTC; empty: the system's clock
  Chains chains;                 ///< without them chains are refused

  std::size_t most_jobs = 20'000;                            ///< stored and not done (MaxDownloadableJobOrders)
  std::uint64_t most_request = std::uint64_t{1} << 20;       ///< bytes of a request
  std::size_t most_results = 100'000;                        ///< read or cleared results beyond are removed, oldest first
  std::uint64_t most_result_bytes = std::uint64_t{1} << 30;  ///< the same for the bytes of all replies
  double result_days = 90;                                   ///< the same for the age
  double identifier_days = 30;                               ///< identifiers and keys of removed jobs stay reserved
};

/// What a monitor shows.
struct JobsStatus {
  std::size_t not_allowed_to_start = 0, allowed_to_start = 0, running = 0, interrupted = 0, done = 0;
  int workers = 0;                 ///< processes
  std::uint64_t results = 0;       ///< kept
  std::uint64_t result_bytes = 0;  ///< of their replies
  std::uint64_t lost_workers = 0;  ///< processes that died, hung or wrote garbage since the start
  std::uint64_t differing_replies =
      0;                ///< replies that differ from an earlier one to the same request, robot and build: a defect
  std::string trouble;  ///< the database cannot be written or no worker can be started: why; "" if all is well
};

/// The queue of jobs, their worker processes and their results, kept in an SQLite database: every reply of a verb is durable
/// before the function returns, and a job is done once, whenever the process is killed. Order of execution: priority, then
/// deadline, then order of arrival. A job that ran when the gateway ended runs again after the next start; its state stays
/// Running meanwhile. A worker that dies, or breaks the protocol, costs its job a retry; without one left the job is Aborted and
/// Unsuccessful. Threads: every function may be called from any thread. Clock: deadlines in UTC, checked at least once a second,
/// so that clock steps are followed.
///
/// A chain (a request with the member "steps") is one job. Its steps are given to workers one after the other, each as a request of its
/// own, whose reply is kept as a result of the job: after the end of the process a chain goes on with the step that is not answered.
///
/// Worker protocol: lines of JSON. To stdin {"id", "request"}; from stdout {"id", "progress", "message"} any number of times, then
/// {"id", "reply"} or {"id", "problem": {"title", "detail", "pointer"}}. A job is cancelled by killing its worker.
class Jobs {
 public:
  /// Opens the database and starts to work. Throws Error if the options are out of range, or if the database cannot be opened, is
  /// damaged, of another program or a newer version, or in use: the message then names the file and the process.
  explicit Jobs(JobsOptions options);
  /// close().
  ~Jobs();
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  /// Store and StoreAndStart. Never throws for bad orders: the reply has the status and the reason. kInvalidJobOrderStatus: the
  /// identifier is in use or was used before.
  JobReply store(const JobOrder& order, const StoreOptions& options = {});
  /// Update of an order that is not Running yet; its identifier and state stay. `version`: kVersionChanged if the job has another.
  JobReply update(const JobOrder& order, std::optional<std::int64_t> version = {},
                  const std::vector<LocalizedText>& comment = {});
  JobReply command(const std::string& id, JobVerb verb, const std::vector<LocalizedText>& comment = {});
  /// Cancel in state 1 or 2, Clear if the job is done, else kInvalidJobOrderStatus.
  JobReply remove(const std::string& id);

  // These throw Unavailable if the database cannot be read.

  /// nullopt: no job order has this identifier, or it was removed.
  std::optional<Job> find(const std::string& id);
  /// As find; marks a job that is done as read, so that its result may be removed when the limits are reached.
  std::optional<Job> response(const std::string& id);
  /// A page of at most `limit` (1 to 1000) jobs; it ends early where it reaches 4 MiB. `cursor`: "" or JobPage::next of the same filter. Throws Error for another one.
  JobPage list(const JobFilter& filter, std::string_view cursor = {}, std::size_t limit = 100);
  /// The reply is included. nullopt: there is none with this number.
  std::optional<Result> result(std::int64_t number);
  /// As list. Throws Error also if filter.request is no JSON object.
  ResultPage results(const ResultFilter& filter, std::string_view cursor = {}, std::size_t limit = 100);

  /// Waits until the job is done or removed, or `seconds` have passed; returns it as find.
  std::optional<Job> wait(const std::string& id, double seconds);

  /// `callback` is called on a thread of its own for every change, in the order of the changes; it must not block, and must not
  /// call close(). Progress is passed on at most 10 times a second per job. Returns a number for unsubscribe.
  std::uint64_t subscribe(std::function<void(const JobChange&)> callback);
  /// After it returned the callback is not called any more; not from within a callback.
  void unsubscribe(std::uint64_t number);

  JobsStatus status();
  /// Applies the limits of results and identifiers now; done by itself once a minute.
  void clean();
  /// Kills the workers; running jobs run again after the next start. Later calls of other functions throw Unavailable or reply
  /// kUnableToAccept. The destructor closes the database.
  void close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Canonical form of a request: members sorted, shortest numbers, no blanks. Equal requests have equal texts. Throws Error with the
/// JSON pointer for anything but a JSON object, for a member that appears twice, and for more than 32 levels.
std::string canonical_json(std::string_view text);

}  // namespace cotwin::gateway
