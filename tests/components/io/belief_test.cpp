// What is believed of a device's messages: components/io/link/belief.h, and which press of a button counts: acknowledgement.h.
#include "components/io/link/belief.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <random>
#include <vector>

#include "components/io/link/acknowledgement.h"

namespace cotwin::io::belief_test {
namespace {

using Kind = BelievedNumbers::Kind;
using Verdict = Belief::Verdict;

constexpr double kEffort = 100;  // N.m
constexpr double kNone = std::numeric_limits<double>::infinity();

/// Three joints, of which the last one has no effort.
std::vector<trajectory::Axis> three_axes() {
  std::vector<trajectory::Axis> axes = trajectory::free_axes(3);
  axes[0].tau_max = axes[1].tau_max = kEffort;
  for (trajectory::Axis& axis : axes) axis.dq_max = 2;
  return axes;
}

/// Joints without and with a limit of speed, rad/s.
std::vector<trajectory::Axis> axes(std::initializer_list<double> limits) {
  std::vector<trajectory::Axis> result;
  for (const double limit : limits) result.emplace_back().dq_max = limit;
  return result;
}

/// Of the last five; the oracle is the definition.
double middle(const std::vector<double>& all) {
  std::vector<double> last(all.end() - 5, all.end());
  std::ranges::sort(last);
  return last[2];
}

TEST(BelievedNumbers, AreTheMiddleOfFiveAndStatesThreeInARow) {
  BelievedNumbers numbers;
  const std::size_t number = numbers.add(Kind::kNumber), state = numbers.add(Kind::kState), bits = numbers.add(Kind::kBits);
  std::mt19937 random(3);
  std::vector<double> all;
  double used_state = 0;
  std::uint32_t used_bits = 0;
  for (int k = 0; k < 5000; ++k) {
    const auto x = static_cast<double>(random() % 3);
    all.push_back(x);
    numbers.put(number, x);
    numbers.put(state, x);
    numbers.put(bits, x);
    const std::size_t n = all.size();
    if (n >= 3 && x == all[n - 2] && x == all[n - 3]) used_state = x;
    for (std::uint32_t bit = 1; n >= 3 && bit <= 2; bit *= 2) {
      const auto of = [&](std::size_t ago) { return static_cast<std::uint32_t>(all[n - 1 - ago]) & bit; };
      if (of(0) == of(1) && of(1) == of(2)) used_bits = (used_bits & ~bit) | of(0);
    }
    EXPECT_EQ(numbers.known(number), n >= 5);
    EXPECT_EQ(numbers.known(state), n >= 3);
    ASSERT_EQ(numbers.used(number), n >= 5 ? middle(all) : 0) << k;
    ASSERT_EQ(numbers.used(state), used_state) << k;
    ASSERT_EQ(numbers.used(bits), used_bits) << k;
  }
  const double before = numbers.used(number);
  for (int k = 0; k < 9; ++k) EXPECT_EQ(numbers.put(number, std::nan("")), before) << "is left out";
}

// A number that changes in every message, as a counter does, comes two messages late.
TEST(BelievedNumbers, FollowWhatChangesInEveryMessage) {
  BelievedNumbers numbers;
  const std::size_t i = numbers.add(Kind::kNumber);
  for (int k = 0; k < 100; ++k) EXPECT_EQ(numbers.put(i, k), k < 4 ? 0 : k - 2);
}

TEST(ConfirmedState, NeedsThreeMessagesInARow) {
  ConfirmedState state;
  const auto see = [&](const std::vector<int>& messages) {
    for (const int message : messages) state.see(message);
    return state.value;
  };
  EXPECT_EQ(see({2, 2}), 0);
  EXPECT_EQ(see({0, 2, 2, 1}), 0);
  EXPECT_EQ(see({2, 2, 2}), 2);
  EXPECT_EQ(see({0, 1, 2, 0, 3}), 2);
  EXPECT_FALSE(state.is_sure());
  EXPECT_EQ(see({2, 0, 1, 3}), 0) << "three that say something else end it, whatever they say";
}

/// With h = 5 ms. `pressed`: for so many steps. Whether it ended the wait.
TEST(Acknowledgement, IsAnInputThatWasOffForThreeStepsAndThenOnFor50Milliseconds) {
  struct Input {
    Variables v;
    Acknowledgement a;
    Input() {
      a.declare(v, "nothing is commanded", "it is ready");
      a.begin("test");
      a.demand();
    }
    bool steps(int n, bool on, double h = 0.005, bool ready = true, bool believed = true) {
      assign_text(v.at("acknowledge"), on ? "true" : "false");
      for (int k = 0; k < n; ++k) a.decide(ready, believed, h);
      return !a.awaits();
    }
  };
  for (const double h : {0.0005, 0.001, 0.005, 0.02, 0.1}) {
    const int needed = static_cast<int>(std::ceil(0.05 / h - 1e-9));
    Input input;
    EXPECT_FALSE(input.steps(1000, true, h)) << "it was on at the start";
    EXPECT_FALSE(input.steps(2, false, h) || input.steps(1000, true, h)) << "two steps";
    EXPECT_FALSE(input.steps(3, false, h) || (needed > 1 && input.steps(needed - 1, true, h))) << h;
    EXPECT_TRUE(input.steps(1, true, h)) << h;
    input.a.demand();
    EXPECT_FALSE(input.steps(1000, true, h)) << "held since before the loss";
    EXPECT_TRUE(!input.steps(3, false, h) && input.steps(needed, true, h));
  }
  // Two of three steps are damaged, or none is believed.
  Input input;
  for (int k = 0; k < 300; ++k) EXPECT_FALSE(input.steps(1, k % 3 != 0));
  EXPECT_FALSE(input.steps(5, false) || input.steps(100, true, 0.005, true, false) || input.steps(9, true));
  EXPECT_TRUE(input.steps(1, true)) << "what is not believed neither counts nor ends it";
  input.a.demand();
  EXPECT_FALSE(input.steps(5, false) || input.steps(5, true) || input.steps(1, true, 0.005, false) || input.steps(50, true));
  EXPECT_TRUE(!input.steps(3, false) && input.steps(10, true));
}

/// Known, with these torques.
BelievedTorques at(const std::array<double, 3>& tau) {
  BelievedTorques torques(three_axes());
  for (int k = 0; k < 5; ++k) {
    EXPECT_FALSE(torques.known());
    EXPECT_EQ(torques.add(tau), nullptr);
  }
  EXPECT_TRUE(torques.known());
  return torques;
}

// One and two in a row, in each five.
TEST(BelievedTorques, UseNoneThatIsDamagedTwiceInFiveAndCountIt) {
  for (const double bad : {9.0, 20.0, 70.0, 900.0, -900.0}) {
    for (std::size_t joint = 0; joint < 3; ++joint) {
      for (const int equal : {1, 2}) {
        const std::array<double, 3> tau{1, -2, 3};
        BelievedTorques torques = at(tau);
        int counted = 0;
        for (int k = 0; k < 100; ++k) {
          std::array<double, 3> sent = tau;
          if (k % 5 < equal) sent[joint] = bad;
          counted += torques.add(sent) == nullptr ? 0 : 1;
          for (std::size_t i = 0; i < 3; ++i) ASSERT_EQ(torques.torque(i), tau[i]) << bad << ' ' << k;
        }
        EXPECT_EQ(counted, 20 * equal) << bad;
        EXPECT_TRUE(torques.known());
      }
    }
  }
}

// Three equal ones of five cannot be told from a hit: so the header promises.
TEST(BelievedTorques, UseThreeEqualOnes) {
  BelievedTorques torques = at({0, 0, 0});
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(torques.torque(0), 0);
    torques.add(std::array{80.0, 0.0, 0.0});
  }
  EXPECT_EQ(torques.torque(0), 80);
}

// 200 N.m in 5 ms, which then stay or fall to nothing within 10 ms: what lasts for three messages comes two messages late.
TEST(BelievedTorques, UseAHitTwoMessagesLate) {
  for (const double period : {0.0005, 0.001, 0.002, 0.005}) {
    for (const bool stays : {true, false}) {
      const auto hit = [&](int k) {
        const double t = k * period - 0.02;
        return t <= 0 ? 0 : t <= 0.005 ? 200 * t / 0.005 : stays ? 200 : std::max(0.0, 200 - 200 * (t - 0.005) / 0.01);
      };
      BelievedTorques torques = at({0, 0, 0});
      double largest = 0;
      for (int k = 0; k * period < 0.1; ++k) {
        torques.add(std::array{hit(k), 0.5, -hit(k)});
        const auto [least, most] = std::minmax({hit(k - 1), hit(k - 2), hit(k - 3)});
        ASSERT_GE(torques.torque(0), least) << period << ' ' << k;
        ASSERT_LE(torques.torque(0), most) << period << ' ' << k;
        ASSERT_TRUE(torques.known());
        largest = std::max(largest, torques.torque(0));
      }
      EXPECT_GE(largest, stays ? 200 : period < 0.005 ? 100 : 0) << period;
    }
  }
}

TEST(BelievedTorques, AreNeverUsedBeyondTenTimesTheEffort) {
  for (const double bad : {1001.0, -5000.0, std::numeric_limits<double>::quiet_NaN()}) {
    BelievedTorques torques = at({1, 2, 3});
    for (int k = 0; k < 50; ++k) {
      EXPECT_NE(torques.add(std::array{bad, 2.0, 3.0}), nullptr);
      EXPECT_EQ(torques.known(), k < Belief::kMostHeld);
      EXPECT_EQ(torques.torque(0), k < Belief::kMostHeld ? 1 : 0) << "what is not known is no torque";
    }
    for (int k = 0; k < 5; ++k) EXPECT_EQ(torques.add(std::array{1.0, 2.0, 3.0}), nullptr);
    EXPECT_TRUE(torques.known());
  }
  BelievedTorques torques = at({0, 0, 0});
  for (int k = 0; k < 3; ++k) torques.add(std::array{999.0, 0.0, 9999.0});
  EXPECT_EQ(torques.torque(0), 999);
  EXPECT_EQ(torques.torque(2), 9999) << "without an effort";
  EXPECT_NE(torques.add(std::array{999.0, 0.0, 10'001.0}), nullptr);
}

TEST(BelievedTorques, TakeTheForcesAlong) {
  BelievedTorques torques(three_axes(), 2);
  const std::array<double, 3> tau{1, 2, 3}, bad{1, 500, 3};
  const std::array<double, 2> F{10, 20}, bad_F{10, 2000};
  for (int k = 0; k < 5; ++k) {
    EXPECT_EQ(torques.along(1), 0);
    torques.add(tau, F);
  }
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(torques.along(1), 20);
    torques.add(bad, bad_F);
  }
  EXPECT_EQ(torques.along(1), 2000);
  torques.add(tau, F, false);
  EXPECT_EQ(torques.along(1), 2000) << "not possible";
  torques.forget();
  EXPECT_EQ(torques.along(1), 0);
}

TEST(Belief, FindsJumpsButNoMotions) {
  for (const double h : {0.001, 0.002, 0.005, 0.02}) {
    Belief jumps(axes({kNone, kNone}));
    // 2 rad/s from the first position on, then a reversal with 30 rad/s²; one position of three is lost.
    double q = 0, dq = 2, since = 0;
    for (int k = 0; k < 400; ++k) {
      if (k > 50) dq = std::max(dq - 30 * h, -2.0);
      q += dq * h;
      since += h;
      if (k % 3 == 1) continue;
      const Verdict expected = k < 6 ? Verdict::kHeld : k == 6 ? Verdict::kFirst : Verdict::kPlausible;
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
    for (int k = 0; k < 4; ++k) EXPECT_EQ(jumps.add(std::array{5.0, 5.0}, h), Verdict::kHeld);
    EXPECT_EQ(jumps.add(std::array{5.0, 5.0}, h), Verdict::kFirst) << "another session";
  }
  Belief jumps(axes({kNone}));
  for (int k = 0; k < 5; ++k) EXPECT_EQ(jumps.add(std::array{1.0}, 0.001) == Verdict::kHeld, k < 4) << k;
  EXPECT_EQ(jumps.add(std::array{1.0055}, 0.001), Verdict::kHeld) << "at rest 5 mrad are the limit";
}

TEST(Belief, HoldsSingleOnesAndThoseFasterThanTwiceTheLimit) {
  Belief jumps(axes({1}));
  // The largest speed and twice of it, with every third position damaged.
  for (const double dq : {1.0, 1.9}) {
    jumps.forget();
    for (int k = 0; k < 300; ++k) {
      const double q = dq * 0.01 * k;
      const bool damaged = k % 3 == 2 && k > 4;
      ASSERT_EQ(jumps.add(std::array{damaged ? q + 1 : q}, 0.01), damaged || k < 4 ? Verdict::kHeld
                                                                  : k == 4         ? Verdict::kFirst
                                                                                   : Verdict::kPlausible)
          << k;
    }
  }
  EXPECT_EQ(jumps.implausible(), 198);
  EXPECT_FALSE(jumps.allows(0, 2.1));
  EXPECT_TRUE(jumps.allows(0, -1.9));
  EXPECT_FALSE(jumps.allows(0, std::nan("")));
}

// Damaged positions that do not agree with one another are never believed, however many there are in a row.
TEST(Belief, HoldsOnWhatDoesNotFollowFromOneAnother) {
  for (const double limit : {3.0, kNone}) {
    Belief jumps(axes({limit}));
    std::mt19937 random(7);
    for (int k = 0; k < 6; ++k) jumps.add(std::array{0.2}, 0.001);
    for (int k = 0; k < 40; ++k) {
      const double wild = 0.2 + std::ldexp(1, static_cast<int>(random() % 8) - 4) * (k % 2 == 0 ? 1 : -1);
      EXPECT_EQ(jumps.add(std::array{wild}, 0.001), Verdict::kHeld) << limit << ' ' << k;
    }
    EXPECT_EQ(jumps.implausible(), 40);
    EXPECT_EQ(jumps.add(std::array{0.2}, 0.001), Verdict::kPlausible) << "it was there all the time";
    // Faster than twice the limit nothing agrees.
    for (int k = 0; limit < kNone && k < 50; ++k) EXPECT_EQ(jumps.add(std::array{0.3 + 0.02 * k}, 0.001), Verdict::kHeld) << k;
    // After so long everything would be explained by the old position: five are needed, and they are a jump.
    for (int k = 0; k < 100; ++k) jumps.add(std::array{k % 2 == 0 ? 5.0 : -5.0}, 0.001);
    int held = 0;
    Verdict verdict;
    while ((verdict = jumps.add(std::array{0.25}, 0.001)) == Verdict::kHeld) ++held;
    EXPECT_EQ(verdict, Verdict::kJump);
    EXPECT_TRUE(held == 4 || (limit == kNone && held <= 5)) << limit << ' ' << held;
  }
}

TEST(Belief, BeginsWhereFivePositionsAgreeAndBeyondTheLimitsLater) {
  std::vector<trajectory::Axis> one = axes({3});
  one[0].q_min = -2;
  one[0].q_max = 2;
  Belief jumps(one);
  const auto add = [&](double q) { return jumps.add(std::array{q}, 0.001); };
  for (const double q : {9000.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5}) EXPECT_EQ(add(q), Verdict::kHeld) << "three damaged ones";
  EXPECT_EQ(add(0.5), Verdict::kFirst);
  EXPECT_EQ(jumps.implausible(), 2);
  // The same bit of any number of positions: 0.4 s are no place beyond the limits.
  for (int k = 0; k < 400; ++k) ASSERT_EQ(add(-21474), Verdict::kHeld) << k;
  for (int k = 0; k < 4; ++k) EXPECT_EQ(add(0.5), Verdict::kHeld);
  EXPECT_EQ(add(0.5), Verdict::kJump) << "it is too long ago that it was there";
  for (const double q : {2.09, 2.11}) {  // an axis that stands beyond its limits at the start
    jumps.begin();
    int held = 0;
    while (add(q) == Verdict::kHeld) ++held;
    EXPECT_NEAR(held, q < 2.1 ? 4 : 500, q < 2.1 ? 0 : 2) << q;
    EXPECT_EQ(jumps.implausible(), 0);
    EXPECT_EQ(add(q + 0.001), Verdict::kPlausible);
  }
  jumps.begin();
  for (int k = 0; k < 5; ++k) add(0.1);
  EXPECT_EQ(jumps.add(std::array{0.1}, 0.001, true, false), Verdict::kHeld) << "another value of the message is impossible";
  for (int k = 0; k < 40; ++k) EXPECT_EQ(jumps.add(std::array{0.8}, 0.001, true, false), Verdict::kHeld);
  jumps.expect_jump();
  EXPECT_EQ(add(0.8), Verdict::kFirst) << "an axis that found its home";
}

/// A joint that moves as q(t), and says that its speed is dq(t).
struct Compared {
  Agreement agreement{axes({3, 3})};
  double t = 0, h = 0.002;
  std::string why;
  bool add(double q, double dq) {
    if (const char* const now = agreement.compare(std::array{0.0, q}, std::array{0.0, dq}, t > 0 ? h : 0)) why += now;
    t += h;
    return agreement.holds();
  }
};

TEST(Agreement, FindsAPositionThatDriftsWithoutASpeed) {
  for (const double h : {0.001, 0.002, 0.005, 0.02, 0.1}) {
    for (const double drift : {5e-5, 1e-4, 4e-4, 1e-3, 5e-3, -5e-3}) {
      if (drift < 1e-4 && h > 0.01) continue;  // 0.5 s are too few messages: 25 of 0.05 mrad
      if (std::abs(drift) < 1e-3 && h > 0.05) continue;
      Compared joint{.h = h};
      int k = 0;
      for (; k < 100; ++k) EXPECT_EQ(joint.add(0.3, 0), k + 1 >= 50 || k * h >= 0.5 - 1e-9) << h << ' ' << k;
      double q = 0.3;
      for (k = 0; k < 60 && joint.agreement.holds(); ++k) joint.add(q += drift, 0);
      EXPECT_LE(k * std::abs(drift), 2e-3 + 2 * std::abs(drift)) << h << ' ' << drift;
      EXPECT_THAT(joint.why, ::testing::HasSubstr(" has moved by ")) << "once";
    }
  }
}

// 10 mrad/s at 1 ms: more than 50 messages are needed.
TEST(Agreement, FindsASlowDriftOverHalfASecond) {
  Compared joint{.h = 0.001};
  int k = 0;
  for (double q = 0; k < 1000 && (k < 60 || joint.agreement.holds()); ++k) joint.add(q += 1e-5, 0);
  EXPECT_NEAR(k, 200, 15) << "2 mrad";
  for (double q = 0; k < 3000; ++k) joint.add(q += 3e-6, 0);  // 3 mrad/s are below the slack
  EXPECT_TRUE(joint.agreement.holds());
}

// A low-pass of 40 ms of the speed, half of it allowed for by the change of speed, a scale that is 4 % off, noise, coarse counts.
TEST(Agreement, TakesNoSoundJointForOneThatDrifts) {
  std::mt19937 random(8);
  std::normal_distribution<double> noise(0, 2e-4);
  for (const double h : {0.001, 0.002, 0.005, 0.02, 0.1}) {
    for (const double omega : {0.5, 2.0, 6.0}) {
      Compared joint{.h = h};
      double filtered = 0;
      for (int k = 0; k * h < 6; ++k) {
        const double t = k * h, q = 1.5 / omega * (1 - std::cos(omega * t)), dq = 1.5 * std::sin(omega * t);
        filtered += (dq - filtered) * -std::expm1(-h / 0.015);
        joint.add(q + noise(random), 1.04 * filtered);
        ASSERT_EQ(joint.why, "") << h << ' ' << omega << ' ' << t;
      }
    }
  }
  Compared coarse;
  coarse.agreement.set_resolution(1, 1e-2, 0.05);
  for (int k = 0; k < 2000; ++k) coarse.add(1e-2 * std::round(100 * 0.3 * k * coarse.h), 0.05 * std::round(0.3 / 0.05));
  EXPECT_EQ(coarse.why, "");
}

TEST(Agreement, LeavesOutTheWayOverMissingMessagesAndWithoutASpeedComparesNothing) {
  Compared joint;
  for (int k = 0; k < 60; ++k) joint.add(0.3, 0);
  EXPECT_TRUE(joint.agreement.holds());
  joint.h = 0.008;
  EXPECT_TRUE(joint.add(0.7, 0)) << "three are missing";
  joint.h = 0.006;
  EXPECT_FALSE(joint.add(0.71, 0)) << "two are";
  Compared bursts;  // of three lost ones in each 30, and the joint moves
  for (int k = 0, n = 0; k < 500; ++k) {
    const int next = k % 27 == 26 ? 4 : 1;
    bursts.h = 0.002 * next;
    n += next;
    EXPECT_EQ(bursts.add(0.002 * 0.5 * n, 0.5), k > 48) << k;
  }
  Compared without;
  for (int k = 0; k < 200; ++k) EXPECT_EQ(without.add(0.001 * k, std::nan("")), k >= 49);
}

/// A robot whose set point leads by 2 mrad, in motion at up to 2 rad/s.
struct Moving {
  BelievedSetPoint place{three_axes()};
  std::array<double, 3> measured{}, q{};
  double t = 0;

  void take(double off = 0, bool yields = false, double behind = 0.002) {
    t += 0.005;
    measured[0] = 0.5 * std::sin(4 * t) - behind;
    q = {0.5 * std::sin(4 * t), 0, off};
    place.take(q, measured, 0.005, true, yields, false);
  }
};

TEST(BelievedSetPoint, ReplacesASingleOneByWhereTheRobotIs) {
  for (const double off : {0.008, 0.05, 0.5, -3.0}) {
    Moving robot;
    for (int k = 0; k < 400; ++k) {
      const double bad = k % 20 == 13 ? off : 0;
      robot.take(bad);
      ASSERT_NEAR(robot.q[0], robot.measured[0] + 0.002, 1e-12) << off << ' ' << k;
      ASSERT_EQ(robot.q[2], 0) << off << ' ' << k;
      ASSERT_EQ(robot.place.believed(), k % 20 != 13 && k % 20 != 14) << off << ' ' << k;
    }
  }
}

TEST(BelievedSetPoint, IsNearTheRobotUnlessThatYields) {
  Moving stiff, soft;
  for (int k = 0; k < 100; ++k) {
    stiff.take(0, false, 0.3);
    soft.take(0, true, 0.3);
    EXPECT_NEAR(stiff.q[0], stiff.measured[0], 1e-12);
    EXPECT_FALSE(stiff.place.believed());
    if (k == 0) continue;
    EXPECT_NEAR(soft.q[0], soft.measured[0] + 0.3, 1e-12);
    EXPECT_EQ(soft.place.believed(), k > 1);
  }
}

}  // namespace
}  // namespace cotwin::io::belief_test
