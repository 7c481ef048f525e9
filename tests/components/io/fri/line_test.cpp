// A minute of FRI at 1 kHz over a line that loses, delays, doubles and reorders, then loses everything, in simulated time and
// without sockets. The line knows what it has done, the client and the controller have to find it out.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/fri/client.h"
#include "tests/support/lossy_line.h"

namespace cotwin::fri::line_test {
namespace {

constexpr std::int64_t kMillisecond = 1'000'000;  // ns
constexpr std::int64_t kPeriod = kMillisecond;
constexpr double kSpeedLimit = 2;  // rad/s

/// The twin's motion: at most 0.32 rad/s.
double desired(double t) { return 0.1 * (1 - std::cos(std::numbers::pi * t)); }

ControllerSettings controller_settings(Protocol protocol) {
  ControllerSettings s;
  s.protocol = protocol;
  s.send_period = kPeriod;
  s.speed_limit.assign(7, kSpeedLimit);
  // The line is slower than the period, so late answers must not end commanding.
  s.rating.good = s.rating.fair = 0;
  return s;
}

ClientSettings client_settings(Protocol protocol) {
  ClientSettings s;
  s.protocol = protocol;
  s.speed_limit.assign(7, kSpeedLimit);
  return s;
}

class Session {
 public:
  explicit Session(Protocol protocol)
      : controller(controller_settings(protocol), "controller"), client(client_settings(protocol), "client") {
    Monitoring& robot = controller.robot();
    robot.fields |= Monitoring::kMeasuredPosition | Monitoring::kDriveStates | Monitoring::kSafetyState;
    wanted_.fields = Command::kPosition;
    wanted_.joints = robot.joints;
    controller.open(0);
    controller.request(true);
  }

  void run_seconds(double seconds) {
    constexpr std::int64_t kStep = 100'000;  // ns
    for (const std::int64_t end = now + std::llround(seconds * 1e9); now < end; now += kStep) {
      while (down.due() <= now) answer(down.pop(now));
      while (up.due() <= now) {
        const auto bytes = up.pop(now);
        controller.receive(bytes, {0x7f000001, 30200}, now);
        last_command = now;
      }
      if (controller.next() <= now) cycle();
    }
  }

  void disturb(const testing::Disturbance& disturbance) {
    testing::Disturbance other = disturbance;
    other.seed = disturbance.seed + 1;
    down.set(disturbance);
    up.set(other);
  }

  Controller controller;
  Client client;
  testing::LossyLine down{{}}, up{{}};
  std::int64_t now = 0;           // ns
  std::int64_t last_command = 0;  // ns: when a command came to the controller
  std::int64_t last_moved = 0;    // ns: the last cycle in which the set point moved
  double largest_step = 0;        // rad per cycle
  double largest_error = 0;       // rad, from the twin's motion while the robot follows it

 private:
  void answer(const std::vector<std::uint8_t>& bytes) {
    if (client.receive(bytes, {0x7f000002, 30200}, now) != Client::Reception::kAnswerDue) return;
    wanted_.q.fill(desired(static_cast<double>(now) * 1e-9));
    up.push(now, client.answer(wanted_, now));
  }
  void cycle() {
    const Setpoint& s = controller.setpoint(now);
    controller.robot().q_measured = s.q;
    const double step = std::abs(s.q[0] - before_);
    before_ = s.q[0];
    if (step > 1e-9) last_moved = now;
    largest_step = std::max(largest_step, step);
    // The twin is approached with the speed limit when commanding begins.
    following_ = s.active ? following_ + 1 : 0;
    if (following_ > 500) largest_error = std::max(largest_error, std::abs(s.q[0] - desired(static_cast<double>(now) * 1e-9)));
    down.push(now, controller.cycle(now));
  }

