// Cartesian compliance (3a), (3b) of the whole unit, alone and with the flexible robot behind it.
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/components/compliance/cartesian_harness.h"
#include "tests/support/error_of.h"

namespace cotwin::testing::cartesian_compliance_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

TEST(CartesianCompliance, AFlexibleRobotShowsTheStiffnessOfTableTwoAtItsLinkSide) {
  Kinematics kinematics("lwr4");
  const VectorXd q = lwr4_posture();
  const Pose X = kinematics.at(q);
  CartesianLoop loop("", "lwr4");
  for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) {
    loop.unit[friction].setZero();
    loop.drive[friction].setZero();
  }
  desire(loop.unit, X);
  loop.unit["M_T"].setConstant(10);
  loop.unit["S_T"] = Vector3d(1500, 1000, 500);
  loop.unit["M_R"].setConstant(1);
  loop.unit["K_o"].setConstant(500);
  loop.start(q);
  const Vector3d f(30, -20, 15), m(5, -3, 4);
  loop.unit["f_e"] = f;
  loop.unit["m_e"] = m;
  for (int n = 0; n < 4000; ++n) loop.step();
  EXPECT_EQ(loop.unit.warning(), "");
  const Pose now = kinematics.at(loop.drive["q"]);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double deflection = f[i] / loop.unit["S_T"][i];
    EXPECT_NEAR(loop.unit["p_c"][i] - X.p[i], deflection, 1e-10) << i;
    EXPECT_NEAR(now.p[i] - X.p[i], deflection, 1e-3 * std::abs(deflection)) << i;
  }
  const Eigen::AngleAxisd turn(now.R * X.R.transpose());
  EXPECT_NEAR(turn.angle(), std::asin(m.norm() / 500), 1e-3 * turn.angle());
  EXPECT_NEAR(turn.axis().dot(m.normalized()), 1, 1e-6);
}

TEST(CartesianCompliance, AHeavyRobotOfSixJointsAndAPlanarArmShowTheirStiffnessAtTheirLinksToo) {
  struct Case {
    const char *robot, *query;
    VectorXd q;
    Eigen::Index i;
  };
  const Case cases[] = {{"kr300_r2500", "", (VectorXd(6) << 0.2, -1.2, 1.4, 0.3, 0.8, -0.4).finished(), 1},
                        {"planar2", "&task=x,z", Eigen::Vector2d(0.4, -1.2), 2}};
  for (const Case& c : cases) {
    Kinematics kinematics(c.robot);
    const Pose X = kinematics.at(c.q);
    CartesianLoop loop(c.query, c.robot);
    for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) {
      loop.unit[friction].setZero();
      loop.drive[friction].setZero();
    }
    if (c.q.size() == 6) {  // drives for its weight, of which it has no data
      for (Subject* subject : {&loop.unit, &loop.drive}) {
        (*subject)["B"].setConstant(200);
        (*subject)["K"].setConstant(1e6);
      }
      loop.drive["D"].setConstant(1000);
      loop.unit["tau_max"].setZero();
    }
    desire(loop.unit, X);
    loop.unit["M_T"].setConstant(50);
    loop.start(c.q);
    loop.unit["f_e"][c.i] = 30;
    for (int n = 0; n < 5000; ++n) loop.step();
    EXPECT_NEAR(kinematics.at(loop.drive["q"]).p[c.i] - X.p[c.i], 0.03, 3e-5) << c.robot;
    EXPECT_EQ(loop.unit.warning(), "") << c.robot;
  }
}

/// The unit alone, whose robot is always where it should be.
class Alone {
 public:
  Alone(const std::string& query, const std::string& robot, const VectorXd& q)
      : unit("unit:compliance?space=cartesian" + query, robot) {
    unit["q"] = q;
    unit["theta"] = q;
  }
  void step() {
    for (const char* name : {"q", "theta"}) unit[name] = unit["q_c"];
    for (const char* name : {"dq", "dtheta"}) unit[name] = unit["dq_c"];
    unit.step();
  }
  Subject unit;
};

void without_limits(Subject& unit) {
  for (const char* name : {"q_min", "q_max", "dq_max", "tau_max"}) unit[name].setZero();
}

void table_two(Subject& unit) {
  unit["M_T"].setConstant(1);
  unit["S_T"] = Vector3d(1500, 1000, 500);
  unit["M_R"].setConstant(1);
  unit["K_o"].setConstant(500);
  unit.set("transition", "0");
}

