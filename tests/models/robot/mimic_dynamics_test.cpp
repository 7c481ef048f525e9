// Dynamics of robots with mimic joints, against those of the robot with all joints free, closed forms and differences.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/maximal_coordinates.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"

namespace cotwin::robot::mimic_dynamics_test {
namespace {

using namespace testing;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRounding = 1e-11;   // of sums over at most 14 bodies, about 1e3 in size
constexpr double kStep = 1e-5;        // of central differences
constexpr double kDifference = 1e-6;  // their error: curvature 1e3 · kStep² and rounding 1e-13 / kStep

double relative(const MatrixXd& a, const MatrixXd& b) { return (a - b).cwiseAbs().maxCoeff() / (1 + b.cwiseAbs().maxCoeff()); }

template <class F>
void sweep(int count, F f) {
  for (const char* isa : isas()) {
    Draw draw(11);
    for (int i = 0; i < count; ++i) {
      SCOPED_TRACE(std::string(isa) + ", robot " + std::to_string(i));
      const MimicPair pair = random_pair(draw, draw.integer(1, 12));
      const Mechanism mechanism(pair.robot, isa);
      Data data(mechanism);
      const int n = pair.robot.n();
      ASSERT_EQ(mechanism.n(), n);
      f(pair, mechanism, data, draw.numbers(n, -2, 2), draw.numbers(n, -2, 2), draw.numbers(n, -3, 3), draw);
      if (::testing::Test::HasFailure()) return;
    }
  }
}

TEST(MimicDynamics, IsThatOfAllJointsProjectedOnTheMotionOfTheGroups) {
  sweep(60, [](const MimicPair& pair, const Mechanism& mechanism, Data& data, const VectorXd& q, const VectorXd& dq,
               const VectorXd& ddq, Draw& draw) {
    const int n = pair.robot.n();
    const VectorXd at = pair.G * q + pair.g_0;
    const MaximalDynamics second = maximal_dynamics(pair.all, at);  // from poses and Jacobians, without recursion
    MatrixXd M(n, n), C(n, n);
    VectorXd g(n), h(n), tau(n), back(n);
    mass_matrix(mechanism, data, q, M);
    gravity(mechanism, data, q, g);
    EXPECT_LT(relative(M, pair.G.transpose() * second.M * pair.G), kRounding);
    EXPECT_LT(relative(g, pair.G.transpose() * second.g), kRounding);
    EXPECT_LT(relative(VectorXd::Constant(1, potential_energy(mechanism, data, q)), VectorXd::Constant(1, second.U)),
              kRounding);
    EXPECT_NEAR(kinetic_energy(mechanism, data, q, dq), 0.5 * dq.dot(M * dq), kRounding * (1 + dq.dot(M * dq)));

    coriolis_matrix(mechanism, data, q, dq, C);
    inverse_dynamics(mechanism, data, q, dq, ddq, tau);
    EXPECT_LT(relative(tau, M * ddq + C * dq + g), kRounding);
    bias(mechanism, data, q, dq, h);
    EXPECT_LT(relative(h, C * dq + g), kRounding);
    MatrixXd M_again(n, n);
    VectorXd h_again(n);
    mass_matrix_and_bias(mechanism, data, q, dq, M_again, h_again);
    EXPECT_LT(relative(M_again, M), kRounding);
    EXPECT_LT(relative(h_again, h), kRounding);
    forward_dynamics(mechanism, data, q, dq, tau, back);
    EXPECT_LT((M * (back - ddq)).norm(), 1e-9 * (1 + (M * ddq).norm() + h.norm()));

    const FrameOnBody frame = on_body(pair.robot.frames[static_cast<std::size_t>(draw.integer(0, pair.all.n() - 1))]);
    const int body = pair.free[static_cast<std::size_t>(frame.body)];
    MatrixXd J(6, n);
    const Pose X = jacobian(mechanism, data, q, frame, J);
    const Pose expected = body_pose(pair.all, at, body) * frame.X_BF;
    EXPECT_LT(relative(X.R, expected.R) + relative(X.p, expected.p), kRounding);
    EXPECT_TRUE(X == forward_kinematics(mechanism, data, q, frame));
    EXPECT_LT(relative(J, point_jacobian(pair.all, at, body, expected.p) * pair.G), kRounding);

    VectorXd pi(10 * pair.robot.body_count());
    for (int b = 0; b < pair.robot.body_count(); ++b)
      pi.segment<10>(10 * b) = pair.robot.bodies[static_cast<std::size_t>(b)].inertia.parameters();
    MatrixXd Y(n, pi.size());
    regressor(mechanism, data, q, dq, ddq, Y);
    EXPECT_LT(relative(Y * pi, tau), kRounding);
  });
}

TEST(MimicDynamics, ObeysLagrangesEquations) {
  sweep(25, [](const MimicPair& pair, const Mechanism& mechanism, Data& data, const VectorXd& q, const VectorXd& dq,
               const VectorXd&, Draw&) {
    // τ(q̈ = 0) = d/dt ∂T/∂q̇ − ∂T/∂q + ∂U/∂q with differences of the energies
    const int n = pair.robot.n();
    VectorXd h(n), expected(n);
    bias(mechanism, data, q, dq, h);
    MatrixXd before(n, n), after(n, n);
    mass_matrix(mechanism, data, q - kStep * dq, before);
    mass_matrix(mechanism, data, q + kStep * dq, after);
    expected = (after - before) / (2 * kStep) * dq;
    const auto lagrangian = [&](const VectorXd& at) {
      return kinetic_energy(mechanism, data, at, dq) - potential_energy(mechanism, data, at);
    };
    for (int i = 0; i < n; ++i) {
      const VectorXd e = kStep * VectorXd::Unit(n, i);
      expected[i] -= (lagrangian(q + e) - lagrangian(q - e)) / (2 * kStep);
    }
    EXPECT_LT(relative(h, expected), kDifference);
  });
}

TEST(MimicDynamics, DerivativesAgreeWithDifferences) {
  sweep(25, [](const MimicPair& pair, const Mechanism& mechanism, Data& data, const VectorXd& q, const VectorXd& dq,
               const VectorXd& ddq, Draw&) {
    const int n = pair.robot.n();
    MatrixXd by_q(n, n), by_dq(n, n);
    VectorXd low(n), high(n);
    inverse_dynamics_derivatives(mechanism, data, q, dq, ddq, by_q, by_dq);
    for (int i = 0; i < n; ++i) {
      const VectorXd e = kStep * VectorXd::Unit(n, i);
      inverse_dynamics(mechanism, data, q - e, dq, ddq, low);
      inverse_dynamics(mechanism, data, q + e, dq, ddq, high);
      EXPECT_LT(relative(by_q.col(i), (high - low) / (2 * kStep)), kDifference);
      inverse_dynamics(mechanism, data, q, dq - e, ddq, low);
      inverse_dynamics(mechanism, data, q, dq + e, ddq, high);
      EXPECT_LT(relative(by_dq.col(i), (high - low) / (2 * kStep)), kDifference);
    }
    const FrameOnBody frame = on_body(pair.robot.frames.back());
    MatrixXd J_low(6, n), J_high(6, n);
    jacobian(mechanism, data, q - kStep * dq, frame, J_low);
    jacobian(mechanism, data, q + kStep * dq, frame, J_high);
    Twist a;
    jacobian_dot_times_dq(mechanism, data, q, dq, frame, a);
    EXPECT_LT(relative(a, (J_high - J_low) / (2 * kStep) * dq), kDifference);
    MatrixXd J(6, n), dJ(6, n), J_alone(6, n);
    jacobian(mechanism, data, q, dq, frame, J, dJ);
    jacobian(mechanism, data, q, frame, J_alone);
    EXPECT_EQ(J, J_alone);
    EXPECT_LT(relative(dJ, (J_high - J_low) / (2 * kStep)), kDifference);
  });
}

TEST(MimicDynamics, BatchesAgreeWithSingleStatesAndNothingAllocates) {
  sweep(10, [](const MimicPair& pair, const Mechanism& mechanism, Data& data, const VectorXd& q, const VectorXd& dq,
               const VectorXd& ddq, Draw& draw) {
    const int n = pair.robot.n();
    constexpr int kStates = 150;  // more than two of the inner batches, and no multiple of them
    const VectorXd qs = draw.numbers(n * kStates, -2, 2), dqs = draw.numbers(n * kStates, -2, 2),
                   ddqs = draw.numbers(n * kStates, -2, 2);
    VectorXd taus(n * kStates), tau(n), ddq_out(n), h(n);
    MatrixXd M(n, n), by_q(n, n), by_dq(n, n), J(6, n), Y(n, 10 * pair.robot.body_count());
    const FrameOnBody frame = on_body(pair.robot.frames.front());
    const std::uint64_t before = cotwin::testing::allocations();
    inverse_dynamics_batch(mechanism, data, kStates, qs.data(), dqs.data(), ddqs.data(), taus.data());
    mass_matrix_and_bias(mechanism, data, q, dq, M, h);
    inverse_dynamics_derivatives(mechanism, data, q, dq, ddq, by_q, by_dq);
    forward_dynamics(mechanism, data, q, dq, tau, ddq_out);
    regressor(mechanism, data, q, dq, ddq, Y);
    jacobian(mechanism, data, q, frame, J);
    coriolis_matrix(mechanism, data, q, dq, M);
    EXPECT_EQ(cotwin::testing::allocations(), before);
    for (int s = 0; s < kStates; ++s) {
      VectorXd one_q(n), one_dq(n), one_ddq(n);
      for (int j = 0; j < n; ++j) {
        one_q[j] = qs[j * kStates + s];
        one_dq[j] = dqs[j * kStates + s];
        one_ddq[j] = ddqs[j * kStates + s];
      }
      inverse_dynamics(mechanism, data, one_q, one_dq, one_ddq, tau);
      for (int j = 0; j < n; ++j) EXPECT_NEAR(taus[j * kStates + s], tau[j], kRounding * (1 + tau.cwiseAbs().maxCoeff()));
    }
  });
}

/// A hand that lies on its side, with two fingers of 0.2 and 0.3 kg that slide along y = up.
constexpr const char* kGripper = R"(<robot name="gripper"><gravity xyz="0 -10 0"/><link name="hand"/>
<link name="left"><inertial><mass value="0.2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="right"><inertial><mass value="0.3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>
<joint name="follow" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/>
  <limit lower="0" upper="0.1" effort="20" velocity="0.2"/><mimic joint="slide" multiplier="2" offset="0.01"/></joint></robot>)";

TEST(MimicDynamics, OfAParallelGripperHasTheClosedForm) {
  const RobotModel gripper = parse_urdf(kGripper, "gripper.urdf");
  const Mechanism mechanism(gripper);
  Data data(mechanism);
  const VectorXd q = VectorXd::Constant(1, 0.02), dq = VectorXd::Constant(1, 0.3), ddq = VectorXd::Constant(1, 1.5);
  VectorXd tau(1);
  inverse_dynamics(mechanism, data, q, dq, ddq, tau);
  // T = ½ (m_l + 2² m_r) q̇², U = 10 (m_l q − m_r (2 q + 0.01))
  EXPECT_NEAR(tau[0], (0.2 + 4 * 0.3) * 1.5 + 10 * (0.2 - 2 * 0.3), 1e-13);
  EXPECT_NEAR(kinetic_energy(mechanism, data, q, dq), 0.5 * 1.4 * 0.09, 1e-15);
  EXPECT_NEAR(potential_energy(mechanism, data, q), 10 * (0.2 * 0.02 - 0.3 * 0.05), 1e-15);
  EXPECT_NEAR(forward_kinematics(mechanism, data, q, on_body(gripper.frame("right"))).p.y(), -0.05, 1e-16);
}

TEST(MimicDynamics, OfAFingerWhoseTipFollowsItsKnuckleHasTheClosedForm) {
  // Two links of length l in a vertical plane with point masses at their ends, θ_2 = θ_1 + (r θ_1 + c):
  // T = ½ m_1 l² w² + ½ m_2 l² (1 + (1 + r)² + 2 (1 + r) cos θ) w², θ = r θ_1 + c
  constexpr double l = 0.05, m_1 = 0.03, m_2 = 0.02, r = 0.8, c = 0.3, q = 0.4, w = 7, g = 9.81;
  RobotModel finger;
  finger.name = "finger";
  Joint knuckle, tip;
  knuckle.axis = tip.axis = -Eigen::Vector3d::UnitY();  // positive angles lift x
  tip.parent = 0;
  tip.X_PJ.p = {l, 0, 0};
  finger.joints = {knuckle};
  finger.mimics = {{tip, 0, r, c, 1}};
  finger.bodies = {{"proximal", {m_1, {l, 0, 0}, Eigen::Matrix3d::Zero()}},
                   {"distal", {m_2, {l, 0, 0}, Eigen::Matrix3d::Zero()}}};
  const Mechanism mechanism(finger);
  Data data(mechanism);
  const double theta = r * q + c, M = m_1 * l * l + m_2 * l * l * (1 + (1 + r) * (1 + r) + 2 * (1 + r) * std::cos(theta));
  const double dM = -m_2 * l * l * 2 * (1 + r) * std::sin(theta) * r;
  const double dU = g * l * ((m_1 + m_2) * std::cos(q) + m_2 * (1 + r) * std::cos(q + theta));
  VectorXd h(1);
  MatrixXd mass(1, 1);
  mass_matrix_and_bias(mechanism, data, VectorXd::Constant(1, q), VectorXd::Constant(1, w), mass, h);
  EXPECT_NEAR(mass(0, 0), M, 1e-16);
  EXPECT_NEAR(h[0], 0.5 * dM * w * w + dU, 1e-15);
}

TEST(MimicDynamics, ModelsThatAreNoTreeAreRefused) {
  const RobotModel good = parse_urdf(kGripper, "gripper.urdf");
  for (const auto& spoil : {+[](Mimic& m) { m.leader = 1; }, +[](Mimic& m) { m.multiplier = std::nan(""); },
                            +[](Mimic& m) { m.joint.parent = 1; }}) {
    RobotModel bad = good;
    spoil(bad.mimics[0]);
    EXPECT_THROW(Mechanism{bad}, Error);
  }
}

}  // namespace
}  // namespace cotwin::robot::mimic_dynamics_test
