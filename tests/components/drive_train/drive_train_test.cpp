// The drive train's physics: closed forms, conserved quantities, and a second formulation.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/drive_train/harness.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::testing::drive_train_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

const std::string kSlide =
    "<robot name='slide'><link name='base'/><link name='cart'><inertial><mass value='2'/><inertia ixx='0.01' iyy='0.01' "
    "izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='lift' type='prismatic'><parent link='base'/>"
    "<child link='cart'/><axis xyz='0 0 -1'/><limit lower='0' upper='0.2' effort='100' velocity='1'/></joint></robot>";

// Every method, with tolerances tighter than the test needs.
class DriveTrainPhysics : public ::testing::TestWithParam<std::string> {
 protected:
  std::string with(const std::string& query) const { return query + "&method=" + GetParam(); }
  static Drive& tight(Drive& drive) { return drive.tolerances(1e-12, 1e-12, 1e-10).set("max_substeps", 100000); }
};

TEST_P(DriveTrainPhysics, SettlesWhereTheSpringCarriesTheMotorTorque) {
  Drive drive(with("link_side=outside&joints=1"));
  drive.set("K", 5000).set("B", 0.5).set("sigma2", 60).set("q", 0.3);
  drive.initialise();
  drive.set("tau_m", 12);
  for (int n = 0; n < 500; ++n) drive.step(1e-3);
  // (2b), (2c) at rest: τ_J = τ_m − τ_f, τ_f = 0, θ = q + τ_J / K
  EXPECT_NEAR(drive["tau_J"][0], 12, 1e-6);
  EXPECT_NEAR(drive["theta"][0], 0.3 + 12.0 / 5000, 1e-9);
  EXPECT_NEAR(drive["dtheta"][0], 0, 1e-7);
}

TEST_P(DriveTrainPhysics, SettlesBeyondTheBacklashWhereThereIsPlay) {
  Drive drive(with("link_side=outside&joints=1"));
  drive.set("K", 5000).set("B", 0.5).set("sigma2", 60).set("q", 0.3).set("backlash", 2e-3);
  drive.initialise();
  for (const double tau : {12.0, -12.0}) {
    drive.set("tau_m", tau);
    for (int n = 0; n < 1000; ++n) drive.step(1e-3);
    // K (φ ∓ b), smooth within K ε²/(2 (φ − b)) with ε = b/10
    EXPECT_NEAR(drive["theta"][0], 0.3 + std::copysign(12.0 / 5000 + 2e-3, tau), 2e-4 * 2e-4 / (2 * 12.0 / 5000));
    EXPECT_NEAR(drive["tau_J"][0], tau, 1e-5);
  }
}

TEST_P(DriveTrainPhysics, StaysWhereItIsWhenTheMotorsHoldTheWeight) {
  Drive drive(with("robot=lwr4"));
  for (std::size_t i = 0; i < 7; ++i) drive["q0"][i] = 0.3 + 0.1 * static_cast<double>(i);
  drive.initialise();
  const std::vector<double> q(drive["q"].begin(), drive["q"].end()), theta(drive["theta"].begin(), drive["theta"].end());
  EXPECT_GT(std::abs(drive["tau_J"][1]), 5);  // it hangs in gravity
  std::copy(drive["tau_J"].begin(), drive["tau_J"].end(), drive["tau_m"].begin());
  for (int n = 0; n < 100; ++n) drive.step(1e-3);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(drive["q"][i], q[i], 1e-10);
    EXPECT_NEAR(drive["theta"][i], theta[i], 1e-10);
    EXPECT_NEAR(drive["ddq"][i], 0, 1e-3);  // of links of 1e-4 kg.m² on springs of 6000 N.m/rad
  }
}

TEST_P(DriveTrainPhysics, OfOneJointSwingsAsTheTwoMassOscillatorDoes) {
  const double B = 0.8, I = kRotorInertia, K = 2000, twist = 0.01;
  Drive drive(with("robot=" + kRotor));
  tight(drive).set("K", K).set("B", B).set("tau_e", -K * twist);  // twisted and at rest at first
  drive.initialise();
  EXPECT_NEAR(drive["theta"][0] - drive["q"][0], twist, 1e-15);
  drive.set("tau_e", 0);
  const double theta0 = drive["theta"][0], omega = std::sqrt(K * (1 / B + 1 / I));
  for (int n = 1; n <= 400; ++n) {
    drive.step(1e-3);
    // φ = twist cos ωt about the resting centre of B and I: θ = θ₀ − I/(B + I) twist (1 − cos ωt)
    const double swing = twist * (1 - std::cos(omega * drive.now()));
    ASSERT_NEAR(drive["theta"][0], theta0 - I / (B + I) * swing, 2e-8) << n;
    ASSERT_NEAR(drive["q"][0], B / (B + I) * swing, 2e-8) << n;
  }
}

