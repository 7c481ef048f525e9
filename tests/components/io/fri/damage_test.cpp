// Damaged messages move no arm: components/io/link/belief.h and the twin's side of FRI beside a controller whose messages are made here.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <random>

#include "components/io/link/belief.h"
#include "tests/components/io/fri/rig.h"

namespace cotwin::io {
namespace {

class FriDamage : public ::testing::TestWithParam<Protocol> {};
INSTANTIATE_TEST_SUITE_P(Protocols, FriDamage, ::testing::ValuesIn(kProtocols), name_of_protocol);

using Damage = std::function<void(M&)>;

/// A period whose message is damaged; its counter, time stamp and contents are then sound again. Whether it was answered.
bool damaged_period(Rig& rig, const Damage& damage) {
  const M sound = rig.m;
  damage(rig.m);
  const bool answered = rig.period();
  const std::uint32_t counter = sound.counter + 1;
  const std::int64_t time = sound.time + static_cast<std::int64_t>(sound.send_period * 1e9);
  rig.m = sound;
  rig.m.counter = counter;
  rig.m.time = time;
  return answered;
}

TEST_P(FriDamage, OneMessageGivesNoTorqueOrForce) {
  for (const bool gated : {true, false}) {
    Rig rig(GetParam());
    rig.twin.set("tau_e_gated", gated ? "true" : "false");
    rig.extra = M::kExternalWrench;
    rig.m.tau_external.fill(1.5);
    rig.m.tau_measured.fill(8);
    rig.m.F_external[1] = 3;
    rig.begin();
    rig.settle();
    const double F = rig.twin.real("F_e", 1);
    int damaged = 0;
    for (const double bad : {20.0, 70.0, -70.0, 9000.0}) {
      for (const Damage& damage :
           {Damage([&](M& m) { m.tau_external[3] = bad; }), Damage([&](M& m) { m.tau_measured[6] = bad; }),
            Damage([&](M& m) { m.F_external[0] = 20 * bad; })}) {
        for (int k = 0; k < 10; ++k) {
          EXPECT_TRUE(k == 3 ? damaged_period(rig, damage) : rig.period()) << "its position is sound";
          for (std::size_t i = 0; i < 7; ++i) {
            ASSERT_EQ(rig.twin.real("tau_e", i), 1.5) << bad << ' ' << k;
            ASSERT_EQ(rig.twin.real("tau", i), 8) << bad << ' ' << k;
          }
          ASSERT_EQ(rig.twin.real("F_e", 0), 0) << bad << ' ' << k;
          ASSERT_EQ(rig.twin.real("F_e", 1), F) << bad << ' ' << k;
        }
        ++damaged;
      }
    }
    const bool forces = GetParam() == Protocol::kLwr || GetParam() == Protocol::kSunrise2_7;
    EXPECT_EQ(F, forces ? 3 : 0);
    EXPECT_EQ(rig.twin.integer("implausible"), forces ? damaged : damaged * 2 / 3);
    EXPECT_TRUE(rig.twin.boolean("commanding"));
  }
}

TEST_P(FriDamage, AHitIsNoDamage) {
  for (const double period : {0.001, 0.002, 0.005}) {
    Rig rig(GetParam());
    rig.m.send_period = period;
    rig.h = Duration::from_seconds(period);
    rig.begin();
    for (int k = 0; k * period < 0.05; ++k) {
      rig.m.tau_external[3] = std::min(200.0, k * period * 200 / 0.005);
      EXPECT_TRUE(rig.period());
      EXPECT_TRUE(rig.twin.boolean("has_tau_e"));
      EXPECT_NEAR(rig.twin.real("tau_e", 3), std::clamp((k - 2) * period * 200 / 0.005, 0.0, 200.0), 1e-9)
          << "two messages late";
    }
    EXPECT_EQ(rig.twin.real("tau_e", 3), 200);
    EXPECT_EQ(rig.twin.integer("implausible"), 0) << period;
    EXPECT_TRUE(rig.twin.boolean("commanding"));
  }
}

// Up to 1.9 rad/s, 10 ms behind its set point, by up to 60 N.m; commands begin in motion.
TEST_P(FriDamage, ARobotThatIsGuidedFastIsNoDamage) {
  for (const double period : {0.001, 0.002, 0.005}) {
    Rig rig(GetParam());
    rig.m.send_period = period;
    rig.h = Duration::from_seconds(period);
    rig.start();
    for (int k = 0; k * period < 2; ++k) {
      const double t = k * period, rate = 6.3;
      const auto at = [&](double time) { return kQ[3] + 0.3 * std::sin(rate * time); };
      rig.m.q_measured[3] = at(t - 0.01);
      rig.m.q_commanded[3] = rig.m.q_interpolator[3] = at(t);
      rig.m.tau_external[3] = 60 * std::cos(rate * t);
      const bool waits = k < 20 && GetParam() != Protocol::kLwr;
      rig.m.state = k < 10  ? SessionState::kMonitoringReady
                    : waits ? SessionState::kCommandingWait
                            : SessionState::kCommandingActive;
      EXPECT_TRUE(rig.period());
    }
    EXPECT_EQ(rig.twin.integer("implausible"), 0) << period;
    EXPECT_TRUE(rig.twin.boolean("commanding")) << period;
  }
}

TEST_P(FriDamage, TorquesThatCannotBeAreNotKnown) {
  Rig rig(GetParam());
  rig.begin();
  rig.m.tau_external[6] = 2000;  // of 38 N.m
  for (int k = 0; k < 20; ++k) EXPECT_TRUE(rig.period());
  EXPECT_FALSE(rig.twin.boolean("has_tau_e"));
  EXPECT_TRUE(rig.twin.boolean("has_tau"));
  EXPECT_EQ(rig.twin.real("tau_e", 6), 0);
  EXPECT_EQ(rig.twin.integer("implausible"), 20);
  rig.m.tau_external[6] = 2;
  for (int k = 0; k < 5; ++k) EXPECT_TRUE(rig.period());
  EXPECT_TRUE(rig.twin.boolean("has_tau_e"));
}

// Every message up to that with which commands begin, of which that one alone is not known to be where the robot is.
TEST_P(FriDamage, CommandsBeginWhereTheRobotIs) {
  for (const double off : {0.02, 0.5, -3.0}) {
    int awaited = 0;
    for (int where = -1; where < 60; ++where) {
      SCOPED_TRACE(::testing::Message() << off << " rad, message " << where);
      const Damage damage = [&](M& m) { m.q_commanded[3] = m.q_interpolator[3] = kQ[3] + off; };
      Rig rig(GetParam());
      rig.start();
      const auto near = [&] {
        for (std::size_t i = 0; i < 7 && rig.command.has(fri::Command::kPosition); ++i) {
          ASSERT_NEAR(rig.command.q[i], kQ[i], 1e-3 * 0.002 + rig.rounding());
        }
      };
      for (int k = 0; k < 5; ++k) rig.period();
      if (GetParam() != Protocol::kLwr) rig.m.state = SessionState::kCommandingWait;
      rig.period();
      if (where < 0) {
        damaged_period(rig, damage);
        near();
      }
      rig.m.state = SessionState::kCommandingActive;
      for (int k = 0; k < 70; ++k) {
        k == where ? damaged_period(rig, damage) : rig.period();
        near();
      }
      const bool awaits = rig.twin.boolean("awaits_acknowledgement");
      awaited += awaits ? 1 : 0;
      for (int k = 0; k < 60 && awaits; ++k) rig.period();
      if (awaits) rig.acknowledge();
      EXPECT_TRUE(rig.twin.boolean("commanding"));
    }
    EXPECT_EQ(awaited, 2) << "it, and the one before it";
  }
}

TEST_P(FriDamage, ARobotThatIsElsewhereIsFollowedThereThoughItsSetPointIsDamaged) {
  for (const bool damaged : {false, true}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    std::array<double, 7> there = kQ;
    there[3] += 0.3;
    rig.put(there);
    for (int k = 0; k < Belief::kMostHeld; ++k) EXPECT_FALSE(rig.period());
    EXPECT_TRUE(damaged_period(rig, [&](M& m) {
      if (damaged) m.q_commanded[3] += 2;
    }));
    for (int k = 0; k < 30; ++k) {
      for (std::size_t i = 0; i < 7; ++i) ASSERT_NEAR(rig.command.q[i], there[i], rig.rounding()) << k;
      rig.period();
    }
    EXPECT_TRUE(rig.twin.boolean("awaits_acknowledgement"));
  }
}

// An impedance-controlled robot is held away from its set point; commands begin at the set point without an acknowledgement.
TEST_P(FriDamage, ARobotThatYieldsIsNoDamage) {
  Rig rig(GetParam(), "position");
  rig.m.control = fri::ControlMode::kJointImpedance;
  rig.m.q_measured[1] += 0.25;
  rig.start();
  for (int k = 0; k < 5; ++k) rig.period();
  if (GetParam() != Protocol::kLwr) rig.m.state = SessionState::kCommandingWait;
  for (int k = 0; k < 5; ++k) rig.period();
  rig.m.state = SessionState::kCommandingActive;
  for (int k = 0; k < 3; ++k) rig.period();
  EXPECT_TRUE(rig.twin.boolean("commanding"));
  EXPECT_NEAR(rig.command.q[1], kQ[1], 1e-6);
  EXPECT_EQ(rig.twin.integer("implausible"), 0);
}

// The twin moves at the speed limit; the command goes on without a step, and no controller has begun anew.
TEST_P(FriDamage, OneCounterTimeStampOrPeriodIsNotUsed) {
  for (const std::int64_t ahead : {2, 3, 15, 1000, 30'000, -50}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    rig.twin.reals("q_command")[5] += 1;
    double before = rig.command.q[5];
    for (int k = 0; k < 60; ++k) {
      const bool answered =
          k == 30 ? damaged_period(rig, [&](M& m) { m.counter += static_cast<std::uint32_t>(ahead); }) : rig.period();
      EXPECT_EQ(answered, k != 30) << ahead;
      const bool extrapolated = k == 31 && GetParam() >= Protocol::kSunrise2_5;
      EXPECT_LE(rig.command.q[5] - before, kSpeed * 0.002 * (extrapolated ? 2 : 1) * 1.001 + rig.rounding())
          << ahead << ' ' << k;
      before = rig.command.q[5];
    }
    EXPECT_TRUE(rig.twin.boolean("commanding")) << ahead;
    EXPECT_EQ(rig.twin.integer("restarts") + rig.twin.integer("reordered"), 0) << ahead;
    EXPECT_EQ(rig.twin.integer("lost"), 1) << ahead;
  }
  for (const double off : {-3600.0, -10.0, 5.0, 3600.0, 1e6}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    for (int k = 0; k < 20; ++k) {
      if (k % 5 != 3) {
        EXPECT_TRUE(rig.period()) << off;
      } else {
        EXPECT_FALSE(damaged_period(rig, [&](M& m) { m.time += static_cast<std::int64_t>(off * 1e9); })) << off;
      }
    }
    EXPECT_TRUE(rig.twin.boolean("commanding")) << off;
    EXPECT_EQ(rig.twin.integer("restarts"), 0) << off;
  }
  for (const double period : {0.001, 0.005, 0.1, 1.0}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    for (int k = 0; k < 20; ++k) {
      if (k % 5 != 3) {
        EXPECT_TRUE(rig.period()) << period;
      } else {
        EXPECT_FALSE(damaged_period(rig, [&](M& m) { m.send_period = period; })) << period;
      }
      EXPECT_NEAR(rig.twin.real("period"), 0.002, 1e-9);
    }
    EXPECT_TRUE(rig.twin.boolean("commanding")) << period;
    EXPECT_EQ(rig.twin.integer("restarts"), 0) << period;
  }
}

// The robot has been moved away from its own motion, whose position is in messages of some states.
TEST_P(FriDamage, ThreeStatesInARowEndCommandsAndMoveNothing) {
  for (const int messages : {1, 2, 3}) {
    const double away = messages == 1 ? 0.06 : 0.4;
    for (const SessionState state :
         {SessionState::kMonitoringWait, SessionState::kMonitoringReady, SessionState::kCommandingWait}) {
      if (GetParam() == Protocol::kLwr && state == SessionState::kCommandingWait) continue;
      SCOPED_TRACE(::testing::Message() << away << " rad, state " << static_cast<int>(state));
      Rig rig(GetParam());
      rig.begin();
      rig.settle();
      const auto follow = [&] {  // the robot is where it was commanded to
        std::ranges::copy_n(rig.command.q.begin(), 7, rig.m.q_measured.begin());
        std::ranges::copy_n(rig.command.q.begin(), 7, rig.m.q_commanded.begin());
      };
      rig.twin.reals("q_command")[0] += away;
      for (int k = 0; k < 600; ++k) {
        follow();
        rig.period();
      }
      const double q = rig.command.q[0];
      ASSERT_NEAR(q, kQ[0] + away, 1e-3);
      for (int k = 0; k < 50; ++k) {
        follow();
        const bool damaged = k >= 20 && k < 20 + messages;
        const bool answered = damaged ? damaged_period(rig, [&](M& m) { m.state = state; }) : rig.period();
        if (answered && rig.command.has(fri::Command::kPosition)) {
          ASSERT_NEAR(rig.command.q[0], q, 1e-6) << k;
        }
      }
      EXPECT_EQ(rig.twin.boolean("awaits_acknowledgement"), messages == 3);
      EXPECT_EQ(rig.twin.boolean("commanding"), messages < 3);
    }
  }
}

TEST_P(FriDamage, TheFirstPositionIsNotMeasuredBeforeFiveAgree) {
  Rig rig(GetParam());
  rig.start();
  damaged_period(rig, [](M& m) { m.q_measured[3] = 9000; });
  EXPECT_FALSE(rig.twin.boolean("fresh"));
  for (int k = 0; k < 10; ++k) {
    rig.period();
    ASSERT_EQ(rig.twin.boolean("fresh"), k > 3);
    if (k > 3) {
      ASSERT_NEAR(rig.twin.real("q", 3), kQ[3], rig.rounding());
    }
  }
}

/// A twin that tau_e pushes, 4 kg.m² and 30 N.m.s per joint, beside a robot that rests and that nobody touches.
struct Guided : Rig {
  using Rig::Rig;
  std::array<double, 7> dq_twin{};
  double way = 0, pushed = 0;  // rad: of commands from where the robot is; that of a twin without inertia

  void rest() {
    dq_twin = {};
    std::ranges::copy(kQ, twin.reals("q_command").begin());
    way = pushed = 0;
  }
  bool move() {
    double largest = 0;
    for (std::size_t i = 0; i < 7; ++i) {
      const double tau_e = twin.real("tau_e", i);
      dq_twin[i] += 0.002 * (tau_e - 30 * dq_twin[i]) / 4;
      twin.reals("q_command")[i] += 0.002 * dq_twin[i];
      largest = std::max(largest, std::abs(tau_e));
    }
    pushed += largest * 0.002 / 30;
    const bool answered = period();
    const bool commands = answered && command.has(fri::Command::kPosition) && !twin.boolean("awaits_acknowledgement");
    for (std::size_t i = 0; i < 7 && commands; ++i) way = std::max(way, std::abs(command.q[i] - kQ[i]));
    return answered;
  }
};

// Every bit of a message. Where at most two of any five are damaged nothing moves; else tau_e moves the twin as long as the middle of five says so.
TEST_P(FriDamage, DamagedBitsMoveNothing) {
  Guided rig(GetParam());
  rig.begin();
  rig.settle();
  std::mt19937 random(12);
  for (int n = 0; n < 250 && !HasFatalFailure(); ++n) {
    rig.rest();
    const std::size_t at = random();
    const auto bit = static_cast<std::uint8_t>(1u << random() % 8);
    const int in_a_row = static_cast<int>(random() % 5), every = in_a_row > 0 ? 0 : std::array{2, 3, 5}[random() % 3];
    for (int k = 0; k < 30; ++k) {
      rig.damage = [&](std::vector<std::uint8_t>& bytes) {
        if (every > 0 ? k % every == 0 : k < in_a_row) bytes[at % bytes.size()] ^= bit;
      };
      rig.move();
    }
    rig.damage = nullptr;
    EXPECT_LE(rig.way, 1e-3 + (in_a_row > 2 || every == 2 ? rig.pushed : 0))
        << "byte " << at % rig.message().size() << ", bit " << int{bit} << ": " << in_a_row << " in a row, or every " << every;
    rig.m.counter -= 1;
    rig.m.time -= 2'000'000;
    if (rig.twin.boolean("awaits_acknowledgement")) {
      for (int k = 0; k < 70; ++k) rig.move();
      rig.acknowledge();
    }
    for (int k = 0; k < 5; ++k) rig.move();
    ASSERT_TRUE(rig.twin.boolean("commanding"));
  }
}

// The robot's own motion (Sunrise), or its set point, drifts while the robot rests, before commands: they do not begin.
TEST_P(FriDamage, CommandsDoNotBeginAtASetPointThatDrifts) {
  for (const double drift : {5e-5, 4e-4, -1e-3, 4e-3}) {
    Rig rig(GetParam());
    rig.start();
    for (int k = 0; k < 60; ++k) rig.period();
    for (int k = 0; k < 120; ++k) {
      const bool waits = k < 20 && GetParam() != Protocol::kLwr;
      rig.m.state = waits ? SessionState::kCommandingWait : SessionState::kCommandingActive;
      if (k == 0 && !waits) continue;
      rig.m.q_interpolator[3] += drift;
      rig.m.q_commanded[3] += drift;
      rig.period();
    }
    const bool gives = GetParam() != Protocol::kLwr;
    EXPECT_FALSE(gives && rig.twin.boolean("commanding")) << drift;
    if (gives && std::abs(drift) < 2e-3) {  // else it is soon too far away
      EXPECT_GE(rig.twin.integer("implausible"), 1) << drift;
    }
  }
}

// The robot is at each answer at once, and its own motion was damaged before commands: it must not be led on from where it has gone.
TEST_P(FriDamage, ARobotThatFollowsAtOnceIsNotLedOn) {
  for (const double drift : {4e-4, -1e-3, 4e-3}) {
    Rig rig(GetParam());
    rig.start();
    for (int k = 0; k < 60; ++k) rig.period();
    if (GetParam() != Protocol::kLwr) rig.m.state = SessionState::kCommandingWait;
    for (int k = 0; k < 200; ++k) {
      rig.m.q_interpolator[3] += drift;
      rig.period();
    }
    rig.m.state = SessionState::kCommandingActive;
    std::ranges::copy(kQ, rig.m.q_interpolator.begin());
    for (int k = 0; k < 300; ++k) {
      if (!rig.period()) continue;
      ASSERT_NEAR(rig.command.q[3], kQ[3], 2e-3 + 2 * std::abs(drift)) << drift << ' ' << k;
      std::ranges::copy_n(rig.command.q.begin(), 7, rig.m.q_measured.begin());
      std::ranges::copy_n(rig.command.q.begin(), 7, rig.m.q_commanded.begin());
    }
  }
}

TEST(FriLwrDamage, APoseThatCommandsBeginAtIsThatOfTheRobot) {
  Rig rig(Protocol::kLwr, "cartesian_impedance");
  rig.extra = M::kCommandedPose | M::kMeasuredPose;
  for (Pose* X : {&rig.m.X_measured, &rig.m.X_commanded}) X->p = {0.5, 0, 0.6};
  std::ranges::copy(std::array{0.5, 0.0, 0.6}, rig.twin.reals("p_command").begin());
  rig.start();
  for (int k = 0; k < 60; ++k) rig.period();
  rig.m.state = SessionState::kCommandingActive;
  for (int k = 0; k < 20; ++k) {
    k == 2 ? damaged_period(rig, [](M& m) { m.X_commanded.p = {-0.4, 0.3, 0.2}; }) : rig.period();
    ASSERT_NEAR((rig.command.X.p - Eigen::Vector3d(0.5, 0, 0.6)).norm(), 0, 1e-6) << k;
  }
  EXPECT_TRUE(rig.twin.boolean("awaits_acknowledgement")) << "commands began with that message";
}

}  // namespace
}  // namespace cotwin::io
