// The compliance unit compared with closed forms, a Lyapunov function and a rigid plant (2a) that the test integrates itself.
#include "components/compliance/compliance.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::compliance::compliance_test {
namespace {

using Eigen::Vector2d;
using Eigen::VectorXd;

constexpr Duration kMillisecond{1'000'000};
const std::filesystem::path kModels = std::filesystem::path(places::source()) / "models";

Settings planar_settings() {
  Settings settings("compliance", "robot=planar2", {}, {kModels});
  SettingList list;
  Compliance::declare_settings(list);
  settings.declare(std::move(list));
  return settings;
}

/// The unit with its variables by name. planar2 without its drive data: rigid and without friction unless a test says
/// otherwise.
class Controller {
 public:
  Controller() : settings_(planar_settings()), unit_(settings_) {
    unit_.declare(variables_);
    for (const char* name : {"K", "B"}) (*this)[name].setZero();
  }

  Eigen::Map<VectorXd> operator[](const char* name) {
    const std::span<double> values = variables_.at(name).reals();
    return {values.data(), static_cast<Eigen::Index>(values.size())};
  }
  const Variable& variable(const char* name) { return variables_.at(name); }
  bool saturated() { return std::get<std::span<bool>>(variables_.at("saturated").storage)[0]; }
  void initialise() { unit_.initialise({}); }
  void step(Duration h = kMillisecond) { EXPECT_EQ(unit_.step({}, h), StepResult::kDone); }
  /// At rest and without error at q.
  void rest_at(const Vector2d& q) {
    for (const char* name : {"q_d", "q", "theta"}) (*this)[name] = q;
    for (const char* name : {"dq_d", "ddq_d", "dq", "dtheta", "tau_e"}) (*this)[name].setZero();
    initialise();
  }

 private:
  Settings settings_;
  Compliance unit_;
  Variables variables_;
};

/// (2a) with rigid joints: (M + B) q̈ + C q̇ + g = τ_m + τ_e, torques constant over a step, integrated by the classical
/// Runge–Kutta method.
class RigidRobot {
 public:
  RigidRobot() : model(robot::load_urdf(kModels / "robots/planar2/robot.urdf")), mechanism(model), data(mechanism) {}

  VectorXd acceleration(const VectorXd& at, const VectorXd& velocity, const VectorXd& tau) {
    Eigen::MatrixXd M(2, 2);
    VectorXd h(2);
    robot::mass_matrix_and_bias(mechanism, data, at, velocity, M, h);
    M.diagonal() += B;
    const double det = M(0, 0) * M(1, 1) - M(0, 1) * M(1, 0);
    const VectorXd f = tau - h;
    return Vector2d((M(1, 1) * f[0] - M(0, 1) * f[1]) / det, (M(0, 0) * f[1] - M(1, 0) * f[0]) / det);
  }
  void step(const VectorXd& tau, double h) {
    const VectorXd k1 = dq, l1 = acceleration(q, dq, tau);
    const VectorXd k2 = dq + h / 2 * l1, l2 = acceleration(q + h / 2 * k1, k2, tau);
    const VectorXd k3 = dq + h / 2 * l2, l3 = acceleration(q + h / 2 * k2, k3, tau);
    const VectorXd k4 = dq + h * l3, l4 = acceleration(q + h * k3, k4, tau);
    q += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    dq += h / 6 * (l1 + 2 * l2 + 2 * l3 + l4);
  }

