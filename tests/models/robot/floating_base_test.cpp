// Free-floating robots against a second formulation from poses and body Jacobians, closed forms, conserved quantities, finite
// differences and published values.

#include "models/robot/floating_base.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/floating_dynamics.h"
#include "tests/models/robot/maximal_coordinates.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::robot::floating_base_test {
namespace {

using namespace testing;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kRounding = 1e-10;

Matrix3d cross_matrix(const Vector3d& v) {
  Matrix3d S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

RobotModel floating_robot(Draw& draw, Kind kind, int n) {
  RobotModel robot = draw.robot(kind, n);
  robot.base.name = "hull";
  robot.base.inertia = draw.inertia();
  robot.base.inertia.mass *= 3;
  robot.base.inertia.I_CC = 10 * Matrix3d(robot.base.inertia.I_CC.selfadjointView<Eigen::Upper>());  // symmetric to the bit
  return robot;
}

struct Case {
  RobotModel robot;
  int n;
  FloatingMechanism mechanism;
  FloatingData data;
  FloatingInertia inertia;
  VectorXd q, dq, ddq, tau;
  Twist V_B;
  Wrench W;
  Vector3d gravity;

  Case(Draw& draw, const RobotModel& model, const char* isa)
      : robot(model),
        n(model.n()),
        mechanism(model, isa),
        data(mechanism),
        inertia(n),
        q(draw.numbers(n, -2, 2)),
        dq(draw.numbers(n, -2, 2)),
        ddq(draw.numbers(n, -2, 2)),
        tau(draw.numbers(n, -5, 5)),
        V_B(draw.numbers(6, -2, 2)),
        W(draw.numbers(6, -5, 5)),
        gravity(draw.numbers(3, -9, 9)) {
    floating_inertia(mechanism, data, q, inertia);
  }
};

template <class F>
void sweep(int count, std::uint64_t seed, F f) {
  for (const char* isa : isas()) {
    Draw draw(seed);
    for (int i = 0; i < count; ++i) {
      const int n = i % 5 == 0 ? 7 : draw.integer(1, 14);
      SCOPED_TRACE(std::string(isa) + ", robot " + std::to_string(i) + ", " + std::to_string(n) + " joints");
      Case c(draw, floating_robot(draw, static_cast<Kind>(i % 3), n), isa);
      f(c, draw);
      if (::testing::Test::HasFailure()) return;
    }
  }
}

double relative(const MatrixXd& a, const MatrixXd& b) { return (a - b).norm() / (1 + b.norm()); }

// Σ over the bodies of m v and c × m v + I ω, with velocities by body Jacobians.
TEST(FloatingBase, MomentumIsTheSumOverTheBodies) {
  sweep(300, 1, [](Case& c, Draw&) {
    Eigen::Matrix<double, 6, 6> I_c = Eigen::Matrix<double, 6, 6>::Zero();
    MatrixXd F = MatrixXd::Zero(6, c.n), M = MatrixXd::Zero(c.n, c.n);
    for (int b = -1; b < c.n; ++b) {
      const Inertia& body = b < 0 ? c.robot.base.inertia : c.robot.bodies[static_cast<std::size_t>(b)].inertia;
      const Pose X = body_pose(c.robot, c.q, b);
      const Vector3d p = X * body.p_LC;
      const Matrix3d I = X.R * body.I_CC * X.R.transpose();
      MatrixXd J = point_jacobian(c.robot, c.q, b, p);
      Eigen::Matrix<double, 6, 6> base;
      base << Matrix3d::Identity(), -cross_matrix(p), Matrix3d::Zero(), Matrix3d::Identity();
      const auto momentum = [&](const MatrixXd& velocity) {
        MatrixXd h(6, velocity.cols());
        h.topRows(3) = body.mass * velocity.topRows(3);
        h.bottomRows(3) = cross_matrix(p) * h.topRows(3) + I * velocity.bottomRows(3);
        return h;
      };
      I_c += momentum(base);
      F += momentum(J);
      M += body.mass * J.topRows(3).transpose() * J.topRows(3) + J.bottomRows(3).transpose() * I * J.bottomRows(3);
    }
    const MatrixXd A = -I_c.lu().solve(F);
    EXPECT_LT(relative(c.inertia.I_c, I_c), kRounding);
    EXPECT_LT(relative(c.inertia.F, F), kRounding);
    EXPECT_LT(relative(c.inertia.M, M), kRounding);
    EXPECT_LT(relative(c.inertia.A, A), kRounding);
    EXPECT_LT(relative(c.inertia.Z(), A.bottomRows(3)), kRounding);
    EXPECT_LT(relative(c.inertia.M_star, M - F.transpose() * I_c.lu().solve(F)), kRounding);
    EXPECT_EQ(c.inertia.M_star, c.inertia.M_star.transpose());
    EXPECT_GT(c.inertia.M_star.llt().matrixL().determinant(), 0);
    const Wrench h = c.inertia.momentum(c.V_B, c.dq);
    EXPECT_LT(relative(h, I_c * c.V_B + F * c.dq), kRounding);
    EXPECT_LT(relative(c.inertia.base_twist(h, c.dq), c.V_B), kRounding);
    const Vector3d spin = h.tail<3>() - c.inertia.p_C.cross(h.head<3>());
    EXPECT_LT(relative(c.inertia.base_spin(spin, c.dq), c.V_B.tail<3>()), kRounding);
  });
}

// A hull and one link in the plane: with the reduced mass μ of both and the distances a and b from the joint to their centres
// of mass, D = I_0 + I_1 + μ (a² + b² + 2 a b cos q).
TEST(FloatingBase, AHullWithOneLinkIsTheClosedForm) {
  RobotModel robot;
  robot.base.name = "hull";
  robot.base.inertia = {8, {0, 0, 0}, Vector3d(0.5, 0.6, 0.7).asDiagonal()};
  robot.joints.resize(1);
  robot.joints[0].X_PJ.p = {0.4, 0, 0};
  robot.bodies.resize(1);
  robot.bodies[0].inertia = {3, {0.3, 0, 0}, Vector3d(0.01, 0.05, 0.06).asDiagonal()};
  const FloatingMechanism mechanism(robot);
  FloatingData data(mechanism);
  FloatingInertia inertia(1);
  const double mu = 8.0 * 3 / 11, a = 0.4, b = 0.3;
  for (double q = -3; q < 3; q += 0.1) {
    floating_inertia(mechanism, data, VectorXd::Constant(1, q), inertia);
    const double own = 0.06 + mu * (b * b + a * b * std::cos(q)),
                 D = 0.7 + 0.06 + mu * (a * a + b * b + 2 * a * b * std::cos(q));
    EXPECT_NEAR(inertia.Z()(2, 0), -own / D, 1e-14);
    EXPECT_NEAR(inertia.M_star(0, 0), 0.06 + mu * b * b - own * own / D, 1e-14);
    // M* q̈ + ½ M*' q̇² = τ without spin; with spin H the energy ½ H²/D adds the torque ½ H² (1/D)'.
    const double d = 1e-5, H = 0.8, dq = 1.3;
    const auto reduced = [&](double at) {
      FloatingInertia there(1);
      floating_inertia(mechanism, data, VectorXd::Constant(1, at), there);
      return Eigen::Vector2d(there.M_star(0, 0), 1 / there.I_C(2, 2));
    };
    const Eigen::Vector2d slope = (reduced(q + d) - reduced(q - d)) / (2 * d);
    VectorXd tau(1);
    reduced_inverse_dynamics(mechanism, data, inertia, VectorXd::Constant(1, q), VectorXd::Constant(1, dq), VectorXd::Zero(1),
                             {0, 0, H}, Wrench::Zero(), tau);
    EXPECT_NEAR(tau[0], 0.5 * slope[0] * dq * dq + 0.5 * H * H * slope[1], 1e-8);
  }
}

// Independent figures for the LWR 4+ on a base of 30 kg (shared/facts/specifications.md, section 10).
TEST(FloatingBase, ReactionOfTheLwr4OnItsBaseIsThatOfTheReference) {
  RobotModel robot = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  robot.base.inertia.mass = 30;
  robot.base.inertia.p_LC = {0.05, -0.03, -0.2};
  robot.base.inertia.I_CC << 1.5, 0.1, 0.05, 0.1, 1.2, -0.04, 0.05, -0.04, 0.9;
  const FloatingMechanism mechanism(robot);
  FloatingData data(mechanism);
  FloatingInertia inertia(7);
  VectorXd q(7), row(7);
  q << 0, 0.5, 0, -1, 0, 1, 0;
  row << -0.410597, 0.020106, -0.223520, -0.013675, -0.006581, 0.000136, 0.000088;
  floating_inertia(mechanism, data, q, inertia);
  EXPECT_LT((inertia.Z().row(2).transpose() - row).cwiseAbs().maxCoeff(), 1e-6);
  const Vector3d sigma = MatrixXd(inertia.Z()).jacobiSvd().singularValues();
  EXPECT_LT((sigma - Vector3d(0.54322, 0.495085, 0.041228)).cwiseAbs().maxCoeff(), 1e-5);
}

// Without momentum the base moves by A q̇; the frame is then seen from W by a central difference along the motion.
TEST(FloatingBase, GeneralisedJacobianIsTheRateOfTheFrameInSpace) {
  sweep(100, 2, [](Case& c, Draw& draw) {
    const FrameOnBody frame = on_body(c.robot.frames[static_cast<std::size_t>(draw.integer(0, c.n - 1))]);
    MatrixXd J(6, c.n);
    const Pose X_BF = generalised_jacobian(c.mechanism, c.data, c.inertia, c.q, frame, J);
    const auto pose_at = [&](double t) {  // with the base's twist over t
      const Twist V = c.inertia.A * c.dq;
      const double angle = V.tail<3>().norm() * t;
      const Pose X_WB{Eigen::AngleAxisd(angle, V.tail<3>().normalized()).toRotationMatrix(), t * V.head<3>()};
      return X_WB * body_pose(c.robot, c.q + t * c.dq, frame.body) * frame.X_BF;
    };
    const double d = 1e-5;
    const Pose before = pose_at(-d), after = pose_at(d);
    EXPECT_LT((pose_at(0).p - X_BF.p).norm(), 1e-12);
    const Eigen::AngleAxisd turn(after.R * before.R.transpose());
    Twist V;
    V << (after.p - before.p) / (2 * d), turn.angle() / (2 * d) * turn.axis();
    EXPECT_LT((J * c.dq - V).norm(), 1e-7 * (1 + V.norm()));
  });
}

TEST(FloatingBase, ForwardAndInverseDynamicsUndoEachOther) {
  sweep(300, 3, [](Case& c, Draw& draw) {
    VectorXd ddq(c.n), tau(c.n);
    Twist A_B;
    Wrench W;
    floating_forward_dynamics(c.mechanism, c.data, c.q, c.dq, c.tau, c.V_B, c.W, c.gravity, ddq, A_B);
    floating_inverse_dynamics(c.mechanism, c.data, c.q, c.dq, ddq, c.V_B, A_B, c.gravity, tau, W);
    const double scale = 1 + ddq.norm();
    EXPECT_LT((tau - c.tau).norm(), 1e-9 * scale);
    EXPECT_LT((W - c.W).norm(), 1e-9 * scale);
    // The reduced equation has the same motion, whatever the linear velocity and gravity.
    const Wrench h = c.inertia.momentum(c.V_B, c.dq);
    const Vector3d spin = h.tail<3>() - c.inertia.p_C.cross(h.head<3>());
    reduced_inverse_dynamics(c.mechanism, c.data, c.inertia, c.q, c.dq, ddq, spin, c.W, tau);
    EXPECT_LT((tau - c.tau).norm(), 1e-9 * scale);
    VectorXd bias(c.n);
    reduced_inverse_dynamics(c.mechanism, c.data, c.inertia, c.q, c.dq, VectorXd::Zero(c.n), spin, c.W, bias);
    EXPECT_LT((c.inertia.M_star * ddq + bias - c.tau).norm(), 1e-9 * scale);
    Twist A = base_acceleration(c.mechanism, c.data, c.inertia, c.q, c.dq, ddq, spin, c.W);
    A.head<3>() += c.gravity;
    EXPECT_LT((A - A_B).norm(), 1e-9 * scale);
    // Updated masses are those of a mechanism made anew.
    RobotModel other = floating_robot(draw, Kind::kChain, c.n);
    RobotModel changed = c.robot;
    changed.base.inertia = other.base.inertia;
    for (std::size_t i = 0; i < changed.bodies.size(); ++i) changed.bodies[i].inertia = other.bodies[i].inertia;
    c.mechanism.update(changed);
    FloatingMechanism anew(changed);
    FloatingData data(anew);
    FloatingInertia a(c.n), b(c.n);
    floating_inertia(c.mechanism, c.data, c.q, a);
    floating_inertia(anew, data, c.q, b);
    EXPECT_LT(relative(a.M_star, b.M_star), 1e-12);
  });
}

TEST(FloatingBase, RateOfTheReducedMassMatrixIsTheSymmetricPartOfTwiceItsCoriolisMatrix) {
  sweep(100, 5, [](Case& c, Draw&) {
    MatrixXd C(c.n, c.n);
    VectorXd bias(c.n);
    reduced_coriolis_matrix(c.mechanism, c.data, c.inertia, c.q, c.dq, Vector3d::Zero(), C);
    reduced_inverse_dynamics(c.mechanism, c.data, c.inertia, c.q, c.dq, VectorXd::Zero(c.n), Vector3d::Zero(), Wrench::Zero(),
                             bias);
    EXPECT_LT(relative(C * c.dq, bias), kRounding);
    FloatingInertia before(c.n), after(c.n);
    const double d = 1e-5;
    floating_inertia(c.mechanism, c.data, c.q - d * c.dq, before);
    floating_inertia(c.mechanism, c.data, c.q + d * c.dq, after);
    EXPECT_LT(relative(C + C.transpose(), (after.M_star - before.M_star) / (2 * d)), 1e-7);
  });
}

TEST(FloatingBase, ReactionOfAFixedBaseIsItsLoad) {
  sweep(100, 4, [](Case& c, Draw&) {
    RobotModel robot = c.robot;
    robot.gravity = c.gravity;
    const Mechanism fixed(robot);
    Data data(fixed);
    VectorXd expected(c.n), tau(c.n);
    Wrench W;
    inverse_dynamics(fixed, data, c.q, c.dq, c.ddq, expected);
    floating_inverse_dynamics(c.mechanism, c.data, c.q, c.dq, c.ddq, Twist::Zero(), Twist::Zero(), c.gravity, tau, W);
    EXPECT_LT(relative(tau, expected), kRounding);
    // W is the rate of the momentum minus the weight.
    const auto momentum = [&](double t) {
      FloatingInertia at(c.n);
      floating_inertia(c.mechanism, c.data, c.q + t * c.dq + t * t / 2 * c.ddq, at);
      return at.momentum(Twist::Zero(), c.dq + t * c.ddq);
    };
    const double d = 1e-5;
    Wrench rate = (momentum(d) - momentum(-d)) / (2 * d);
    const Vector3d weight = c.inertia.mass * c.gravity;
    rate.head<3>() -= weight;
    rate.tail<3>() -= c.inertia.p_C.cross(weight);
    EXPECT_LT((W - rate).norm(), 1e-6 * (1 + rate.norm()));
  });
}

/// A free-floating robot's state, integrated by RK4 with the base's pose in W.
struct Motion {
  VectorXd q, dq;
  Pose X_WB;
  Twist V_B;
};

TEST(FloatingBase, AFreeFlightKeepsMomentumAndEnergy) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Draw draw(seed);
    Case c(draw, floating_robot(draw, Kind::kTree, 5), nullptr);
    Motion x{c.q, 0.5 * c.dq, {}, 0.5 * c.V_B};
    const auto momenta = [&](const Motion& at) {
      floating_inertia(c.mechanism, c.data, at.q, c.inertia);
      const Wrench h = c.inertia.momentum(at.V_B, at.dq);
      Wrench in_W;
      in_W << at.X_WB.R * h.head<3>(), at.X_WB.R * (h.tail<3>() - c.inertia.p_C.cross(h.head<3>()));
      return in_W;
    };
    const auto energy = [&](const Motion& at) {
      floating_inertia(c.mechanism, c.data, at.q, c.inertia);
      const Wrench h = c.inertia.momentum(at.V_B, at.dq);
      return 0.5 * at.dq.dot(c.inertia.M_star * at.dq) + 0.5 * h.dot(c.inertia.locked_twist(h));
    };
    struct Rate {
      VectorXd dq, ddq;
      Vector3d dp, w;
      Twist dV;
    };
    const auto rate = [&](const Motion& at) {
      Rate r{at.dq, VectorXd(c.n), at.X_WB.R * at.V_B.head<3>(), at.V_B.tail<3>(), {}};
      Twist A_B;
      floating_forward_dynamics(c.mechanism, c.data, at.q, at.dq, VectorXd::Zero(c.n), at.V_B, Wrench::Zero(), Vector3d::Zero(),
                                r.ddq, A_B);
      r.dV << A_B.head<3>() - at.V_B.tail<3>().cross(at.V_B.head<3>()), A_B.tail<3>();  // components in the rotating B
      return r;
    };
    const auto moved = [](const Motion& from, double h, const Rate& r) {
      Motion to{from.q + h * r.dq, from.dq + h * r.ddq, from.X_WB, from.V_B + h * r.dV};
      to.X_WB.p += h * r.dp;
      const double angle = h * r.w.norm();
      if (angle > 0) to.X_WB.R = from.X_WB.R * Eigen::AngleAxisd(angle, r.w.normalized());
      return to;
    };
    const Wrench start = momenta(x);
    const double energy_0 = energy(x), h = 2e-4;
    for (int k = 0; k < 2500; ++k) {  // the midpoint rule is enough: the error is compared with h²
      const Rate r1 = rate(x);
      x = moved(x, h, rate(moved(x, h / 2, r1)));
    }
    EXPECT_LT((momenta(x) - start).norm(), 1e-4 * (1 + start.norm())) << seed;
    EXPECT_NEAR(energy(x), energy_0, 1e-4 * energy_0) << seed;
    EXPECT_GT(std::abs(Eigen::AngleAxisd(x.X_WB.R).angle()), 0.01);
  }
}

