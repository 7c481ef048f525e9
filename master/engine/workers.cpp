#include "master/engine/workers.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <system_error>

namespace cotwin::master {

namespace {

void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

/// Waits until `value` differs from `old`: spins for a few microseconds, then sleeps.
template <class T>
void wait_for_change(const std::atomic<T>& value, T old) {
  for (int i = 0; i < 500; ++i) {
    if (value.load(std::memory_order_acquire) != old) return;
    pause();
  }
  value.wait(old, std::memory_order_acquire);
}

}  // namespace

Workers::Workers(int threads) {
  try {
    for (int i = 1; i < threads; ++i) threads_.emplace_back([this, i] { work(static_cast<std::uint8_t>(i)); });
  } catch (const std::system_error&) {  // no more threads: use those that exist
  }
}

Workers::~Workers() {
  quit_ = true;
  round_.fetch_add(1, std::memory_order_release);
  round_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void Workers::run(std::span<const std::uint8_t> thread_of, Task task, void* context) {
  thread_of_ = thread_of;
  task_ = task;
  context_ = context;
  busy_.store(static_cast<std::uint32_t>(threads_.size()), std::memory_order_relaxed);
  round_.fetch_add(1, std::memory_order_release);
  round_.notify_all();
  for (std::size_t i = 0; i < thread_of.size(); ++i) {
    if (thread_of[i] == 0) task(context, i);
  }
  for (std::uint32_t busy = busy_.load(std::memory_order_acquire); busy != 0; busy = busy_.load(std::memory_order_acquire)) {
    wait_for_change(busy_, busy);
  }
}

void Workers::work(std::uint8_t self) {
  for (std::uint32_t round = 0;;) {
    wait_for_change(round_, round);
    ++round;  // run() waits for all threads, so no round is missed
    if (quit_) return;
    for (std::size_t i = 0; i < thread_of_.size(); ++i) {
      if (thread_of_[i] == self) task_(context_, i);
    }
    if (busy_.fetch_sub(1, std::memory_order_acq_rel) == 1) busy_.notify_all();
  }
}

double Workers::barrier_seconds() {
  using Clock = std::chrono::steady_clock;
  std::array<double, 31> seconds;
  for (double& s : seconds) {
    const auto begin = Clock::now();
    run({}, nullptr, nullptr);
    s = std::chrono::duration<double>(Clock::now() - begin).count();
  }
  std::nth_element(seconds.begin(), seconds.begin() + seconds.size() / 2, seconds.end());
  return seconds[seconds.size() / 2];
}

Balance::Balance(std::vector<bool> movable, int threads, double barrier_seconds, bool always)
    : movable_(std::move(movable)),
      cost_(movable_.size()),
      order_(movable_.size()),
      thread_of_(movable_.size()),
      load_(static_cast<std::size_t>(threads)),
      barrier_(barrier_seconds),
      always_(always && threads > 1),
      parallel_(always_) {
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  assign();
}

void Balance::sampled(std::span<const double> unit_seconds) {
  for (std::size_t i = 0; i < cost_.size(); ++i) cost_[i] += (unit_seconds[i] - cost_[i]) / (samples_ == 0 ? 1 : kWindow);
  ++samples_;
}

std::int64_t Balance::next_trial() const {
  constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  if (always_ || load_.size() < 2 || samples_ < kWindow) return kNever;
  if (parallel_) return next_trial_;
  // The largest possible saving must exceed the cost of two barriers.
  const double all = std::accumulate(cost_.begin(), cost_.end(), 0.0);
  const double best = std::max(*std::max_element(cost_.begin(), cost_.end()), all / static_cast<double>(load_.size()));
  return all - best > 2 * barrier_ ? next_trial_ : kNever;
}

void Balance::begin_trial() {
  assign();
  on_trial_ = true;
  trial_parallel_ = parallel_;
  block_ = in_block_ = 0;
  block_seconds_ = 0;
}

void Balance::trial_tick(std::int64_t tick, double seconds) {
  if (in_block_++ >= kSettle) block_seconds_ += seconds;
  if (in_block_ < kBlock) return;
  (trial_parallel_ ? threaded_ : serial_)[static_cast<std::size_t>(block_ / 2)] = block_seconds_;
  in_block_ = 0;
  block_seconds_ = 0;
  trial_parallel_ = !trial_parallel_;
  if (++block_ < 2 * kBlocks) return;
  // Delayed blocks, and blocks between which the costs changed, are at the ends of the sorted ratios.
  std::array<double, kBlocks> ratios;
  for (std::size_t i = 0; i < ratios.size(); ++i) ratios[i] = std::log((threaded_[i] + 1e-9) / (serial_[i] + 1e-9));
  std::sort(ratios.begin(), ratios.end());
  constexpr int kQuarter = kBlocks / 4;
  const double ratio = std::accumulate(ratios.begin() + kQuarter, ratios.end() - kQuarter, 0.0) / (kBlocks - 2 * kQuarter);
  parallel_ = parallel_ ? ratio < kClear : ratio < -kClear;
  on_trial_ = false;
  next_trial_ = tick + kHold * 2 * kBlocks * kBlock;
}

/// Assigns the most expensive unit first, to the least loaded thread.
void Balance::assign() {
  std::fill(load_.begin(), load_.end(), 0.0);
  std::sort(order_.begin(), order_.end(),
            [&](std::size_t a, std::size_t b) { return cost_[a] != cost_[b] ? cost_[a] > cost_[b] : a < b; });
  std::size_t next = 0;  // thread for the next unit of unknown cost
  for (const std::size_t i : order_) {
    std::size_t thread = 0;
    if (movable_[i]) {
      const auto least = std::min_element(load_.begin(), load_.end());
      thread = cost_[i] > 0 ? static_cast<std::size_t>(least - load_.begin()) : next++ % load_.size();
    }
    thread_of_[i] = static_cast<std::uint8_t>(thread);
    load_[thread] += cost_[i];
  }
}

}  // namespace cotwin::master
