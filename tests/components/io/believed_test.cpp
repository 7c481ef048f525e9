// What is believed of a robot's messages beside its positions: components/io/link/believed.h.
#include "components/io/link/believed.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace cotwin::io {
namespace {

constexpr double kEffort = 100;  // N.m
constexpr double kStep = BelievedTorques::kLargestStep * kEffort;

/// Three joints, of which the last one has no effort.
std::vector<trajectory::Axis> axes() {
  std::vector<trajectory::Axis> axes = trajectory::free_axes(3);
  axes[0].tau_max = axes[1].tau_max = kEffort;
  for (trajectory::Axis& axis : axes) axis.dq_max = 2;
  return axes;
}

/// Known, with these torques.
BelievedTorques at(const std::array<double, 3>& tau) {
  BelievedTorques torques(axes());
  EXPECT_TRUE(torques.add(tau) && !torques.known() && torques.add(tau) && torques.known());
  return torques;
}

TEST(BelievedTorques, UsesNoSingleOneThatStepsAndCountsItOnce) {
  for (const double bad : {9.0, 20.0, 70.0, 9000.0, -9000.0, 3.6e8, std::numeric_limits<double>::quiet_NaN()}) {
    for (std::size_t joint = 0; joint < 3; ++joint) {
      std::array<double, 3> tau{1, -2, 3};
      BelievedTorques torques = at(tau);
      int counted = 0;
      for (int k = 0; k < 100; ++k) {
        std::array<double, 3> sent = tau;
        if (k % 10 == 3) sent[joint] = bad;
        counted += torques.add(sent) ? 0 : 1;
        for (std::size_t i = 0; i < 3; ++i) ASSERT_EQ(torques.torques()[i], tau[i]) << bad << ' ' << k;
      }
      EXPECT_EQ(counted, 10) << bad;
      EXPECT_TRUE(torques.known());
    }
  }
}

// 200 N.m in 5 ms, which then stay or fall to nothing within 10 ms.
TEST(BelievedTorques, UsesAHitOneMessageLateAtMost) {
  for (const double period : {0.0005, 0.001, 0.002, 0.005}) {
    for (const bool stays : {true, false}) {
      const auto hit = [&](int k) {
        const double t = k * period - 0.02;
        return t <= 0 ? 0 : t <= 0.005 ? 200 * t / 0.005 : stays ? 200 : std::max(0.0, 200 - 200 * (t - 0.005) / 0.01);
      };
      BelievedTorques torques = at({0, 0, 0});
      double largest = 0;
      for (int k = 0; k * period < 0.1; ++k) {
        ASSERT_TRUE(torques.add(std::array{hit(k), 0.5, -hit(k)})) << period;
        const auto [least, most] = std::minmax({hit(k - 1), hit(k)});
        ASSERT_GE(torques.torques()[0], least - kStep) << period << ' ' << k;
        ASSERT_LE(torques.torques()[0], most + kStep) << period << ' ' << k;
        ASSERT_TRUE(torques.known());
        largest = std::max(largest, torques.torques()[0]);
      }
      EXPECT_GE(largest, stays ? 200 : 100) << period;
    }
  }
}

TEST(BelievedTorques, NeverUsesWhatIsBeyondTenTimesTheEffort) {
  for (const double bad : {1001.0, -5000.0}) {
    BelievedTorques torques = at({1, 2, 3});
    for (int k = 0; k < 50; ++k) {
      EXPECT_FALSE(torques.add(std::array{bad, 2.0, 3.0}));
      EXPECT_EQ(torques.known(), k < BelievedTorques::kMostHeld);
      EXPECT_EQ(torques.torques()[0], k < BelievedTorques::kMostHeld ? 1 : 0) << "what is not known is no torque";
    }
    EXPECT_TRUE(torques.add(std::array{1.0, 2.0, 3.0}) && !torques.known());
    EXPECT_TRUE(torques.add(std::array{1.0, 2.0, 3.0}) && torques.known());
  }
  BelievedTorques torques = at({0, 0, 0});
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(torques.add(std::array{999.0, 0.0, 9999.0}));
  EXPECT_EQ(torques.torques()[0], 999);
  EXPECT_EQ(torques.torques()[2], 9999) << "without an effort";
  EXPECT_FALSE(torques.add(std::array{999.0, 0.0, 10'001.0}));
}

// Of torques that move by less than a step, with damage that never comes twice in a row, what is used is among the last three sound ones.
TEST(BelievedTorques, StaysAmongSoundOnes) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> share(0, 1), any(-2000, 2000);
  BelievedTorques torques = at({0, 0, 0});
  std::array<double, 3> tau{};
  std::vector<std::array<double, 3>> sound{tau};
  bool damaged = true;
  for (int k = 0; k < 20'000; ++k) {
    for (double& x : tau) x = std::clamp(x + 0.3 * (share(random) - 0.5) * kStep, -80.0, 80.0);
    std::array<double, 3> sent = tau;
    damaged = !damaged && share(random) < 0.5;
    if (damaged) sent[random() % 3] = any(random);
    torques.add(sent);
    sound.push_back(tau);
    if (sound.size() > 3) sound.erase(sound.begin());
    for (std::size_t i = 0; i < 3; ++i) {
      const auto of = [i](const auto& a, const auto& b) { return a[i] < b[i]; };
      ASSERT_GE(torques.torques()[i], (*std::ranges::min_element(sound, of))[i] - kStep) << k;
      ASSERT_LE(torques.torques()[i], (*std::ranges::max_element(sound, of))[i] + kStep) << k;
    }
  }
}

TEST(BelievedTorques, TakesTheForcesAlong) {
  BelievedTorques torques(axes(), 2);
  const std::array<double, 3> tau{1, 2, 3}, bad{1, 500, 3};
  const std::array<double, 2> F{10, 20}, bad_F{10, 2000};
  torques.add(tau, F);
  EXPECT_EQ(torques.along()[1], 0);
  torques.add(tau, F);
  EXPECT_EQ(torques.along()[1], 20);
  torques.add(bad, bad_F);
  EXPECT_EQ(torques.along()[1], 20);
  torques.add(bad, bad_F);
  EXPECT_EQ(torques.along()[1], 2000);
  torques.add(tau, F, false);
  EXPECT_EQ(torques.along()[1], 2000) << "not possible";
  torques.forget();
  EXPECT_EQ(torques.along()[1], 0);
}

/// A robot whose set point leads by 2 mrad, in motion at up to 2 rad/s.
struct Moving {
  BelievedSetPoint place{axes()};
  std::array<double, 3> measured{}, q{};
  double t = 0;

  void take(double off = 0, bool yields = false, double behind = 0.002) {
    t += 0.005;
    measured[0] = 0.5 * std::sin(4 * t) - behind;
    q = {0.5 * std::sin(4 * t), 0, off};
    place.take(q, measured, 0.005, true, yields);
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
}  // namespace cotwin::io
