#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <thread>
#include <vector>

/// Persistent threads that share the units of a stage, and the decision whether that pays.
namespace cotwin::master {

class Workers {
 public:
  /// `threads` in all, the caller's included; at least 1. Fewer, see threads(), where the machine does not give as many.
  explicit Workers(int threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  int threads() const { return static_cast<int>(threads_.size()) + 1; }

  using Task = void (*)(void* context, std::size_t index);
  /// Calls task(context, i) for all i in [0, thread_of.size()), on the thread that thread_of[i] names (0: the caller), in
  /// ascending order on each thread, and returns when all are done. Allocates nothing. The task must not throw.
  void run(std::span<const std::uint8_t> thread_of, Task task, void* context);

  /// Median seconds that run() takes for nothing.
  double barrier_seconds();

 private:
  void work(std::uint8_t self);

  std::vector<std::thread> threads_;
  std::span<const std::uint8_t> thread_of_;
  Task task_ = nullptr;
  void* context_ = nullptr;
  alignas(64) std::atomic<std::uint32_t> round_{0};
  alignas(64) std::atomic<std::uint32_t> busy_{0};
  std::atomic<bool> quit_{false};
};

/// Spreads a stage's units over threads, where that is quicker than one after the other. The decision rests on measured times
/// and is looked at again as the run goes on; results do not depend on it.
class Balance {
 public:
  /// `movable[i]`: unit i may run on any thread. `always`: use the threads whether or not it pays (for tests).
  Balance(std::vector<bool> movable, int threads, double barrier_seconds, bool always);

  bool parallel() const { return parallel_; }
  std::span<const std::uint8_t> thread_of() const { return thread_of_; }

  /// Measured seconds of each unit and of the whole stage in one sampled tick.
  void sampled(std::span<const double> unit_seconds, double stage_seconds);

 private:
  static constexpr int kWindow = 8;  // samples before a decision

  void assign();
  double longest_thread() const;

  std::vector<bool> movable_;
  std::vector<double> cost_;  // seconds per step, smoothed
  std::vector<std::size_t> order_;
  std::vector<std::uint8_t> thread_of_;
  std::vector<double> load_;  // per thread
  double barrier_;
  bool always_;
  bool parallel_ = false;
  int samples_ = 0;
  int hold_ = kWindow;              // samples until the next look
  int patience_ = kWindow;          // doubles after each trial that did not pay
  double serial_ = 0, spread_ = 0;  // mean seconds of the stage, one after the other and spread
};

}  // namespace cotwin::master
