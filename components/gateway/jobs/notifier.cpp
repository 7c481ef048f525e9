#include "components/gateway/jobs/notifier.h"

#include <exception>
#include <iostream>
#include <utility>

#include "components/gateway/jobs/threads.h"

namespace cotwin::gateway {

Notifier::Notifier() : thread_(thread_without_signals([this] { run(); })) {}

Notifier::~Notifier() { close(); }

std::uint64_t Notifier::add(std::function<void(const JobChange&)> callback) {
  const std::lock_guard lock(call_mutex_);
  callbacks_.emplace(++last_, std::move(callback));
  return last_;
}

void Notifier::remove(std::uint64_t number) {
  const std::lock_guard lock(call_mutex_);
  callbacks_.erase(number);
}

void Notifier::publish(JobChange::Kind kind, const Job& job) {
  JobChange change{kind, job, false};
  change.job.order.request.clear();
  const std::lock_guard lock(queue_mutex_);
  if (kind == JobChange::Kind::kProgress && queue_.size() >= kMostProgress) return;
  if (queue_.size() >= kMostChanges) {
    queue_.pop_front();
    lost_ = true;
  }
  queue_.push_back(std::move(change));
  filled_.notify_one();
}

void Notifier::close() {
  {
    const std::lock_guard lock(queue_mutex_);
    closing_ = true;
    filled_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
}

void Notifier::run() {
  for (;;) {
    JobChange change;
    {
      std::unique_lock lock(queue_mutex_);
      filled_.wait(lock, [&] { return closing_ || !queue_.empty(); });
      if (queue_.empty()) return;
      change = std::move(queue_.front());
      queue_.pop_front();
      change.lost = std::exchange(lost_, false);
    }
    const std::lock_guard lock(call_mutex_);
    for (const auto& [number, callback] : callbacks_) {
      try {
        callback(change);
      } catch (const std::exception& error) {
        std::cerr << "cotwin: a subscriber of job changes failed: " << error.what() << '\n';
      }
    }
  }
}

}  // namespace cotwin::gateway