  robot::RobotModel model;
  robot::Mechanism mechanism;
  robot::Data data;
  VectorXd q = VectorXd::Zero(2), dq = VectorXd::Zero(2), B = VectorXd::Zero(2);
};

/// A smooth desired motion and its derivatives.
void desire(Controller& c, double t) {
  const Vector2d amplitude(0.6, 0.8), rate(2.0, 3.1);
  for (Eigen::Index i = 0; i < 2; ++i) {
    const double a = amplitude[i], w = rate[i];
    c["q_d"][i] = 0.3 + a * std::sin(w * t);
    c["dq_d"][i] = a * w * std::cos(w * t);
    c["ddq_d"][i] = -a * w * w * std::sin(w * t);
  }
}

/// Runs the closed loop from time 0 and the current state of unit and robot; calls `watch` at every instant.
void close_loop(Controller& c, RigidRobot& robot, double h, int steps, const std::function<void(double)>& watch) {
  for (int n = 0; n < steps; ++n) {
    desire(c, (n + 1) * h);
    c["q"] = robot.q;
    c["dq"] = robot.dq;
    c.step(Duration::from_seconds(h));
    robot.step(c["tau_m"] + c["tau_e"], h);
    watch((n + 1) * h);
  }
}

TEST(Compliance, DeviatesByTorqueOverStiffnessAtRestAndInTheTorquesDirection) {
  Controller c;
  c["S_a"] << 40, 250;
  c.rest_at({0.2, -0.4});
  c["tau_e"] << 10, -5;
  for (int n = 0; n < 20'000; ++n) c.step();
  // (3a) at rest: S Δ = τ_e, with Δ = q_c − q_d. The tolerance is rounding of the last steps only.
  EXPECT_NEAR(c["q_c"][0] - 0.2, 10.0 / 40, 1e-13);
  EXPECT_NEAR(c["q_c"][1] + 0.4, -5.0 / 250, 1e-13);
  EXPECT_NEAR(c["dq_c"].norm(), 0, 1e-13);
}

TEST(Compliance, ApproachesAperiodicallyWithDampingRatioOne) {
  Controller c;
  c["M_a"] << 2, 0.5;
  c["S_a"] << 18, 40;
  c.rest_at({0, 0});
  c["tau_e"] << 9, 9;
  VectorXd before = VectorXd::Zero(2);
  for (int n = 1; n <= 5000; ++n) {
    c.step();
    for (Eigen::Index i = 0; i < 2; ++i) {
      const double S = c["S_a"][i], w = std::sqrt(S / c["M_a"][i]), t = n * 1e-3;
      EXPECT_NEAR(c["q_c"][i], 9 / S * (1 - (1 + w * t) * std::exp(-w * t)), 1e-13);  // critical damping, closed form
      EXPECT_GE(c["q_c"][i], before[i] - 1e-15);
    }
    before = c["q_c"];
  }
}

TEST(Compliance, OneStepOfATenthOfASecondEqualsAHundredOfAMillisecond) {
  Controller fine, coarse;
  for (Controller* c : {&fine, &coarse}) {
    (*c)["M_a"] << 1.5, 0.2;
    (*c)["D_a"] << 3, 0;
    (*c)["zeta_a"] << 0.2, 1;
    (*c)["S_a"] << 100, 30;
    c->rest_at({0, 0});
    (*c)["tau_e"] << 4, -2;
  }
  for (int n = 0; n < 100; ++n) fine.step();
  coarse.step(100 * kMillisecond);
  for (const char* name : {"q_c", "dq_c", "ddq_c"}) {
    EXPECT_NEAR((fine[name] - coarse[name]).norm(), 0, 1e-13) << name;  // rounding of 100 steps
  }
}

TEST(Compliance, FollowsARampedTorqueExactly) {
  Settings settings = planar_settings();
  Compliance unit(settings);
  Variables variables;
  unit.declare(variables);
  const Variable& tau_e = variables.at("tau_e");
  ASSERT_EQ(tau_e.rate.size(), 2u);
  for (double& value : variables.at("zeta_a").reals()) value = 0;
  unit.initialise({});
  tau_e.rate[0] = 6;
  ASSERT_EQ(unit.step({}, 100 * kMillisecond), StepResult::kDone);
  // Undamped, from rest: Δ = (u1/S) (t − sin(w t)/w).
  const double S = 200, w = std::sqrt(S), t = 0.1;
  EXPECT_NEAR(variables.at("q_c").reals()[0], 6 / S * (t - std::sin(w * t) / w), 1e-15);
}

TEST(Compliance, WithoutStiffnessIsGuidedFreelyAndStaysWhereItIsLeft) {
  Controller c;
  c["S_a"].setZero();
  c["D_a"] << 8, 8;
  c.rest_at({0.1, 0.1});
  c["tau_e"] << 2, 0;
  for (int n = 0; n < 5000; ++n) c.step();
  EXPECT_NEAR(c["dq_c"][0], 2.0 / 8, 1e-12);  // D Δ̇ = τ_e
  c["tau_e"].setZero();
  for (int n = 0; n < 5000; ++n) c.step();
  // Released at speed v = τ/D, it continues for M v / D. Until then: v (t − T), T = M/D.
  const double v = 2.0 / 8, T = 1.0 / 8;
  EXPECT_NEAR(c["q_c"][0], 0.1 + v * (5 - T) + T * v, 1e-10);
  EXPECT_NEAR(c["q_c"][1], 0.1, 1e-15);
}

TEST(Compliance, HoldsTheRobotUpAtRest) {
  Controller c;
  RigidRobot robot;
  const Vector2d q(0.3, 0.5);
  c.rest_at(q);
  c.step();
  VectorXd g(2);
  robot::gravity(robot.mechanism, robot.data, q, g);
  EXPECT_NEAR((c["tau_m"] - g).norm(), 0, 1e-12);
  EXPECT_NEAR((c["tau_id"] - g).norm(), 0, 1e-12);
}

TEST(Compliance, InverseDynamicsAloneIsThatOfTheCompliantMotionWithFrictionAndExternalTorque) {
  Controller c;
  RigidRobot robot;
  c["tau_C"] << 1.5, 0.5;
  c["sigma2"] << 2, 1;
  c["link_A"] << 0.8, 0;
  c["link_alpha"] << 20, 0;
  desire(c, 0);
  c.initialise();
  c["tau_e"] << 3, 1;
  for (int n = 1; n <= 700; ++n) {
    desire(c, n * 1e-3);
    c.step();
  }
  VectorXd expected(2);
  robot::inverse_dynamics(robot.mechanism, robot.data, c["q_c"], c["dq_c"], c["ddq_c"], expected);
  const VectorXd dq = c["dq_c"];
  expected[0] += 1.5 * std::tanh(dq[0] / 0.01) + 2 * dq[0] + 0.8 / (1 + std::exp(-20 * dq[0]));
  expected[1] += 0.5 * std::tanh(dq[1] / 0.01) + dq[1];
  EXPECT_NEAR((c["tau_id"] - (expected - c["tau_e"])).norm(), 0, 1e-12);  // (2a) solved for τ_J
}

TEST(Compliance, ComputedTorqueLeavesALinearDecoupledErrorOfEachJoint) {
  // ë + 2ζω ė + ω² e = 0, from e(0) in the first joint alone. The remaining error is due to sampling, of order h.
  const double h = 2e-5, e0 = 0.05, omega = 8;
  Controller c;
  RigidRobot robot;
  robot.B << 0.3, 0.2;
  c["B"] = robot.B;
  c["omega"] << omega, omega;
  c["zeta"] << 1, 0.5;
  desire(c, 0);
  robot.q = c["q_d"] - Vector2d(e0, 0);
  robot.dq = c["dq_d"];
  c["q"] = robot.q;
  c["dq"] = robot.dq;
  c.initialise();
  close_loop(c, robot, h, 50'000, [&](double t) {
    const Vector2d e = c["q_c"] - robot.q;
    ASSERT_NEAR(e[0], e0 * (1 + omega * t) * std::exp(-omega * t), 2e-3 * e0) << t;
    ASSERT_NEAR(e[1], 0, 2e-3 * e0) << t;
  });
}

TEST(Compliance, PassivityBasedTrackingDecreasesItsLyapunovFunction) {
  // V = ½ sᵀ M s + eᵀ Λ K_s e with V̇ = −ėᵀ K_s ė − eᵀ Λ K_s Λ e (Slotine and Li, IJRR 6(3), 1987). Requires that Ṁ − 2C is
  // skew-symmetric.
  const double h = 2e-5;
  const Vector2d Lambda(6, 9), K_s(5, 3);
  Controller c;
  RigidRobot robot;
  c["passivity"].setOnes();
  c["Lambda"] = Lambda;
  c["K_s"] = K_s;
  desire(c, 0);
  robot.q = c["q_d"] + Vector2d(0.4, -0.7);
  robot.dq = c["dq_d"] + Vector2d(-2, 3);
  c["q"] = robot.q;
  c["dq"] = robot.dq;
  c.initialise();
  Eigen::MatrixXd M(2, 2);
  double V_before = 0, rate_before = 0, V_start = 0;
  close_loop(c, robot, h, 50'000, [&](double t) {
    const Vector2d e = c["q_c"] - robot.q, de = c["dq_c"] - robot.dq;
    const Vector2d s = de + Lambda.cwiseProduct(e);
    robot::mass_matrix(robot.mechanism, robot.data, robot.q, M);
    const double V = 0.5 * s.dot(M * s) + e.dot(Lambda.cwiseProduct(K_s).cwiseProduct(e));
    const double rate = -de.dot(K_s.cwiseProduct(de)) - e.dot(Lambda.cwiseProduct(K_s).cwiseProduct(Lambda).cwiseProduct(e));
    if (t > 1.5 * h) {
      // The balance holds except for the sampling of the controller.
      ASSERT_NEAR((V - V_before) / h, (rate + rate_before) / 2, 5e-3 * V_start) << t;
      ASSERT_TRUE(V < V_before || V < 1e-6 * V_start) << t;
    } else {
      V_start = V;
    }
    V_before = V;
    rate_before = rate;
  });
  EXPECT_LT(V_before, 1e-3 * V_start);
}

