#pragma once
#include <atomic>
#include <semaphore>
#include <string>
#include <thread>

#include "models/identification/identification.h"

namespace cotwin::tuner {

/// The result of one estimation.
struct Estimation {
  identification::Estimate estimate;
  Eigen::VectorXd rms, rms_prior, rms_floor;  // n, N.m
  double cost = 0, condition = 0;
  int rank = 0;
  std::string failure;      // the reason if there is no estimate; else empty
  std::string log;          // one sentence about the estimate
  robot::RobotModel robot;  // with the estimated bodies; its history names each estimation so far
};

struct EstimationOptions {
  numerics::SwarmOptions swarm;
  double prior_weight = identification::kPriorWeightOfShortData;
  double forgetting = 1;  // factor per sample
  friend bool operator==(const EstimationOptions&, const EstimationOptions&) = default;
};

/// A thread for estimations, one at a time. A result depends on samples, options, prior and starting time alone. The functions
/// are called by the owner's thread; start(), ready() and clear() neither block nor allocate.
class Worker {
 public:
  Worker(const robot::RobotModel& prior, const identification::ModelOptions& model, const EstimationOptions& options);
  ~Worker();

  const EstimationOptions& options() const { return options_; }
  /// Starts an estimation with a copy of `samples`, without rows in an incomplete block; `now`, s, is named in its log.
  void start(const identification::TorqueData& samples, double now);
  bool ready() const { return ready_.load(std::memory_order_acquire); }
  /// Blocks until the estimation is ready, if one was started.
  void wait();
  /// The result, once ready().
  Estimation& result() { return result_; }
  /// Ends the estimation that is ready; the next one may start.
  void clear();

  /// Appends the samples of the estimation that runs or is ready.
  void write_samples(ByteWriter& out) const { samples_.write_samples(out); }
  /// Makes the state that of a worker whose estimation started at `now` with the samples that write_samples() wrote: continues
  /// the running estimation if it is that one, else starts it again, from `robot`. Throws Error as TorqueData::read_samples.
  void restore(ByteReader& in, double now, const robot::RobotModel& robot);
  /// Stops the estimation, if one runs, which blocks for one round of the swarm at most. The history of the next result
  /// continues that of `robot`.
  void reset(const robot::RobotModel& robot);

 private:
  void launch(double now);
  void run();
  void estimate();
  bool stopped() const { return stop_.load(std::memory_order_acquire) || cancel_.load(std::memory_order_acquire); }

  EstimationOptions options_;
  robot::RobotModel prior_, robot_;
  identification::TorqueData samples_;
  double start_time_ = 0;
  bool busy_ = false;  // used by the owner's thread alone
  Estimation result_;
  std::atomic<bool> ready_ = false, stop_ = false, cancel_ = false;
  std::counting_semaphore<2> order_{0};  // a start, and the end of the thread
  std::thread thread_;
};

}  // namespace cotwin::tuner
