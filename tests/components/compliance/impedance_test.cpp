// The impedance law for elastic joints: integrability of its torques, eigenvalues and motion of closed loops of random robots, in
// contact and free.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>

#include "components/compliance/cartesian/impedance_control.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/drive_train/elastic_robot.h"
#include "tests/support/places.h"

namespace cotwin::compliance::impedance_test {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using robot::testing::Draw;
using robot::testing::Kind;

using testing::decades;
using testing::joints;

/// A symmetric matrix with the given eigenvalues.
Matrix3d symmetric(Draw& draw, double low, double high) {
  const Matrix3d R = draw.rotation();
  const double z = decades(draw, low, high), y = decades(draw, low, high), x = decades(draw, low, high);
  return R * Vector3d(x, y, z).asDiagonal() * R.transpose();
}

std::vector<int> directions_of(int n) {
  std::vector<int> all;
  for (int i = 0; i < std::min(n, 6); ++i) all.push_back(i);
  return all;
}

/// A robot with drives and the impedance law about a desired frame.
class ClosedLoop : public testing::ElasticRobot {
 public:
  struct Ranges {
    double K_low = 3, K_high = 5, B_low = -1, B_high = 1;  // decades
    double rigid = 0.15;                                   // share of rigid joints
    bool gravity = true;
    double ratio = 0.7;  // the largest stiffness ratio ρ
  };

  ClosedLoop(Draw& draw, robot::RobotModel robot, const Ranges& r, const VectorXd& posture = {})
      : ElasticRobot(std::move(robot)),
        q_0(posture.size() > 0 ? posture : draw.numbers(n, -1.5, 1.5)),
        control(model, directions_of(n)) {
    frame_on = robot::on_body(model.end_effector());
    drives = robot::DriveParameters(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      drives.K[k] = i > 0 && draw.number(0, 1) < r.rigid ? 0.0 : decades(draw, r.K_low, r.K_high);
      drives.B[k] = decades(draw, r.B_low, r.B_high);
      shaping.push_back(decades(draw, 0, 1));
      if (elastic(i) && r.gravity) drives.K[k] += 8 * steepest_gravity(draw, q_0, 3 * n);
    }
    zero = Joints(static_cast<std::size_t>(n), 0.0);
    rest_posture = joints(q_0);
    const Pose X = robot::forward_kinematics(mechanism, data, q_0, frame_on);
    spring.desired.p = X.p;
    spring.desired.Q = Eigen::Quaterniond(X.R);
    spring.R_BA = draw.rotation();
    spring.S_T = symmetric(draw, 1, 4);
    spring.K_o = symmetric(draw, 0, 3);
    spring.D_T = symmetric(draw, 0, 2);
    spring.D_R = symmetric(draw, -1, 1);
    spring.zeta_T = draw.number(0, 1);
    spring.zeta_R = draw.number(0, 1);
    spring.omega_free = 2;
    if (draw.integer(0, 1)) spring.potential = Potential::kLog;
    D_n = draw.number(0.1, 5);
    // At rest q̄ = q and τ_J = g(q).
    VectorXd g(n);
    robot::gravity(mechanism, data, q_0, g);
    theta_0 = q_0;
    for (int i = 0; i < n; ++i) {
      if (elastic(i)) theta_0[i] += g[i] / drives.K[static_cast<std::size_t>(i)];
    }
    torque(q_0, zeros(), theta_0, zeros());
    const double factor = r.ratio / std::max(control.stiffness_ratio, r.ratio);
    spring.S_T *= factor;
    spring.K_o *= factor;
  }

  VectorXd zeros() const { return VectorXd::Zero(n); }

  VectorXd torque(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    const Joints at_q = joints(q), at_dq = joints(dq), at_theta = joints(theta), at_dtheta = joints(dtheta);
    Joints tau(static_cast<std::size_t>(n));
    control.torque(links, frame_on, spring, {rest_posture, K_n, D_n}, drives, {at_q, at_dq, at_theta, at_dtheta}, shaping,
                   nullptr, tau);
    return Eigen::Map<VectorXd>(tau.data(), n);
  }
  /// u of τ_m = r u − (r − 1) τ_J.
  VectorXd u(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    VectorXd result = torque(q, dq, theta, dtheta);
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (elastic(i)) result[i] = (result[i] + (shaping[k] - 1) * drives.K[k] * (theta[i] - q[i])) / shaping[k];
    }
    return result;
  }