// x, v of M ẍ + D ẋ + S x = f at the aperiodic limit after t seconds.
struct State {
  double x = 0, v = 0;
};
State aperiodic(const State& s, double f, double S, double t) {
  const double w = std::sqrt(S), a = s.x - f / S, b = s.v + w * a, decay = std::exp(-w * t);
  return {f / S + (a + b * t) * decay, (b - w * (a + b * t)) * decay};
}

TEST(CartesianCompliance, TranslationIsTheClosedFormThroughStepsOfTheWrenchWithChangesOfSign) {
  Kinematics kinematics("lwr4");
  Alone alone("", "lwr4", lwr4_posture());
  const Pose X = kinematics.at(lwr4_posture());
  desire(alone.unit, X);
  table_two(alone.unit);
  without_limits(alone.unit);  // a kilogram moves faster than the joints may
  alone.unit.initialise();
  const Vector3d pushes[] = {{60, 0, 0}, {60, -60, 0}, {-60, 60, 30}, {0, 0, -30}, {0, 0, 0}};
  State expected[3];
  double worst = 0;
  for (const Vector3d& f : pushes) {
    alone.unit["f_e"] = f;
    for (int n = 0; n < 500; ++n) {
      alone.step();
      for (Eigen::Index i = 0; i < 3; ++i) {
        expected[i] = aperiodic(expected[i], f[i], alone.unit["S_T"][i], 1e-3);
        worst = std::max(worst, std::abs(alone.unit["p_c"][i] - X.p[i] - expected[i].x));
      }
    }
  }
  EXPECT_LT(worst, 1e-12);
  EXPECT_LT(alone.unit.value("task_error"), 1e-9);
  EXPECT_EQ(alone.unit.warning(), "");
}

TEST(CartesianCompliance, SettlesInTheTimesOfTableTwoWithoutOvershoot) {
  const double expected[] = {0.151, 0.184, 0.261};
  Kinematics kinematics("lwr4");
  for (Eigen::Index i = 0; i < 3; ++i) {
    Alone alone("", "lwr4", lwr4_posture());
    const Pose X = kinematics.at(lwr4_posture());
    desire(alone.unit, X);
    table_two(alone.unit);
    alone.unit.initialise();
    const double deflection = 20 / alone.unit["S_T"][i];
    alone.unit["f_e"][i] = 20;
    double settled = 0, highest = 0, joints = 0;
    for (int n = 1; n <= 800; ++n) {
      alone.step();
      const double x = alone.unit["p_c"][i] - X.p[i];
      highest = std::max(highest, x);
      joints = std::max(joints, kinematics.at(alone.unit["q_c"]).p[i] - X.p[i]);
      if (x < 0.98 * deflection) settled = n * 1e-3;
    }
    EXPECT_NEAR(settled, expected[i], 1.5e-3) << i;
    EXPECT_LT(highest, deflection * (1 + 1e-6)) << i;
    EXPECT_LT(joints, deflection * (1 + 1e-6)) << i;
  }
}

TEST(CartesianCompliance, JointsFollowAFastDesiredMotionOfTheFrame) {
  Kinematics kinematics("lwr4");
  Alone alone("", "lwr4", lwr4_posture());
  const Pose X = kinematics.at(lwr4_posture());
  desire(alone.unit, X);
  without_limits(alone.unit);
  alone.unit.initialise();
  const Vector3d a(0.06, 0.1, -0.05), axis = Vector3d(1, 2, -1).normalized();
  double worst = 0, acceleration = 0;
  for (int n = 1; n <= 3000; ++n) {
    const double t = n * 1e-3, w = 4, s = 1 - std::cos(w * t), ds = w * std::sin(w * t), dds = w * w * std::cos(w * t);
    const double soft = std::min(t, 1.0), u = soft * soft * soft * (10 - 15 * soft + 6 * soft * soft);
    const double du = t < 1 ? 30 * soft * soft * (1 - soft) * (1 - soft) : 0;
    const double ddu = t < 1 ? 60 * soft * (1 - soft) * (1 - 2 * soft) : 0;
    const double x = u * s, dx = u * ds + du * s, ddx = u * dds + 2 * du * ds + ddu * s;
    alone.unit["p_d"] = X.p + a * x;
    alone.unit["v_d"] = a * dx;
    alone.unit["dv_d"] = a * ddx;
    alone.unit["quat_d"] = quaternion_values(Quaterniond(Eigen::AngleAxisd(0.3 * x, axis)) * Quaterniond(X.R));
    alone.unit["w_d"] = 0.3 * axis * dx;
    alone.unit["dw_d"] = 0.3 * axis * ddx;
    const VectorXd dq = alone.unit["dq_c"], ddq = alone.unit["ddq_c"];
    alone.step();
    worst = std::max(worst, alone.unit.value("task_error"));
    const VectorXd mean = (VectorXd(alone.unit["dq_c"]) - dq) / 1e-3, ends = (ddq + VectorXd(alone.unit["ddq_c"])) / 2;
    if (n > 10) acceleration = std::max(acceleration, (mean - ends).norm() / (1 + mean.norm()));
  }
  EXPECT_LT(worst, 5e-6) << alone.unit.warning();
  EXPECT_LT(acceleration, 0.02);
}

