#include "components/motion/motion.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/motion/subject.h"
#include "tests/support/allocations.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::motion_test {
namespace {

using cotwin::testing::TemporaryFile;
using ::testing::HasSubstr;

using testing::kTick;
using Subject = testing::MotionSubject;

std::vector<std::string> joint_names() {
  std::vector<std::string> names;
  for (const auto& joint : robot::load_urdf(std::filesystem::path(places::source()) / "models/robots/lwr4/robot.urdf").joints) {
    names.push_back(joint.name);
  }
  return names;
}

/// 0.5 sin(2πt) of one joint, 100 Hz, 2 s.
std::string sine() {
  std::string content = "t,q1\n";
  for (int k = 0; k <= 200; ++k) {
    content += text::to_text(k * 0.01) + "," + text::to_text(0.5 * std::sin(2 * std::numbers::pi * k * 0.01)) + "\n";
  }
  return content;
}

TEST(Motion, APolynomialFollowsItsClosedForm) {
  Subject s("kind=polynomial&joints=2", {{"T", "2"}, {"q_start", "1, -1"}, {"q_end", "0, 2"}});
  s.initialise();
  EXPECT_EQ(s.real("q_d", 1), -1);
  EXPECT_FALSE(s.boolean("done"));
  for (double t = 0.001; t < 2; t += 0.1) {
    s.at(t);
    const double x = t / 2;
    EXPECT_NEAR(s.real("q_d", 1), -1 + 3 * x * x * x * (10 + x * (6 * x - 15)), 1e-14);
    EXPECT_NEAR(s.real("dq_d", 1), 3 * 30 * x * x * (1 - x) * (1 - x) / 2, 1e-13);
    EXPECT_NEAR(s.real("ddq_d", 1), 3 * 60 * x * (1 - x) * (1 - 2 * x) / 4, 1e-12);
  }
  s.at(2.5);
  EXPECT_EQ(s.real("q_d", 0), 0);
  EXPECT_EQ(s.real("dq_d", 0), 0);
  EXPECT_EQ(s.real("ddq_d", 0), 0);
  EXPECT_TRUE(s.boolean("done"));
  EXPECT_EQ(s.real("duration"), 2);
}

TEST(Motion, RedundantCoefficientsKeepBothEndsAndPrescribedJerks) {
  Subject s("kind=polynomial&degree=10&jerk=true", {{"T", "0.8"},
                                                    {"q_start", "0.1"},
                                                    {"dq_start", "-0.2"},
                                                    {"ddq_start", "0.3"},
                                                    {"q_end", "1"},
                                                    {"dq_end", "0.4"},
                                                    {"ddq_end", "-0.5"},
                                                    {"dddq_start", "2"},
                                                    {"c_r", "0.5,-0.3,0.2"}});
  s.initialise();
  EXPECT_EQ(s.real("q_d"), 0.1);
  EXPECT_NEAR(s.real("dq_d"), -0.2, 1e-14);
  EXPECT_NEAR(s.real("ddq_d"), 0.3, 1e-12);
  s.at(1e-6);
  EXPECT_NEAR((s.real("ddq_d") - 0.3) / 1e-6, 2, 0.1);  // the jerk at the start, and its change within a microsecond
  s.at(0.8);
  EXPECT_EQ(s.real("q_d"), 1);
  EXPECT_NEAR(s.real("dq_d"), 0.4, 1e-13);
  EXPECT_NEAR(s.real("ddq_d"), -0.5, 1e-11);
  EXPECT_TRUE(s.boolean("done"));
}

TEST(Motion, AMotionBeginsAtItsStartAndRestsBefore) {
  Subject s("points=3",
            {{"t_start", "1"}, {"waypoint_t", "5,6,8"}, {"waypoint_q", "0.5, 1, -1"}, {"waypoint_dwell", "0,0.5,0"}});
  s.initialise();
  EXPECT_EQ(s.real("q_d"), 0.5);
  s.at(0.9);
  EXPECT_EQ(s.real("q_d"), 0.5);
  EXPECT_EQ(s.real("ddq_d"), 0);
  for (const double t : {2.0, 2.3, 2.5}) {  // reached at 1 + (6 − 5) s, then a dwell
    s.at(t);
    EXPECT_NEAR(s.real("q_d"), 1, 1e-15);
    EXPECT_NEAR(s.real("dq_d"), 0, 1e-14);
  }
  s.at(4);
  EXPECT_NEAR(s.real("q_d"), -1, 1e-15);
  EXPECT_TRUE(s.boolean("done"));
}

TEST(Motion, WaypointsComeFromAFileWithTheRobotsJointNamesInDegrees) {
  // A header with the LWR's joint names, in another order than the robot's.
  std::string header = "dwell", first, second, third;
  const auto names = joint_names();
  for (std::size_t j = names.size(); j-- > 0;) {
    header += "," + names[j];
    first += ",0";
    second += j == 0 ? ",90" : j == 1 ? ",30" : j == 6 ? ",45" : ",0";
    third += ",0";
  }
  const TemporaryFile points(header + ",t\n0" + first + ",0\n1" + second + ",2\n0" + third + ",5\n");
  Subject s("robot=lwr4&degree=7", {{"file", points.path()}, {"angle", "deg"}});
  s.initialise();
  for (const double t : {2.0, 2.7, 3.0}) {
    s.at(t);
    EXPECT_NEAR(s.real("q_d", 0), std::numbers::pi / 2, 1e-14);
    EXPECT_NEAR(s.real("q_d", 1), std::numbers::pi / 6, 1e-14);
    EXPECT_NEAR(s.real("q_d", 6), std::numbers::pi / 4, 1e-14);
  }
  s.at(5);
  EXPECT_TRUE(s.boolean("done"));
}

TEST(Motion, LimitsOfTheRobotAreErrorsThatNameJointTimeValueAndLimit) {
  // LWR 4+: ±170° and 110°/s at joint 1.
  Subject far("robot=lwr4&kind=polynomial", {{"T", "10"}, {"q_end", "3.1,0,0,0,0,0,0"}});
  const std::string position = far.error_of_initialise();
  EXPECT_THAT(position, HasSubstr(" is at 3.1 rad at 10 s, expected -2.9"));
  Subject fast("robot=lwr4&kind=polynomial", {{"T", "1"}, {"q_end", "2,0,0,0,0,0,0"}});
  EXPECT_THAT(fast.error_of_initialise(), HasSubstr(" moves with 3.75 rad/s at 0.5 s, expected at most 1.9"));

  fast.set("limits", "warn");
  fast.initialise();
  EXPECT_THAT(fast.text("warning"), HasSubstr("moves with 3.75 rad/s"));
  fast.set("limits", "ignore");
  fast.initialise();
  EXPECT_EQ(fast.text("warning"), "");
  fast.set("limits", "stretch");
  fast.initialise();
  const double limit = 110 * std::numbers::pi / 180;
  EXPECT_NEAR(fast.real("stretch"), 3.75 / limit, 2e-3);  // the URDF's limit has few digits
  fast.at(fast.real("duration") / 2);
  EXPECT_NEAR(fast.real("dq_d"), limit, 2e-3);
  far.set("limits", "stretch");
  EXPECT_THAT(far.error_of_initialise(), HasSubstr("is at 3.1 rad"));  // stretching cannot help
}

TEST(Motion, LimitsMayBeTighterThanTheRobots) {
  Subject s("kind=polynomial", {{"q_end", "1"}, {"limits", "stretch"}, {"dddq_limit", "60"}});
  s.initialise();
  EXPECT_NEAR(s.real("stretch"), 1, 1e-9);  // 60 Δ/T³ is the quintic's largest jerk
  s.set("dddq_limit", "7.5");
  s.initialise();
  EXPECT_NEAR(s.real("stretch"), 2, 1e-9);
  s.set("limits", "error");
  EXPECT_EQ(s.error_of_initialise(), "motion: joint 1 has a jerk of 60 rad/s3 at 0 s, expected at most 7.5 rad/s3");
}

TEST(Motion, TimeScalingKeepsTheWayAndDividesTheDerivatives) {
  Subject fast("kind=polynomial&degree=8", {{"q_end", "1"}, {"c_r", "0.2,-0.1,0.3"}});
  Subject slow("kind=polynomial&degree=8", {{"q_end", "1"}, {"c_r", "0.2,-0.1,0.3"}, {"time_scale", "2.5"}});
  fast.initialise();
  slow.initialise();
  for (double t = 0.02; t < 1; t += 0.02) {
    fast.at(t);
    slow.at(2.5 * t);
    EXPECT_NEAR(slow.real("q_d"), fast.real("q_d"), 1e-14);
    EXPECT_NEAR(slow.real("dq_d"), fast.real("dq_d") / 2.5, 1e-13);
    EXPECT_NEAR(slow.real("ddq_d"), fast.real("ddq_d") / 6.25, 1e-12);
  }
}

TEST(Motion, ARecordedMotionIsFollowedWithItsDerivatives) {
  const TemporaryFile file(sine());
  Subject s("kind=csv", {{"file", file.path()}, {"start", "0.25"}, {"end", "1.5"}});
  s.initialise();
  const double w = 2 * std::numbers::pi;
  for (double t = 0.001; t <= 1.25; t += 0.0137) {
    s.at(t);
    EXPECT_NEAR(s.real("q_d"), 0.5 * std::sin(w * (t + 0.25)), 1e-8);
    EXPECT_NEAR(s.real("dq_d"), 0.5 * w * std::cos(w * (t + 0.25)), 1e-6);
    EXPECT_NEAR(s.real("ddq_d"), -0.5 * w * w * std::sin(w * (t + 0.25)), 1e-4);
  }
  EXPECT_NEAR(s.real("duration"), 1.25, 1e-15);
}

TEST(Motion, ASoftStartEntersARecordingFromRestWithoutAJump) {
  const TemporaryFile file(sine());
  Subject s("kind=csv", {{"file", file.path()}, {"soft_start", "0.4"}, {"soft_stop", "0.4"}});
  s.initialise();
  EXPECT_EQ(s.real("dq_d"), 0);
  double q = s.real("q_d"), dq = s.real("dq_d"), ddq = s.real("ddq_d");
  for (int k = 1; k <= 2500; ++k) {
    s.at(k * 0.001);
    // The mean of both ends over a millisecond: h²/12 times the second derivative, here up to about 10³ and 10⁵.
    ASSERT_NEAR(s.real("q_d") - q, 0.5e-3 * (dq + s.real("dq_d")), 1e-7) << k;
    ASSERT_NEAR(s.real("dq_d") - dq, 0.5e-3 * (ddq + s.real("ddq_d")), 1e-5) << k;
    q = s.real("q_d"), dq = s.real("dq_d"), ddq = s.real("ddq_d");
  }
  EXPECT_TRUE(s.boolean("done"));
  EXPECT_NEAR(s.real("duration"), 2.4, 1e-12);
}

TEST(Motion, LoopsRepeatOrTurnBack) {
  Subject s("points=2", {{"waypoint_t", "0,1"}, {"waypoint_q", "0,1"}, {"loop", "repeat"}});
  EXPECT_THAT(s.error_of_initialise(),
              HasSubstr("joint 1 starts at 0 rad with 0 rad/s and ends at 1 rad with 0 rad/s, expected the same"));
  s.set("loop", "there_and_back");
  s.initialise();
  s.at(0.3);
  const double q = s.real("q_d"), dq = s.real("dq_d"), ddq = s.real("ddq_d");
  for (const double t : {1.7, 3.7, 101.7}) {
    s.at(t);
    EXPECT_NEAR(s.real("q_d"), q, 1e-12);
    EXPECT_NEAR(s.real("dq_d"), -dq, 1e-12);
    EXPECT_NEAR(s.real("ddq_d"), ddq, 1e-11);
    EXPECT_FALSE(s.boolean("done"));
  }
  const TemporaryFile file(sine());
  Subject turning("kind=csv", {{"file", file.path()}, {"loop", "there_and_back"}});
  EXPECT_THAT(turning.error_of_initialise(), HasSubstr("expected rest at both ends"));
  Subject repeating("kind=csv", {{"file", file.path()}, {"loop", "repeat"}});
  repeating.initialise();
  repeating.at(10.125);
  EXPECT_NEAR(repeating.real("q_d"), 0.5 * std::sin(2 * std::numbers::pi * 0.125), 1e-6);
}

TEST(Motion, OutputsDependOnTimeAloneAndStepsAllocateNothing) {
  const TemporaryFile file(sine());
  for (const auto& [query, values] : std::vector<std::pair<std::string, std::vector<std::pair<std::string, std::string>>>>{
           {"kind=csv", {{"file", file.path()}, {"soft_start", "0.5"}}},
           {"kind=polynomial&degree=12", {{"q_end", "1"}, {"c_r", "0.1"}}},
           {"points=4", {{"waypoint_q", "0,1,2,1"}, {"passing", "through"}}}}) {
    Subject a(query, values), b(query, values);
    a.initialise();
    b.initialise();
    for (const double t : {0.9, 0.2, 1.4}) b.at(t);
    b.at(0.5);
    const std::uint64_t before = testing::allocations();
    for (int k = 1; k <= 500; ++k) a.at(k * 0.001);
    EXPECT_EQ(testing::allocations(), before) << query;
    for (const char* name : {"q_d", "dq_d", "ddq_d"}) EXPECT_EQ(a.real(name), b.real(name)) << query << ", " << name;
  }
}

TEST(Motion, UnknownWordsAreErrorsThatListTheValidOnes) {
  EXPECT_EQ(Subject("", {{"loop", "always"}}).error_of_initialise(),
            "motion: loop: 'always', expected one of no, repeat, there_and_back");
  EXPECT_THAT(Subject("", {{"limits", "x"}}).error_of_initialise(), HasSubstr("expected one of error, warn, stretch, ignore"));
  EXPECT_THAT(Subject("", {{"passing", "x"}}).error_of_initialise(), HasSubstr("expected one of rest, through"));
  EXPECT_THAT(Subject("kind=csv").error_of_initialise(), HasSubstr("motion: file: is empty"));
  EXPECT_THROW(Subject("kind=spline"), Error);
  EXPECT_THROW(Subject("robot=lwr4&joints=6"), Error);
  const TemporaryFile file(sine());
  EXPECT_THAT(Subject("kind=csv", {{"file", file.path()}, {"end", "3"}}).error_of_initialise(),
              HasSubstr("expected a part of the 2 s of"));
}

TEST(Motion, WarnsOfImplausibleSamplingTimes) {
  const TemporaryFile file("t,q1\n0,0\n1,0.001\n2,0.002\n3,0.004\n4,0.005\n");  // milliseconds
  Subject seconds("kind=csv", {{"file", file.path()}});
  seconds.initialise();
  EXPECT_THAT(seconds.text("warning"),
              HasSubstr("its samples are 1 s apart, expected at most 0.1 s; are its times in another unit"));
  Subject milliseconds("kind=csv", {{"file", file.path()}, {"t_unit", "ms"}});
  milliseconds.initialise();
  EXPECT_EQ(milliseconds.text("warning"), "");
  Subject nanoseconds("kind=csv", {{"file", file.path()}, {"t_unit", "ns"}, {"max_speed", "1e9"}});
  nanoseconds.initialise();
  EXPECT_THAT(nanoseconds.text("warning"), HasSubstr("its samples are 1e-09 s apart, expected at least 1e-05 s"));
}

}  // namespace
}  // namespace cotwin::motion_test
