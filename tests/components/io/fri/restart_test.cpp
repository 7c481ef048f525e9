// After a loss, a restart or a jump the twin's side of FRI commands nothing until `acknowledge` rises: components/io/links/fri_link.h,
// components/io/link/acknowledgement.h.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "components/io/link/belief.h"
#include "tests/components/io/fri/rig.h"
#include "tests/support/error_of.h"

namespace cotwin::io::restart_test {
namespace {

class FriRestart : public ::testing::TestWithParam<Protocol> {};
INSTANTIATE_TEST_SUITE_P(Protocols, FriRestart, ::testing::ValuesIn(kProtocols), name_of_protocol);

/// The twin is at kQ, and the robot is put to where its first joint is 0.3 rad further.
std::array<double, 7> moved() {
  std::array<double, 7> q = kQ;
  q[0] += 0.3;
  return q;
}

/// The robot takes commands, but gets its own position only, until somebody acknowledges. Then it is driven to the twin, softly.
void expect_held_until_acknowledged(Rig& rig, const std::array<double, 7>& place) {
  for (int k = 0; k < 300; ++k) {
    if (!rig.period() || !rig.command.has(fri::Command::kPosition)) continue;
    for (std::size_t i = 0; i < 7; ++i) ASSERT_NEAR(rig.command.q[i], place[i], rig.rounding()) << k;
  }
  EXPECT_FALSE(rig.twin.boolean("commanding"));
  EXPECT_TRUE(rig.twin.boolean("awaits_acknowledgement"));
  EXPECT_THAT(rig.twin.instance.variables.at("warning").strings()[0], ::testing::HasSubstr("until acknowledge rose"));
  rig.acknowledge();
  EXPECT_FALSE(rig.twin.boolean("awaits_acknowledgement"));
  EXPECT_TRUE(rig.twin.boolean("commanding"));
  double before = rig.command.q[0], speed = 0;
  for (int k = 0; k < 700; ++k) {
    ASSERT_TRUE(rig.period());
    const double now = (rig.command.q[0] - before) / rig.m.send_period;
    ASSERT_LE(std::abs(now), kSpeed * std::min(1.0, (k + 3) * 0.002 / 0.5) + rig.rounding() / 0.002) << k;
    ASSERT_LE(std::abs(now - speed), 20 * rig.m.send_period * 1.001 + 2 * rig.rounding() / 0.002) << k;
    before = rig.command.q[0];
    speed = now;
  }
  EXPECT_NEAR(before, kQ[0], 2 * rig.rounding());
}

TEST_P(FriRestart, ALossIsFollowedByNothingUntilItIsAcknowledged) {
  Rig rig(GetParam());
  rig.begin();
  rig.settle();
  while (rig.twin.boolean("connected")) rig.period(false);
  EXPECT_EQ(rig.twin.integer("losses"), 1);
  // By hand, to another place; the robot's program commands again before the twin hears of it.
  rig.put(moved());
  rig.m.q_interpolator = {};  // Sunrise: its own motion is somewhere else
  if (GetParam() == Protocol::kLwr) std::ranges::copy(moved(), rig.m.q_interpolator.begin());
  expect_held_until_acknowledged(rig, moved());
  EXPECT_EQ(rig.twin.integer("restarts"), 0) << "a loss, no restart";
}

TEST_P(FriRestart, ARestartIsFollowedByNothingUntilItIsAcknowledged) {
  for (const bool within_timeout : {true, false}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    while (!within_timeout && rig.twin.boolean("connected")) rig.period(false);
    // Killed and started again at q₁ = 0.4.
    rig.put(moved());
    rig.m.counter = 0;
    rig.m.time = 0;
    rig.m.state = SessionState::kMonitoringReady;
    for (int k = 0; k < 20; ++k) rig.period();
    rig.m.state = SessionState::kCommandingWait;
    if (GetParam() != Protocol::kLwr) rig.period();
    rig.m.state = SessionState::kCommandingActive;
    expect_held_until_acknowledged(rig, moved());
    EXPECT_EQ(rig.twin.integer("restarts"), within_timeout ? 1 : 0);
  }
}

TEST_P(FriRestart, AJumpIsFollowedByNothingUntilItIsAcknowledged) {
  Rig rig(GetParam());
  rig.begin();
  rig.settle();
  rig.put(moved());
  expect_held_until_acknowledged(rig, moved());
  EXPECT_EQ(rig.twin.integer("restarts") + rig.twin.integer("losses"), 0);
}

// Four of five messages are damaged and well-formed: they are not used, and the robot goes on.
TEST_P(FriRestart, DamagedMessagesAreNotUsed) {
  Rig rig(GetParam());
  rig.begin();
  rig.settle();
  for (int k = 0; k < 100; ++k) {
    const auto whole = rig.m;
    if (k % 5 == 1) rig.m.q_measured[0] += 0.5;
    if (k % 5 == 2) rig.m.tau_external[3] = 1e6;
    if (k % 5 == 3) rig.m.send_period = 0.064;
    if (k % 5 == 4) rig.m.q_measured[6] = -1e8;
    const bool answered = rig.period();
    rig.m.q_measured = whole.q_measured;
    rig.m.tau_external = whole.tau_external;
    rig.m.send_period = whole.send_period;
    EXPECT_EQ(answered, k % 5 == 0) << k;
    for (std::size_t i = 0; i < 7; ++i) {
      ASSERT_NEAR(rig.twin.reals("q")[i], kQ[i], rig.rounding()) << k;
      ASSERT_NEAR(rig.twin.reals("dq")[i], 0, 1e-3) << k;
      ASSERT_LT(std::abs(rig.twin.reals("tau_e")[i]), 100) << k;
    }
  }
  EXPECT_TRUE(rig.twin.boolean("commanding"));
  EXPECT_FALSE(rig.twin.boolean("awaits_acknowledgement"));
  EXPECT_EQ(rig.twin.integer("implausible") + rig.twin.integer("rejected"), 80);
}

TEST_P(FriRestart, TheEndOfCommandingIsFollowedByNothingUntilItIsAcknowledged) {
  Rig rig(GetParam());
  rig.begin();
  rig.settle();
  // A safety stop, in which somebody moves the robot slowly out of the way.
  rig.m.state = SessionState::kMonitoringReady;
  rig.m.safety = fri::SafetyState::kStopLevel1;
  for (int k = 0; k <= 300; ++k) {
    std::array<double, 7> q = kQ;
    q[0] += 0.001 * k;
    rig.put(q);
    rig.period();
  }
  const bool tells = rig.m.has(M::kSafetyState) && GetParam() != Protocol::kLwr;
  rig.acknowledge();
  EXPECT_EQ(rig.twin.boolean("awaits_acknowledgement"), tells) << "not while the robot reports a stop";
  if (!tells) return;
  rig.m.safety = fri::SafetyState::kNormal;
  rig.period();
  rig.m.state = SessionState::kCommandingWait;
  rig.period();
  rig.m.state = SessionState::kCommandingActive;
  expect_held_until_acknowledged(rig, moved());
}

TEST_P(FriRestart, TorquesAreNotAddedUntilTheLossIsAcknowledged) {
  Rig rig(GetParam(), "torque");
  rig.m.command_mode = fri::ClientCommandMode::kTorque;
  std::ranges::fill(rig.twin.reals("tau_command"), 2.5);
  rig.begin();
  rig.settle();
  ASSERT_EQ(rig.command.tau[3], 2.5);
  while (rig.twin.boolean("connected")) rig.period(false);
  for (int k = 0; k < 50; ++k) {
    if (!rig.period()) continue;
    ASSERT_EQ(rig.command.tau[3], 0);
  }
  for (int k = 0; k < 60; ++k) rig.period();
  rig.acknowledge();
  EXPECT_LT(rig.command.tau[3], 0.05);
  rig.settle();
  EXPECT_EQ(rig.command.tau[3], 2.5);
}

TEST(FriRestart, VariablesOfTheRobotsProgramStayUntilTheLossIsAcknowledged) {
  Rig rig(Protocol::kLwr);
  rig.twin.reals("krl_command_real")[3] = 1.5;
  rig.begin();
  rig.settle();
  rig.put(moved());
  rig.twin.reals("krl_command_real")[3] = 2.5;
  rig.period();
  EXPECT_EQ(rig.command.krl.real[3], 1.5f);
  rig.m.counter = 0;  // another session
  rig.m.time = 0;
  for (int k = 0; k < 60; ++k) rig.period();
  EXPECT_EQ(rig.command.krl.real[3], 0);
  rig.acknowledge();
  EXPECT_EQ(rig.command.krl.real[3], 2.5f);
}

TEST(FriRestart, GoesOnByItselfOnlyIfItIsAskedTo) {
  Rig rig(Protocol::kSunrise1_15);
  rig.twin.set("restart", "automatic");
  rig.begin();
  rig.settle();
  while (rig.twin.boolean("connected")) rig.period(false);
  rig.put(moved());
  for (int k = 0; k < 350; ++k) rig.period();
  EXPECT_TRUE(rig.twin.boolean("commanding"));
  EXPECT_FALSE(rig.twin.boolean("awaits_acknowledgement"));
  EXPECT_LT(rig.command.q[0], moved()[0] - 0.1);
  rig.twin.set("restart", "never");
  EXPECT_THAT(testing::error_of([&] { rig.start(); }),
              ::testing::HasSubstr("restart is 'never', expected acknowledged or automatic"));
}

TEST(FriRestart, AMonitorAwaitsNothing) {
  Rig rig(Protocol::kLwr, "monitor");
  rig.start();
  for (int k = 0; k < 5; ++k) rig.period();
  rig.put(moved());
  for (int k = 0; k < 5; ++k) rig.period();
  while (rig.twin.boolean("connected")) rig.period(false);
  rig.period();
  EXPECT_FALSE(rig.twin.boolean("awaits_acknowledgement"));
}

}  // namespace
}  // namespace cotwin::io::restart_test
