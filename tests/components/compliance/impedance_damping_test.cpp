// The damping of render=impedance: how far E swings beyond a desired pose that jumps.
#include "components/compliance/cartesian/impedance_control.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "tests/components/compliance/cartesian_harness.h"

namespace cotwin::testing::impedance_damping_test {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

/// A robot with a random stiffness in a random posture, whose desired pose jumps.
class Jump {
 public:
  /// `gears`: stiffness of the gears relative to 1e4 N.m/rad (those of the first designs have 0.06 to 0.2 of it in stiffness_ratio).
  Jump(const std::string& robot, unsigned round, double gears)
      : kinematics_(robot), loop_("&render=impedance", robot), random_(round) {
    for (const char* off : {"tau_max", "q_min", "q_max", "dq_max", "tau_C", "tau_S", "sigma0", "sigma1", "sigma2"})
      loop_.unit[off].setZero();
    for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) loop_.drive[friction].setZero();
    q_ = loop_.unit["q"].size() == 7 ? lwr4_posture() : (VectorXd(6) << 0.2, -1.2, 1.5, 0.3, 0.7, 0.1).finished();
    for (double& angle : q_) angle += draw(-0.4, 0.4);
    loop_.unit["S_T"] = Vector3d(draw(200, 2000), draw(200, 2000), draw(200, 2000));
    loop_.unit["K_o"] = Vector3d(draw(20, 200), draw(20, 200), draw(20, 200));
    loop_.unit["shaping"].setConstant(draw(1, 4));
    for (Subject* part : {&loop_.unit, &loop_.drive}) (*part)["K"].setConstant(1e4 * gears);
    loop_.drive["D"].setConstant(
        15);  // without damping in the gears, motors of other sizes than the links vibrate with shaping > 2
  }
  Vector3d direction() { return Vector3d(draw(-1, 1), draw(-1, 1), draw(-1, 1)).normalized(); }
  void set_ratio(double zeta) { loop_.unit["zeta_T"][0] = loop_.unit["zeta_R"][0] = zeta; }

  /// How far E goes beyond the desired pose along `way`, relative to the jump of `length`, m or rad.
  double overshoot(const Vector3d& way, bool turn, double length) {
    const Pose X = kinematics_.at(q_);
    desire(loop_.unit, X);
    loop_.start(q_);
    for (int k = 0; k < 5; ++k) loop_.step();
    Pose to = X;
    if (turn) to.R = X.R * Eigen::AngleAxisd(length, way).toRotationMatrix();
    if (!turn) to.p += length * way;
    desire(loop_.unit, to);
    double most = 0, stiffest = loop_.unit.value("stiffness_ratio");
    for (int k = 0; k < 1500; ++k) {
      loop_.step();
      stiffest = std::max(stiffest, loop_.unit.value("stiffness_ratio"));
      const Pose now = kinematics_.at(loop_.drive["q"]);
      const Eigen::AngleAxisd turned(X.R.transpose() * now.R);
      most = std::max(most, (turn ? Vector3d(turned.angle() * turned.axis()) : Vector3d(now.p - X.p)).dot(way) / length);
    }
    const bool soft = loop_.unit.warning().find("let the frame overshoot") != std::string::npos;
    EXPECT_EQ(soft, stiffest > compliance::ImpedanceControl::kSwinging);
    return most - 1;
  }

 private:
  double draw(double least, double most) { return std::uniform_real_distribution<double>(least, most)(random_); }

  Kinematics kinematics_;
  CartesianLoop loop_;
  std::mt19937_64 random_;
  VectorXd q_;
};

TEST(ImpedanceDamping, AtTheAperiodicLimitLeavesNoOvershootAlongAxesOfTheStiffnessInAnyPosture) {
  // For modes v with S v = ω² Λ v the motion along an axis i of a diagonal S is Σ v_i² S_i/ω² (1 + ωt) e^(−ωt), a sum without negative terms.
  for (const char* robot : {"lwr4", "ur5e", "ur10e"}) {
    for (unsigned round = 0; round < 18; ++round) {
      const bool turn = round % 2 > 0;
      const double length = (turn ? 0.05 : 0.02) * (round % 3 == 2 ? 6 : 1);
      EXPECT_LT(Jump(robot, round, 1).overshoot(Vector3d::Unit(round / 2 % 3), turn, length), 2e-3) << robot << round;
    }
  }
}

TEST(ImpedanceDamping, AtTheAperiodicLimitLeavesHardlyAnyOvershootInObliqueDirections) {
  for (const char* robot : {"lwr4", "ur5e", "ur10e"}) {
    for (unsigned round = 0; round < 12; ++round) {
      Jump jump(robot, round, 1);
      const bool turn = round % 2 > 0;
      const Vector3d way = jump.direction();
      EXPECT_LT(jump.overshoot(way, turn, turn ? 0.05 : 0.02), 0.02) << robot << round;
    }
  }
}

TEST(ImpedanceDamping, CountsTheComplianceOfTheGears) {
  for (unsigned round = 0; round < 24; ++round) {
    const bool turn = round % 2 > 0;
    EXPECT_LT(Jump("lwr4", round, 0.25).overshoot(Vector3d::Unit(round / 2 % 3), turn, turn ? 0.05 : 0.02), 0.02) << round;
  }
}

TEST(ImpedanceDamping, OfASmallRatioLetsTheFrameSwing) {
  for (unsigned round = 0; round < 3; ++round) {
    Jump jump("lwr4", round, 1);
    jump.set_ratio(0.4);
    EXPECT_GT(jump.overshoot(Vector3d::Unit(round), false, 0.02), 0.05) << round;
  }
}

}  // namespace
}  // namespace cotwin::testing::impedance_damping_test
