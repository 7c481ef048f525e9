#pragma once
#include <atomic>
#include <semaphore>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "models/identification/identification.h"

namespace cotwin::tuner {

/// What a tuning found.
struct Finding {
  identification::Estimate estimate;
  Eigen::VectorXd rms, rms_prior, rms_floor;  // n, N.m
  double cost = 0, condition = 0;
  int rank = 0;
  std::string failure;      // why nothing was found; else empty
  std::string log;          // what was found, in a sentence
  robot::RobotModel robot;  // as found, with each finding before it in its history
};

/// How to seek.
struct Orders {
  numerics::SwarmOptions swarm;
  double prior_weight = 0.1;
  double forgetting = 1;  // of the data
  friend bool operator==(const Orders&, const Orders&) = default;
};

/// A thread that tunes: a finding is a function of the data and the orders alone. The other thread asks; nothing that it calls
/// blocks (but wait() and cancel()) or allocates.
class Worker {
 public:
  Worker(const robot::RobotModel& prior, const identification::ModelOptions& model, const Orders& orders);
  ~Worker();

  const Orders& orders() const { return orders_; }
  /// Seeks with what TorqueData::store gave, at `now` s, which the finding will name. One search at a time: when ready() or
  /// after wait(), taken() makes way for the next one.
  void seek(std::span<const double> data, double now);
  bool busy() const { return busy_; }
  bool ready() const { return ready_.load(std::memory_order_acquire); }
  void wait();
  void taken();
  /// Gives the search up, if there is one: waits for a round of the swarm at most, once it has begun.
  void cancel();
  /// Whether that very search is under way or ready.
  bool seeks(std::span<const double> data, double now) const;
  /// Of the last seek(), once ready.
  Finding& finding() { return finding_; }
  /// The robot whose history the next findings continue. While not busy.
  void continue_from(const robot::RobotModel& robot) { robot_ = robot; }

 private:
  void run();
  void tune();
  bool given_up() const { return stop_.load(std::memory_order_acquire) || cancel_.load(std::memory_order_acquire); }

  Orders orders_;
  robot::RobotModel prior_, robot_;
  identification::TorqueData data_;
  std::vector<double> order_data_;
  double order_now_ = 0;
  bool busy_ = false;  // the caller's
  Finding finding_;
  std::atomic<bool> ready_ = false, stop_ = false, cancel_ = false;
  std::counting_semaphore<2> order_{0};  // an order, and the end
  std::thread thread_;
};

}  // namespace cotwin::tuner
