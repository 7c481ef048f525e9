#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "tests/support/lossy_relay.h"

/// What is between the two sides of a session.
namespace cotwin::benchmark {

/// A line that can be disturbed. All functions are called from one thread.
class Line {
 public:
  virtual ~Line() = default;
  virtual void disturb() = 0;  // 5 % lost, up to 2 ms of jitter, 5 % twice, 4 % held back so that others overtake them
  virtual void clear() = 0;    // every datagram passes at once
  virtual void cut() = 0;      // none passes
  /// ns, CLOCK_MONOTONIC: no command came to the robot later, while the line was cut.
  virtual std::int64_t last_command() const = 0;
};

/// Our own relay in user space.
class RelayLine final : public Line {
 public:
  explicit RelayLine(testing::LossyRelay& relay) : relay_(relay) {}
  void disturb() override;
  void clear() override { relay_.set({}); }
  void cut() override;
  std::int64_t last_command() const override { return relay_.last_up(); }

 private:
  testing::LossyRelay& relay_;
};

/// The kernel's netem on the loopback device of a network namespace, which the calling thread and the threads that it starts
/// enter for good. It counts what it loses in both directions together.
class Netem final : public Line {
 public:
  /// Nothing where the machine does not permit it or has no netem; `reason` is one sentence then.
  static std::unique_ptr<Netem> open(std::string& reason);
  void disturb() override;
  void clear() override;
  void cut() override;
  std::int64_t last_command() const override { return cut_at_; }
  /// Datagrams lost in both directions so far.
  std::int64_t lost() const;

 private:
  Netem() = default;
  std::int64_t cut_at_ = 0;
};

}  // namespace cotwin::benchmark
