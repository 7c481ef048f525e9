// A motion that an input slows: on its path at every speed, against closed forms of stopping and limits of acceleration.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "models/numerics/random.h"
#include "tests/components/motion/subject.h"
#include "tests/support/allocations.h"
#include "tests/support/files.h"

namespace cotwin::override_test {
namespace {

using testing::Values;
using Subject = testing::MotionSubject;

constexpr double kStep = 1e-3;  // s

/// A joint that moves with 0.8 rad/s all the time.
std::string line() { return "t,q1\n0,0\n1,0.8\n2,1.6\n3,2.4\n4,3.2\n5,4\n6,4.8\n"; }

struct Case {
  std::string query;
  Values values;
};

/// Motions of all kinds, in joints and poses, with loops.
std::vector<Case> cases(const testing::TemporaryFile& recording) {
  const Values waypoints{{"waypoint_t", "0,1,2.5,4"}, {"waypoint_q", "0,1,-0.5,0.3"}, {"passing", "through"}};
  Values back = waypoints,
         again = {{"waypoint_t", "0.2,1,2"}, {"waypoint_q", "0.1,1,0.1"}, {"loop", "repeat"}, {"t_start", "0.3"}};
  back.emplace_back("loop", "there_and_back");
  const Values poses{{"waypoint_t", "0,2,4"},
                     {"waypoint_p", "0.5 0.1 0.4  0.5 -0.2 0.3  0.4 -0.1 0.5"},
                     {"waypoint_quat", "0 0 1 0  0 0 1 0  0 0 1 0"},
                     {"passing", "blend"}};
  Values inverse = poses;
  inverse.emplace_back("q_start", "0 -0.444 0 1.682 0 -1.02 0");
  return {{"points=4", waypoints},
          {"points=4", back},
          {"points=3", again},
          {"kind=polynomial&degree=9", {{"T", "3"}, {"q_end", "2"}, {"c_r", "0.1"}}},
          {"kind=csv", {{"file", recording.path()}, {"soft_start", "0.5"}, {"soft_stop", "0.5"}}},
          {"space=cartesian&points=3", poses},
          {"space=cartesian&points=3&inverse=true&robot=lwr4", inverse}};
}

TEST(Override, IsThePlannedMotionToTheLastBitUntilSomethingSlowsIt) {
  const testing::TemporaryFile recording(line());
  for (const Case& c : cases(recording)) {
    Subject planned(c.query, c.values), same(c.query + "&override=true", c.values);
    planned.initialise();
    same.initialise();
    for (int k = 0; k < 6000; ++k) {
      planned.step(kStep);
      same.step(kStep);
      for (const char* name : {"q_d", "dq_d", "ddq_d", "p_d", "quat_d", "v_d"}) {
        if (planned.has(name)) {
          ASSERT_EQ(planned.values(name), same.values(name)) << c.query << " " << name << " " << k;
        }
      }
    }
    EXPECT_EQ(same.real("delay"), 0);
    EXPECT_EQ(planned.boolean("done"), same.boolean("done"));
  }
}

TEST(Override, KeepsThePathAtEverySpeed) {
  const testing::TemporaryFile recording(line());
  for (const Case& c : cases(recording)) {
    Subject planned(c.query, c.values), slowed(c.query + "&override=true", c.values);
    planned.initialise();
    slowed.initialise();
    std::uint32_t draw = 0;
    for (int k = 1; k <= 8000; ++k) {
      if (k % 97 == 1) slowed["speed"][0] = numerics::uniform({.seed = 5, .draw = draw++}) * 1.4 - 0.2;  // clamped
      if (k > 2000 && k < 2200) slowed["speed"][0] = k % 2;
      slowed.step(kStep);
      const double rate = slowed.real("path_speed");
      ASSERT_GE(rate, 0);
      ASSERT_LE(rate, 1);
      planned.at(k * kStep - slowed.real("delay"));
      for (const auto& [name, factor] : {std::pair{"q_d", 1.0}, {"dq_d", rate}, {"p_d", 1.0}, {"quat_d", 1.0}, {"v_d", rate}}) {
        if (!planned.has(name)) continue;
        // The planned motion is evaluated at whole nanoseconds.
        ASSERT_LT((slowed.joints(name) - factor * planned.joints(name)).norm(), 1e-8) << c.query << " " << name << " " << k;
      }
    }
    EXPECT_GT(slowed.real("delay"), 1);
  }
}

TEST(Override, IsOnTheQuinticToRounding) {
  Subject s("kind=polynomial&degree=5&override=true", {{"T", "2"}, {"q_end", "1.5"}});
  s.initialise();
  std::uint32_t draw = 0;
  for (int k = 1; k <= 6000; ++k) {
    if (k % 50 == 1) s["speed"][0] = numerics::uniform({.seed = 7, .draw = draw++});
    s.step(kStep);
    const double x = std::min(1.0, (k * kStep - s.real("delay")) / 2), r = s.real("path_speed");
    ASSERT_NEAR(s.real("q_d"), 1.5 * x * x * x * (10 - 15 * x + 6 * x * x), 1e-12);
    ASSERT_NEAR(s.real("dq_d"), 1.5 / 2 * 30 * x * x * (1 - x) * (1 - x) * r, 1e-12);
  }
  EXPECT_TRUE(s.boolean("done"));
}

// Without limits the rate falls linearly within speed_ramp: the motion stops after half a ramp of its planned way.
TEST(Override, StopsAndGoesOnAsTheClosedFormSays) {
  const testing::TemporaryFile recording(line());
  Subject s("kind=csv&override=true", {{"file", recording.path()}, {"speed_ramp", "0.4"}});
  s.initialise();
  for (int k = 0; k < 1000; ++k) s.step(kStep);
  const double speed = s.real("dq_d"), before = s.real("q_d");
  s["speed"][0] = std::numeric_limits<double>::quiet_NaN();
  for (int k = 1; k <= 600; ++k) {
    s.step(kStep);
    const double t = std::min(k * kStep, 0.4);
    ASSERT_NEAR(s.real("path_speed"), 1 - t / 0.4, 1e-12);
    ASSERT_NEAR(s.real("q_d") - before, speed * (t - t * t / 0.8), 1e-9);
    ASSERT_NEAR(s.real("ddq_d"), k <= 400 ? -speed / 0.4 : 0, 1e-6);
  }
  EXPECT_EQ(s.real("dq_d"), 0);
  const double rest = s.real("q_d");
  for (int k = 0; k < 5000; ++k) s.step(kStep);
  EXPECT_NEAR(s.real("q_d"), rest, 1e-12);
  EXPECT_FALSE(s.boolean("done"));
  s["speed"][0] = 1;
  for (int k = 0; k < 5100; ++k) s.step(kStep);
  EXPECT_NEAR(s.real("delay"), 5.6 - 0.2 + 0.2, 1e-9);  // at rest, less half a ramp on each side
  EXPECT_TRUE(s.boolean("done"));
  EXPECT_NEAR(s.real("q_d"), 4.8, 1e-9);
}

// The planned motion uses its limit fully, so that slowing down may take longer than the ramp.
TEST(Override, KeepsTheLimitsOfAcceleration) {
  const std::string ends = "0.4,-0.6,0.5,1.2,-0.9,-0.3,0.6";
  const std::vector<double> end{0.4, -0.6, 0.5, 1.2, -0.9, -0.3, 0.6};
  const double peak = 10 / std::sqrt(3.0) / 4;  // of the quintic in 2 s, per rad
  std::string limits;
  for (const double q : end) limits += std::to_string(std::abs(q) * peak + 1e-6) + " ";
  for (const double ramp : {1e-3, 0.05, 1.0}) {
    Subject s("kind=polynomial&degree=5&robot=lwr4&override=true",
              {{"T", "2"}, {"q_end", ends}, {"ddq_limit", limits}, {"speed_ramp", std::to_string(ramp)}});
    s.initialise();
    std::uint32_t draw = 0;
    double slowest = 1, largest = 0;
    const int period = ramp > 0.5 ? 700 : 61;
    for (int k = 1; k <= 12000; ++k) {
      if (k % period == 0) s["speed"][0] = numerics::uniform({.seed = 9, .draw = draw++}) < 0.4 ? 0 : 1;
      const Eigen::VectorXd q = s.joints("q_d"), dq = s.joints("dq_d");
      s.step(kStep);
      slowest = std::min(slowest, s.real("path_speed"));
      for (Eigen::Index j = 0; j < 7; ++j) {
        const double most = std::abs(end[static_cast<std::size_t>(j)]) * peak + 2e-6;
        largest = std::max(largest, std::abs(s.joints("ddq_d")[j]) / most);
        ASSERT_LE(std::abs(s.joints("ddq_d")[j]), most) << j << " at " << k;
      }
      ASSERT_LT((s.joints("q_d") - q - kStep / 2 * (dq + s.joints("dq_d"))).norm(), 2e-6);
    }
    EXPECT_LT(slowest, 0.5) << ramp;
    EXPECT_GT(largest, 0.9) << ramp;
    EXPECT_TRUE(s.boolean("done")) << ramp << " " << s.real("delay") << " " << s.real("path_speed");
  }
}

TEST(Override, WaitsAtTheStartAndIsRestoredWithoutAllocations) {
  Subject s("points=2&override=true", {{"waypoint_t", "0,1"}, {"waypoint_q", "0,1"}, {"speed", "0"}});
  s.initialise();
  for (int k = 0; k < 500; ++k) s.step(kStep);
  EXPECT_EQ(s.real("q_d"), 0);
  s["speed"][0] = 0.5;
  const std::uint64_t before = testing::allocations();
  for (int k = 0; k < 300; ++k) s.step(kStep);
  EXPECT_EQ(testing::allocations(), before);
  Snapshot snapshot;
  snapshot.take(s.variables(), s.unit());
  const auto run = [&] {
    for (int k = 0; k < 200; ++k)
      EXPECT_EQ(s.unit().step(Time::from_seconds(0.8 + k * kStep), Duration::from_seconds(kStep)), StepResult::kDone);
    return s.values("q_d");
  };
  const std::vector<double> first = run();
  snapshot.restore(s.variables(), s.unit());
  EXPECT_EQ(run(), first);
  EXPECT_GT(first[0], 0);
}

}  // namespace
}  // namespace cotwin::override_test
