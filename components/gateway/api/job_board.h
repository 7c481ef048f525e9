#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "components/gateway/api/json_tools.h"
#include "components/gateway/http/stream.h"
#include "components/gateway/jobs/jobs.h"

namespace cotwin::gateway {

/// Job control as JSON (OPC 10031-4), those who wait for the end of jobs, and those who watch their changes.
class JobBoard {
 public:
  explicit JobBoard(Jobs& jobs);
  /// stop()
  ~JobBoard();
  JobBoard(const JobBoard&) = delete;
  JobBoard& operator=(const JobBoard&) = delete;

  Jobs& jobs() { return jobs_; }

  /// Calls `function` once, on any thread: with true when the job is done or removed, with false after `seconds`.
  void wait(const std::string& id, double seconds, std::function<void(bool done)> function);

  /// Sends the changes of all jobs to a stream; those after the event `last` first, if they are still kept, else an event `resync`. `last`:
  /// Last-Event-ID, "": none.
  void watch(const std::shared_ptr<http::Stream>& stream, const std::string& last);

  /// Job order and state. Throws Refusal 404.
  Json job_json(const std::string& id);
  static Json to_json(const Job& job);
  /// The reply of a job that is done, byte for byte. Throws Refusal: the worker's problem, or why there is no reply.
  http::Response reply_of(const std::string& id);

  /// Ends all waits with false, and the subscription. Later waits end at once.
  void stop();

 private:
  struct Waiter {
    std::string id;
    std::chrono::steady_clock::time_point end;
    std::function<void(bool)> function;
  };
  void on_change(const JobChange& change);
  void run();

  Jobs& jobs_;
  std::uint64_t subscription_ = 0;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopped_ = false;
  std::vector<Waiter> waiters_;
  std::vector<std::string> ended_;                         // jobs that ended since run() looked
  std::deque<std::pair<std::int64_t, http::Event>> kept_;  // the last events with a number
  std::vector<std::weak_ptr<http::Stream>> streams_;
  std::thread thread_;
};

/// Stores the order of a client, with the key of its field Idempotency-Key, whose quotes may be left out. Throws Refusal; 410 if the
/// key was used for a job order that was removed since.
JobReply store_for(Jobs& jobs, const http::Request& client, const JobOrder& order, bool start = true);

/// The response of a function, also if it throws: 503 for Unavailable, 422 for another Error, else 500.
http::Response response_of(const std::function<http::Response()>& function);

/// The refusal for a reply with an error: status by the ReturnStatus, which is a member of the problem.
http::Refusal refusal_of(const JobReply& reply);

}  // namespace cotwin::gateway