  /// Force of the environment on the links: K_e (p_e − p) at E, and `push`.
  VectorXd environment(const VectorXd& q) {
    MatrixXd J(6, n);
    const Pose X = robot::jacobian(mechanism, data, q, frame_on, J);
    return J.topRows(3).transpose() * (K_e * (spring.desired.p - X.p)) + J.transpose() * push;
  }

  VectorXd acceleration(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    return accelerations(torque(q, dq, theta, dtheta), environment(q), q, dq, theta);
  }

  /// Energy of links, motors as shaped, gears, environment and the rendered springs at q̄.
  double energy(const VectorXd& q, const VectorXd& dq, const VectorXd& theta, const VectorXd& dtheta) {
    torque(q, dq, theta, dtheta);
    double sum = robot::kinetic_energy(mechanism, data, q, dq) + robot::potential_energy(mechanism, data, q);
    // Of u: −W(q̄) + ½ lᵀ K⁻¹ l, W = springs at q̄ less the weight there; K (θ − q̄) = l.
    sum -= robot::potential_energy(mechanism, data, control.q_bar);
    const Vector3d Delta = spring.R_BA.transpose() * (control.X.p - spring.desired.p);
    sum += 0.5 * Delta.dot(spring.S_T * Delta);
    sum += potential_energy(spring.potential, spring.K_o, spring.desired.Q.conjugate() * Eigen::Quaterniond(control.X.R));
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double twist = theta[i] - q[i], static_twist = theta[i] - control.q_bar[i];
      if (elastic(i)) sum += 0.5 * drives.K[k] * (twist * twist - static_twist * static_twist);
      sum += 0.5 * drives.B[k] / (elastic(i) ? shaping[k] : 1) * (elastic(i) ? dtheta[i] * dtheta[i] : dq[i] * dq[i]);
    }
    const Pose X = robot::forward_kinematics(mechanism, data, q, frame_on);
    return sum + 0.5 * K_e * (spring.desired.p - X.p).squaredNorm();
  }

  VectorXd q_0, theta_0;
  robot::FrameOnBody frame_on;
  Joints shaping, zero, rest_posture;
  ElasticFrame spring;
  ImpedanceControl control;
  double K_n = 0, D_n = 1;
  double K_e = 0;  // N/m
  Wrench push = Wrench::Zero();
};

// Without stiffness in the null space there are eigenvalues 0, which differences of accelerations give to √ε of the largest.
constexpr double kRounding = 1e-5;

/// Eigenvalues of the closed loop about (q_0, θ_0) by differences of the accelerations; y = (q, θ of elastic joints).
Eigen::VectorXcd eigenvalues(ClosedLoop& c) {
  std::vector<int> motors;
  for (int i = 0; i < c.n; ++i) {
    if (c.elastic(i)) motors.push_back(i);
  }
  const int n = c.n, size = n + static_cast<int>(motors.size());
  MatrixXd A = MatrixXd::Zero(2 * size, 2 * size);
  A.topRightCorner(size, size).setIdentity();
  const double step = 1e-5;
  for (int column = 0; column < 2 * size; ++column) {
    const auto at = [&](double s) {
      VectorXd q = c.q_0, theta = c.theta_0, dq = c.zeros(), dtheta = c.zeros();
      const int place = column % size;
      VectorXd& link = column < size ? q : dq;
      VectorXd& motor = column < size ? theta : dtheta;
      (place < n ? link[place] : motor[motors[static_cast<std::size_t>(place - n)]]) += s;
      const VectorXd a = c.acceleration(q, dq, theta, dtheta);
      VectorXd result(size);
      result.head(n) = a.head(n);
      for (int m = n; m < size; ++m) result[m] = a[n + motors[static_cast<std::size_t>(m - n)]];
      return result;
    };
    A.col(column).tail(size) = (at(step) - at(-step)) / (2 * step);
  }
  return Eigen::EigenSolver<MatrixXd>(A, false).eigenvalues();
}