TEST(Compliance, TracksAtAMillisecondInBothModes) {
  for (double passivity : {0.0, 1.0}) {
    Controller c;
    RigidRobot robot;
    c["passivity"].setConstant(passivity);
    desire(c, 0);
    robot.q = c["q_d"];
    robot.dq = c["dq_d"];
    c["q"] = robot.q;
    c["dq"] = robot.dq;
    c.initialise();
    double worst = 0;
    close_loop(c, robot, 1e-3, 4000, [&](double) { worst = std::max(worst, (c["q_c"] - robot.q).lpNorm<Eigen::Infinity>()); });
    EXPECT_LT(worst, 2e-5) << "passivity " << passivity;  // error of the torque that is constant for 1 ms, of second order
  }
}

TEST(Compliance, LinkStaysOnTheCompliantMotionWhileAnExternalTorquePushesIt) {
  Controller c;
  RigidRobot robot;
  desire(c, 0);
  robot.q = c["q_d"];
  robot.dq = c["dq_d"];
  c["q"] = robot.q;
  c["dq"] = robot.dq;
  c.initialise();
  c["tau_e"] << 12, -7;  // arrives as a jump
  double worst = 0;
  close_loop(c, robot, 1e-3, 3000, [&](double) { worst = std::max(worst, (c["q_c"] - robot.q).lpNorm<Eigen::Infinity>()); });
  EXPECT_LT(worst, 2e-5);
}

