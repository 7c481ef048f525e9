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

/// Spreads a stage's units over threads, where that is quicker than one after the other. Costs of the units, from sampled
/// ticks, tell which thread each belongs on and whether a trial is worth it; a trial decides. In it both ways take turns, a
/// block of ticks each, and the medians of the blocks' times are compared: of whole ticks, for threads that wait awake slow
/// down what runs beside them. Trials repeat, since load and costs change; they take about 2 % of the ticks. Results do not
/// depend on any of it.
class Balance {
 public:
  static constexpr int kBlock = 16;       // ticks
  static constexpr int kSettle = 2;       // of them, the first ones, which are not measured: threads wake up, caches fill
  static constexpr int kBlocks = 20;      // of each way, in a trial
  static constexpr int kHold = 50;        // trials' length between two trials
  static constexpr double kClear = 0.02;  // the other way has to be better by this share

  /// `movable[i]`: unit i may run on any thread. `always`: use the threads whether or not it pays (for tests).
  Balance(std::vector<bool> movable, int threads, double barrier_seconds, bool always);

  /// How the next tick is to be made.
  bool parallel() const { return on_trial_ ? trial_parallel_ : parallel_; }
  std::span<const std::uint8_t> thread_of() const { return thread_of_; }

  /// Measured seconds of each unit in one sampled tick.
  void sampled(std::span<const double> unit_seconds);

  /// The tick from which on a trial is due; the end of time if none promises anything.
  std::int64_t next_trial() const;
  void begin_trial();
  bool on_trial() const { return on_trial_; }
  /// Measured seconds of a whole tick of the trial. The one that ends the trial decides how ticks are made from then on.
  void trial_tick(std::int64_t tick, double seconds);

 private:
  static constexpr int kWindow = 8;  // samples before the first trial

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

  bool on_trial_ = false, trial_parallel_ = false;
  int block_ = 0, in_block_ = 0;
  double block_seconds_ = 0;
  std::array<double, kBlocks> alone_{}, together_{};  // seconds of the blocks
  std::int64_t next_trial_ = 0;
};

}  // namespace cotwin::master
