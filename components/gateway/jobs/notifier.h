#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

#include "components/gateway/jobs/job.h"

namespace cotwin::gateway {

/// Calls subscribers on a thread of its own, in the order of the changes. The queue is bounded: progress is dropped first.
class Notifier {
 public:
  static constexpr std::size_t kMostProgress = 1'000, kMostChanges = 100'000;  // changes that wait

  Notifier();
  ~Notifier();
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;

  std::uint64_t add(std::function<void(const JobChange&)> callback);
  void remove(std::uint64_t number);
  void publish(JobChange::Kind kind, const Job& job);
  /// Passes on what is queued and ends the thread.
  void close();

 private:
  void run();

  std::mutex queue_mutex_, call_mutex_;  // never both at once
  std::condition_variable filled_;
  std::deque<JobChange> queue_;
  bool lost_ = false, closing_ = false;
  std::uint64_t last_ = 0;
  std::map<std::uint64_t, std::function<void(const JobChange&)>> callbacks_;
  std::thread thread_;
};

}  // namespace cotwin::gateway
