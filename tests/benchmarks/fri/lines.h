#pragma once
#include <cstdint>

#include "tests/support/lossy_relay.h"

/// What is between the two sides of a session.
namespace cotwin::benchmark {

/// A relay in user space that can be disturbed. All functions are called from one thread.
class Line {
 public:
  explicit Line(testing::LossyRelay& relay) : relay_(relay) {}
  void disturb();                   // 5 % lost, up to 2 ms of jitter, 5 % twice, 4 % held back so that others overtake them
  void clear() { relay_.set({}); }  // every datagram passes at once
  void cut();                       // none passes
  /// ns, CLOCK_MONOTONIC: no command came to the robot later, while the line was cut.
  std::int64_t last_command() const { return relay_.last_up(); }

 private:
  testing::LossyRelay& relay_;
};

}  // namespace cotwin::benchmark
