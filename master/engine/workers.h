#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <thread>
#include <vector>

/// Persistent threads that share the units of a stage, and the decision whether to use them.
namespace cotwin::master {

class Workers {
 public:
  /// `threads` >= 1 includes the caller's. threads() is smaller if the system refuses to create as many.
  explicit Workers(int threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  int threads() const { return static_cast<int>(threads_.size()) + 1; }

  using Task = void (*)(void* context, std::size_t index);
  /// Calls task(context, i) for all i in [0, thread_of.size()) on thread thread_of[i] (0: the caller), in ascending order on
  /// each thread, and returns when all are done. Allocates nothing. The task must not throw.
  void run(std::span<const std::uint8_t> thread_of, Task task, void* context);

  /// Median seconds of a run() without tasks.
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

/// Decides whether the units of a stage step on several threads. The costs of the units, from timed ticks, determine the thread
/// of each unit and whether a trial is worthwhile. A trial alternates blocks of ticks on one thread and on several, and
/// compares the times of neighbouring blocks (mean of the middle half of their log ratios). Whole ticks are timed, because a
/// thread that waits by spinning slows down the other cores. Trials repeat because load and costs change; they take about 2 %
/// of the ticks. Results of the simulation do not depend on the decision.
class Balance {
 public:
  static constexpr int kBlock = 16;       // ticks
  static constexpr int kSettle = 2;       // first ticks of a block, not measured: threads wake up, caches fill
  static constexpr int kBlocks = 20;      // of each kind in a trial
  static constexpr int kHold = 50;        // time between two trials, in lengths of a trial
  static constexpr double kClear = 0.02;  // minimum gain, relative, to change the decision

  /// `movable[i]`: unit i may run on any thread. `always`: use the threads even where they are slower (for tests).
  Balance(std::vector<bool> movable, int threads, double barrier_seconds, bool always);

  /// Whether the next tick uses several threads.
  bool parallel() const { return on_trial_ ? trial_parallel_ : parallel_; }
  std::span<const std::uint8_t> thread_of() const { return thread_of_; }

  /// Takes the measured seconds of each unit in one timed tick.
  void sampled(std::span<const double> unit_seconds);

  /// The tick from which on a trial is due; the largest number if none is worthwhile.
  std::int64_t next_trial() const;
  void begin_trial();
  bool on_trial() const { return on_trial_; }
  /// Takes the measured seconds of a whole tick of the trial. The last tick of the trial decides.
  void trial_tick(std::int64_t tick, double seconds);

 private:
  static constexpr int kWindow = 8;  // samples before the first trial

  void assign();

  std::vector<bool> movable_;
  std::vector<double> cost_;  // seconds per step, smoothed
  std::vector<std::size_t> order_;
  std::vector<std::uint8_t> thread_of_;
  std::vector<double> load_;  // per thread
  double barrier_;
  bool always_;
  bool parallel_ = false;
  int samples_ = 0;

  bool on_trial_ = false, trial_parallel_ = false;
  int block_ = 0, in_block_ = 0;  // blocks and ticks of the block so far
  double block_seconds_ = 0;
  std::array<double, kBlocks> serial_{}, threaded_{};  // seconds of the blocks
  std::int64_t next_trial_ = 0;
};

}  // namespace cotwin::master
