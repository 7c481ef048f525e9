// Tracking with elastic joints: the closed loop of random robots, drives and gains, linearised and simulated.
#include "components/compliance/joints/tracking.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>

#include "models/robot/dynamics.h"
#include "tests/components/drive_train/elastic_robot.h"

namespace cotwin::compliance::tracking_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using robot::testing::Draw;
using robot::testing::Kind;

using testing::joints;

using testing::decades;

/// A robot with drives and a controller whose reference is constant at q_c.
class ClosedLoop : public testing::ElasticRobot {
 public:
  struct Ranges {
    double K_low, K_high, B_low, B_high, omega_low, omega_high;  // decades
    double rigid;                                                // share of rigid joints
  };

  ClosedLoop(Draw& draw, int joint_count, bool gravity, const Ranges& r)
      : ElasticRobot(robot_of(draw, joint_count, gravity)), q_c(draw.numbers(joint_count, -2, 2)), tracking(model) {
    const auto fill = [&](Joints& values, double low, double high) {
      values.resize(static_cast<std::size_t>(n));
      for (double& value : values) value = decades(draw, low, high);
    };
    fill(K, r.K_low, r.K_high);
    fill(B, r.B_low, r.B_high);
    fill(omega, r.omega_low, r.omega_high);
    fill(zeta, -0.5, 0.7);
    fill(Lambda, r.omega_low, r.omega_high);
    fill(K_s, r.omega_low, r.omega_high);
    fill(shaping, 0, 1.2);
    passivity = draw.integer(0, 2) == 0 ? draw.number(0, 1) : draw.integer(0, 1);
    // K > −2 ∂g/∂q, which the proof assumes.
    for (double& k : K) k += 4.2 * steepest_gravity(draw, q_c, 4 * n);
    for (std::size_t i = 1; i < K.size(); ++i) {
      if (draw.number(0, 1) < r.rigid) K[i] = 0;
    }
    zero = Joints(static_cast<std::size_t>(n), 0.0);
    for (Joints* spring : {&drives.spring_sin, &drives.spring_cos})
      spring->assign(static_cast<std::size_t>(n) * robot::Harmonics::kMost, 0.0);
    reference_q = joints(q_c);
    tracking.start(links, reference(), {zero, zero}, drives);
    theta_c = Eigen::Map<VectorXd>(tracking.theta_c.data(), n);
    tau_m = zero;
  }

  VectorXd torque(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    const Joints at_q = joints(q), at_dq = joints(dq), at_theta = joints(theta), at_dtheta = joints(dtheta);
    const Measured measured{at_q, at_dq, at_theta, at_dtheta};
    tracking.update_error(measured, drives);
    tracking.torque(links, reference(), {zero, zero}, drives, measured, {omega, zeta, Lambda, K_s, shaping, passivity}, 0,
                    tau_m);
    return Eigen::Map<VectorXd>(tau_m.data(), n);
  }

  VectorXd acceleration(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    return accelerations(torque(q, dq, theta, dtheta), VectorXd::Zero(n), q, dq, theta);
  }

  /// ½ q̇ᵀ M q̇ + ½ θ̇ᵀ (B/r) θ̇ + ½ (θ − q)ᵀ K (θ − q) + ½ eᵀ K_P e, without gravity.
  double energy(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    MatrixXd M(n, n);
    robot::mass_matrix(mechanism, data, q_c, M);
    M.diagonal() += Eigen::Map<VectorXd>(B.data(), n);
    const Eigen::Map<VectorXd> w(omega.data(), n), L(Lambda.data(), n), ks(K_s.data(), n);
    VectorXd e(n);
    double sum = robot::kinetic_energy(mechanism, data, q, dq);
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      e[i] = q_c[i] - (elastic(i) ? theta[i] : q[i]);
      const double speed = elastic(i) ? dtheta[i] : dq[i], twist = elastic(i) ? theta[i] - q[i] : 0.0;
      sum += 0.5 * B[k] / (elastic(i) ? shaping[k] : 1) * speed * speed + 0.5 * K[k] * twist * twist;
    }
    const VectorXd we = w.cwiseProduct(e);
    return sum + 0.5 * (1 - passivity) * we.dot(M * we) + 0.5 * passivity * e.dot(ks.cwiseProduct(L).cwiseProduct(e));
  }

  VectorXd q_c, theta_c;
  Joints &K = drives.K, &B = drives.B;
  Joints omega, zeta, Lambda, K_s, shaping;
  double passivity = 0;

 private:
  static robot::RobotModel robot_of(Draw& draw, int n, bool gravity) {
    robot::RobotModel robot = draw.robot(static_cast<Kind>(draw.integer(0, 2)), n);
    if (!gravity) robot.gravity.setZero();
    return robot;
  }
  Reference reference() const { return {reference_q, zero, zero, zero}; }

  Joints zero, reference_q;
  Tracking tracking;
  Joints tau_m;
};