TEST(CartesianCompliance, QAndMinusQOfTheDesiredOrientationGiveTheSameBits) {
  Kinematics kinematics("lwr4");
  std::vector<double> results[2];
  for (int k = 0; k < 2; ++k) {
    Alone alone("", "lwr4", lwr4_posture());
    desire(alone.unit, kinematics.at(lwr4_posture()));
    if (k == 1) alone.unit["quat_d"] *= -1;
    alone.unit.initialise();
    alone.unit["m_e"] = Vector3d(5, -8, 3);
    for (int n = 0; n < 100; ++n) {
      alone.step();
      if (n == 50) alone.unit["quat_d"] *= -1;
      for (const Variable& v : alone.unit.instance().variables) {
        if (v.kind() != Kind::kReal || v.role == Role::kInput) continue;
        results[k].insert(results[k].end(), v.reals().begin(), v.reals().end());
      }
    }
  }
  ASSERT_EQ(results[0].size(), results[1].size());
  EXPECT_EQ(std::memcmp(results[0].data(), results[1].data(), results[0].size() * sizeof(double)), 0);
}

TEST(CartesianCompliance, AWrenchOfJointTorquesMovesTheFrameLikeTheWrenchItself) {
  Kinematics kinematics("lwr4");
  const VectorXd q = lwr4_posture();
  Alone sensor("", "lwr4", q), joints("&wrench=joints", "lwr4", q);
  Eigen::Matrix<double, 6, 1> F;
  F << 10, -20, 15, 2, -1, 3;
  for (Alone* a : {&sensor, &joints}) {
    desire(a->unit, kinematics.at(q));
    a->unit.initialise();
  }
  sensor.unit["f_e"] = F.head<3>();
  sensor.unit["m_e"] = F.tail<3>();
  for (int n = 0; n < 300; ++n) {
    joints.unit["tau_e"] = kinematics.jacobian(joints.unit["q_c"]).transpose() * F;
    sensor.step();
    joints.step();
  }
  EXPECT_LT((VectorXd(sensor.unit["p_c"]) - VectorXd(joints.unit["p_c"])).norm(), 1e-12);
  EXPECT_LT((VectorXd(sensor.unit["quat_c"]) - VectorXd(joints.unit["quat_c"])).norm(), 1e-12);
}

TEST(CartesianCompliance, AJointMotionIsTheDesiredMotionOfItsFrame) {
  Kinematics kinematics("kr300_r2500");
  const VectorXd q = (VectorXd(6) << 0.2, -1.2, 1.4, 0.3, 0.8, -0.4).finished();
  Alone joints("&desired=joints", "kr300_r2500", q);
  joints.unit["q_d"] = q;
  joints.unit.initialise();
  for (int n = 1; n <= 1000; ++n) {
    const double t = n * 1e-3, s = t * t * t * (10 - 15 * t + 6 * t * t), ds = 30 * t * t * (1 - t) * (1 - t);
    joints.unit["q_d"] = q.array() + 0.3 * s;
    joints.unit["dq_d"].setConstant(0.3 * ds);
    joints.unit["ddq_d"].setConstant(0.3 * 60 * t * (1 - t) * (1 - 2 * t));
    joints.step();
  }
  const Pose X = kinematics.at(q.array() + 0.3);
  EXPECT_LT((VectorXd(joints.unit["p_c"]) - X.p).norm(), 1e-12);
  EXPECT_LT((VectorXd(joints.unit["q_c"]) - VectorXd(joints.unit["q_d"])).norm(), 1e-6);  // six joints: no freedom left
}

