// Self-motion: the derivative of N against differences, the energy balance, and its failure without the two terms of Ṅ and Ṁ.

#include "models/control/null_space.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <vector>

#include "models/control/goals.h"
#include "tests/models/control/robots.h"
#include "tests/support/allocations.h"

namespace cotwin::control::null_space_test {
namespace {

using namespace testing;

TEST(NullSpace, TakesTheDerivativeOfNFromTheRatesOfTheMassMatrixAndTheJacobians) {
  sweep_robots(0.5, [](Robot& robot, Draw& draw, int& checked) {
    const int n = robot.n;
    if (n < 3) return;
    const int first = draw.integer(1, std::min(4, n - 2));
    const std::vector<int> rows{first, 1};
    const VectorXd q = draw.numbers(n, -2, 2), dq = draw.numbers(n, -1, 1);
    Cascade cascade(n, rows);
    cascade.sigma_0 = 1e-4;
    const auto N_at = [&](const VectorXd& at, MatrixXd& N) {
      robot.fill(cascade.tasks[0], at, dq, 0);
      robot.fill(cascade.tasks[1], at, dq, 1, n / 2);
      ASSERT_TRUE(cascade.decompose(robot.metric(at)));
      N = projector(cascade);
    };
    MatrixXd after(n, n), before(n, n), N(n, n);
    const double h = 1e-5;
    N_at(q + h * dq, after);
    N_at(q - h * dq, before);
    N_at(q, N);
    if (!cascade.exact() || cascade.tasks[0].sigma_min < 0.03 || cascade.tasks[1].sigma_min < 0.03) return;

    NullSpace self_motion(cascade);
    const MatrixXd M = robot.metric(q), dM = robot.metric_rate(q, dq);
    const VectorXd zero = VectorXd::Zero(n);
    self_motion.evaluate(cascade, {dq, M, dM, zero, zero});
    const VectorXd expected = -N * ((after - before) / (2 * h) * dq + 0.5 * M.inverse() * dM * N * dq);
    EXPECT_LT((self_motion.nu - N * dq).norm(), 1e-10 * (1 + N.norm()));
    EXPECT_LT((self_motion.ddq - expected).norm(), 1e-6 * (1 + expected.norm()) * (1 + N.norm()));
    ++checked;
  });
}

TEST(NullSpace, AnAddedAccelerationActsThroughTheProjector) {
  sweep_robots(0.5, [](Robot& robot, Draw& draw, int& checked) {
    const int n = robot.n;
    const VectorXd q = draw.numbers(n, -2, 2), dq = draw.numbers(n, -1, 1), added = draw.numbers(n, -3, 3);
    Cascade cascade(n, {std::min(n, 2)});
    cascade.sigma_0 = 1e-4;
    robot.fill(cascade.tasks[0], q, dq, 0);
    const MatrixXd M = robot.metric(q), dM = robot.metric_rate(q, dq);
    ASSERT_TRUE(cascade.decompose(M));
    if (cascade.tasks[0].sigma_min < 0.03) return;
    const VectorXd gradient = draw.numbers(n, -1, 1), zero = VectorXd::Zero(n);
    const MatrixXd N = projector(cascade);
    NullSpace self_motion(cascade);
    self_motion.evaluate(cascade, {dq, M, dM, gradient, zero, 0, 2});
    const VectorXd without = self_motion.ddq;
    self_motion.evaluate(cascade, {dq, M, dM, gradient, zero, 0, 2, &added});
    EXPECT_LT((self_motion.ddq - without - N * added).norm(), 1e-10 * (1 + N.norm()) * (1 + without.norm()));
    VectorXd v = added;
    cascade.project(v, gradient);
    EXPECT_LT((v - N * (added + M.inverse() * gradient)).norm(), 1e-9 * (1 + N.norm()) * (1 + v.norm()));
    ++checked;
  });
}

struct Balance {
  double start = 0, drift = 0, tip = 0, speed = 0, worst_rise = 0;
};

/// One second of self-motion of the lwr4 by Runge and Kutta with steps of 0.25 ms from the pose of the specification with a
/// speed in the null space: W + V + ∫ k_ν νᵀ M ν dt.
Balance run(double k_nu, bool with_rates, double posture_stiffness) {
  Robot robot("lwr4", 0.05);
  Cascade cascade(7, {6});
  NullSpace self_motion(cascade);
  const VectorXd q_0 = (VectorXd(7) << 0.5, 0.9, 0.3, -1.2, 0.2, 0.8, -0.4).finished();
  const VectorXd K = VectorXd::Constant(7, posture_stiffness), zero = VectorXd::Zero(7);
  double V = 0;
  const std::function<VectorXd(const VectorXd&)> rate = [&](const VectorXd& x) {
    const VectorXd q = x.head(7), dq = x.segment(7, 7);
    VectorXd gradient = zero, ddq(7);
    V = posture(q, q_0, K, gradient);
    robot.fill(cascade.tasks[0], q, dq, 0);
    const MatrixXd M = robot.metric(q);
    const MatrixXd dM = with_rates ? robot.metric_rate(q, dq) : MatrixXd::Zero(7, 7);
    if (!with_rates) cascade.tasks[0].dJ.setZero();
    EXPECT_TRUE(cascade.decompose(M));
    EXPECT_TRUE(cascade.exact());
    cascade.solve(ddq);
    self_motion.evaluate(cascade, {dq, M, dM, gradient, zero, 0, k_nu});
    VectorXd dx(15);
    dx << dq, ddq + self_motion.ddq, self_motion.dissipation;
    return dx;
  };
  VectorXd x = VectorXd::Zero(15);
  x.head(7) = lwr4_pose();
  rate(x);
  x.segment(7, 7) = VectorXd::Unit(7, 2) * 40;
  cascade.project(x.segment(7, 7));
  rate(x);
  Balance balance;
  balance.start = self_motion.energy + V;
  const Eigen::Vector3d tip = robot::forward_kinematics(robot.mechanism, robot.data, x.head(7), robot.frame(6)).p;
  const double h = 0.25e-3;
  for (int i = 0; i < 4000; ++i) {
    const VectorXd k1 = rate(x), k2 = rate(x + h / 2 * k1), k3 = rate(x + h / 2 * k2), k4 = rate(x + h * k3);
    x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    const double before = self_motion.energy + V;
    rate(x);
    balance.drift = std::max(balance.drift, std::abs(self_motion.energy + V + x[14] - balance.start));
    balance.worst_rise = std::max(balance.worst_rise, self_motion.energy + V - before);
  }
  balance.tip = (robot::forward_kinematics(robot.mechanism, robot.data, x.head(7), robot.frame(6)).p - tip).norm();
  balance.speed = self_motion.nu.norm();
  return balance;
}

TEST(NullSpace, KineticAndPotentialEnergyAndTheDampedPartAreConstantTogether) {
  for (const double k_nu : {0.0, 4.0}) {
    const Balance balance = run(k_nu, true, 3);
    EXPECT_GT(balance.start, 4.46);  // J, of the specification
    EXPECT_LT(balance.drift, 1e-10) << k_nu;
    EXPECT_LT(balance.tip, 1e-10);  // the drift of J q̈ + J̇ q̇ = 0, which the task has no feedback against
  }
}

TEST(NullSpace, EnergyIsNotConstantWithoutTheRatesOfMAndN) { EXPECT_GT(run(0, false, 3).drift, 0.08); }

TEST(NullSpace, SelfMotionStopsOnlyWithDamping) {
  EXPECT_GT(run(0, true, 0).speed, 0.3);
  const Balance free = run(0, true, 0), damped = run(20, true, 0);
  EXPECT_LT(damped.speed, 1e-6);
  EXPECT_LT(free.drift, 1e-7);  // W alone
}

// A push at the elbow: at rest N ᵀ(∇V − s τ_e) = 0, and the power s νᵀ τ_e is all that enters.
TEST(NullSpace, YieldsToTorquesThatMoveNoTask) {
  Robot robot("lwr4", 0.05);
  Cascade cascade(7, {6});
  NullSpace self_motion(cascade);
  const VectorXd q_0 = lwr4_pose(), K = VectorXd::Constant(7, 20), zero = VectorXd::Zero(7);
  const Eigen::Vector3d push(0, 15, 0);  // N, at the elbow
  for (const double yield : {0.0, 1.0, 2.0}) {
    VectorXd q = q_0, dq = zero, ddq(7), gradient(7), tau_e(7);
    for (int i = 0; i < 8000; ++i) {
      tau_e = robot.jacobian(q, 3).topRows(3).transpose() * push;
      gradient.setZero();
      posture(q, q_0, K, gradient);
      robot.fill(cascade.tasks[0], q, dq, 0);
      const MatrixXd M = robot.metric(q);
      ASSERT_TRUE(cascade.decompose(M));
      cascade.solve(ddq);
      self_motion.evaluate(cascade, {dq, M, robot.metric_rate(q, dq), gradient, tau_e, yield, 8});
      dq += 1e-3 * (ddq + self_motion.ddq);
      q += 1e-3 * dq;
    }
    const VectorXd balance = gradient - yield * tau_e;
    EXPECT_LT((projector(cascade).transpose() * balance).norm(), 1e-3);
    EXPECT_LT(dq.norm(), 1e-4);
    EXPECT_EQ(yield > 0, (q - q_0).norm() > 0.01) << (q - q_0).norm();
  }
}

TEST(NullSpace, AllocatesNothing) {
  Robot robot("lwr4", 0.05);
  Cascade cascade(7, {6});
  NullSpace self_motion(cascade);
  const VectorXd q = lwr4_pose(), dq = VectorXd::Ones(7), zero = VectorXd::Zero(7);
  robot.fill(cascade.tasks[0], q, dq, 0);
  const MatrixXd M = robot.metric(q), dM = robot.metric_rate(q, dq);
  ASSERT_TRUE(cascade.decompose(M));
  const auto before = cotwin::testing::allocations();
  self_motion.evaluate(cascade, {dq, M, dM, zero, zero, 1, 4});
  EXPECT_EQ(cotwin::testing::allocations() - before, 0U);
}

}  // namespace
}  // namespace cotwin::control::null_space_test