/// The closed loop about its rest as 𝗠 ÿ + 𝗗 ẏ + 𝗞 y = 0, y = (q, θ of the elastic joints), rows of motors divided by
/// `shaping`.
struct Linear {
  MatrixXd M, D, K;
};

Linear linearised(ClosedLoop& c) {
  const int n = c.n;
  std::vector<int> motors;
  for (int i = 0; i < n; ++i) {
    if (c.elastic(i)) motors.push_back(i);
  }
  const int size = n + static_cast<int>(motors.size());
  Linear l{MatrixXd::Zero(size, size), MatrixXd::Zero(size, size), MatrixXd::Zero(size, size)};
  MatrixXd M(n, n);
  robot::mass_matrix(c.mechanism, c.data, c.q_c, M);
  l.M.topLeftCorner(n, n) = M;
  const double step = 1e-4;
  const VectorXd rest = VectorXd::Zero(n);
  for (int column = 0; column < size; ++column) {
    VectorXd dq = rest, dtheta = rest;
    (column < n ? dq[column] : dtheta[motors[static_cast<std::size_t>(column - n)]]) = step;
    const VectorXd by_place =
        (c.torque(c.q_c + dq, rest, c.theta_c + dtheta, rest) - c.torque(c.q_c - dq, rest, c.theta_c - dtheta, rest)) /
        (2 * step);
    const VectorXd by_speed = (c.torque(c.q_c, dq, c.theta_c, dtheta) - c.torque(c.q_c, -dq, c.theta_c, -dtheta)) / (2 * step);
    VectorXd g_low(n), g_high(n);
    robot::gravity(c.mechanism, c.data, c.q_c - dq, g_low);
    robot::gravity(c.mechanism, c.data, c.q_c + dq, g_high);
    l.K.col(column).head(n) = (g_high - g_low) / (2 * step);
    for (int i = 0, m = n; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (!c.elastic(i)) {
        l.M(i, i) += column == i ? c.B[k] : 0;
        l.K(i, column) -= by_place[i];
        l.D(i, column) -= by_speed[i];
        continue;
      }
      const double twist = column < n ? (column == i ? -1.0 : 0.0) : (column == m ? 1.0 : 0.0);  // of θ − q
      l.K(i, column) -= c.K[k] * twist;
      l.K(m, column) = (c.K[k] * twist - by_place[i]) / c.shaping[k];
      l.D(m, column) = -by_speed[i] / c.shaping[k];
      l.M(m, m) = c.B[k] / c.shaping[k];
      ++m;
    }
  }
  return l;
}

Eigen::VectorXcd eigenvalues_of(const Linear& l) {
  const Eigen::Index size = l.M.rows();
  MatrixXd A = MatrixXd::Zero(2 * size, 2 * size);
  A.topRightCorner(size, size).setIdentity();
  const Eigen::LLT<MatrixXd> M(l.M);
  A.bottomLeftCorner(size, size) = -M.solve(l.K);
  A.bottomRightCorner(size, size) = -M.solve(l.D);
  return Eigen::EigenSolver<MatrixXd>(A, false).eigenvalues();
}

TEST(Tracking, OfElasticRobotsIsStableForTenThousandDesignsOfAnyGains) {
  // Coupled arms, light motors, soft and stiff springs, unequal gains over three decades: stiffness and damping matrix of the
  // closed loop are symmetric, the stiffness is positive definite, the damping is not negative, and no eigenvalue has a
  // positive real part.
  Draw draw(20261120);
  for (int round = 0; round < 10'000; ++round) {
    ClosedLoop c(draw, 1 + round % 6, round % 2 == 0, {1.5, 5, -3, 1, -0.5, 2.5, 0.15});
    const Linear l = linearised(c);
    const double scale = l.K.cwiseAbs().maxCoeff(), damping = l.D.cwiseAbs().maxCoeff();
    // Error of differences with 1e-4: third derivatives of g, and rounding of shaping K (θ − q).
    ASSERT_LT((l.K - l.K.transpose()).cwiseAbs().maxCoeff(), 1e-7 * scale) << round;
    ASSERT_LT((l.D - l.D.transpose()).cwiseAbs().maxCoeff(), 1e-7 * damping) << round;
    const MatrixXd K = (l.K + l.K.transpose()) / 2, D = (l.D + l.D.transpose()) / 2;
    ASSERT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(K, Eigen::EigenvaluesOnly).eigenvalues().minCoeff(), -1e-9 * scale)
        << round;
    ASSERT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(D, Eigen::EigenvaluesOnly).eigenvalues().minCoeff(), -1e-9 * damping)
        << round;
    const Eigen::VectorXcd eigenvalues = eigenvalues_of(l);
    ASSERT_LT(eigenvalues.real().maxCoeff(), 1e-9 * eigenvalues.cwiseAbs().maxCoeff()) << round;
  }
}

