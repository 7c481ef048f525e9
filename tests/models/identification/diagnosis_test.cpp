// Logs of known robots with known damage, and 200 without.
#include "models/identification/diagnosis.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <functional>

#include "models/robot/urdf/urdf.h"
#include "tests/models/identification/samples.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/places.h"

namespace cotwin::identification::diagnosis_test {
namespace {

using namespace testing;
using Kind = Finding::Kind;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kStep = 0.01;  // s, of simulate()

robot::RobotModel lwr() { return robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

std::vector<Finding> findings(const robot::RobotModel& robot, const Samples& s, const ModelOptions& options = {}) {
  Diagnosis diagnosis(robot, options, kStep);
  for (std::size_t k = 0; k < s.count(); ++k) {
    const std::size_t i = k * s.joints;
    diagnosis.add(0, true, &s.q[i], &s.dq[i], &s.ddq[i], &s.tau[i]);
  }
  return diagnosis.findings().findings;
}

std::vector<Kind> kinds(const std::vector<Finding>& found) {
  std::vector<Kind> kinds;
  for (const Finding& one : found) kinds.push_back(one.kind);
  return kinds;
}

Samples log_of(const robot::RobotModel& robot, double noise = 0.3, std::uint32_t stream = 0, std::size_t count = 1000) {
  return simulate(robot, truth_of(robot), count, noise, stream);
}

void exchange(std::vector<double>& values, std::size_t n, std::size_t i, std::size_t j) {
  for (std::size_t k = 0; k < values.size(); k += n) std::swap(values[k + i], values[k + j]);
}

/// Torques of joints (all: empty) that come `rows` later.
void delay(Samples& s, std::ptrdiff_t rows, const std::vector<std::size_t>& joints) {
  const std::vector<double> before = s.tau;
  const auto count = static_cast<std::ptrdiff_t>(s.count());
  for (std::ptrdiff_t k = 0; k < count; ++k)
    for (const std::size_t j : joints)
      s.tau[static_cast<std::size_t>(k) * s.joints + j] =
          before[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k - rows, 0, count - 1)) * s.joints + j];
}

TEST(Diagnosis, AccusesNoUndamagedLog) {
  int robots = 0;
  for (std::uint32_t stream = 0; stream < 200; ++stream) {
    robot::testing::Draw draw(stream);
    const robot::RobotModel robot =
        stream % 20 == 0
            ? lwr()
            : draw.robot(stream % 2 == 1 ? robot::testing::Kind::kMixedChain : robot::testing::Kind::kTree, 2 + stream % 2);
    const std::vector<Finding> found = findings(robot, log_of(perturbed(robot, 0.3, stream), 0.5, stream, 200));
    EXPECT_THAT(kinds(found), IsEmpty()) << stream << ' ' << (found.empty() ? 0 : found[0].value);
    ++robots;
  }
  EXPECT_EQ(robots, 200);
}

/// Friction as real joints have it: hysteresis (Dahl) of other widths than those of the diagnosis, Stribeck's peak, more in one
/// direction, and less of it as the joint warms up.
void add_rich_friction(Samples& s, bool warms) {
  for (std::size_t j = 0; j < s.joints; ++j) {
    const double width = 0.004 * std::pow(1.5, static_cast<double>(j)), coulomb = 6 - 0.8 * static_cast<double>(j);
    double z = 0;
    for (std::size_t k = 0; k < s.count(); ++k) {
      const std::size_t i = k * s.joints + j;
      const double v = s.dq[i], end = v < 0 ? -1 : 1, warm = warms ? 0.75 + 0.25 * std::exp(-s.t[k] / 3) : 1;
      for (int part = 0; part < 20; ++part) z += std::abs(v) * kStep / 20 / width * (end - z);
      const double peak = 1 + 0.5 * std::exp(-std::pow(v / 0.15, 2)), side = z > 0 ? 1.05 : 0.95;
      s.tau[i] += warm * (coulomb * z * peak * side + 3 * v / (1 + std::abs(v)));
    }
  }
}

TEST(Diagnosis, TakesFrictionWithHysteresisForNoLagAndFindsALagBesideIt) {
  for (std::uint32_t stream = 0; stream < 3; ++stream) {
    SCOPED_TRACE(stream);
    Samples s = log_of(lwr(), 0.3, stream);
    add_rich_friction(s, stream % 2 == 1);
    EXPECT_THAT(kinds(findings(lwr(), s)), IsEmpty());
    delay(s, 5, {0, 1, 2, 3, 4, 5, 6});
    const std::vector<Finding> late = findings(lwr(), s);
    ASSERT_THAT(kinds(late), ElementsAre(Kind::kLag));
    EXPECT_NEAR(late[0].value, 0.05, 0.03);
  }
}

TEST(Diagnosis, FindsTheDirectionOfGravity) {
  for (const double degrees : {10.0, 90.0, 180.0}) {
    SCOPED_TRACE(degrees);
    robot::RobotModel mounted = lwr();
    const double angle = degrees * std::numbers::pi / 180;
    mounted.gravity = Eigen::AngleAxisd(angle, Eigen::Vector3d(0.6, -0.8, 0)) * mounted.gravity;
    const std::vector<Finding> found = findings(lwr(), log_of(mounted));
    ASSERT_THAT(kinds(found), ElementsAre(Kind::kGravity));
    EXPECT_NEAR(found[0].value, angle, 0.01);
    EXPECT_LT((found[0].gravity - mounted.gravity).norm(), 0.1);
    EXPECT_GT(found[0].gain, 1.2);
  }
}

TEST(Diagnosis, FindsLateAndEarlyTorques) {
  for (const std::ptrdiff_t rows : {-10, 5, 20}) {
    Samples s = log_of(lwr());
    delay(s, rows, {0, 1, 2, 3, 4, 5, 6});
    const std::vector<Finding> found = findings(lwr(), s);
    ASSERT_THAT(kinds(found), ElementsAre(Kind::kLag)) << rows;
    EXPECT_NEAR(found[0].value, static_cast<double>(rows) * kStep, 0.006);
  }
  Samples s = log_of(lwr());
  delay(s, 5, {3});
  const std::vector<Finding> one = findings(lwr(), s);
  ASSERT_THAT(kinds(one), ElementsAre(Kind::kLag));
  EXPECT_THAT(one[0].joints, ElementsAre(3));
  EXPECT_NEAR(one[0].value, 0.05, 0.006);
}

TEST(Diagnosis, FindsExchangedTorquesAndJoints) {
  Samples s = log_of(lwr());
  exchange(s.tau, 7, 4, 6);
  std::vector<Finding> found = findings(lwr(), s);
  ASSERT_THAT(kinds(found), ElementsAre(Kind::kTorques));
  EXPECT_THAT(found[0].joints, ElementsAre(4, 6));
  s = log_of(lwr());
  for (std::vector<double>* values : {&s.q, &s.dq, &s.ddq, &s.tau}) exchange(*values, 7, 1, 3);
  found = findings(lwr(), s);
  ASSERT_THAT(kinds(found), ElementsAre(Kind::kJoints));
  EXPECT_THAT(found[0].joints, ElementsAre(1, 3));
}

TEST(Diagnosis, FindsTorquesOfTheOtherSignByTheirFriction) {
  for (const std::vector<std::size_t>& joints : {std::vector<std::size_t>{2}, {1, 5}}) {
    Samples s = log_of(lwr());
    for (std::size_t k = 0; k < s.tau.size(); k += 7)
      for (const std::size_t j : joints) s.tau[k + j] *= -1;
    const std::vector<Finding> found = findings(lwr(), s);
    ASSERT_THAT(kinds(found), ElementsAre(Kind::kSign));
    EXPECT_EQ(std::vector<std::size_t>(found[0].joints.begin(), found[0].joints.end()), joints);
  }
}

TEST(Diagnosis, FindsAClockThatRunsAtAnotherRate) {
  for (const double rate : {0.5, 2.0}) {
    Samples s = log_of(lwr());
    for (double& v : s.dq) v *= rate;
    for (double& a : s.ddq) a *= rate * rate;
    const std::vector<Finding> found = findings(lwr(), s);
    ASSERT_THAT(kinds(found), ElementsAre(Kind::kClock));
    EXPECT_NEAR(found[0].value, rate, 0.1 * rate);
  }
}

TEST(Diagnosis, NamesTheLargerOfTwoDamagesFirst) {
  robot::RobotModel mounted = lwr();
  mounted.gravity = Eigen::AngleAxisd(0.35, Eigen::Vector3d::UnitX()) * mounted.gravity;
  Samples s = log_of(mounted);
  exchange(s.tau, 7, 1, 3);
  EXPECT_THAT(kinds(findings(lwr(), s)), ElementsAre(Kind::kTorques, Kind::kGravity));
}

TEST(Diagnosis, IsQuietWhereNothingCanBeSeen) {
  Samples s = log_of(lwr());
  s.q.resize(99 * 7);  // too few
  EXPECT_THAT(findings(lwr(), s), IsEmpty());
  // A joint that stands still, a robot without gravity, and a joint about the vertical alone.
  Samples still = log_of(lwr());
  for (std::size_t k = 0; k < still.q.size(); k += 7) {
    still.q[k + 2] = 0.5;
    still.dq[k + 2] = still.ddq[k + 2] = 0;
  }
  still.tau = torques(lwr(), truth_of(lwr()), still);
  ModelOptions options;
  options.still = {0, 0, 1, 0, 0, 0, 0};
  EXPECT_THAT(kinds(findings(lwr(), still, options)), IsEmpty());
  robot::RobotModel floating = lwr();
  floating.gravity.setZero();
  EXPECT_THAT(kinds(findings(floating, log_of(floating))), IsEmpty());
}

TEST(Diagnosis, KeepsFewOfManySamplesAndTheSameResult) {
  robot::RobotModel mounted = lwr();
  mounted.gravity = Eigen::AngleAxisd(0.35, Eigen::Vector3d::UnitX()) * mounted.gravity;
  const std::vector<Finding> found = findings(lwr(), log_of(mounted, 0.3, 0, 9000));
  ASSERT_THAT(kinds(found), ElementsAre(Kind::kGravity));
  EXPECT_NEAR(found[0].value, 0.35, 0.01);
}

}  // namespace
}  // namespace cotwin::identification::diagnosis_test