TEST(CartesianCompliance, MatricesMayBeGivenInTheWorldTheDesiredAndTheToolFrame) {
  Kinematics kinematics("lwr4");
  const Pose X = kinematics.at(lwr4_posture());
  const Vector3d f(12, -9, 5), S(1500, 1000, 500);
  for (const std::string axes : {"world", "desired", "tool"}) {
    Alone alone("&axes=" + axes, "lwr4", lwr4_posture());
    desire(alone.unit, X);
    table_two(alone.unit);
    alone.unit["K_o"].setConstant(5000);
    alone.unit.initialise();
    alone.unit["f_e"] = f;
    for (int n = 0; n < 2000; ++n) alone.step();
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    if (axes == "desired") R = X.R;
    if (axes == "tool") R = quaternion(alone.unit["quat_c"]).toRotationMatrix();
    const Vector3d expected = R * (R.transpose() * f).cwiseQuotient(S);
    EXPECT_LT((VectorXd(alone.unit["p_c"]) - X.p - expected).norm(), 1e-9) << axes;
    EXPECT_LT(VectorXd(alone.unit["ddq_c"]).norm(), 1e-6) << axes;
    // The spring in tool axes is turned by the force at its end.
    const double turn = Vector3d(alone.unit["epsilon"]).norm();
    if (axes == "tool") {
      EXPECT_NEAR(10000 * turn, expected.cross(f).norm(), 1e-4);
    }
    if (axes != "tool") {
      EXPECT_LT(turn, 1e-60);  // rounding; nothing turns it
    }
  }
}

