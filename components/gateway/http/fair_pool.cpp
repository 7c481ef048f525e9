#include "components/gateway/http/fair_pool.h"

#include <algorithm>
#include <exception>
#include <tuple>
#include <utility>

namespace cotwin::gateway::http {

FairPool::FairPool(const Options& options) : options_(options) {}

FairPool::~FairPool() { stop(); }

FairPool::Verdict FairPool::post(const std::string& owner, Task task) {
  const std::lock_guard lock(mutex_);
  if (stopped_ || waiting_ >= options_.waiting) return Verdict::kFull;
  if (const auto found = owners_.find(owner); found != owners_.end() && found->second.waiting.size() >= options_.owner_waiting)
    return Verdict::kOwnerFull;
  ensure_thread();
  if (threads_.empty()) return Verdict::kFull;
  const auto [entry, is_new] = owners_.try_emplace(owner);
  if (is_new) entry->second.turn = turn_;
  entry->second.waiting.push_back({++number_, Clock::now(), std::move(task)});
  ++waiting_;
  changed_.notify_one();
  return Verdict::kTaken;
}

void FairPool::ensure_thread() noexcept {
  if (idle_ > 0 || threads_.size() >= options_.most) return;
  try {
    threads_.emplace_back([this] { work(); });
    ++idle_;
  } catch (const std::exception&) {
    // The system has no resources for another thread now.
  }
}

FairPool::Owners::iterator FairPool::choose(Clock::time_point now, Clock::time_point& next) {
  auto best = owners_.end();
  for (auto each = owners_.begin(); each != owners_.end(); ++each) {
    const Owner& owner = each->second;
    if (owner.waiting.empty()) continue;
    const Clock::time_point patient_until = owner.waiting.front().since + options_.patience;
    const bool late = now >= patient_until && running_ < options_.many;
    if (running_ >= options_.threads && !(owner.running == 0 && running_ < options_.most) && !late) {
      if (running_ < options_.many) next = std::min(next, patient_until);
      continue;
    }
    const auto rank = [](const Owner& p) { return std::tuple(p.running, p.turn, p.waiting.front().number); };
    if (best == owners_.end() || rank(owner) < rank(best->second)) best = each;
  }
  return best;
}

void FairPool::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (stopped_) return;
    Clock::time_point next = Clock::time_point::max();
    const auto chosen = choose(Clock::now(), next);
    if (chosen == owners_.end()) {
      if (next == Clock::time_point::max()) {
        changed_.wait(lock);
      } else {
        changed_.wait_until(lock, next);
      }
      continue;
    }
    const std::string name = chosen->first;
    Task task = std::move(chosen->second.waiting.front().task);
    chosen->second.waiting.pop_front();
    ++chosen->second.running;
    chosen->second.turn = ++turn_;
    ++running_;
    --waiting_;
    --idle_;
    // Another one may begin at once, or after its patience.
    if (waiting_ > 0) {
      ensure_thread();
      changed_.notify_one();
    }
    lock.unlock();
    task();
    task = nullptr;
    lock.lock();
    ++idle_;
    --running_;
    const auto owner = owners_.find(name);
    if (--owner->second.running == 0 && owner->second.waiting.empty()) owners_.erase(owner);
  }
}

void FairPool::stop() noexcept {
  std::vector<std::thread> threads;
  Owners dropped;
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    for (auto& [name, owner] : owners_) dropped[name].waiting.swap(owner.waiting);
    waiting_ = 0;
    threads.swap(threads_);
  }
  changed_.notify_all();
  dropped.clear();
  for (std::thread& thread : threads) thread.join();
}

}  // namespace cotwin::gateway::http
