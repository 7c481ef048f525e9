#pragma once
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace cotwin::gateway::http {

/// Threads that run the tasks of several owners in fair shares. A task that waits begins
/// 1. when fewer than `threads` tasks run,
/// 2. when none of its owner runs and fewer than `most` do: long tasks of others do not delay it,
/// 3. when it has waited for `patience` and fewer than `many` run: nor do long tasks of its owner.
/// Of several, that of the owner with the fewest running ones begins; equal owners take turns. Threads are started when they are needed.
class FairPool {
 public:
  struct Options {
    std::size_t threads = 2, many = 8, most = 16;    // threads <= many <= most
    std::size_t waiting = 256, owner_waiting = 128;  // tasks that wait: of all, of one owner
    std::chrono::milliseconds patience{50};
  };
  using Task = std::function<void()>;  // must not throw

  explicit FairPool(const Options& options);
  /// stop()
  ~FairPool();
  FairPool(const FairPool&) = delete;
  FairPool& operator=(const FairPool&) = delete;

  enum class Verdict { kTaken, kOwnerFull, kFull };
  Verdict post(const std::string& owner, Task task);
  /// Drops the tasks that wait and waits for those that run.
  void stop() noexcept;

 private:
  using Clock = std::chrono::steady_clock;
  struct Waiting {
    std::uint64_t number = 0;  // in the order of arrival
    Clock::time_point since;
    Task task;
  };
  struct Owner {
    std::size_t running = 0;
    std::uint64_t turn = 0;  // when its last task began, or its first one came
    std::deque<Waiting> waiting;
  };
  using Owners = std::map<std::string, Owner>;

  void work();
  /// Another thread, unless one is idle. Without resources for it the others go on.
  void ensure_thread() noexcept;
  /// The owner whose first task begins now, or end(); `next`: when the answer may change by itself.
  Owners::iterator choose(Clock::time_point now, Clock::time_point& next);

  const Options options_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Owners owners_;  // only those with tasks
  std::vector<std::thread> threads_;
  std::size_t idle_ = 0, running_ = 0, waiting_ = 0;
  std::uint64_t number_ = 0, turn_ = 0;
  bool stopped_ = false;
};

}  // namespace cotwin::gateway::http