TEST(Compliance, NothingJumpsWhenModeGainsOrStiffnessAreSwitched) {
  // Inputs are constant with an error and a deviation, so every change of τ_m is caused by switching.
  const std::vector<std::pair<const char*, double>> switches = {
      {"passivity", 1}, {"omega", 60},  {"zeta", 3},         {"Lambda", 90},   {"K_s", 200},  {"S_a", 600},
      {"D_a", 50},      {"zeta_a", 4},  {"M_a", 3},          {"B", 3},         {"tau_0", -4}, {"link_tau_0", 5},
      {"tau_C", 3},     {"sigma2", 50}, {"link_sigma2", 50}, {"link_tau_C", 3}};
  Controller settled;
  for (const auto& [name, value] : switches) {
    Controller c;
    c.rest_at({0.3, 0.4});
    c["passivity"].setConstant(0.5);  // so that the gains of both modes have an effect
    c["tau_e"] << 5, 5;
    for (int n = 0; n < 200; ++n) c.step();  // still moving
    c["q"] << 0.31, 0.41;
    c.step();
    VectorXd tau = c["tau_m"], q_c = c["q_c"];
    c.step();
    const double unswitched = (c["tau_m"] - tau).norm();
    tau = c["tau_m"], q_c = c["q_c"];
    c[name].setConstant(value);
    double total = 0, largest = 0;
    for (int n = 0; n < 300; ++n) {
      c.step();
      largest = std::max(largest, (c["tau_m"] - tau).norm());
      total += (c["tau_m"] - tau).norm();
      EXPECT_LT((c["q_c"] - q_c).norm(), 2e-3) << name;
      tau = c["tau_m"], q_c = c["q_c"];
    }
    // With 50 ms, one millisecond changes the gains by at most 1 − e^(−1/50) = 2 % of the difference: no jump, but the
    // transition completes.
    EXPECT_LT(largest, 0.06 * total + unswitched) << name;
    EXPECT_GT(total, 0.01) << name;
  }
}

TEST(Compliance, ParametersInForceReachTheTunables) {
  Controller c;
  c.rest_at({0, 0});
  c["S_a"].setConstant(777);
  for (int n = 0; n < 3000; ++n) c.step();
  EXPECT_NEAR(c["S_a_in_force"][0], 777, 1e-9);
  c["transition"].setZero();
  c["S_a"].setConstant(100);
  c.step();
  EXPECT_EQ(c["S_a_in_force"][1], 100);
}