TEST(ImpedanceControl, TorqueOfElasticJointsIsTheGradientOfAPotentialOfTheMotorPositions) {
  // ∂u/∂θ is symmetric in any position, far from the desired pose, too: no cycle of θ gains energy.
  Draw draw(1);
  int solved = 0;
  for (int round = 0; round < 300; ++round) {
    ClosedLoop c(draw, draw.robot(static_cast<Kind>(round % 3), 2 + round % 6), {.K_low = 4, .rigid = 0, .ratio = 0.4});
    c.D_n = 0;
    c.spring.turns_with_tool = round % 2 == 1;
    const VectorXd theta = c.theta_0 + draw.numbers(c.n, -0.3, 0.3);
    MatrixXd slope(c.n, c.n);
    const double step = 1e-5;
    double error = 0;
    for (int k = 0; k < c.n; ++k) {
      const VectorXd way = step * VectorXd::Unit(c.n, k);
      slope.col(k) =
          (c.u(theta, c.zeros(), theta + way, c.zeros()) - c.u(theta, c.zeros(), theta - way, c.zeros())) / (2 * step);
      error = std::max(error, c.control.static_error);
    }
    // Forces of thousands of newtons and their change of direction: the iteration is not contracting everywhere.
    if (error > 1e-9) continue;
    ++solved;
    EXPECT_LT((slope - slope.transpose()).cwiseAbs().maxCoeff(), 1e-5 * slope.cwiseAbs().maxCoeff()) << round;
  }
  EXPECT_GT(solved, 280);
}

TEST(ImpedanceControl, IsStableFreeAndOnAnySpringForThousandsOfDesigns) {
  // Light and heavy motors, soft and stiff gears, rigid joints among them, coupled arms, stiffness in any axes up to 0.7 of what the
  // gears allow; environments from none to steel.
  Draw draw(2);
  for (int round = 0; round < 3000; ++round) {
    ClosedLoop c(draw, draw.robot(static_cast<Kind>(round % 3), 1 + round % 8), {.K_low = 2, .B_low = -2});
    if (round % 3 > 0) c.K_e = decades(draw, 2, 7);
    c.spring.turns_with_tool = round % 4 == 3;
    const Eigen::VectorXcd lambda = eigenvalues(c);
    ASSERT_LT(lambda.real().maxCoeff(), kRounding * lambda.cwiseAbs().maxCoeff()) << round << " K_e " << c.K_e;
  }
}

TEST(ImpedanceControl, GivesEveryModeOfTheCoupledFrameTheRatioOfDamping) {
  Draw draw(7);
  int pairs = 0;
  for (int round = 0; round < 200; ++round) {
    ClosedLoop c(draw, draw.robot(static_cast<Kind>(round % 3), 6 + round % 2), {.rigid = 1});
    std::fill(c.drives.K.begin(), c.drives.K.end(), 0.0);
    c.spring.D_T = c.spring.D_R = Matrix3d::Zero();
    const double zeta = draw.number(0.1, 0.9);
    c.spring.zeta_T = c.spring.zeta_R = zeta;
    c.spring.omega_free = 0;
    const Eigen::VectorXcd lambda = eigenvalues(c);
    if (c.control.sigma_min < 0.05) continue;  // damped J̄
    for (const std::complex<double>& at : lambda) {
      if (at.imag() <= 1e-3 * std::abs(at)) continue;  // the self-motion
      EXPECT_NEAR(-at.real() / std::abs(at), zeta, 1e-3) << round;
      ++pairs;
    }
  }
  EXPECT_GT(pairs, 400);
}

TEST(ImpedanceControl, IsStableOnTheArmsOfTheLibrary) {
  Draw draw(3);
  for (const char* name : {"lwr4", "planar2", "kr300_r2500"}) {
    const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf");
    for (int round = 0; round < 100; ++round) {
      ClosedLoop c(draw, robot, {.K_low = 4, .K_high = 6});
      for (const double K_e : {0.0, 1e4, 1e7}) {
        c.K_e = K_e;
        const Eigen::VectorXcd lambda = eigenvalues(c);
        ASSERT_LT(lambda.real().maxCoeff(), kRounding * lambda.cwiseAbs().maxCoeff()) << name << round << " K_e " << K_e;
      }
    }
  }
}

/// Classical Runge–Kutta with a continuous controller, y = (q, θ, q̇, θ̇).
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

VectorXd started(Draw& draw, ClosedLoop& c, double off, double speed) {
  const int n = c.n;
  VectorXd y(4 * n);
  const VectorXd away = draw.numbers(n, -off, off);
  y << c.q_0 + away, c.theta_0 + away, draw.numbers(2 * n, -speed, speed);
  for (int i = 0; i < n; ++i) {
    if (!c.elastic(i)) y[n + i] = y[i], y[3 * n + i] = y[2 * n + i];
  }
  return y;
}