// With q_all = G q + g_0 of a robot whose mimics are free joints, speeds and torques are those of G.
TEST(FloatingBase, MimicJointsFollowTheirLeaders) {
  Draw draw(10);
  for (int i = 0; i < 40; ++i) {
    MimicPair pair = random_pair(draw, draw.integer(2, 9));
    pair.robot.base.inertia = pair.all.base.inertia = draw.inertia();
    for (RobotModel* robot : {&pair.robot, &pair.all})
      robot->base.inertia.I_CC = Matrix3d(robot->base.inertia.I_CC.selfadjointView<Eigen::Upper>());
    const FloatingMechanism mechanism(pair.robot), whole(pair.all);
    FloatingData data(mechanism), data_all(whole);
    const int n = pair.robot.n();
    FloatingInertia some(n), all(pair.all.n());
    const VectorXd q = draw.numbers(n, -2, 2), dq = draw.numbers(n, -2, 2), ddq = draw.numbers(n, -2, 2);
    const VectorXd q_all = pair.G * q + pair.g_0;
    floating_inertia(mechanism, data, q, some);
    floating_inertia(whole, data_all, q_all, all);
    EXPECT_LT(relative(some.I_c, all.I_c), kRounding);
    EXPECT_LT(relative(some.A, all.A * pair.G), kRounding);
    EXPECT_LT(relative(some.M_star, pair.G.transpose() * all.M_star * pair.G), kRounding);
    const int body = draw.integer(0, pair.robot.body_count() - 1);
    MatrixXd J(6, n), J_all(6, pair.all.n());
    const FrameOnBody frame{body, draw.pose(0.3)}, same{pair.free[static_cast<std::size_t>(body)], frame.X_BF};
    const Pose X = generalised_jacobian(mechanism, data, some, q, frame, J);
    EXPECT_LT((X.p - generalised_jacobian(whole, data_all, all, q_all, same, J_all).p).norm(), kRounding);
    EXPECT_LT(relative(J, J_all * pair.G), kRounding);
    VectorXd tau(n), tau_all(pair.all.n());
    const Vector3d spin = draw.numbers(3, -1, 1);
    reduced_inverse_dynamics(mechanism, data, some, q, dq, ddq, spin, Wrench::Zero(), tau);
    reduced_inverse_dynamics(whole, data_all, all, q_all, pair.G * dq, pair.G * ddq, spin, Wrench::Zero(), tau_all);
    EXPECT_LT(relative(tau, pair.G.transpose() * tau_all), kRounding);
    if (::testing::Test::HasFailure()) return;
  }
}

