#pragma once
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"
#include "models/foundation/net/endpoint.h"

/// The two sides of an FRI session as units, each on a thread of its own and on the wall clock.
namespace cotwin::benchmark {

struct SessionSettings {
  std::string protocol;
  Duration period{1'000'000};
  double seconds = 0;         // for which the samples of answer times have room
  master::ClockSpec clock;    // priority and CPUs of both threads
  bool rates_answers = true;  // false: late answers do not end commanding, as on a line whose delay exceeds the period
};

/// The motion of the twin, common to all joints: q(t) = q_0 + 0.1 rad (1 − cos 2πt/(2 s)), at most 0.32 rad/s.
double desired_offset(double t);

/// A unit of `unit:io?robot=lwr4&link=…` with its ports by name.
class Side {
 public:
  Side(const std::string& link, const SessionSettings& settings);

  void set(const std::string& name, const std::string& value);
  std::span<double> reals(const std::string& name) { return instance_.variables.at(name).reals(); }
  std::int32_t integer(const std::string& name) { return instance_.variables.at(name).integers()[0]; }
  /// The address and port that datagrams come to.
  net::Endpoint local();
  /// Allocations within the loop of run().
  std::uint64_t allocations() const { return allocations_; }

 protected:
  SessionSettings settings_;
  Instance instance_;
  std::uint64_t allocations_ = 0;
};

/// The robot: `link=fri_controller`, stepped at the multiples of the period. Its joints follow q_command without error.
class Robot : public Side {
 public:
  explicit Robot(const SessionSettings& settings);
  void initialise(const net::Endpoint& client);
  /// From `start` (ns, CLOCK_MONOTONIC) until `end`.
  void run(std::int64_t start, const std::atomic<bool>& end);

  std::atomic<bool> active = false;                  // it follows the twin
  std::atomic<bool> watch = false;                   // `error` is recorded
  std::atomic<std::int64_t> moved_at = 0;            // ns, CLOCK_MONOTONIC: end of the last step that has moved the set point
  double error() const { return error_; }            // rad, largest from the twin's motion after 0.5 s of following
  std::int64_t latest() const { return latest_; }    // ns, largest delay of a step
  std::int64_t skipped() const { return skipped_; }  // periods in which no step was made in time

 private:
  double error_ = 0;
  std::atomic<std::int64_t> latest_ = 0;
  std::int64_t skipped_ = 0;
};

/// The twin: `link=fri`, stepped when a message has come.
class Twin : public Side {
 public:
  explicit Twin(const SessionSettings& settings);
  void initialise();
  void run(std::int64_t start, const std::atomic<bool>& end);

  /// s, from the arrival of a message at the socket (time stamp of the kernel) to the end of the step that has sent the answer; of
  /// messages that came together, the newest one's.
  std::vector<double>& answer_times() { return answer_times_; }

 private:
  std::vector<double> answer_times_;
};

}  // namespace cotwin::benchmark