TEST(ImpedanceControl, LosesEnergyInLargeMotionsFreeAndAgainstSteel) {
  Draw draw(4);
  for (int moved = 0; moved < 24;) {
    ClosedLoop c(draw, draw.robot(static_cast<Kind>(moved % 3), 2 + moved % 6), {.K_low = 3, .K_high = 4, .ratio = 0.2});
    if (moved % 2 == 1) c.K_e = 1e5;
    const double h = 0.05 / eigenvalues(c).cwiseAbs().maxCoeff();
    if (h < 1.5e-5) continue;
    ++moved;
    VectorXd y = started(draw, c, 0.4, 1);
    const auto energy = [&](const VectorXd& at) {
      return c.energy(at.head(c.n), at.segment(2 * c.n, c.n), at.segment(c.n, c.n), at.tail(c.n));
    };
    const double start = energy(y) - energy((VectorXd(4 * c.n) << c.q_0, c.theta_0, c.zeros(), c.zeros()).finished());
    double before = energy(y);
    integrate(c, y, std::min(h, 1e-3), 0.3, [&](const VectorXd& at) {
      const double now = energy(at);
      ASSERT_LT(now, before + 2e-7 * start) << moved;  // error of the integration
      before = now;
    });
  }
}

TEST(ImpedanceControl, RendersTheStiffnessExactlyByTheLinksBehindSoftGears) {
  // At rest q̄ = q, so Jᵀ [S Δ; 2 EᵀK_o ε] = Jᵀ F: the gears' own compliance does not add to that of S.
  Draw draw(5);
  const robot::RobotModel robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const VectorXd posture = (VectorXd(7) << 0, 0.5, 0, -1.4, 0, 0.9, 0).finished();
  for (int round = 0; round < 3; ++round) {
    ClosedLoop c(draw, robot, {.K_low = 4, .K_high = 4.3, .B_low = -0.3, .B_high = 0, .rigid = 0}, posture);
    c.spring.D_T = 40 * Matrix3d::Identity();
    c.spring.D_R = 3 * Matrix3d::Identity();
    c.spring.zeta_T = c.spring.zeta_R = 1;
    c.spring.potential = Potential::kQuaternion;
    c.spring.S_T = 500 * Matrix3d::Identity();
    c.spring.K_o = 50 * Matrix3d::Identity();
    c.D_n = 10;
    c.push << draw.numbers(3, -20, 20), draw.numbers(3, -5, 5);
    VectorXd y(28);
    y << c.q_0, c.theta_0, c.zeros(), c.zeros();
    integrate(c, y, std::min(1e-3, 0.3 / eigenvalues(c).cwiseAbs().maxCoeff()), 2.5, [](const VectorXd&) {});
    const Pose X = robot::forward_kinematics(c.mechanism, c.data, y.head(7), c.frame_on);
    EXPECT_LT((X.p - c.spring.desired.p - c.push.head<3>() / 500).norm(), 1e-3 * c.push.head<3>().norm() / 500) << round;
    const Eigen::AngleAxisd turn(X.R * c.spring.desired.Q.toRotationMatrix().transpose());
    EXPECT_NEAR(turn.angle(), std::asin(c.push.tail<3>().norm() / 50), 1e-3) << round;
  }
}

TEST(ImpedanceControl, IsSofterButStableWhereTheGearsAreSofterThanTheStiffness) {
  Draw draw(6);
  for (int round = 0; round < 300; ++round) {
    ClosedLoop c(draw, draw.robot(static_cast<Kind>(round % 3), 2 + round % 6),
                 {.K_low = 3, .K_high = 4, .gravity = false, .ratio = 1e9});
    c.spring.S_T *= 100;
    if (round % 2 > 0) c.K_e = decades(draw, 2, 7);
    const Eigen::VectorXcd lambda = eigenvalues(c);
    EXPECT_LT(c.control.static_error, 1e-8) << round;
    ASSERT_LT(lambda.real().maxCoeff(), kRounding * lambda.cwiseAbs().maxCoeff())
        << round << " ratio " << c.control.stiffness_ratio;
  }
}

}  // namespace
}  // namespace cotwin::compliance::impedance_test
