#include "models/robot/dynamics.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <string>

#include "tests/models/robot/maximal_coordinates.h"
#include "tests/models/robot/random_robots.h"

namespace cotwin::robot::dynamics_test {
namespace {

using namespace testing;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Rounding of sums over at most 14 bodies of up to 5 kg and 8 m reach, about 1e3 in size, with an allowance for cancellation.
constexpr double kRounding = 1e-11;
// Central differences with kStep: curvature of order 1e3 · kStep² and rounding 1e-13 / kStep.
constexpr double kStep = 1e-5;
constexpr double kDifference = 1e-6;

double relative(const MatrixXd& a, const MatrixXd& b) { return (a - b).cwiseAbs().maxCoeff() / (1 + b.cwiseAbs().maxCoeff()); }

/// One robot in one state on one instruction set; all three are in every failure message.
struct Case {
  RobotModel robot;
  Mechanism mechanism;
  Data data;
  int n;
  VectorXd q, dq, ddq;
  std::string what;

  Case(Draw& draw, RobotModel model, const char* isa, const std::string& name)
      : robot(std::move(model)), mechanism(robot, isa), data(mechanism), n(robot.n()), what(name) {
    q = draw.numbers(n, -3, 3);
    dq = draw.numbers(n, -2, 2);
    ddq = draw.numbers(n, -4, 4);
  }
  MatrixXd M(const VectorXd& at) {
    MatrixXd result(n, n);
    mass_matrix(mechanism, data, at, result);
    return result;
  }
  MatrixXd C(const VectorXd& at, const VectorXd& speed) {
    MatrixXd result(n, n);
    coriolis_matrix(mechanism, data, at, speed, result);
    return result;
  }
  VectorXd g(const VectorXd& at) {
    VectorXd result(n);
    gravity(mechanism, data, at, result);
    return result;
  }
  VectorXd tau(const VectorXd& at, const VectorXd& speed, const VectorXd& acceleration) {
    VectorXd result(n);
    inverse_dynamics(mechanism, data, at, speed, acceleration, result);
    return result;
  }
  FrameOnBody frame(int body) const { return on_body(robot.frames[static_cast<std::size_t>(body)]); }
};

/// Calls f for `count` random robots of every kind and size, 1 to 14 joints, on every instruction set.
template <class F>
void sweep(int count, std::uint64_t seed, F f) {
  for (const char* isa : isas()) {
    Draw draw(seed);
    for (int i = 0; i < count; ++i) {
      const Kind kind = static_cast<Kind>(i % 3);
      const int n = i % 5 == 0 ? 7 : i % 5 == 1 ? 6 : draw.integer(1, 14);
      const std::string what = std::string(isa) + ", seed " + std::to_string(seed) + ", robot " + std::to_string(i) +
                               ": kind " + std::to_string(i % 3) + ", " + std::to_string(n) + " joints";
      SCOPED_TRACE(what);
      Case c(draw, draw.robot(kind, n), isa, what);
      f(c, draw);
      if (::testing::Test::HasFailure()) return;
    }
  }
}

TEST(Dynamics, MassMatrixIsThatOfMaximalCoordinatesProjectedOnTheJoints) {
  sweep(2000, 1, [](Case& c, Draw&) {  // (2a): M = J_mcᵀ M*_mc J_mc
    const MatrixXd M = c.M(c.q);
    EXPECT_LT(relative(M, maximal_dynamics(c.robot, c.q).M), kRounding);
    EXPECT_EQ(M, M.transpose());
  });
}

// Column k of M is the torque of q̈ = e_k from rest without gravity, by recursive Newton–Euler. Joints are in any order with
// parents first, and in depth-first order as in a URDF.
TEST(Dynamics, MassMatrixOfLargeTreesHasTheColumnsOfInverseDynamics) {
  for (const char* isa : isas()) {
    Draw draw(11);
    for (int i = 0; i < 120; ++i) {
      const int n = draw.integer(12, 41);
      RobotModel robot = draw.robot(Kind::kTree, n);
      robot.gravity.setZero();
      if (i % 2) draw.order_depth_first(robot);
      Case c(draw, robot, isa, "tree " + std::to_string(i));
      const MatrixXd M = c.M(c.q);
      MatrixXd columns(n, n);
      for (int k = 0; k < n; ++k) columns.col(k) = c.tau(c.q, VectorXd::Zero(n), VectorXd::Unit(n, k));
      ASSERT_LT(relative(M, columns), kRounding) << isa << ", tree " << i;
      ASSERT_EQ(M, M.transpose());
      for (int b = 0; b < n; ++b) {  // zero for joints of different branches
        VectorXd others = M.col(b).head(b);
        for (int a = robot.joints[static_cast<std::size_t>(b)].parent; a >= 0;
             a = robot.joints[static_cast<std::size_t>(a)].parent)
          others[a] = 0;
        ASSERT_TRUE(others.isZero(0)) << "column " << b;
      }
    }
  }
}

// A mobile robot: its position in the plane, far from the origin, has no influence on M; moments are not about the origin.
TEST(Dynamics, MassMatrixKeepsItsAccuracyFarFromTheBase) {
  for (const char* isa : isas()) {
    Draw draw(12);
    RobotModel robot = draw.robot(Kind::kTree, 14);
    for (std::size_t j = 0; j < 14; ++j) {
      robot.joints[j].parent = j < 4 ? static_cast<int>(j) - 1 : robot.joints[j].parent < 3 ? 3 : robot.joints[j].parent;
      robot.joints[j].type = j < 2 ? JointType::kPrismatic : JointType::kRevolute;
    }
    robot.joints[0].X_PJ.R.setIdentity();
    robot.joints[1].X_PJ.R.setIdentity();
    robot.joints[0].axis = Eigen::Vector3d::UnitX();
    robot.joints[1].axis = Eigen::Vector3d::UnitY();
    Case c(draw, robot, isa, "mobile robot");
    VectorXd far = c.q;
    far[0] += 8192;
    far[1] -= 4096;
    EXPECT_LT((c.M(far) - c.M(c.q)).cwiseAbs().maxCoeff(), 1e-11 * c.M(c.q).cwiseAbs().maxCoeff()) << isa;
  }
}

TEST(Dynamics, GravityTorqueAndPotentialEnergyAreThoseOfMaximalCoordinates) {
  sweep(2000, 2, [](Case& c, Draw&) {
    const MaximalDynamics expected = maximal_dynamics(c.robot, c.q);
    EXPECT_LT(relative(c.g(c.q), expected.g), kRounding);
    EXPECT_NEAR(potential_energy(c.mechanism, c.data, c.q), expected.U, kRounding * (1 + std::abs(expected.U)));
  });
}

TEST(Dynamics, InverseDynamicsIsMassTimesAccelerationPlusCoriolisPlusGravity) {
  sweep(2000, 3, [](Case& c, Draw&) {
    const VectorXd expected = c.M(c.q) * c.ddq + c.C(c.q, c.dq) * c.dq + c.g(c.q);  // (2a)
    EXPECT_LT(relative(c.tau(c.q, c.dq, c.ddq), expected), kRounding);
    VectorXd h(c.n), h_pass(c.n);
    MatrixXd M(c.n, c.n);
    bias(c.mechanism, c.data, c.q, c.dq, h);
    EXPECT_LT(relative(h, c.C(c.q, c.dq) * c.dq + c.g(c.q)), kRounding);
    mass_matrix_and_bias(c.mechanism, c.data, c.q, c.dq, M, h_pass);
    EXPECT_LT(relative(M, c.M(c.q)), kRounding);  // not equal: the compiler fuses the two passes' products and sums differently
    EXPECT_LT(relative(h_pass, h), kRounding);
  });
}

TEST(Dynamics, RateOfTheMassMatrixIsTheSymmetricPartOfTwiceTheCoriolisMatrix) {
  sweep(1000, 4, [](Case& c, Draw&) {  // [21]: Ṁ − 2C is skew-symmetric, hence Ṁ = C + Cᵀ
    const MatrixXd dM = (c.M(c.q + kStep * c.dq) - c.M(c.q - kStep * c.dq)) / (2 * kStep);
    const MatrixXd C = c.C(c.q, c.dq);
    EXPECT_LT(relative(C + C.transpose(), dM), kDifference);
  });
}

TEST(Dynamics, CoriolisMatrixIsThatOfTheChristoffelSymbols) {
  sweep(300, 5, [](Case& c, Draw&) {  // c_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i)
    std::vector<MatrixXd> dM;
    for (int k = 0; k < c.n; ++k) {
      const VectorXd step = kStep * VectorXd::Unit(c.n, k);
      dM.push_back((c.M(c.q + step) - c.M(c.q - step)) / (2 * kStep));
    }
    MatrixXd C = MatrixXd::Zero(c.n, c.n);
    for (int i = 0; i < c.n; ++i)
      for (int j = 0; j < c.n; ++j)
        for (int k = 0; k < c.n; ++k) {
          const auto at = [&](int a, int b, int d) { return dM[static_cast<std::size_t>(d)](a, b); };
          C(i, j) += 0.5 * (at(i, j, k) + at(i, k, j) - at(j, k, i)) * c.dq[k];
        }
    EXPECT_LT(relative(c.C(c.q, c.dq), C), kDifference);
  });
}

TEST(Dynamics, ForwardDynamicsUndoesInverseDynamics) {
  sweep(2000, 6, [](Case& c, Draw&) {
    const MatrixXd M = c.M(c.q);
    VectorXd ddq(c.n);
    forward_dynamics(c.mechanism, c.data, c.q, c.dq, c.tau(c.q, c.dq, c.ddq), ddq);
    const Eigen::SelfAdjointEigenSolver<MatrixXd> modes(M);
    const double condition = modes.eigenvalues().maxCoeff() / modes.eigenvalues().minCoeff();
    EXPECT_LT(relative(ddq, c.ddq), 1e-13 * condition + kRounding);
    EXPECT_LT(relative(c.tau(c.q, c.dq, ddq), c.tau(c.q, c.dq, c.ddq)), 10 * kRounding);
  });
}

TEST(Dynamics, ForwardDynamicsHoldsWhereTheArmIsStretched) {
  for (const char* isa : isas()) {  // a kinematic singularity is not a singularity of M
    Draw draw(7);
    for (int n = 1; n <= 12; ++n) {
      RobotModel arm = draw.robot(Kind::kChain, n);
      for (Joint& joint : arm.joints)
        joint.X_PJ = {Eigen::Matrix3d::Identity(), {0.3, 0, 0}}, joint.axis = Eigen::Vector3d::UnitY();
      Case c(draw, arm, isa, "stretched arm");
      c.q.setZero();
      VectorXd ddq(n);
      forward_dynamics(c.mechanism, c.data, c.q, c.dq, c.tau(c.q, c.dq, c.ddq), ddq);
      EXPECT_LT(relative(ddq, c.ddq), 1e-8) << n << " joints, " << isa;
    }
  }
}

TEST(Dynamics, DerivativesOfInverseDynamicsAreTheCentralDifferences) {
  sweep(600, 8, [](Case& c, Draw&) {
    MatrixXd by_q(c.n, c.n), by_dq(c.n, c.n), difference_q(c.n, c.n), difference_dq(c.n, c.n);
    inverse_dynamics_derivatives(c.mechanism, c.data, c.q, c.dq, c.ddq, by_q, by_dq);
    for (int k = 0; k < c.n; ++k) {
      const VectorXd step = kStep * VectorXd::Unit(c.n, k);
      difference_q.col(k) = (c.tau(c.q + step, c.dq, c.ddq) - c.tau(c.q - step, c.dq, c.ddq)) / (2 * kStep);
      difference_dq.col(k) = (c.tau(c.q, c.dq + step, c.ddq) - c.tau(c.q, c.dq - step, c.ddq)) / (2 * kStep);
    }
    EXPECT_LT(relative(by_q, difference_q), kDifference);
    EXPECT_LT(relative(by_dq, difference_dq), kDifference);
  });
}

TEST(Dynamics, RegressorTimesParametersIsTheTorqueForAnyParameters) {
  sweep(1500, 9, [](Case& c, Draw& draw) {
    MatrixXd Y(c.n, 10 * c.n);
    regressor(c.mechanism, c.data, c.q, c.dq, c.ddq, Y);
    VectorXd pi(10 * c.n);
    for (int i = 0; i < c.n; ++i) {
      c.robot.bodies[static_cast<std::size_t>(i)].inertia = draw.inertia();  // Y does not depend on them
      pi.segment<10>(10 * i) = c.robot.bodies[static_cast<std::size_t>(i)].inertia.parameters();
    }
    c.mechanism.update(c.robot);
    EXPECT_LT(relative(Y * pi, c.tau(c.q, c.dq, c.ddq)), kRounding);
  });
}

TEST(Dynamics, UpdatedMechanismIsTheOneMadeAnew) {
  sweep(300, 10, [](Case& c, Draw& draw) {
    for (Body& body : c.robot.bodies) body.inertia = draw.inertia();
    c.robot.gravity = 3.7 * draw.direction();
    c.mechanism.update(c.robot);
    Mechanism anew(c.robot, c.what.substr(0, 9).c_str());
    VectorXd tau(c.n);
    inverse_dynamics(anew, c.data, c.q, c.dq, c.ddq, tau);
    EXPECT_EQ(tau, c.tau(c.q, c.dq, c.ddq));
  });
}

TEST(Dynamics, PosesAndJacobiansAreThoseOfTheModelsOwnFrames) {
  sweep(800, 11, [](Case& c, Draw&) {
    MatrixXd J(6, c.n);
    for (int body = -1; body < c.n; ++body) {
      const FrameOnBody frame = body < 0 ? FrameOnBody{-1, c.frame(0).X_BF} : c.frame(body);
      const Pose expected = body_pose(c.robot, c.q, body) * frame.X_BF;
      for (const Pose& X :
           {forward_kinematics(c.mechanism, c.data, c.q, frame), jacobian(c.mechanism, c.data, c.q, frame, J)}) {
        EXPECT_LT((X.R - expected.R).cwiseAbs().maxCoeff(), 1e-14);
        EXPECT_LT((X.p - expected.p).cwiseAbs().maxCoeff(), 1e-14 * (1 + c.n));
      }
      EXPECT_LT(relative(J, point_jacobian(c.robot, c.q, body, expected.p)), 1e-14 * (1 + c.n));
    }
  });
}

TEST(Dynamics, JacobianIsTheRateOfThePose) {
  sweep(300, 12, [](Case& c, Draw&) {
    MatrixXd J(6, c.n);
    const FrameOnBody frame = c.frame(c.n - 1);
    const Pose X = jacobian(c.mechanism, c.data, c.q, frame, J);
    const Pose after = forward_kinematics(c.mechanism, c.data, c.q + kStep * c.dq, frame);
    const Pose before = forward_kinematics(c.mechanism, c.data, c.q - kStep * c.dq, frame);
    const Eigen::Matrix3d w = (after.R - before.R) * X.R.transpose() / (2 * kStep);  // Ṙ Rᵀ = [w]×
    Twist V;
    V << (after.p - before.p) / (2 * kStep), w(2, 1), w(0, 2), w(1, 0);
    EXPECT_LT(relative(J * c.dq, V), kDifference);
  });
}

TEST(Dynamics, JacobianRateTimesSpeedIsItsFiniteDifference) {
  sweep(300, 13, [](Case& c, Draw&) {
    for (int body = 0; body < c.n; ++body) {
      MatrixXd after(6, c.n), before(6, c.n);
      jacobian(c.mechanism, c.data, c.q + kStep * c.dq, c.frame(body), after);
      jacobian(c.mechanism, c.data, c.q - kStep * c.dq, c.frame(body), before);
      Twist a;
      jacobian_dot_times_dq(c.mechanism, c.data, c.q, c.dq, c.frame(body), a);
      EXPECT_LT(relative(a, (after - before) * c.dq / (2 * kStep)), kDifference);
    }
    Twist a;
    jacobian_dot_times_dq(c.mechanism, c.data, c.q, c.dq, {-1, c.frame(0).X_BF}, a);
    EXPECT_TRUE(a.isZero(0));
  });
}

TEST(Dynamics, JacobianRateIsTheFiniteDifferenceOfEachColumn) {
  sweep(300, 15, [](Case& c, Draw&) {
    MatrixXd after(6, c.n), before(6, c.n), J(6, c.n), dJ(6, c.n), alone(6, c.n);
    for (int body = 0; body < c.n; ++body) {
      jacobian(c.mechanism, c.data, c.q + kStep * c.dq, c.frame(body), after);
      jacobian(c.mechanism, c.data, c.q - kStep * c.dq, c.frame(body), before);
      const Pose X = jacobian(c.mechanism, c.data, c.q, c.dq, c.frame(body), J, dJ);
      EXPECT_EQ(X.p, jacobian(c.mechanism, c.data, c.q, c.frame(body), alone).p);
      EXPECT_EQ(J, alone);
      EXPECT_LT(relative(dJ, (after - before) / (2 * kStep)), kDifference);
    }
  });
}

TEST(Dynamics, KineticEnergyIsTheQuadraticFormOfTheMassMatrix) {
  sweep(500, 15, [](Case& c, Draw&) {
    const double expected = 0.5 * c.dq.dot(c.M(c.q) * c.dq);
    EXPECT_NEAR(kinetic_energy(c.mechanism, c.data, c.q, c.dq), expected, kRounding * (1 + expected));
  });
}

TEST(Dynamics, ManyJointsWork) {
  for (const char* isa : isas())
    for (const Kind kind : {Kind::kChain, Kind::kMixedChain, Kind::kTree})
      for (const int n : {63, 64, 65, 100}) {
        SCOPED_TRACE(std::string(isa) + ", " + std::to_string(n) + " joints");
        Draw draw(16);
        RobotModel robot = draw.robot(kind, n);
        for (Joint& joint : robot.joints) joint.X_PJ.p *= 0.1;
        Case c(draw, robot, isa, "");
        const MaximalDynamics expected = maximal_dynamics(c.robot, c.q);
        EXPECT_LT(relative(c.M(c.q), expected.M), 1e-10);
        EXPECT_LT(relative(c.g(c.q), expected.g), 1e-10);
        EXPECT_LT(relative(c.tau(c.q, c.dq, c.ddq), c.M(c.q) * c.ddq + c.C(c.q, c.dq) * c.dq + c.g(c.q)), 1e-10);
        VectorXd ddq(n);
        forward_dynamics(c.mechanism, c.data, c.q, c.dq, c.tau(c.q, c.dq, c.ddq), ddq);
        EXPECT_LT(relative(c.tau(c.q, c.dq, ddq), c.tau(c.q, c.dq, c.ddq)), 1e-9);
        MatrixXd Y(n, 10 * n);
        VectorXd pi(10 * n);
        for (int i = 0; i < n; ++i) pi.segment<10>(10 * i) = c.robot.bodies[static_cast<std::size_t>(i)].inertia.parameters();
        regressor(c.mechanism, c.data, c.q, c.dq, c.ddq, Y);
        EXPECT_LT(relative(Y * pi, c.tau(c.q, c.dq, c.ddq)), 1e-10);
      }
}

TEST(Dynamics, ARobotWithoutJointsHasNothingToCompute) {
  for (const char* isa : isas()) {
    Draw draw(17);
    Case c(draw, draw.robot(Kind::kChain, 0), isa, isa);
    MatrixXd M(0, 0), J(6, 0);
    VectorXd tau(0);
    inverse_dynamics(c.mechanism, c.data, c.q, c.dq, c.ddq, tau);
    forward_dynamics(c.mechanism, c.data, c.q, c.dq, tau, c.ddq);
    mass_matrix(c.mechanism, c.data, c.q, M);
    const Pose X_BF{Eigen::Matrix3d::Identity(), {1, 2, 3}};
    EXPECT_EQ(jacobian(c.mechanism, c.data, c.q, {-1, X_BF}, J), X_BF);
    EXPECT_EQ(kinetic_energy(c.mechanism, c.data, c.q, c.dq), 0);
    EXPECT_EQ(potential_energy(c.mechanism, c.data, c.q), 0);
  }
}

TEST(Dynamics, ADoublePendulumMovesByItsTextbookEquations) {
  // Two point masses at the ends of massless rods, turning about −y in the plane x, −z, angles from the plumb line:
  //   τ_1 = (m_1 + m_2) l_1² q̈_1 + m_2 l_2² (q̈_1 + q̈_2) + m_2 l_1 l_2 (cos q_2 (2 q̈_1 + q̈_2) − sin q_2 (2 q̇_1 q̇_2 + q̇_2²)) +
  //   g_1 …
  const double m1 = 1.3, m2 = 0.7, l1 = 0.5, l2 = 0.8, g0 = 9.81;
  RobotModel pendulum;
  for (int i = 0; i < 2; ++i) {
    Joint joint;
    joint.parent = i - 1;
    joint.axis = -Eigen::Vector3d::UnitY();
    if (i == 1) joint.X_PJ.p = {0, 0, -l1};
    pendulum.joints.push_back(joint);
    Body body;
    body.inertia.mass = i ? m2 : m1;
    body.inertia.p_LC = {0, 0, -(i ? l2 : l1)};
    pendulum.bodies.push_back(body);
    pendulum.frames.push_back({"end", i, {}});
  }
  for (const char* isa : isas()) {
    Draw draw(18);
    Case c(draw, pendulum, isa, isa);
    for (int i = 0; i < 1000; ++i) {
      const VectorXd q = draw.numbers(2, -3, 3), dq = draw.numbers(2, -4, 4), ddq = draw.numbers(2, -9, 9);
      const double c2 = std::cos(q[1]), s2 = std::sin(q[1]), s1 = std::sin(q[0]), s12 = std::sin(q[0] + q[1]);
      const double tau1 = (m1 + m2) * l1 * l1 * ddq[0] + m2 * l2 * l2 * (ddq[0] + ddq[1]) +
                          m2 * l1 * l2 * (c2 * (2 * ddq[0] + ddq[1]) - s2 * (2 * dq[0] * dq[1] + dq[1] * dq[1])) +
                          (m1 + m2) * g0 * l1 * s1 + m2 * g0 * l2 * s12;
      const double tau2 =
          m2 * l2 * l2 * (ddq[0] + ddq[1]) + m2 * l1 * l2 * (c2 * ddq[0] + s2 * dq[0] * dq[0]) + m2 * g0 * l2 * s12;
      const VectorXd tau = c.tau(q, dq, ddq);
      EXPECT_NEAR(tau[0], tau1, 1e-12) << isa << ", state " << i;
      EXPECT_NEAR(tau[1], tau2, 1e-12) << isa << ", state " << i;
    }
  }
}

TEST(Dynamics, EnergyOfAFreeArmIsKeptToTheOrderOfTheIntegrator) {
  // Kutta's method of order 4 loses energy of order h⁴ (its trajectory error), h⁵ if the error is a pure phase error.
  for (const char* isa : isas()) {
    Draw draw(19);
    for (const int n : {2, 3, 6, 7}) {
      for (const Kind kind : {Kind::kChain, Kind::kTree}) {
        RobotModel arm = draw.robot(kind, n);
        for (Body& body : arm.bodies) body.inertia.I_CC += 0.05 * Eigen::Matrix3d::Identity();
        for (Joint& joint : arm.joints) joint.type = JointType::kRevolute;
        Case c(draw, arm, isa, isa);
        const VectorXd zero = VectorXd::Zero(n);
        const auto energy = [&](const VectorXd& q, const VectorXd& dq) {
          return kinetic_energy(c.mechanism, c.data, q, dq) + potential_energy(c.mechanism, c.data, q);
        };
        const auto drift = [&](double h) {
          VectorXd q = c.q, dq = 0.5 * c.dq;
          const double start = energy(q, dq);
          const auto acceleration = [&](const VectorXd& at, const VectorXd& speed) {
            VectorXd ddq(n);
            forward_dynamics(c.mechanism, c.data, at, speed, zero, ddq);
            return ddq;
          };
          double worst = 0;
          for (int i = 0; i < static_cast<int>(std::lround(0.4 / h)); ++i) {
            const VectorXd a1 = acceleration(q, dq), v2 = dq + h / 2 * a1, a2 = acceleration(q + h / 2 * dq, v2);
            const VectorXd v3 = dq + h / 2 * a2, a3 = acceleration(q + h / 2 * v2, v3);
            const VectorXd v4 = dq + h * a3, a4 = acceleration(q + h * v3, v4);
            q += h / 6 * (dq + 2 * v2 + 2 * v3 + v4);
            dq += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
            worst = std::max(worst, std::abs(energy(q, dq) - start));
          }
          return worst / (1 + std::abs(start));
        };
        const double coarse = drift(5e-4), fine = drift(2.5e-4);
        EXPECT_LT(coarse, 1e-5) << n << " joints, " << isa;
        EXPECT_LT(fine, coarse / 10 + 1e-12) << n << " joints, " << isa;
      }
    }
  }
}

TEST(Dynamics, ATurnOfTheWholeRobotWithGravityChangesNoTorque) {
  sweep(500, 20, [](Case& c, Draw& draw) {
    RobotModel turned = c.robot;
    const Pose X = draw.pose(2);
    for (Joint& joint : turned.joints)
      if (joint.parent < 0) joint.X_PJ = X * joint.X_PJ;
    turned.gravity = X.R * c.robot.gravity;
    const Mechanism mechanism(turned, c.what.substr(0, 9).c_str());
    VectorXd tau(c.n);
    inverse_dynamics(mechanism, c.data, c.q, c.dq, c.ddq, tau);
    EXPECT_LT(relative(tau, c.tau(c.q, c.dq, c.ddq)), kRounding);
  });
}

TEST(Dynamics, NearlyParallelAxesAreNoSpecialCase) {
  // Calibrated robots have axes parallel to 1e-4 … 1e-9 rad, whose common normal is far away: a frame must not be placed there.
  for (const char* isa : isas()) {
    Draw draw(21);
    for (const double tilt : {1e-3, 1e-5, 1e-8, 1e-12, 1e-16, 0.0}) {
      RobotModel arm = draw.robot(Kind::kChain, 7);
      for (Joint& joint : arm.joints) {
        joint.axis = Eigen::Vector3d(tilt * draw.number(-1, 1), tilt * draw.number(-1, 1), 1).normalized();
        joint.X_PJ.R = rotation_from_rpy(tilt * draw.number(-1, 1), tilt * draw.number(-1, 1), draw.number(-3, 3));
      }
      Case c(draw, arm, isa, "");
      const MaximalDynamics expected = maximal_dynamics(c.robot, c.q);
      EXPECT_LT(relative(c.M(c.q), expected.M), kRounding) << isa << ", tilt " << tilt;
      EXPECT_LT(relative(c.g(c.q), expected.g), kRounding) << isa << ", tilt " << tilt;
    }
  }
}

}  // namespace
}  // namespace cotwin::robot::dynamics_test
