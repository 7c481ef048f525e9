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

#include "components/io/link/acknowledgement.h"
#include "tests/components/io/fri/rig.h"
#include "tests/support/error_of.h"

namespace cotwin::io::restart_test {
namespace {

/// Joints without and with a limit of speed, rad/s.
std::vector<trajectory::Axis> axes(std::initializer_list<double> limits) {
  std::vector<trajectory::Axis> result;
  for (const double limit : limits) result.emplace_back().dq_max = limit;
  return result;
}
constexpr double kNone = std::numeric_limits<double>::infinity();
using Verdict = JumpDetector::Verdict;

TEST(JumpDetector, FindsJumpsButNoMotions) {
  for (const double h : {0.001, 0.002, 0.005, 0.02}) {
    JumpDetector jumps(axes({kNone, kNone}));
    // 2 rad/s from the first position on, then a reversal with 30 rad/s²; one position of three is lost.
    double q = 0, dq = 2, since = 0;
    for (int k = 0; k < 400; ++k) {
      if (k > 50) dq = std::max(dq - 30 * h, -2.0);
      q += dq * h;
      since += h;
      if (k % 3 == 1) continue;
      const Verdict expected = k < 3 ? Verdict::kHeld : k == 3 ? Verdict::kFirst : Verdict::kPlausible;
      ASSERT_EQ(jumps.add(std::array{0.0, q}, k == 0 ? 0 : since), expected) << h << ' ' << k;
      since = 0;
    }
    EXPECT_EQ(jumps.implausible(), 0);
    for (const double jump : {0.004, 0.7, -0.7}) {
      q += jump;
      for (int k = 0; k < 8; ++k) {
        const bool real = std::abs(jump) > 0.1;
        EXPECT_EQ(jumps.add(std::array{0.0, q += dq * h}, h), real && k < 4    ? Verdict::kHeld
                                                              : real && k == 4 ? Verdict::kJump
                                                                               : Verdict::kPlausible)
            << h << ' ' << jump << ' ' << k;
      }
    }
    jumps.forget();
    for (int k = 0; k < 2; ++k) EXPECT_EQ(jumps.add(std::array{5.0, 5.0}, h), Verdict::kHeld);
    EXPECT_EQ(jumps.add(std::array{5.0, 5.0}, h), Verdict::kFirst) << "another session";
  }
  JumpDetector jumps(axes({kNone}));
  for (int k = 0; k < 5; ++k) EXPECT_EQ(jumps.add(std::array{1.0}, 0.001) == Verdict::kHeld, k < 2) << k;
  EXPECT_EQ(jumps.add(std::array{1.0055}, 0.001), Verdict::kHeld) << "at rest 5 mrad are the limit";
}

TEST(JumpDetector, HoldsSingleOnesAndThoseFasterThanTwiceTheLimit) {
  JumpDetector jumps(axes({1}));
  // The largest speed and twice of it, with every third position damaged.
  for (const double dq : {1.0, 1.9}) {
    jumps.forget();
    for (int k = 0; k < 300; ++k) {
      const double q = dq * 0.01 * k;
      const bool damaged = k % 3 == 2;
      ASSERT_EQ(jumps.add(std::array{damaged ? q + 1 : q}, 0.01), damaged || k == 0 ? Verdict::kHeld
                                                                  : k == 1          ? Verdict::kFirst
                                                                                    : Verdict::kPlausible)
          << k;
    }
  }
  EXPECT_EQ(jumps.implausible(), 200);
  EXPECT_FALSE(jumps.allows(0, 2.1));
  EXPECT_TRUE(jumps.allows(0, -1.9));
  EXPECT_FALSE(jumps.allows(0, std::nan("")));
}

// Damaged positions that do not agree with one another are never believed, however many there are in a row.
TEST(JumpDetector, HoldsOnWhatDoesNotFollowFromOneAnother) {
  for (const double limit : {3.0, kNone}) {
    JumpDetector jumps(axes({limit}));
    std::mt19937 random(7);
    for (int k = 0; k < 4; ++k) jumps.add(std::array{0.2}, 0.001);
    for (int k = 0; k < 40; ++k) {
      const double wild = 0.2 + std::ldexp(1, static_cast<int>(random() % 8) - 4) * (k % 2 == 0 ? 1 : -1);
      EXPECT_EQ(jumps.add(std::array{wild}, 0.001), Verdict::kHeld) << limit << ' ' << k;
    }
    EXPECT_EQ(jumps.implausible(), 40);
    EXPECT_EQ(jumps.add(std::array{0.2}, 0.001), Verdict::kPlausible) << "it was there all the time";
    // Faster than twice the limit nothing agrees.
    for (int k = 0; limit < kNone && k < 50; ++k) EXPECT_EQ(jumps.add(std::array{0.3 + 0.02 * k}, 0.001), Verdict::kHeld) << k;
    // After so long everything would be explained by the old position: two are needed, and they are a jump.
    for (int k = 0; k < 100; ++k) jumps.add(std::array{k % 2 == 0 ? 5.0 : -5.0}, 0.001);
    int held = 0;
    Verdict verdict;
    while ((verdict = jumps.add(std::array{0.25}, 0.001)) == Verdict::kHeld) ++held;
    EXPECT_EQ(verdict, Verdict::kJump);
    EXPECT_TRUE(held == 1 || (limit == kNone && held <= 3)) << limit << ' ' << held;
  }
}

TEST(JumpDetector, BeginsWhereASecondPositionAgreesAndBeyondTheLimitsLater) {
  std::vector<trajectory::Axis> one = axes({3});
  one[0].q_min = -2;
  one[0].q_max = 2;
  JumpDetector jumps(one);
  const auto add = [&](double q) { return jumps.add(std::array{q}, 0.001); };
  EXPECT_EQ(add(9000), Verdict::kHeld) << "a damaged one";
  EXPECT_EQ(add(0.5), Verdict::kHeld);
  EXPECT_EQ(add(0.5), Verdict::kFirst);
  EXPECT_EQ(jumps.implausible(), 1);
  // The same bit of any number of positions: 0.4 s are no place beyond the limits.
  for (int k = 0; k < 400; ++k) ASSERT_EQ(add(-21474), Verdict::kHeld) << k;
  EXPECT_EQ(add(0.5), Verdict::kHeld);
  EXPECT_EQ(add(0.5), Verdict::kJump) << "it is too long ago that it was there";
  for (const double q : {2.09, 2.11}) {  // an axis that stands beyond its limits at the start
    jumps.begin();
    int held = 0;
    while (add(q) == Verdict::kHeld) ++held;
    EXPECT_NEAR(held, q < 2.1 ? 1 : 500, q < 2.1 ? 0 : 2) << q;
    EXPECT_EQ(jumps.implausible(), 0);
    EXPECT_EQ(add(q + 0.001), Verdict::kPlausible);
  }
  jumps.begin();
  for (const double q : {0.1, 0.1}) add(q);
  EXPECT_EQ(jumps.add(std::array{0.1}, 0.001, true, false), Verdict::kHeld) << "another value of the message is impossible";
  for (int k = 0; k < 40; ++k) EXPECT_EQ(jumps.add(std::array{0.8}, 0.001, true, false), Verdict::kHeld);
  jumps.expect_jump();
  EXPECT_EQ(add(0.8), Verdict::kFirst) << "an axis that found its home";
}

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
  for (int k = 0; k < 3; ++k) rig.period();
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
  rig.settle();
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