/// By the classical Runge–Kutta method, with a continuous controller. y = (q, θ, q̇, θ̇).
void integrate(ClosedLoop& c, VectorXd& y, double h, double seconds, const std::function<void(const VectorXd&)>& watch) {
  const int n = c.n;
  const auto rate = [&](const VectorXd& at) {
    VectorXd d(4 * n);
    d.head(2 * n) = at.tail(2 * n);
    d.tail(2 * n) = c.acceleration(at.head(n), at.segment(2 * n, n), at.segment(n, n), at.tail(n));
    return d;
  };
  for (int k = 0; k * h < seconds; ++k) {
    const VectorXd k1 = rate(y), k2 = rate(y + h / 2 * k1), k3 = rate(y + h / 2 * k2), k4 = rate(y + h * k3);
    y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    watch(y);
  }
}

/// A step that resolves the fastest eigenvalue; 0 if that is too fast for a test.
double resolving_step(ClosedLoop& c) {
  const double h = 0.1 / eigenvalues_of(linearised(c)).cwiseAbs().maxCoeff();
  return h > 1e-5 ? std::min(h, 1e-3) : 0.0;
}

TEST(Tracking, OfElasticRobotsLosesEnergyFromAnyStartWithUnequalGains) {
  Draw draw(7);
  for (int moved = 0; moved < 40;) {
    ClosedLoop c(draw, 2 + moved % 3, false, {3, 4, -0.5, 0.5, 0, 1.5, 0.2});
    const double h = resolving_step(c);
    if (h == 0) continue;
    ++moved;
    const int n = c.n;
    VectorXd y(4 * n);
    const VectorXd off = draw.numbers(n, -0.5, 0.5);
    y << c.q_c + off, c.q_c + off, draw.numbers(2 * n, -1, 1);
    y.head(n) += draw.numbers(n, -0.02, 0.02);
    for (int i = 0; i < n; ++i) {
      if (!c.elastic(i)) y[n + i] = y[i], y[3 * n + i] = y[2 * n + i];
    }
    const auto energy = [&](const VectorXd& at) {
      return c.energy(at.head(n), at.segment(2 * n, n), at.segment(n, n), at.tail(n));
    };
    const double start = energy(y);
    double before = start;
    integrate(c, y, h, 0.5, [&](const VectorXd& at) {
      const double now = energy(at);
      ASSERT_LT(now, before + 1e-7 * start) << moved;  // error of the integration
      before = now;
    });
    EXPECT_LT(before, 0.9 * start) << moved;
  }
}

TEST(Tracking, OfElasticRobotsHoldsThemUpInAnyPostureWithWeakUnequalGains) {
  // Gains below the gradient of gravity, from a disturbed start: the arm does not fall.
  Draw draw(11);
  for (int moved = 0; moved < 30;) {
    ClosedLoop c(draw, 2 + moved % 2, true, {3, 4, -0.5, 0.5, -0.5, 1, 0.2});
    const double h = resolving_step(c);
    if (h == 0) continue;
    ++moved;
    const int n = c.n;
    VectorXd y(4 * n);
    const VectorXd off = draw.numbers(n, -0.1, 0.1);
    y << c.q_c + off, c.theta_c + off, VectorXd::Zero(2 * n);
    const auto error = [&](const VectorXd& at) {
      VectorXd e(n);
      for (int i = 0; i < n; ++i) e[i] = c.elastic(i) ? at[n + i] - c.theta_c[i] : at[i] - c.q_c[i];
      return e.norm();
    };
    const double start = error(y);
    double worst = 0;
    integrate(c, y, h, 2, [&](const VectorXd& at) { worst = std::max(worst, error(at)); });
    EXPECT_LT(worst, 5 * start) << moved;
    EXPECT_LT(error(y), start) << moved;
  }
}

}  // namespace
}  // namespace cotwin::compliance::tracking_test
