// Limits of joints with render=impedance, with the flexible robot behind it.
#include "components/compliance/cartesian/impedance_limits.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "models/robot/robot_model.h"
#include "tests/components/compliance/cartesian_harness.h"
#include "tests/support/allocations.h"

namespace cotwin::testing::impedance_limits_test {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

class Arm : public CartesianLoop {
 public:
  explicit Arm(double shaping = 4)
      : CartesianLoop("&render=impedance", "lwr4"),
        kinematics("lwr4"),
        high(unit["q_max"]),
        low(unit["q_min"]),
        fastest(unit["dq_max"]) {
    for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) {
      unit[friction].setZero();
      drive[friction].setZero();
    }
    unit["shaping"].setConstant(shaping);
    unit["S_T"].setConstant(1000);
    unit["K_o"].setConstant(50);
  }
  void without_limits() {
    for (const char* limit : {"q_min", "q_max", "dq_max"}) unit[limit].setZero();
  }
  /// rad; of the joint that is farthest beyond its limits, below 0 where all are inside.
  double beyond() const {
    const VectorXd q = drive["q"];
    return std::max((q - high).maxCoeff(), (low - q).maxCoeff());
  }
  /// Speed of the fastest motor or link relative to the limit of its joint.
  double speed(const char* side) const {
    double most = 0;
    for (Eigen::Index i = 0; i < 7; ++i) most = std::max(most, std::abs(drive[side][i]) / fastest[i]);
    return most;
  }

  Kinematics kinematics;
  const VectorXd high, low, fastest;
};

TEST(ImpedanceApproach, StopsAtTheWallWithTheGivenDeceleration) {
  for (const double T : {0.004, 0.016, 0.1}) {
    for (const double braking : {1.0, 10.0, 100.0}) {
      const double h = T / 400;
      double s = 1, v = std::sqrt(2 * braking * s) / 2, hardest = 0;
      for (int k = 0; k < 200000 && s > 1e-6; ++k) {
        const compliance::Approach may = compliance::approach(s, v, braking, T);
        const double a = std::min(may.acceleration, 5.0);  // a push to the wall
        hardest = std::max(hardest, -a);
        s -= h * v + h * h / 2 * a;
        v += h * a;
      }
      EXPECT_GT(s, -1e-6);
      EXPECT_LT(v, 2e-6 / T);
      EXPECT_LT(hardest, 1.1 * braking + 0.1) << T;
      EXPECT_LT(compliance::approach(-0.01, 0, braking, T).acceleration, 0);
    }
  }
}

TEST(ImpedanceLimits, HoldJointsThatTheSpringsPullAcross) {
  int across = 0;
  for (unsigned round = 0; round < 24; ++round) {
    for (const bool limited : {true, false}) {
      std::mt19937_64 random(round);
      const auto draw = [&](double least, double most) { return std::uniform_real_distribution<double>(least, most)(random); };
      Arm arm(round % 3 == 2 ? 1 : 4);
      const bool soft = round % 4 == 3;
      if (soft) {
        arm.unit["K"] /= 4;
        arm.drive["K"] /= 4;
      }
      VectorXd q(7), to(7);
      for (int i = 0; i < 7; ++i) {
        const double middle = (arm.low[i] + arm.high[i]) / 2, range = arm.high[i] - arm.low[i];
        q[i] = middle + draw(-0.3, 0.3) * range;
        to[i] = middle + draw(-0.55, 0.55) * range;
      }
      desire(arm.unit, arm.kinematics.at(to));
      arm.unit["S_T"].setConstant(draw(200, 1500));
      arm.unit["K_o"].setConstant(draw(20, 100));
      if (round % 2 == 1) arm.unit["tau_max"].setZero();
      if (!limited) arm.without_limits();
      arm.start(q);
      double beyond = -1, motors = 0, links = 0;
      bool told = false;
      for (int n = 0; n < 2000; ++n) {
        arm.step();
        beyond = std::max(beyond, arm.beyond());
        motors = std::max(motors, arm.speed("dtheta"));
        links = std::max(links, arm.speed("dq"));
        for (const std::int32_t limit : arm.unit.instance().variables.at("limit").integers()) told = told || limit != 0;
      }
      if (limited) {
        EXPECT_LT(beyond, soft ? 0.01 : 1e-3) << round;  // links swing on soft gears
        EXPECT_LT(motors, 1.15) << round;
        EXPECT_LT(links, 2) << round;  // they swing on their gears after the jump of the desired pose
        EXPECT_EQ(told, arm.unit.warning().find("compliant motion of joints") != std::string::npos) << round;
      } else if (beyond > 0.1 || links > 1.3) {
        ++across;
      }
    }
  }
  EXPECT_GT(across, 15);
}

