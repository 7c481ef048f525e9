#pragma once
#include <atomic>
#include <cstdint>
#include <mutex>

#include "models/foundation/net/udp_socket.h"
#include "tests/support/lossy_line.h"

namespace cotwin::testing {

/// A relay for datagrams in real time: robot <-> relay <-> twin, with a LossyLine in each direction. Its counts are exact.
class LossyRelay {
 public:
  LossyRelay();
  /// Where the robot has its client. What comes from the twin is sent to where the robot's last datagram came from.
  net::Endpoint client() const { return robot_side_.local(); }
  /// For both directions, with different random numbers; from any thread. At the beginning each datagram passes at once.
  void set(const Disturbance& disturbance);
  /// Until `end`, on a thread of its own.
  void run(const net::Endpoint& twin, const std::atomic<bool>& end);

  const LossyLine::Counts& down() const { return down_.counts(); }  // robot to twin; after run()
  const LossyLine::Counts& up() const { return up_.counts(); }
  /// ns, CLOCK_MONOTONIC: when the last datagram was passed on to the robot.
  std::int64_t last_up() const { return last_up_; }

 private:
  void apply();

  net::UdpSocket robot_side_, twin_side_;
  LossyLine down_{{}}, up_{{}};
  std::mutex mutex_;
  Disturbance wanted_;             // guarded by mutex_
  std::atomic<bool> new_ = false;  // wanted_ has changed
  std::atomic<std::int64_t> last_up_ = 0;
};

}  // namespace cotwin::testing