TEST_P(DriveTrainPhysics, LosesTheTwoMassOscillationToJointDampingAsTheClosedFormSays) {
  const double B = 0.8, I = kRotorInertia, K = 2000, D = 3, twist = 0.01;
  Drive drive(with("robot=" + kRotor));
  tight(drive).set("K", K).set("B", B).set("D", D).set("tau_e", -K * twist);
  drive.initialise();
  drive.set("tau_e", 0);
  const double m = 1 / (1 / B + 1 / I), delta = D / (2 * m), omega = std::sqrt(K / m - delta * delta);
  for (int n = 1; n <= 200; ++n) {
    drive.step(1e-3);
    const double t = drive.now();
    const double phi = twist * std::exp(-delta * t) * (std::cos(omega * t) + delta / omega * std::sin(omega * t));
    ASSERT_NEAR(drive["theta"][0] - drive["q"][0], phi, 2e-8) << n;
  }
}

TEST_P(DriveTrainPhysics, KeepsItsEnergyWithoutFriction) {
  Drive drive(with("robot=lwr4"));
  for (const char* name : {"D", "sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) drive.set(name, 0);
  drive.tolerances(1e-10, 1e-11, 1e-9).set("max_substeps", 100000);
  for (std::size_t i = 0; i < 7; ++i) drive["q0"][i] = 0.5 - 0.1 * static_cast<double>(i);
  drive.initialise();
  const double start = drive.energy();
  double most = 0;
  for (int n = 0; n < 100; ++n) {  // the arm falls with free motors: about ten joules are exchanged
    drive.step(1e-3);
    most = std::max(most, drive["energy_kinetic"][0]);
    ASSERT_EQ(drive["energy_dissipated"][0], 0);
    ASSERT_NEAR(drive.energy(), start, 2e-5) << n;
  }
  EXPECT_GT(most, 0.2);
}

TEST_P(DriveTrainPhysics, BalancesItsEnergyWithFrictionDampingAndBothTorques) {
  for (const char* friction : {"lugre", "elasto_plastic", "coulomb"}) {
    Drive drive(with(std::string("robot=lwr4&friction=") + friction));
    drive.tolerances(1e-9, 1e-10, 1e-8).set("max_substeps", 100000);
    drive.set("link_A", 0.6)
        .set("link_alpha", 30)
        .set("link_s", 0.02)
        .set("link_k", -0.3)
        .set("link_tau_C", 0.2)
        .set("backlash", 1e-5);
    drive.initialise();
    const double start = drive.energy();
    for (int n = 0; n < 300; ++n) {
      for (std::size_t i = 0; i < 7; ++i) {
        drive["tau_m"][i] = excitation(n, i);
        drive["tau_e"][i] = 0.1 * excitation(n + 100, i);
      }
      drive.step(1e-3);
    }
    EXPECT_GT(drive["energy_dissipated"][0], 0.5) << friction;
    EXPECT_GT(drive["work_m"][0], 0.5) << friction;
    EXPECT_NEAR(drive.unbalanced(start), 0, 2e-4 * drive["work_m"][0]) << friction;
  }
}

TEST_P(DriveTrainPhysics, ConstantFrictionIsReversibleWorkAndNotALoss) {
  // A torque that also acts at rest takes up the torque times the way in either direction; only friction opposite to the motion
  // is lost, and this loss never decreases.
  Drive drive(with("robot=lwr4"));
  drive.tolerances(1e-9, 1e-10, 1e-8).set("max_substeps", 100000);
  drive.set("tau_C", 0).set("tau_S", 0).set("sigma2", 0).set("D", 0);
  drive.set("tau_0", 3).set("link_tau_0", -2).set("link_A", 0.6).set("link_alpha", 30).set("link_k", 0.7);
  drive.initialise();
  const double start = drive.energy();
  const std::vector<double> theta(drive["theta"].begin(), drive["theta"].end()), q(drive["q"].begin(), drive["q"].end());
  double lost = 0;
  for (int n = 0; n < 300; ++n) {
    for (std::size_t i = 0; i < 7; ++i) drive["tau_m"][i] = excitation(n, i);
    drive.step(1e-3);
    ASSERT_GE(drive["energy_dissipated"][0], lost - 1e-12) << n;
    lost = drive["energy_dissipated"][0];
    double work = 0;
    // the sigmoid at rest: k + A/2 = 1 N.m
    for (std::size_t i = 0; i < 7; ++i) work += 3 * (drive["theta"][i] - theta[i]) + (-2 + 1) * (drive["q"][i] - q[i]);
    ASSERT_NEAR(drive["work_0"][0], work, 1e-9) << n;
  }
  EXPECT_GT(lost, 0);
  EXPECT_NEAR(drive.unbalanced(start), 0, 2e-4 * std::abs(drive["work_m"][0]) + 1e-4);
}

TEST_P(DriveTrainPhysics, ABreakawayTorqueWithoutCoulombFrictionSticks) {
  for (const char* friction : {"lugre", "elasto_plastic"}) {
    Drive drive(with("robot=" + kRotor + "&friction=" + friction));
    drive.set("sigma0", 5000).set("sigma1", 5).set("tau_S", 3).set("tau_C", 0).set("K", 5000).set("B", 0.5).set("D", 5);
    drive.initialise();
    drive.set("tau_m", 1);
    for (int n = 0; n < 500; ++n) drive.step(1e-3);
    EXPECT_NEAR(drive["tau_f"][0], 1, 0.3) << friction << ": below its breakaway torque it holds";
    EXPECT_LT(std::abs(drive["theta"][0]), 5e-3) << friction;
    drive.set("tau_m", 3.5);
    for (int n = 0; n < 500; ++n) drive.step(1e-3);
    EXPECT_GT(drive["theta"][0], 0.1) << friction << ": above it, it breaks away";
  }
}

TEST_P(DriveTrainPhysics, WithRigidJointsMovesAsMotorsAndLinksInOne) {
  Drive drive(with("robot=lwr4&transmission=rigid"));
  drive.tolerances(1e-11, 1e-12, 1e-10).set("max_substeps", 100000).set("tau_C", 0).set("tau_S", 0).set("sigma2", 4);
  drive.initialise();
  // (M + B) q̈ + C q̇ + g + σ2 q̇ = τ_m by classical Runge–Kutta
  const robot::RobotModel model = robot::load_urdf(std::filesystem::path(places::source()) / "models/robots/lwr4/robot.urdf");
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(7), dq = q, tau(7), h(7);
  Eigen::MatrixXd M(7, 7);
  const Eigen::Map<Eigen::VectorXd> B(drive["B"].data(), 7);
  const auto acceleration = [&](const Eigen::VectorXd& at, const Eigen::VectorXd& speed) -> Eigen::VectorXd {
    robot::mass_matrix_and_bias(mechanism, data, at, speed, M, h);
    M.diagonal() += B;
    return M.llt().solve(tau - h - 4 * speed);
  };
  for (int n = 0; n < 200; ++n) {
    for (std::size_t i = 0; i < 7; ++i) tau[static_cast<Eigen::Index>(i)] = drive["tau_m"][i] = excitation(n, i);
    drive.step(1e-3);
    for (int k = 0; k < 4; ++k) {
      const double s = 0.25e-3;
      const Eigen::VectorXd a1 = acceleration(q, dq), v1 = dq, v2 = dq + s / 2 * a1, a2 = acceleration(q + s / 2 * v1, v2),
                            v3 = dq + s / 2 * a2, a3 = acceleration(q + s / 2 * v2, v3), v4 = dq + s * a3,
                            a4 = acceleration(q + s * v3, v4);
      q += s / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
      dq += s / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    }
    const Eigen::VectorXd ddq = acceleration(q, dq);
    for (std::size_t i = 0; i < 7; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      ASSERT_NEAR(drive["q"][i], q[k], 2e-8);
      ASSERT_EQ(drive["theta"][i], drive["q"][i]);
      ASSERT_NEAR(drive["ddq"][i], ddq[k], 1e-4);
      ASSERT_NEAR(drive["tau_J"][i], tau[k] - 4 * dq[k] - B[k] * ddq[k], 1e-4);  // (2b)
    }
  }
}

TEST_P(DriveTrainPhysics, TendsToRigidJointsAsTheStiffnessGrows) {
  Drive rigid(with("robot=lwr4&transmission=rigid"));
  rigid.tolerances(1e-9, 1e-9, 1e-7);
  rigid.initialise();
  std::vector<double> deviation;
  for (const double factor : {1.0, 10.0, 100.0}) {
    Drive drive(with("robot=lwr4"));
    drive.tolerances(1e-9, 1e-9, 1e-6).set("max_substeps", 1000);
    for (double& K : drive["K"]) K *= factor;
    for (double& D : drive["D"]) D *= 10;  // so that the test sees the static deviation, τ_J / K
    drive.initialise();
    if (factor > 1) rigid.initialise();
    for (int n = 0; n < 150; ++n) {
      for (std::size_t i = 0; i < 7; ++i) rigid["tau_m"][i] = drive["tau_m"][i] = excitation(n, i) * std::min(1.0, n / 50.0);
      drive.step(1e-3);
      rigid.step(1e-3);
    }
    double most = 0;
    for (std::size_t i = 0; i < 7; ++i) most = std::max(most, std::abs(drive["q"][i] - rigid["q"][i]));
    deviation.push_back(most);
  }
  EXPECT_LT(deviation[1], 0.2 * deviation[0]);
  EXPECT_LT(deviation[2], 0.2 * deviation[1]);
}

TEST_P(DriveTrainPhysics, WithCoulombFrictionSticksBelowBreakawayAndSlipsAbove) {
  Drive drive(with("link_side=outside&joints=1&friction=coulomb"));
  drive.set("K", 1e-9).set("B", 2).set("tau_C", 5).set("tau_S", 7);
  drive.initialise();
  const double theta = drive["theta"][0];
  for (int n = 0; n < 200; ++n) {
    drive.set("tau_m", 6.99 * std::sin(0.1 * n));
    drive.step(1e-3);
    ASSERT_EQ(drive["theta"][0], theta);
    ASSERT_EQ(drive["dtheta"][0], 0);
    ASSERT_NEAR(drive["tau_f"][0], drive["tau_m"][0], 1e-8);  // (2b) at rest: friction carries the motor's torque
  }
  drive.set("tau_m", -7.01);
  for (int n = 0; n < 100; ++n) drive.step(1e-3);
  EXPECT_LT(drive["theta"][0], theta);
  EXPECT_EQ(drive.integer("slip"), -1);
}

TEST_P(DriveTrainPhysics, WithCoulombFrictionComesToRestWhenAndWhereTheClosedFormSays) {
  const double B = 2, tau_C = 5, v0 = 0.8;
  Drive drive(with("link_side=outside&joints=1&friction=coulomb"));
  tight(drive).set("K", 1e-12).set("B", B).set("tau_C", tau_C).set("tau_S", tau_C).set("dq", v0).set("tau_m", tau_C);
  drive.initialise();  // in steady motion with the link
  drive.set("tau_m", 0);
  EXPECT_EQ(drive["dtheta"][0], v0);
  const double stop = v0 * B / tau_C;  // 0.32 s
  int events = 0;
  for (int n = 0; n < 400; ++n) {
    drive.step(1e-3);
    events += drive.integer("events");
    const double t = std::min(drive.now(), stop);
    ASSERT_NEAR(drive["theta"][0], v0 * t - 0.5 * tau_C / B * t * t, 5e-9) << n;
  }
  EXPECT_EQ(drive["dtheta"][0], 0);
  EXPECT_EQ(events, 1);
}

// A block on a belt: the link moves steadily and drags the motor through a soft gear. The motor sticks to the housing, breaks
// away at τ_S, slips, and comes to rest.
TEST_P(DriveTrainPhysics, DraggedThroughASpringSticksAndSlipsInTurn) {
  const double K = 100, B = 0.1, v = 0.1, tau_C = 5, tau_S = 7;
  Drive drive(with("link_side=outside&joints=1&friction=coulomb"));
  drive.tolerances(1e-10, 1e-11, 1e-9).set("max_substeps", 100000);
  drive.set("K", K).set("B", B).set("tau_C", tau_C).set("tau_S", tau_S).set("v_S", 1e-6).set("input_order", 1);
  drive.initialise();
  std::vector<double> breakaways, rests;
  int mode = 0;
  for (int n = 1; n <= 3000; ++n) {
    drive.set("q", v * 1e-3 * n).set("dq", v);
    drive.step(1e-3);
    if (drive.integer("slip") != mode) {
      mode = drive.integer("slip");
      (mode != 0 ? breakaways : rests).push_back(drive.now());
    }
  }
  ASSERT_GE(breakaways.size(), 4u);
  // Sticks until the spring carries τ_S: K v t = τ_S for the first time
  EXPECT_NEAR(breakaways[0], tau_S / (K * v), 1.1e-3);
  // Slipping under τ_C (τ_S − τ_C vanishes at once, because v_S is tiny) from φ₀ = τ_S/K at θ̇ = 0: with u = φ − τ_C/K, u̇ = v:
  // u = u₀ cos ωt + (v/ω) sin ωt until θ̇ = v − u̇ = 0 again; then it sticks, and the spring is wound by v t up to τ_S.
  const double omega = std::sqrt(K / B), u0 = (tau_S - tau_C) / K;
  const double slip_time = 2 * (kPi - std::atan(u0 * omega / v)) / omega;
  const double u_end = u0 * std::cos(omega * slip_time) + v / omega * std::sin(omega * slip_time);
  const double period = slip_time + (u0 - u_end) / v;
  EXPECT_NEAR((breakaways[3] - breakaways[0]) / 3, period, 5e-4);
}

TEST_P(DriveTrainPhysics, ReturnsFromAHardStopWithTheRestitution) {
  for (const double e : {0.3, 0.8}) {
    Drive drive(with("robot=" + kRotor + "&transmission=rigid"));
    drive.tolerances(1e-10, 1e-11, 1e-9).set("max_substeps", 100000);
    drive.set("B", 1).set("q_min", -1).set("q_max", 0.5).set("stop_stiffness", 1e6).set("stop_restitution", e).set("dq0", 2);
    drive.initialise();
    int events = 0;
    for (int n = 0; n < 400; ++n) {
      drive.step(1e-3);
      events += drive.integer("events");
      ASSERT_LT(drive["q"][0], 0.5 + 2 * std::sqrt(1.2 / 1e6));  // not deeper than with the undamped stop
    }
    EXPECT_NEAR(drive["dq"][0], -2 * e, 2e-4 * e) << e;
    EXPECT_EQ(events, 2);  // in and out
    for (int n = 0; n < 3000; ++n) drive.step(1e-3);
    EXPECT_LT(std::abs(drive["dq"][0]), 2 * e * e * 1.001);  // it was at the other end
  }
}

// A cart of 2 kg with 0.1 kg of motor falls 0.2 m onto its limit, which carries 100 N at 10 mm.
TEST_P(DriveTrainPhysics, StopsAtTheLimitsOfTheRobotAndTellsIt) {
  const TemporaryFolder folder("drive_train");
  folder.write("slide.urdf", kSlide);
  const std::string query = "robot=" + (folder.path() / "slide.urdf").string() + "&transmission=rigid";
  Drive drive(with(query));
  drive.set("B", 0.1).set("tau_C", 0).set("sigma2", 0).initialise();
  const auto warning = [](Drive& of) { return of.variables().at("warning").strings()[0]; };
  for (int n = 0; n < 3000; ++n) {
    drive.step(1e-3);
    EXPECT_EQ(warning(drive).empty(), drive["passed_at"][0] < 0) << n;
  }
  const double a = 9.81 * 2 / 2.1, fall = std::sqrt(2 * 0.2 / a);
  EXPECT_NEAR(drive["q"][0], 0.2 + 2 * 9.81 / 1e4, 1e-6);
  EXPECT_NEAR(drive["passed_at"][0], std::ceil(1e3 * fall) / 1e3, 1e-9);
  EXPECT_EQ(warning(drive), "joint lift came to the stop at its upper limit of 0.2 m at 0.207 s");

  Drive free(with(query));
  tight(free).set("B", 0.1).set("tau_C", 0).set("sigma2", 0).set("stop_stiffness", 0).initialise();
  for (int n = 0; n < 1000; ++n) free.step(1e-3);
  EXPECT_NEAR(free["q"][0], a / 2, 1e-6);
  EXPECT_EQ(warning(free), "joint lift passed its upper limit of 0.2 m at 0.207 s");
}

TEST(DriveTrain, RefusesAStartBeyondTheLimits) {
  const TemporaryFolder folder("drive_train");
  folder.write("slide.urdf", kSlide);
  const auto refusal = [&](const std::string& robot, double q0) {
    return error_of([&] {
      Drive drive("robot=" + robot + "&transmission=rigid");
      drive.set("B", 0.1).set("q0", q0).initialise();
    });
  };
  const std::string slide = (folder.path() / "slide.urdf").string();
  EXPECT_EQ(refusal(slide, 0.2 * (1 + 1e-10)), "");
  EXPECT_EQ(refusal(slide, 5), "drive_train.q0[1]: joint lift starts at 5 m, expected 0 to 0.2 m");
  EXPECT_THAT(refusal(slide, 1e300), HasSubstr("joint lift starts at 1e+300 m, expected 0 to 0.2 m"));
  EXPECT_THAT(refusal(kRotor, 1e300), HasSubstr("starts at 1e+300 rad, expected "));
  EXPECT_THAT(refusal("lwr4", 28),
              AllOf(HasSubstr("joint_1 starts at 28 rad, expected -2.9"), HasSubstr("; a value in degrees?")));
}

TEST_P(DriveTrainPhysics, WithLinksOutsideMovesItsMotorsAsWithLinksInside) {
  Drive inside(with("robot=lwr4")), outside(with("link_side=outside&robot=lwr4"));
  for (Drive* drive : {&inside, &outside})
    drive->tolerances(1e-10, 1e-11, 1e-9).set("input_order", 1).set("max_substeps", 100000);
  inside.initialise();
  std::copy(inside["q"].begin(), inside["q"].end(), outside["q"].begin());
  std::copy(inside["tau_J"].begin(), inside["tau_J"].end(), outside["tau_m"].begin());
  outside.initialise();
  std::copy(inside["tau_J"].begin(), inside["tau_J"].end(), inside["tau_m"].begin());
  inside.initialise();
  double moved = 0;
  for (int n = 0; n < 2000; ++n) {
    for (std::size_t i = 0; i < 7; ++i)
      inside["tau_m"][i] = outside["tau_m"][i] = 0.2 * excitation(n / 10, i) * std::min(1.0, n / 1000.0);
    inside.step(1e-4);
    std::copy(inside["q"].begin(), inside["q"].end(), outside["q"].begin());
    std::copy(inside["dq"].begin(), inside["dq"].end(), outside["dq"].begin());
    outside.step(1e-4);
    for (std::size_t i = 0; i < 7; ++i) {
      // Cubic Hermite interpolation over 0.1 ms of a link that may oscillate at 5 krad/s with some µrad
      ASSERT_NEAR(outside["theta"][i], inside["theta"][i], 2e-8) << n << " " << i;
      ASSERT_NEAR(outside["tau_J"][i], inside["tau_J"][i], 2e-3) << n << " " << i;
    }
    moved = std::max(moved, std::abs(inside["dq"][0]));
  }
  EXPECT_GT(moved, 1e-2);
}

TEST(DriveTrain, RefusesTheFormerNameOfTheLinkSideWithTheNewOne) {
  EXPECT_THAT(error_of([] { Drive("robot=lwr4&link=inside"); }), HasSubstr("no setting 'link'; did you mean 'link_side'?"));
}

INSTANTIATE_TEST_SUITE_P(Methods, DriveTrainPhysics, ::testing::Values("exponential", "rosenbrock", "cvode"),
                         [](const auto& method) { return method.param; });

TEST(DriveTrain, CarriesTheWeightThroughLinkFrictionAndExternalTorqueAtTheStart) {
  Drive drive("robot=lwr4");
  drive.set("link_tau_0", 0.5).set("tau_e", 0.25);
  drive.initialise();
  const robot::RobotModel model = robot::load_urdf(std::filesystem::path(places::source()) / "models/robots/lwr4/robot.urdf");
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  Eigen::VectorXd g(7);
  robot::gravity(mechanism, data, Eigen::VectorXd::Zero(7), g);
  for (std::size_t i = 0; i < 7; ++i) {
    // (2a) at rest: g + τ_l = τ_J + τ_e
    EXPECT_NEAR(drive["tau_J"][i], g[static_cast<Eigen::Index>(i)] + 0.5 - 0.25, 1e-10);
    EXPECT_NEAR(drive["theta"][i], drive["tau_J"][i] / drive["K"][i], 1e-14);
    EXPECT_NEAR(drive["ddq"][i], 0, 1e-6);
  }
}

TEST(DriveTrain, InPreslidingDriftsWithLugreAndNotWithTheElastoPlasticBristle) {
  std::vector<double> drifts;
  for (const char* friction : {"lugre", "elasto_plastic"}) {
    Drive drive(std::string("link_side=outside&joints=1&friction=") + friction);
    drive.set("K", 1e-6)
        .set("B", 1)
        .set("sigma0", 5000)
        .set("sigma1", 140)
        .set("tau_C", 5)
        .set("tau_S", 7)
        .set("input_order", 1);
    drive.initialise();
    double after_1s = 0;
    for (int n = 1; n <= 5000; ++n) {
      drive.set("tau_m", 2 + std::sin(2 * kPi * 10 * 1e-3 * n));
      drive.step(1e-3);
      if (n == 1000) after_1s = drive["theta"][0];
    }
    drifts.push_back(drive["theta"][0] - after_1s);
  }
  EXPECT_GT(drifts[0], 1e-4);
  EXPECT_LT(std::abs(drifts[1]), 1e-8);
}

TEST(DriveTrain, NamesTheParameterThatIsUnphysical) {
  const auto message = [](const char* name, double value) -> std::string {
    Drive drive("robot=lwr4");
    drive[name][2] = value;
    try {
      drive.initialise();
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  };
  for (const char* name : {"B", "K", "v_S"}) {
    EXPECT_THAT(message(name, 0), HasSubstr(std::string(name) + "[3]: is 0, expected a finite value > 0"));
  }
  for (const char* name : {"D", "backlash", "sigma0", "sigma1", "sigma2", "tau_C", "stop_stiffness", "link_sigma2"}) {
    EXPECT_THAT(message(name, -1), HasSubstr(std::string(name) + "[3]: is -1, expected a finite value >= 0"));
  }
  EXPECT_THAT(message("sigma0", 0), HasSubstr("tau_C[3]: is 5, expected 0 where no bristle carries it"));
  EXPECT_THAT(message("tau_S", 1), HasSubstr("tau_S[3]: is 1, expected at least tau_C = 5 N.m"));
  EXPECT_THAT(message("q_min", 9), HasSubstr("q_min[3]: is 9, expected below q_max"));
  EXPECT_THAT(message("q0", NAN), HasSubstr("q0[3]: is nan, expected a finite value"));
  EXPECT_THAT(message("dq0", 1e300), HasSubstr("dq0[3]: is 1e+300, expected at most 1e6 rad/s"));
}

// A drive that turns steadily: 4 N.m against viscous friction of the link, then also against Coulomb friction.
TEST(DriveTrainTunables, FrictionChangesWithoutAJumpToTheNewSteadySpeed) {
  const auto turning = [](Drive& drive) {
    drive.set("K", 5000).set("D", 5).set("B", 0.5).set("link_sigma2", 2).set("transition", 0.1).set("dq0", 2).set("tau_m", 4);
    drive.initialise();
    for (int n = 0; n < 500; ++n) drive.step(1e-3);
  };
  Drive drive("robot=" + kRotor);
  turning(drive);
  EXPECT_NEAR(drive["dq"][0], 4.0 / 2, 1e-6);
  drive.set("link_tau_C", 1.5);
  double last = drive["tau_J"][0], largest = 0, way = 0;
  Drive other("robot=" + kRotor);
  turning(other);
  for (int n = 0; n < 5000; ++n) {
    drive.step(1e-3);
    largest = std::max(largest, std::abs(drive["tau_J"][0] - last));
    way += std::abs(drive["tau_J"][0] - last);
    last = drive["tau_J"][0];
    if (n != 50) continue;  // during the transition: a fresh instance continues like this one
    Snapshot snapshot;
    snapshot.take(drive.variables());
    snapshot.restore(other.variables(), *other.instance().unit);
    other.move_clock_to(drive);
  }
  for (int n = 51; n < 5000; ++n) other.step(1e-3);
  EXPECT_EQ(other["q"][0], drive["q"][0]);
  EXPECT_EQ(drive["drives"][6], 1.5);
  EXPECT_NEAR(drive["dq"][0], (4.0 - 1.5) / 2, 1e-6);
  EXPECT_GT(way, 0.3);
  EXPECT_LT(largest, 0.02 * 1.5);  // one of 100 ms changes it by a hundredth of the difference
}

TEST(DriveTrainTunables, AMotorBreaksAwayWhenTheFrictionThatHoldsItHasFallenBelowItsTorque) {
  Drive drive("link_side=outside&joints=1&friction=coulomb");
  drive.set("K", 1e-9).set("B", 2).set("tau_C", 5).set("tau_S", 5).set("transition", 0.1);
  drive.initialise();
  drive.set("tau_m", 4);
  for (int n = 0; n < 100; ++n) drive.step(1e-3);
  EXPECT_EQ(drive["dtheta"][0], 0);
  drive.set("tau_C", 3).set("tau_S", 3);
  const double begin = drive.now();
  while (drive["dtheta"][0] == 0 && drive.now() < begin + 1) drive.step(1e-3);
  EXPECT_NEAR(drive.now() - begin, 0.1 * std::log(2.0), 1.001e-3);  // 3 + 2 e^(−t/0.1) = 4
}

TEST(DriveTrainTunables, TheMotorsAccelerationFollowsItsInertia) {
  Drive drive("link_side=outside&joints=1");
  drive.set("K", 1e-9).set("B", 0.5).set("transition", 0);
  drive.initialise();
  drive.set("tau_m", 3);
  for (const double B : {0.5, 1.25}) {
    drive.set("B", B);
    const double before = drive["dtheta"][0];
    drive.step(1e-3);
    EXPECT_NEAR(drive["dtheta"][0] - before, 3 / B * 1e-3, 1e-12);
  }
}

TEST(DriveTrainTunables, AreRefusedWithTheirNameWhereTheyAreUnphysicalAndTheDriveGoesOnWithoutThem) {
  using ::testing::HasSubstr;
  Drive drive("robot=lwr4"), undisturbed("robot=lwr4");
  drive.initialise();
  undisturbed.initialise();
  drive["tau_C"][2] = NAN;
  try {
    drive.step(1e-3);
    FAIL() << "stepped with NaN";
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("tau_C[3]: is nan, expected a finite value >= 0"));
  }
  drive["tau_C"][2] = undisturbed["tau_C"][2];
  drive.step(1e-3);
  undisturbed.step(1e-3);
  EXPECT_EQ(drive["q"][3], undisturbed["q"][3]);
}

// The history of CVODE is replayed after a snapshot, so their parameters must not change. Changed bodies begin a new one.
TEST(DriveTrainTunables, AreFixedWithSundialsButForTheBodies) {
  EXPECT_EQ(Drive("robot=lwr4&method=cvode").variables().at("mass").role, Role::kTunable);
  for (const char* name : {"B", "tau_C", "link_sigma2"}) {
    EXPECT_EQ(Drive("robot=lwr4").variables().at(name).role, Role::kTunable) << name;
    EXPECT_EQ(Drive("robot=lwr4&method=cvode").variables().at(name).role, Role::kParameter) << name;
  }
}

TEST(DriveTrain, EndsTheRunAtAnInputThatIsNotFiniteAndNamesIt) {
  Drive drive("robot=lwr4");
  drive.initialise();
  drive.step(1e-3);
  drive["tau_e"][3] = NAN;
  try {
    drive.step(1e-3);
    FAIL() << "stepped with NaN";
  } catch (const Error& e) {
    EXPECT_STREQ(e.what(), "drive_train.tau_e[4]: is nan at 0.001 s, expected a finite value");
  }
}

TEST(DriveTrain, RefusesSettingsThatMakeNoSense) {
  EXPECT_THROW(Drive("link_side=outside&joints=2&transmission=rigid"), Error);
  EXPECT_THROW(Drive("robot=lwr4&transmission=rigid&friction=coulomb"), Error);
  EXPECT_THROW(Drive("robot=lwr4&method=euler"), Error);
  EXPECT_THROW(Drive("link_side=inside"), Error);
}

}  // namespace
}  // namespace cotwin::testing::drive_train_test