TEST(CartesianCompliance, IsPassiveInEveryChoiceOfAxesWhileTheFrameTurns) {
  // Work of the wrench on the frame against the energy stored, with the desired pose at rest.
  Kinematics kinematics("lwr4");
  const Pose X = kinematics.at(lwr4_posture());
  for (const std::string axes : {"world", "desired", "tool"}) {
    Alone alone("&axes=" + axes, "lwr4", lwr4_posture());
    desire(alone.unit, X);
    table_two(alone.unit);
    for (const char* name : {"zeta_T", "zeta_R", "omega_free"}) alone.unit[name].setZero();
    without_limits(alone.unit);
    alone.unit["M_T"] = Vector3d(5, 10, 20);
    alone.unit["K_o"] = Vector3d(80, 50, 30);
    alone.unit.initialise();
    const auto stored = [&] {
      const Vector3d x = alone.unit["Delta_axes"], dx = alone.unit["dDelta_axes"], w = alone.unit["w_dc"];
      const Vector3d e = alone.unit["epsilon"];
      return (dx.dot(Vector3d(5, 10, 20).asDiagonal() * dx) + x.dot(Vector3d(1500, 1000, 500).asDiagonal() * x) +
              w.squaredNorm()) /
                 2 +
             2 * e.dot(Vector3d(80, 50, 30).asDiagonal() * e);
    };
    const double h = 2e-5;
    double work = 0, most = 0;
    for (int n = 0; n < 20000; ++n) {
      const double t = n * h;
      const Vector3d f(40 * std::sin(9 * t), 30 * std::cos(7 * t), 20), m(8 * std::cos(5 * t), 6, 4 * std::sin(6 * t));
      alone.unit["f_e"] = f;
      alone.unit["m_e"] = m;
      const Vector3d v = alone.unit["v_c"], w = alone.unit["w_c"];
      alone.unit.step(Duration{20'000});
      work += h / 2 * (f.dot(v + Vector3d(alone.unit["v_c"])) + m.dot(w + Vector3d(alone.unit["w_c"])));
      most = std::max(most, stored());
    }
    EXPECT_GT(most, 1) << axes;
    EXPECT_NEAR(stored(), work, 2e-4 * most) << axes;
  }
}

TEST(CartesianCompliance, GoesThroughAllOrientationsWithoutAJump) {
  // Full turns about the vertical while the pitch goes from −90° to 90° and back, and rolls; the arm follows with its seven
  // joints, without limits.
  Kinematics kinematics("lwr4");
  Alone alone("&task=rx,ry,rz", "lwr4", lwr4_posture());
  without_limits(alone.unit);
  const auto orientation = [&](double t) {
    const double pitch = -M_PI / 2 * std::cos(t), yaw = 2 * t, roll = 0.7 * t;
    return Quaterniond(rotation_from_rpy(roll, pitch, yaw));
  };
  const Quaterniond first(kinematics.at(lwr4_posture()).R), shift = orientation(0).conjugate() * first;
  desire(alone.unit, kinematics.at(lwr4_posture()));
  alone.unit.initialise();
  VectorXd before = alone.unit["quat_c"], q = alone.unit["q_c"];
  double jump = 0, speed = 0, worst = 0;
  for (int n = 1; n <= 13000; ++n) {
    const double t = n * 1e-3, h = 1e-4;
    const auto at = [&](double s) { return orientation(s < 1 ? s * s * s * (1 - s / 2) : s - 0.5) * shift; };
    const Quaterniond Q = at(t);
    Eigen::AngleAxisd forward(at(t + h) * Q.conjugate()), backward(Q * at(t - h).conjugate());
    const Vector3d w1 = forward.angle() * forward.axis() / h, w0 = backward.angle() * backward.axis() / h;
    alone.unit["quat_d"] = quaternion_values(Q);
    alone.unit["w_d"] = (w0 + w1) / 2;
    alone.unit["dw_d"] = (w1 - w0) / h;
    alone.step();
    jump = std::max(jump, (VectorXd(alone.unit["quat_c"]) - before).norm());
    before = alone.unit["quat_c"];
    speed = std::max(speed, (VectorXd(alone.unit["q_c"]) - q).norm() / 1e-3);
    q = alone.unit["q_c"];
    worst = std::max(worst, Vector3d(alone.unit["epsilon"]).norm());
  }
  EXPECT_LT(jump, 3e-3);  // at most 4 rad/s
  EXPECT_LT(worst, 1e-9);
  EXPECT_LT(speed, 50);
  EXPECT_LT(alone.unit.value("task_error"), 1e-3) << alone.unit.warning();
}

TEST(CartesianCompliance, APlanarArmRendersTheDirectionsThatItHas) {
  Kinematics kinematics("planar2");
  const VectorXd q = Eigen::Vector2d(0.4, -1.2);
  const Pose X = kinematics.at(q);
  struct Case {
    const char *task, *port;
    Eigen::Index i;
  };
  for (const Case& c : {Case{"x,z", "f_e", 0}, Case{"x,z", "f_e", 2}, Case{"ry,x", "m_e", 1}, Case{"z", "f_e", 2}}) {
    for (const std::string axes : {"world", "tool"}) {
      Alone alone(std::string("&task=") + c.task + "&axes=" + axes, "planar2", q);
      desire(alone.unit, X);
      alone.unit["K_o"].setConstant(500);
      alone.unit.initialise();
      alone.unit[c.port][c.i] = 5;
      alone.unit["f_e"][1] = 100;  // out of the plane: carried by the bearings
      for (int n = 0; n < 3000; ++n) alone.step();
      const Pose now = kinematics.at(alone.unit["q_c"]);
      if (c.port[0] == 'f') {
        EXPECT_NEAR(now.p[c.i] - X.p[c.i], 5e-3, 1e-6) << c.task << axes;
      }
      if (c.port[0] == 'm') {
        EXPECT_NEAR(Eigen::AngleAxisd(now.R * X.R.transpose()).angle(), 0.01, 1e-5) << c.task << axes;
      }
      EXPECT_LT(alone.unit.value("task_error"), 1e-7) << c.task;
      EXPECT_EQ(alone.unit["Delta_p"][1], 0) << c.task;
    }
  }
}

TEST(CartesianCompliance, StaysBoundedInAndBehindASingularPoseAndTellsIt) {
  Kinematics kinematics("lwr4");
  const VectorXd stretched = VectorXd::Zero(7);  // the arm stands upright
  const Pose X = kinematics.at(stretched);
  Alone alone("", "lwr4", stretched);
  desire(alone.unit, X);
  alone.unit.initialise();
  double speed = 0;
  for (int n = 0; n < 6000; ++n) {
    alone.unit["f_e"] = n < 3000 ? Vector3d(20, 30, 80) : Vector3d(0, 0, 0);  // 80 N upwards, out of reach
    alone.step();
    speed = std::max(speed, VectorXd(alone.unit["dq_c"]).lpNorm<Eigen::Infinity>());
    ASSERT_TRUE(VectorXd(alone.unit["q_c"]).allFinite());
  }
  EXPECT_LT(speed, 3.3);
  EXPECT_LT(alone.unit.value("task_error"), 0.01);
  EXPECT_NE(alone.unit.warning().find("sigma_min"), std::string::npos) << alone.unit.warning();
  EXPECT_NE(alone.unit.warning().find("task_error"), std::string::npos);
}

TEST(CartesianCompliance, StartsWithoutAJumpWhereTheRobotIsAndTellsTheDeviation) {
  Kinematics kinematics("lwr4");
  Alone alone("", "lwr4", lwr4_posture());
  Pose X = kinematics.at(lwr4_posture());
  X.p += Vector3d(0.03, -0.02, 0.01);
  X.R = X.R * rotation_from_rpy(0.1, 0.2, -0.1);
  desire(alone.unit, X);
  alone.unit.initialise();
  EXPECT_LT((VectorXd(alone.unit["q_c"]) - lwr4_posture()).norm(), 1e-15);
  double step = 0;
  for (int n = 0; n < 4000; ++n) {
    const VectorXd q = alone.unit["q_c"];
    alone.step();
    step = std::max(step, (VectorXd(alone.unit["q_c"]) - q).norm());
  }
  EXPECT_LT(step, 2e-3);
  EXPECT_LT((kinematics.at(alone.unit["q_c"]).p - X.p).norm(), 1e-6);
  EXPECT_NE(alone.unit.warning().find("did not start"), std::string::npos) << alone.unit.warning();
}

TEST(CartesianCompliance, ASensorBehindAToolFeelsNeitherItsWeightNorItsInertia) {
  Kinematics kinematics("lwr4"), flange("lwr4", "link_7");
  Alone alone("&sensor=link_7", "lwr4", lwr4_posture());
  desire(alone.unit, kinematics.at(lwr4_posture()));
  const double m = 2.5;
  const Vector3d centre(0.02, -0.01, 0.08);
  alone.unit.set("tool_mass", "2.5");
  alone.unit["tool_centre"] = centre;
  alone.unit.initialise();
  for (int n = 0; n < 3000; ++n) {
    const Eigen::Matrix3d R = flange.at(alone.unit["q_c"]).R;
    const Vector3d weight = R.transpose() * Vector3d(0, 0, -9.81 * m);
    alone.unit["f_s"] = weight + R.transpose() * Vector3d(20, 0, 0);
    alone.unit["m_s"] = centre.cross(weight);
    alone.step();
  }
  // A force of 20 N at the sensor's origin, whose moment about E is that of its arm.
  EXPECT_NEAR(alone.unit["Delta_p"][0], 0.02, 1e-6);
  EXPECT_NEAR(alone.unit["Delta_p"][2], 0, 1e-6);
}

TEST(CartesianCompliance, VariableStiffnessNeverGivesOutMoreThanTheTankHolds) {
  Kinematics kinematics("lwr4");
  Alone alone("", "lwr4", lwr4_posture());
  desire(alone.unit, kinematics.at(lwr4_posture()));
  table_two(alone.unit);
  alone.unit.set("tank_start", "0.05");
  for (const char* name : {"zeta_T", "zeta_R", "omega_free"}) alone.unit[name].setZero();
  alone.unit.initialise();
  const auto stored = [&] {
    const Vector3d x = alone.unit["Delta_axes"], dx = alone.unit["dDelta_axes"], w = alone.unit["w_dc"];
    const Vector3d e = alone.unit["epsilon"], S = alone.unit["S_T_in_force"], K = alone.unit["K_o_in_force"];
    return (dx.squaredNorm() + x.dot(S.asDiagonal() * x) + w.squaredNorm()) / 2 + 2 * e.dot(K.asDiagonal() * e);
  };
  alone.unit["f_e"] = Vector3d(30, 0, 0);
  alone.unit["m_e"] = Vector3d(0, 10, 0);
  for (int n = 0; n < 60; ++n) alone.step();
  alone.unit["f_e"].setZero();
  alone.unit["m_e"].setZero();
  const double begin = stored() + alone.unit.value("tank");
  for (int n = 0; n < 4000; ++n) {
    // Stiff when deflected, soft when passing the middle: the course that pumps most.
    const bool rise = Vector3d(alone.unit["Delta_axes"]).dot(Vector3d(alone.unit["dDelta_axes"])) < 0;
    alone.unit["S_T"] = (rise ? 4 : 1) * Vector3d(1500, 1000, 500);
    alone.unit["K_o"].setConstant(rise ? 2000 : 500);
    alone.step();
    ASSERT_LE(stored() + alone.unit.value("tank"), begin * (1 + 1e-9)) << n;
  }
  EXPECT_NE(alone.unit.warning().find("had to wait"), std::string::npos);
}

TEST(CartesianCompliance, ThePoseOfTheBaseInTheWorldChangesNothingButTheNumbersAtThePorts) {
  Kinematics kinematics("lwr4");
  const Pose X = kinematics.at(lwr4_posture());
  const Pose X_WB{rotation_from_rpy(0.3, -0.5, 1.1), {2.6, 1.2, 0.9}};
  Alone here("&axes=desired", "lwr4", lwr4_posture()), there("&axes=desired", "lwr4", lwr4_posture());
  there.unit["p_WB"] = X_WB.p;
  there.unit["quat_WB"] = quaternion_values(Quaterniond(X_WB.R));
  desire(here.unit, X);
  desire(there.unit, X_WB * X);
  const Vector3d f(12, -9, 5), m(2, 4, -3), v(0.02, -0.01, 0.03), w(0.05, 0.02, -0.04);
  for (Alone* a : {&here, &there}) {
    const Eigen::Matrix3d R = a == &here ? Eigen::Matrix3d(Eigen::Matrix3d::Identity()) : X_WB.R;
    table_two(a->unit);
    a->unit.initialise();
    a->unit["f_e"] = R * f;
    a->unit["m_e"] = R * m;
    for (int n = 1; n <= 500; ++n) {
      const double t = n * 1e-3;
      a->unit["p_d"] = (a == &here ? X : X_WB * X).p + R * v * t * t;
      a->unit["v_d"] = R * v * 2 * t;
      a->unit["dv_d"] = R * v * 2;
      const Quaterniond turn(Eigen::AngleAxisd(w.norm() * t * t, w.normalized()));
      a->unit["quat_d"] = quaternion_values(Quaterniond(R) * turn * Quaterniond(X.R));
      a->unit["w_d"] = R * w * 2 * t;
      a->unit["dw_d"] = R * w * 2;
      a->step();
    }
  }
  EXPECT_GT((VectorXd(here.unit["q_c"]) - lwr4_posture()).norm(), 0.01);
  EXPECT_LT((VectorXd(here.unit["q_c"]) - VectorXd(there.unit["q_c"])).norm(), 1e-9);
  EXPECT_LT((X_WB * Vector3d(here.unit["p_c"]) - Vector3d(there.unit["p_c"])).norm(), 1e-12);
  EXPECT_LT((X_WB.R * Vector3d(here.unit["w_c"]) - Vector3d(there.unit["w_c"])).norm(), 1e-12);
}

TEST(CartesianCompliance, TheFrameMayBeAnywhereOnTheTool) {
  // A frame 0.2 m in front of the flange, turned: a force at its origin does not turn it.
  Kinematics flange("lwr4", "link_7");
  const Pose X_FE{rotation_from_rpy(0.4, 0.2, -0.7), {0.05, -0.03, 0.2}};
  const Pose X = flange.at(lwr4_posture()) * X_FE;
  Alone alone("&frame=link_7", "lwr4", lwr4_posture());
  alone.unit["p_FE"] = X_FE.p;
  alone.unit["quat_FE"] = quaternion_values(Quaterniond(X_FE.R));
  desire(alone.unit, X);
  alone.unit.initialise();
  const Vector3d f(10, -20, 15);
  alone.unit["f_e"] = f;
  for (int n = 0; n < 3000; ++n) alone.step();
  const VectorXd q = alone.unit["q_c"];
  const Pose now = flange.at(q) * X_FE;
  EXPECT_LT((now.p - X.p - f / 1000).norm(), 1e-7);
  EXPECT_LT((now.R - X.R).norm(), 1e-6);
  EXPECT_EQ(alone.unit.warning(), "");
  Eigen::Matrix<double, 6, 1> F;
  F << f, (flange.at(q).R * X_FE.p).cross(f);
  EXPECT_LT((VectorXd(alone.unit["tau_wrench"]) - flange.jacobian(q).transpose() * F).norm(), 1e-4);
}

TEST(CartesianCompliance, StaysFiniteUnderAWrenchThatNoRobotCarries) {
  for (const std::string query : {"", "&axes=tool", "&rotation=log"}) {
    Kinematics kinematics("lwr4");
    Alone alone(query, "lwr4", lwr4_posture());
    desire(alone.unit, kinematics.at(lwr4_posture()));
    alone.unit.initialise();
    for (int n = 0; n < 2000; ++n) {
      alone.unit["f_e"].setConstant(n < 1000 ? 1e6 : 0);
      alone.unit["m_e"].setConstant(n < 1000 ? -1e5 : 0);
      alone.step();
      ASSERT_TRUE(VectorXd(alone.unit["q_c"]).allFinite()) << query << n;
      ASSERT_TRUE(VectorXd(alone.unit["tau_m"]).allFinite()) << query << n;
    }
    EXPECT_LT(VectorXd(alone.unit["q_c"]).lpNorm<Eigen::Infinity>(), 3);
    EXPECT_NE(alone.unit.warning(), "");
  }
}

TEST(CartesianCompliance, ValuesThatChangeAfterLongRestAreFollowedAndChecked) {
  const auto at_rest = [](const std::string& query) {
    auto unit = std::make_unique<Subject>("unit:compliance?space=cartesian" + query, "lwr4");
    Subject& u = *unit;
    desire(u, Kinematics("lwr4").at(lwr4_posture()));
    u["q"] = u["theta"] = lwr4_posture();
    u.initialise();
    for (int n = 0; n < 100; ++n) u.step();
    return unit;
  };
  const auto unit = at_rest("");
  (*unit)["f_e"] << 10, 0, 0;
  (*unit)["S_T"].setConstant(500);
  for (int n = 0; n < 4000; ++n) unit->step();
  EXPECT_NEAR((*unit)["Delta_p"][0], 10.0 / 500, 1e-8);
  const std::pair<const char*, const char*> wrong[] = {
      {"M_T_off", "1000"}, {"S_T", "nan"}, {"k_nu", "-1"}, {"B", "-1"}, {"omega", "-1"}};
  for (const char* query : {"", "&render=impedance"}) {
    for (const auto& [name, values] : wrong) {
      const auto subject = at_rest(query);
      subject->set(name, values);
      EXPECT_NE(error_of([&] { subject->step(); }).find(name), std::string::npos) << name << query;
    }
  }
}

TEST(CartesianCompliance, RefusesWhatItCannotRenderWithOneSentence) {
  const auto refusal = [](const std::string& query, const std::string& robot, const char* name = nullptr,
                          const char* values = "") {
    return error_of([&] {
      Subject unit("unit:compliance?space=cartesian" + query, robot);
      if (name != nullptr) unit.set(name, values);
      unit.initialise();
    });
  };
  const auto says = [](const std::string& message, const std::string& part) {
    EXPECT_NE(message.find(part), std::string::npos) << '\'' << message << "' without '" << part << '\'';
  };
  says(refusal("", "planar2"), "at most 2 of x, z, ry");
  says(refusal("&task=x,y", "planar2"), "cannot render x,y");
  says(refusal("&task=x,up", "lwr4"), "'up'");
  says(refusal("&task=x,x", "lwr4"), "twice");
  says(refusal("&frame=hand", "lwr4"), "hand");
  says(refusal("&base=floating", "lwr4"), "base=floating");
  says(refusal("&sensor=link_7&wrench=joints", "lwr4"), "sensor=");
  says(refusal("", "lwr4", "S_T_off", "2000 0 0"), "S_T: with S_T_off has the eigenvalue -1000");
  says(refusal("", "lwr4", "M_R_off", "1"), "M_R: with M_R_off has the eigenvalue");
  says(refusal("", "lwr4", "M_T", "0"), "M_T[1]");
  says(refusal("", "lwr4", "K_o", "-1"), "K_o[1]");
  says(refusal("", "lwr4", "quat_d", "0"), "quat_d: the quaternion (w, x, y, z) has length 0");
  says(refusal("", "lwr4", "quat_d", "nan"), "quat_d");
  says(refusal("", "lwr4", "f_e", "0 nan 0"), "f_e: is not finite");
  says(refusal("&sensor=link_7", "lwr4", "m_s", "0 nan 0"), "m_s: is not finite");
  says(refusal("", "lwr4", "quat_WB", "0"), "quat_WB");
  says(refusal("", "lwr4", "p_d", "inf"), "p_d");
  says(refusal("", "lwr4", "omega_k", "0"), "omega_k");
}

}  // namespace
}  // namespace cotwin::testing::cartesian_compliance_test