TEST(FloatingBase, NothingAllocates) {
  Draw draw(9);
  Case c(draw, floating_robot(draw, Kind::kTree, 9), nullptr);
  MatrixXd J(6, 9);
  VectorXd tau(9), ddq(9);
  Wrench W;
  Twist A_B;
  const auto before = cotwin::testing::allocations();
  floating_inertia(c.mechanism, c.data, c.q, c.inertia);
  const Wrench h = c.inertia.momentum(c.V_B, c.dq);
  const Twist V = c.inertia.base_twist(h, c.dq);
  generalised_jacobian(c.mechanism, c.data, c.inertia, c.q, {3, {}}, J);
  floating_inverse_dynamics(c.mechanism, c.data, c.q, c.dq, c.ddq, V, V, c.gravity, tau, W);
  floating_forward_dynamics(c.mechanism, c.data, c.q, c.dq, c.tau, V, W, c.gravity, ddq, A_B);
  reduced_inverse_dynamics(c.mechanism, c.data, c.inertia, c.q, c.dq, ddq, c.gravity, W, tau);
  reduced_coriolis_matrix(c.mechanism, c.data, c.inertia, c.q, c.dq, c.gravity, c.inertia.M);
  c.mechanism.update(c.robot);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

TEST(FloatingBase, ARobotWithoutJointsIsOneBody) {
  RobotModel robot;
  robot.base.inertia = {2, {0.1, 0, 0}, Vector3d(0.1, 0.2, 0.3).asDiagonal()};
  const FloatingMechanism mechanism(robot);
  FloatingData data(mechanism);
  FloatingInertia inertia(0);
  floating_inertia(mechanism, data, VectorXd(0), inertia);
  EXPECT_NEAR(inertia.mass, 2, 1e-15);
  EXPECT_LT((inertia.I_C - robot.base.inertia.I_CC).norm(), 1e-15);
}

TEST(FloatingBase, ABaseWithoutMassCannotFloat) {
  RobotModel robot;
  robot.name = "arm";
  robot.base.name = "foot";
  try {
    const FloatingMechanism mechanism(robot);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("base 'foot' cannot float"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace cotwin::robot::floating_base_test
