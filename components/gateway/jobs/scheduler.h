#pragma once
#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "components/bus/wake.h"
#include "components/gateway/jobs/core.h"
#include "components/gateway/jobs/worker_process.h"

namespace cotwin::gateway {

/// Gives jobs to worker processes, on one thread that waits for all of them with poll.
class Scheduler {
 public:
  explicit Scheduler(JobsCore& core);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// There is something new in the store. Any thread.
  void wake() { wake_.notify(); }
  /// Kills the workers and ends the thread. Without the mutex.
  void close();

  // With the mutex of the core:

  /// Stops the worker of a job, if it has one. False: too many are stopped.
  bool pause(const Job& job);
  void resume(const Job& job);
  /// Kills the worker of a job, if it has one.
  void release(const Job& job);
  /// Writes progress and times of a running job.
  void report(Job& job) const;
  int processes() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Lock = std::unique_lock<std::mutex>;

  struct Reply {
    bool problem = false;
    std::string json;
  };
  /// What a worker is given: the request of a job, or one step of a chain.
  struct Task {
    Job job;                          // of a step: with its request, service and robot
    Origin origin;                    // of its result
    std::size_t step = 0, steps = 0;  // steps: 0, no chain
    double share(double progress) const {
      return steps == 0 ? progress : (static_cast<double>(step) + progress) / static_cast<double>(steps);
    }
  };
  struct WorkerSlot {
    std::unique_ptr<WorkerProcess> process;  // null: it has ended after the reply
    std::optional<Job> job;                  // as it was given to the worker; nullopt: idle
    Task task;                               // of the job
    std::string id;                          // of the task, for the worker: the job's, and the number of the step
    std::optional<Reply> reply;              // not yet in the database
    bool paused = false, doomed = false;     // doomed: its process is to be killed
    bool heard = false;                      // the process has written a line for the job
    std::string previous;                    // task that it answered before, "": none
    Clock::time_point since;                 // start or latest resumption of the job
    double busy_s = 0;                       // of the job before that
    double progress = 0;
    std::string message;
    Clock::time_point told;                     // progress was passed on
    std::map<std::string, std::string> robots;  // hashes of the files of robots that the process has had jobs for
    double busy(Clock::time_point now) const {
      return busy_s + (paused ? 0 : std::chrono::duration<double>(now - since).count());
    }
  };

  void run();
  void supervise(Lock& lock);
  void check_limits();
  void dispatch(Lock& lock);
  bool give(Lock& lock, Job job);
  std::optional<Task> task_of(Lock& lock, Job& job);
  void end_with_problem(Job& job, const std::string& problem, UtcTime now);
  WorkerSlot* idle_slot(const std::string& robot, const std::string& hash);
  void serve(WorkerSlot& slot);
  bool robot_is_unchanged(const WorkerSlot& slot) const;
  void accept(WorkerSlot& slot, const WorkerLine& line, bool same_robot);
  void settle(WorkerSlot& slot);
  void fail(WorkerSlot& slot, const std::string& why, bool costs = true);
  void back_off();
  void clean();
  int running() const;
  WorkerSlot* slot_of(const Job& job);
  const WorkerSlot* slot_of(const Job& job) const { return const_cast<Scheduler*>(this)->slot_of(job); }
  double limit_s(const WorkerSlot& slot) const;
  int timeout_ms();
  std::vector<std::unique_ptr<WorkerSlot>> pop_doomed();

  JobsCore& core_;
  bus::Wake wake_;
  std::vector<std::unique_ptr<WorkerSlot>> slots_;  // added and removed by the thread only
  bool closing_ = false;
  Clock::time_point next_start_{}, next_try_{}, next_clean_{};  // of a worker; of the database
  double back_off_s_;
  std::thread thread_;
};

}  // namespace cotwin::gateway