TEST(Compliance, LimitsItsTorqueToTheRobotsAndReportsIt) {
  Controller c;
  c.rest_at({0, 0});
  EXPECT_FALSE(c.saturated());
  EXPECT_EQ(c.variable("warning").strings()[0], "");
  c["q"] << -3, 0;
  c.step();
  EXPECT_TRUE(c.saturated());
  EXPECT_NE(c.variable("warning").strings()[0], "") << "a complete run that was cut reports it";
  EXPECT_EQ(c["tau_m"][0], 150);  // effort of the URDF
  EXPECT_GT(c["tau_excess"][0], 0);
  c["tau_max"].setZero();  // no limit
  c.step();
  EXPECT_FALSE(c.saturated());
  EXPECT_GT(c["tau_m"][0], 150);
}

TEST(Compliance, ElasticJointsAreHeldWhereTheSpringCarriesTheLoad) {
  Controller c;
  RigidRobot robot;
  c["K"] << 10'000, 8'000;
  const Vector2d q(0.2, 0.1);
  c.rest_at(q);
  VectorXd g(2);
  robot::gravity(robot.mechanism, robot.data, q, g);
  EXPECT_NEAR((c["theta_c"] - (q + g.cwiseQuotient(c["K"]))).norm(), 0, 1e-14);  // (2c)
  c["theta"] = c["theta_c"];
  c.step();
  EXPECT_NEAR((c["tau_m"] - g).norm(), 0, 1e-9);
}

TEST(Compliance, OmitsAnExternalTorqueThatDoesNotActOnTheTrackedRobot) {
  // Manual guidance of a stiff robot by its twin (VI-C): the torque moves q_c, but the robot that follows does not measure it.
  Controller pushed, guided;
  std::get<std::span<bool>>(guided.variable("tau_e_acts_on_robot").storage)[0] = false;
  for (Controller* c : {&pushed, &guided}) {
    c->rest_at({0.1, 0.2});
    (*c)["tau_e"] << 4, -3;
    c->step();
  }
  EXPECT_EQ(pushed["q_c"], guided["q_c"]);
  EXPECT_NEAR((guided["tau_id"] - pushed["tau_id"] - pushed["tau_e"]).norm(), 0, 1e-13);
  EXPECT_NEAR((guided["tau_m"] - pushed["tau_m"] - pushed["tau_e"]).norm(), 0, 1e-13);
}

TEST(Compliance, FeedsForwardTheFrictionOfABristleThatKeepsItsTorqueAtRest) {
  Controller c;
  c["tau_C"] << 2, 1;
  c["tau_S"] << 2.5, 1;
  c["v_S"].setConstant(0.05);
  c["sigma0"] << 4000, 2000;
  c["sigma1"] << 3, 3;
  c["sigma2"] << 1, 1;
  c.rest_at({0, 0});
  EXPECT_EQ(c["tau_f"].norm(), 0);
  c["dq_d"] << 0.4, -0.4;
  for (int n = 0; n < 200; ++n) c.step();
  // Steady sliding: the Stribeck term is negligible (e^−64), the bristle carries ±τ_C.
  EXPECT_NEAR(c["tau_f"][0], 2 + 0.4, 1e-9);
  EXPECT_NEAR(c["tau_f"][1], -1 - 0.4, 1e-9);
  c["dq_d"].setZero();
  c.step();
  EXPECT_NEAR(c["tau_f"][0], 2, 1e-9);
  EXPECT_NEAR(c["z"][1], -1.0 / 2000, 1e-12);
}

TEST(Compliance, RefusesParametersWithoutMeaning) {
  for (const char* name : {"M_a", "v_R"}) {
    Controller c;
    c[name][1] = 0;
    try {
      c.initialise();
      FAIL() << name;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(std::string(name) + "[2]: is 0, expected a finite value > 0"), std::string::npos)
          << error.what();
    }
  }
  Controller c;
  c.rest_at({0, 0});
  c["S_a"][0] = -1;  // between two steps
  EXPECT_THROW(c.step(), Error);
  c["S_a"][0] = 1;
  c["passivity"][0] = 1.5;
  EXPECT_THROW(c.step(), Error);
}

}  // namespace
}  // namespace cotwin::compliance::compliance_test