  Command wanted_;
  double before_ = 0;
  int following_ = 0;  // cycles
};

class LossyFri : public ::testing::TestWithParam<Protocol> {};

TEST_P(LossyFri, StaysNearTheTwinCountsTheFaultsStopsAfterTotalLossAndRecovers) {
  Session s(GetParam());
  s.run_seconds(1);
  ASSERT_EQ(s.controller.state(), SessionState::kCommandingActive);
  testing::Disturbance disturbance;
  disturbance.loss = 0.05;
  disturbance.jitter = 2 * kMillisecond;
  disturbance.duplicate = 0.05;
  disturbance.reorder = 0.04;
  disturbance.hold = 3 * kMillisecond;
  s.disturb(disturbance);
  s.run_seconds(60);
  s.disturb({});
  s.run_seconds(0.25);
  EXPECT_EQ(s.controller.drop(), Drop::kNone);
  EXPECT_LE(s.largest_step, kSpeedLimit * 1e-3 * (1 + 1e-6) + 1e-6) << "single floats on the wire";
  // 2 · (2 + 3) ms of transport and ten lost commands, at 0.32 rad/s.
  EXPECT_LE(s.largest_error, 0.32 * 0.020);
  EXPECT_GT(s.largest_error, 0.32 * 0.001) << "there is a delay";

  const auto compare = [](const SequenceTracker& found, const testing::LossyLine::Counts& injected) {
    EXPECT_GT(injected.lost, 2000);
    EXPECT_GT(injected.duplicates, 2000);
    EXPECT_GT(injected.overtaken, 1500);
    EXPECT_EQ(found.lost(), static_cast<std::uint64_t>(injected.lost));
    EXPECT_EQ(found.duplicates(), static_cast<std::uint64_t>(injected.duplicates));
    EXPECT_EQ(found.reordered(), static_cast<std::uint64_t>(injected.overtaken));
    EXPECT_EQ(found.received(), static_cast<std::uint64_t>(injected.delivered - injected.duplicates));
  };
  compare(s.client.statistics().monitoring, s.down.counts());
  compare(s.controller.statistics().commands, s.up.counts());
  EXPECT_EQ(s.client.statistics().faults.total() + s.controller.statistics().faults.total(), 0u);
  EXPECT_EQ(s.client.statistics().answers, s.client.statistics().monitoring.received()) << "each message is answered once";

  // Total loss while the joints move with 0.32 rad/s · sin(π/4).
  const std::int64_t lost = s.down.counts().lost;
  disturbance = {};
  disturbance.loss = 1;
  s.disturb(disturbance);
  s.run_seconds(1);
  EXPECT_EQ(s.controller.drop(), Drop::kLost);
  EXPECT_FALSE(s.controller.setpoint(s.now).active);
  EXPECT_FALSE(s.client.connected(s.now));
  // The period in which the last command came, the one in which it is applied, ten that are extrapolated, the stop (docs/fri.md).
  EXPECT_LE(s.last_moved - s.last_command, 12 * kPeriod + s.controller.settings().stop_time);
  EXPECT_GT(s.last_moved - s.last_command, 11 * kPeriod) << "lost commands are extrapolated";

  // The line is repaired: nothing moves until the robot's program asks again.
  s.disturb({});
  const std::int64_t moved = s.last_moved;
  s.run_seconds(0.5);
  EXPECT_EQ(s.last_moved, moved);
  s.controller.request(false);
  s.run_seconds(0.01);
  s.controller.request(true);
  s.run_seconds(1.5);
  EXPECT_EQ(s.controller.state(), SessionState::kCommandingActive);
  EXPECT_LE(s.largest_step, kSpeedLimit * 1e-3 * (1 + 1e-6) + 1e-6) << "the twin, which went on, is approached";
  EXPECT_NEAR(s.controller.setpoint(s.now).q[0], desired(static_cast<double>(s.now) * 1e-9), 0.32 * 0.003);
  EXPECT_EQ(s.client.statistics().monitoring.lost(), static_cast<std::uint64_t>(s.down.counts().lost));
  EXPECT_EQ(s.down.counts().lost - lost, 1000);
}

INSTANTIATE_TEST_SUITE_P(Protocols, LossyFri, ::testing::ValuesIn(kProtocols), [](const auto& protocol) {
  std::string name = to_text(protocol.param);
  std::erase_if(name, [](char c) { return c == '-' || c == '.'; });
  return name;
});

}  // namespace
}  // namespace cotwin::fri::line_test