TEST(ImpedanceLimits, WithstandAPushThatIsNotMeasured) {
  for (const double shaping : {1.0, 4.0}) {
    Arm arm(shaping);
    VectorXd q = lwr4_posture();
    q[5] = arm.high[5] - 0.02;
    desire(arm.unit, arm.kinematics.at(q));
    arm.unit["S_T"].setConstant(100);
    arm.unit["K_o"].setConstant(5);
    arm.start(q);
    double beyond = -1;
    for (int n = 0; n < 2000; ++n) {
      arm.step_parts(1, [&](Subject& drive) { drive["tau_e"] = VectorXd::Unit(7, 5) * (n < 1000 ? 15 : 0); });
      beyond = std::max(beyond, arm.beyond());
    }
    EXPECT_GT(beyond, 1e-5) << shaping;
    EXPECT_LT(beyond, 0.015) << shaping;
    EXPECT_LT(arm.beyond(), 1e-4) << shaping;
  }
}

TEST(ImpedanceLimits, DriveNoRobotThatStartsBehindThem) {
  Arm arm;
  VectorXd q = lwr4_posture();
  q[6] = arm.high[6] + 0.2;
  arm.drive["q_max"][6] += 1;  // the limit is the unit's alone
  desire(arm.unit, arm.kinematics.at(q));
  arm.start(q);
  for (int n = 0; n < 1000; ++n) arm.step();
  EXPECT_NEAR(arm.drive["q"][6], q[6], 1e-3);
  // Further out it does not go, back it does, and then not out again.
  const auto turn = [&](double angle) {
    VectorXd to = q;
    to[6] += angle;
    desire(arm.unit, arm.kinematics.at(to));
    for (int n = 0; n < 3000; ++n) arm.step();
    return arm.drive["q"][6] - arm.high[6];
  };
  EXPECT_LT(turn(0.5), 0.201);
  EXPECT_LT(turn(-0.6), 0.2 - 0.4);
  EXPECT_LT(turn(0), 1e-3);
}

TEST(ImpedanceLimits, ThatMoveAcrossTheRobotBecomeWallsWhereItIs) {
  Arm arm;
  const VectorXd q = lwr4_posture();
  desire(arm.unit, arm.kinematics.at(q));
  arm.unit["dq_max"].setConstant(0.3);
  arm.start(q);
  for (int n = 0; n < 100; ++n) arm.step();
  arm.unit["q_max"][6] = q[6] - 0.4;
  double fastest = 0;
  for (int n = 0; n < 4000; ++n) {
    arm.step();
    fastest = std::max(fastest, VectorXd(arm.drive["dtheta"]).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(fastest, 1.15 * 0.3);
  // It yields by the depth of a wall at most, and is not driven to the limit.
  EXPECT_LT(arm.drive["q"][6], q[6] + 1e-3);
  EXPECT_GT(arm.drive["q"][6], q[6] - 0.03);
}

TEST(ImpedanceLimits, AllocateNothing) {
  Arm arm;
  VectorXd q = lwr4_posture(), to = q;
  to[5] = arm.high[5] + 0.3;
  desire(arm.unit, arm.kinematics.at(to));
  arm.start(q);
  for (int n = 0; n < 20; ++n) arm.step();
  bool limited = false;
  for (int n = 0; n < 1000; ++n) {
    arm.step();
    const auto before = allocations();
    arm.unit.step();
    EXPECT_EQ(allocations() - before, 0u);
    for (const std::int32_t limit : arm.unit.instance().variables.at("limit").integers()) limited = limited || limit != 0;
  }
  EXPECT_TRUE(limited);
}

}  // namespace
}  // namespace cotwin::testing::impedance_limits_test
