// Effective masses and manipulability against forward dynamics under a force, constrained dynamics, differences, closed forms
// and the figures of the reference pose.
#include "models/robot/indices.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <limits>

#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/floating_dynamics.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::robot::indices_test {
namespace {

using namespace testing;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kRounding = 1e-9;  // inverses of mass matrices with a condition up to 1e5

double rad(double degrees) { return degrees * std::acos(-1.0) / 180; }
RobotModel robot_of(const std::string& name) { return load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf"); }

struct Arm {
  explicit Arm(const RobotModel& model, const std::string& name = "")
      : robot(model),
        mechanism(robot),
        data(mechanism),
        frame(on_body(name.empty() ? robot.frames.back() : robot.frame(name))),
        f(robot.n()),
        m(robot.n()) {}
  void at(const VectorXd& position, const VectorXd& B = VectorXd()) {
    q = position;
    frame_inertia(mechanism, data, q, B, frame, f);
  }
  RobotModel robot;
  Mechanism mechanism;
  Data data;
  FrameOnBody frame;
  FrameInertia f;
  Manipulability m;
  VectorXd q;
};

template <class F>
void sweep(int count, std::uint64_t seed, F visit) {
  Draw draw(seed);
  for (int i = 0; i < count; ++i) {
    const int n = i % 5 == 0 ? 7 : draw.integer(1, 12);
    SCOPED_TRACE("robot " + std::to_string(i) + ", " + std::to_string(n) + " joints");
    Arm arm(i % 4 == 3 ? random_pair(draw, n).robot : draw.robot(static_cast<Kind>(i % 4), n));
    visit(arm, draw.numbers(arm.robot.n(), -2, 2), draw);
    if (::testing::Test::HasFailure()) return;
  }
}

/// The reference pose of the lwr4, frame link_7.
struct Reference : Arm {
  Reference() : Arm(robot_of("lwr4"), "link_7"), q_ref(7), B(7) {
    q_ref << 0, rad(30), 0, rad(-60), 0, rad(60), 0;
    B << 3, 3, 2, 2, 1, 0.6, 0.5;  // drive_train.ssv
  }
  Vector3d axis(int i) const { return f.X_BF.R.col(i); }
  VectorXd q_ref, B;
};

// A point mass at the frame as part of its body, by the other formula.
TEST(Indices, HasTheEffectiveMassWithALoadOfTheRobotThatCarriesIt) {
  sweep(40, 71, [](Arm& arm, const VectorXd& q, Draw& draw) {
    RobotModel carrying = arm.robot;
    const double load = draw.number(0.1, 20);
    Inertia point;
    point.mass = load;
    point.p_LC = arm.frame.X_BF.p;
    if (arm.frame.body < 0) return;
    Inertia& body = carrying.bodies[static_cast<std::size_t>(arm.frame.body)].inertia;
    body = body + point;
    Arm other(carrying);
    arm.at(q);
    other.at(q);
    for (const Vector3d& u : {Vector3d(1, 0, 0), Vector3d(0.6, 0, -0.8), Vector3d(0, 1, 0)}) {
      const double with = effective_mass(arm.f, u, load), wanted = effective_mass(other.f, u);
      if (std::isinf(wanted) || wanted > 1e6 || effective_mass(arm.f, u) > 1e6) continue;  // hardly moves
      EXPECT_NEAR(with, wanted, 1e-6 * wanted) << load;
      EXPECT_GE(with, (effective_mass(arm.f, u) + load) * (1 - 1e-9));
    }
    EXPECT_EQ(effective_mass(arm.f, Vector3d::UnitX(), 0), effective_mass(arm.f, Vector3d::UnitX()));
  });
}

TEST(Indices, HasTheSimpleMassOfTheStandard) {
  EXPECT_NEAR(moving_mass(robot_of("ur10e")), 7.369 + 13.051 + 3.989 + 2.1 + 1.98 + 0.615, 1e-9);
  EXPECT_EQ(simple_effective_mass(30, 5), 20);
}

TEST(Indices, HasTheFiguresOfTheReferencePose) {
  Reference r;
  r.at(r.q_ref);
  EXPECT_NEAR(effective_mass(r.f, r.axis(2)), 3.28702, 5e-6);
  EXPECT_NEAR(effective_mass(r.f, r.axis(0)), 4.90484, 5e-6);
  EXPECT_NEAR(effective_inertia(r.f, r.axis(2)), 4.4007e-4, 5e-9);
  r.at(r.q_ref, r.B);
  EXPECT_NEAR(effective_mass(r.f, r.axis(2)), 8.57909, 5e-6);
  EXPECT_NEAR(effective_mass(r.f, r.axis(0)), 60.9339, 5e-5);
  EXPECT_NEAR(effective_inertia(r.f, r.axis(2)), 0.401920, 5e-7);
}

// Against forward dynamics, which does not form M⁻¹: τ = C q̇ + g + Jᵀ f at rest gives a = J q̈.
TEST(Indices, AForceAcceleratesTheFrameByForceOverEffectiveMass) {
  sweep(200, 1, [](Arm& arm, const VectorXd& q, Draw& draw) {
    const int n = arm.robot.n();
    const Vector3d u = draw.direction();
    arm.at(q);
    MatrixXd J(6, n);
    VectorXd tau(n), ddq(n);
    jacobian(arm.mechanism, arm.data, q, arm.frame, J);
    for (const bool translation : {true, false}) {
      const double mass = translation ? effective_mass(arm.f, u) : effective_inertia(arm.f, u);
      const MatrixXd rows = translation ? J.topRows(3) : J.bottomRows(3);
      gravity(arm.mechanism, arm.data, q, tau);
      tau += rows.transpose() * (100 * u);
      forward_dynamics(arm.mechanism, arm.data, q, VectorXd::Zero(n), tau, ddq);
      const double a = u.dot(rows * ddq), expected = 100 / mass;
      EXPECT_NEAR(a, expected, kRounding * (1 + std::abs(expected)));
    }
  });
}

TEST(Indices, MotorsHeldByTheGearsAddTheirInertiaAndLockedJointsDoNotMove) {
  sweep(100, 2, [](Arm& arm, const VectorXd& q, Draw& draw) {
    const int n = arm.robot.n();
    const Vector3d u = draw.direction();
    VectorXd B = draw.numbers(n, 0.1, 3);
    MatrixXd M(n, n), J(6, n);
    mass_matrix(arm.mechanism, arm.data, q, M);
    jacobian(arm.mechanism, arm.data, q, arm.frame, J);
    M.diagonal() += B;
    for (int i = 0; i < n; ++i) {
      if (draw.integer(0, 3) != 0) continue;
      B[i] = kInfinite;
      M(i, i) = 1e18;  // acts as locked
    }
    arm.at(q, B);
    const VectorXd of_force = J.topRows(3).transpose() * u;
    const double mobility = of_force.dot(M.ldlt().solve(of_force));
    EXPECT_NEAR(1 / effective_mass(arm.f, u), mobility, kRounding * (1 + mobility));
  });
}

TEST(Indices, AreInfiniteWhereThePlanarArmCannotMove) {
  Arm arm(robot_of("planar2"));
  arm.at(Eigen::Vector2d(0.3, 0.9));
  const Vector3d normal = arm.f.J.col(0).tail<3>();
  EXPECT_EQ(effective_mass(arm.f, normal), kInfinite);
  EXPECT_EQ(effective_inertia(arm.f, normal.unitOrthogonal()), kInfinite);
}

TEST(Indices, IsInfiniteAlongTheSingularDirectionOfAStretchedArm) {
  Reference r;
  for (const VectorXd& B : {VectorXd(), r.B}) {
    r.at(VectorXd::Zero(7), B);  // stretched upwards: nothing moves link_7 along z
    EXPECT_EQ(effective_mass(r.f, Vector3d::UnitZ()), kInfinite);
    EXPECT_TRUE(std::isfinite(effective_mass(r.f, Vector3d::UnitX())));
    VectorXd gradient(7);
    effective_mass_gradient(r.mechanism, r.data, r.q, r.frame, r.f, Vector3d::UnitZ(), Direction::kInBase, gradient);
    EXPECT_EQ(gradient, VectorXd(VectorXd::Zero(7)));
    VectorXd near = VectorXd::Zero(7);
    near[3] = 1e-6;
    r.at(near, B);
    EXPECT_GT(effective_mass(r.f, Vector3d::UnitZ()), 1e9);
    EXPECT_TRUE(std::isfinite(effective_mass(r.f, Vector3d::UnitZ())));
  }
}

TEST(Indices, IsInfiniteAtAPointThatTheJointsOnlyTurnAbout) {
  Arm arm(robot_of("lwr4"), "link_2");  // its origin is that of the base
  Draw draw(11);
  for (int i = 0; i < 20; ++i) {
    arm.at(draw.numbers(7, -2, 2));
    EXPECT_EQ(effective_mass(arm.f, draw.direction()), kInfinite);
    EXPECT_TRUE(std::isfinite(effective_inertia(arm.f, arm.f.J.col(0).tail<3>())));
  }
}

TEST(Indices, AJointThatMovesNoMassGivesNoResistance) {
  Draw draw(4);
  RobotModel robot = draw.robot(Kind::kChain, 4);
  robot.bodies.back().inertia = Inertia{};
  Arm arm(robot);
  arm.at(draw.numbers(4, -2, 2));
  const Vector3d free = arm.f.J.col(3).head<3>().normalized();
  EXPECT_TRUE(arm.f.massless);
  EXPECT_EQ(effective_mass(arm.f, free), 0);
  EXPECT_TRUE(arm.f.Lambda_inverse.allFinite());
  dynamic_manipulability(arm.mechanism, arm.data, arm.q, arm.q, arm.frame, arm.f, VectorXd::Constant(4, 10), arm.m);
  EXPECT_EQ(arm.m.translation.lengths, Vector3d::Constant(kInfinite));
  // Its motion does not matter in front of it, or with its motor.
  arm.frame = {2, {}};
  arm.at(arm.q);
  EXPECT_GT(effective_mass(arm.f, draw.direction()), 0);
  arm.frame = {3, {}};
  arm.at(arm.q, VectorXd::Ones(4));
  EXPECT_FALSE(arm.f.massless);
  EXPECT_GT(effective_mass(arm.f, free), 0);
}

/// Sixth-order central difference.
template <class F>
double difference(const F& f, double h) {
  return (45 * (f(h) - f(-h)) - 9 * (f(2 * h) - f(-2 * h)) + (f(3 * h) - f(-3 * h))) / (60 * h);
}

TEST(Indices, GradientsAreThoseOfDifferencesOfSixthOrder) {
  sweep(120, 5, [](Arm& arm, const VectorXd& q, Draw& draw) {
    const int n = arm.robot.n();
    VectorXd B = draw.integer(0, 1) == 0 ? VectorXd() : draw.numbers(n, 0.1, 3);
    if (B.size() > 2 && draw.integer(0, 1) == 0) B[1] = kInfinite;
    arm.at(q, B);
    const Vector3d u = draw.direction(), in_frame = arm.f.X_BF.R.transpose() * u;
    for (const Direction direction : {Direction::kInBase, Direction::kInFrame}) {
      arm.at(q, B);
      VectorXd gradient(n);
      effective_mass_gradient(arm.mechanism, arm.data, arm.q, arm.frame, arm.f, u, direction, gradient);
      const double mass = effective_mass(arm.f, u);
      if (!(mass < 1e4)) continue;  // differences lose their figures near singular positions
      for (int k = 0; k < n; ++k) {
        const double expected = difference(
            [&](double step) {
              VectorXd moved = q;
              moved[k] += step;
              arm.at(moved, B);
              const Vector3d turned = direction == Direction::kInBase ? u : Vector3d(arm.f.X_BF.R * in_frame);
              return effective_mass(arm.f, turned);
            },
            1e-3 / (1 + std::sqrt(mass)));
        if (B.size() > k && std::isinf(B[k])) {
          EXPECT_EQ(gradient[k], 0);
        } else {
          EXPECT_NEAR(gradient[k], expected, 1e-7 * (1 + mass * mass)) << "joint " << k << ", mass " << mass;
        }
      }
    }
  });
}

TEST(Indices, KinematicEllipsoidsAreTheImageOfAllUnitSpeeds) {
  sweep(100, 6, [](Arm& arm, const VectorXd& q, Draw& draw) {
    const int n = arm.robot.n();
    arm.at(q);
    kinematic_manipulability(arm.f, arm.m);
    for (const bool translation : {true, false}) {
      const Ellipsoid& e = translation ? arm.m.translation : arm.m.rotation;
      const MatrixXd A = translation ? arm.f.J.topRows(3) : arm.f.J.bottomRows(3);
      const Matrix3d square = e.axes * e.lengths.cwiseAbs2().asDiagonal() * e.axes.transpose();
      EXPECT_LT((square - A * A.transpose()).norm(), 1e-12 * (1 + square.norm()));
      EXPECT_NEAR(e.axes.determinant(), 1, 1e-12);
      EXPECT_NEAR(e.measure(), std::sqrt(std::max(0.0, (A * A.transpose()).determinant())), 1e-7 * (1 + e.lengths[0]));
      EXPECT_EQ(e.centre, Vector3d(Vector3d::Zero()));
      EXPECT_TRUE(n >= 3 || e.measure() < 1e-12);
      const VectorXd dq = draw.numbers(n, -1, 1).normalized();
      EXPECT_LE((A * dq).norm(), e.lengths[0] * (1 + 1e-12));
    }
  });
}

TEST(Indices, ManipulabilityOfThePlanarArmIsTheSineOfItsElbow) {
  Arm arm(robot_of("planar2"), "tip");
  for (const double elbow : {-2.5, -0.3, 1e-9, 0.7, 3.0}) {
    arm.at(Eigen::Vector2d(0.4, elbow));
    kinematic_manipulability(arm.f, arm.m);
    EXPECT_NEAR(arm.m.translation.measure(2), 0.4 * 0.35 * std::abs(std::sin(elbow)), 1e-15);  // l₁ l₂ |sin q₂|, Yoshikawa
    EXPECT_NEAR(arm.m.rotation.lengths[0], std::sqrt(2), 1e-15);
  }
}

TEST(Indices, DynamicMeasureIsTheKinematicOneTimesTorquesOverDetMForSquareJacobians) {
  Draw draw(7);
  for (int i = 0; i < 50; ++i) {
    Arm arm(draw.robot(Kind::kChain, 3));
    const VectorXd tau_max = draw.numbers(3, 1, 100), B = i % 2 == 0 ? VectorXd() : draw.numbers(3, 0.1, 2);
    arm.at(draw.numbers(3, -2, 2), B);
    kinematic_manipulability(arm.f, arm.m);
    const double w = arm.m.translation.measure();
    dynamic_manipulability(arm.mechanism, arm.data, arm.q, VectorXd::Zero(3), arm.frame, arm.f, tau_max, arm.m);
    const double expected = w * tau_max.prod() / arm.f.M.determinant();
    EXPECT_NEAR(arm.m.translation.measure(), expected, 1e-10 * expected);
  }
}

// Forward dynamics with any torques of ‖diag(τ_max)⁻¹ τ‖ = 1.
TEST(Indices, DynamicEllipsoidsHoldTheAccelerationsThatTheMotorsReach) {
  sweep(100, 8, [](Arm& arm, const VectorXd& q, Draw& draw) {
    const int n = arm.robot.n();
    const VectorXd tau_max = draw.numbers(n, 1, 100), dq = draw.numbers(n, -2, 2), t = draw.numbers(n, -1, 1).normalized();
    arm.at(q);
    dynamic_manipulability(arm.mechanism, arm.data, q, dq, arm.frame, arm.f, tau_max, arm.m);
    VectorXd ddq(n);
    forward_dynamics(arm.mechanism, arm.data, q, dq, tau_max.cwiseProduct(t), ddq);
    Twist a;
    jacobian_dot_times_dq(arm.mechanism, arm.data, q, dq, arm.frame, a);
    a += arm.f.J * ddq;
    for (const bool translation : {true, false}) {
      const Ellipsoid& e = translation ? arm.m.translation : arm.m.rotation;
      const Vector3d from_centre = e.axes.transpose() * ((translation ? a.head<3>() : a.tail<3>()) - e.centre);
      const double noise = 1e-9 * (1 + e.lengths[0] + e.centre.norm());
      double inside = 0;
      for (int i = 0; i < 3; ++i) {
        if (e.lengths[i] <= 1e-6 * e.lengths[0]) {
          EXPECT_LT(std::abs(from_centre[i]), e.lengths[i] + noise);
        } else {
          inside += std::pow(from_centre[i] / e.lengths[i], 2);
        }
      }
      EXPECT_LE(inside, 1 + 1e-6);
      const bool all_act = n <= 3 && e.lengths[n - 1] > 1e-3 * e.lengths[0];  // no torques without effect
      EXPECT_TRUE(!all_act || std::abs(inside - 1) < 1e-5) << inside;
    }
  });
}

TEST(Indices, AFloatingRobotRecoilsUnderAForce) {
  Draw draw(9);
  for (int i = 0; i < 60; ++i) {
    const int n = draw.integer(1, 9);
    RobotModel robot = draw.robot(static_cast<Kind>(i % 3), n);
    robot.base.inertia = draw.inertia();
    robot.base.inertia.I_CC = 3 * Matrix3d(robot.base.inertia.I_CC.selfadjointView<Eigen::Upper>());
    const FloatingMechanism mechanism(robot);
    FloatingData data(mechanism);
    FrameInertia f(n + 6);
    const FrameOnBody frame = on_body(robot.frames.back());
    const VectorXd q = draw.numbers(n, -2, 2);
    const Vector3d u = draw.direction();
    frame_inertia(mechanism, data, q, VectorXd(), frame, f);
    // The force on F acts on the joints by Jᵀ and on the base as a wrench about its origin.
    const Mechanism fixed(robot);
    Data fixed_data(fixed);
    MatrixXd J(6, n);
    const Vector3d p = jacobian(fixed, fixed_data, q, frame, J).p;
    Wrench W;
    W << u, p.cross(u);
    VectorXd ddq(n);
    Twist A;
    floating_forward_dynamics(mechanism, data, q, VectorXd::Zero(n), J.topRows(3).transpose() * u, Twist::Zero(), W,
                              Vector3d::Zero(), ddq, A);
    const double a = u.dot(J.topRows(3) * ddq + A.head<3>() + A.tail<3>().cross(p));
    EXPECT_NEAR(effective_mass(f, u) * a, 1, kRounding);
    double mass = robot.base.inertia.mass;
    for (const Body& body : robot.bodies) mass += body.inertia.mass;
    EXPECT_LT(effective_mass(f, u), mass);  // the whole robot's mass acts only on a force through its centre of mass
  }
}

TEST(Indices, SpeedLimitsAreThoseOfTheHandAndTheChest) {
  const double m_u = 3.287;
  const double hand = reduced_mass(m_u, 0.6), chest = reduced_mass(m_u, 40);
  EXPECT_NEAR(hand, 0.5074, 5e-5);
  EXPECT_NEAR(speed_limit_of_force(280, 75e3, hand), 1.435, 5e-4);
  EXPECT_NEAR(collision_energy(hand, speed_limit_of_force(280, 75e3, hand)), 0.523, 5e-4);
  EXPECT_NEAR(chest, 3.037, 5e-4);
  EXPECT_NEAR(speed_limit_of_force(280, 25e3, chest), 1.016, 5e-4);
  EXPECT_EQ(reduced_mass(kInfinite, 40), 40);
  EXPECT_EQ(reduced_mass(0, 40), 0);
}

// A hand (a mass behind a spring, without friction) in front of a robot that moves at v_max along u: largest force of the spring
// in the motion of both. The equations of v_max leave out the robot's change of position within the 4 ms of the collision.
TEST(Indices, AHandThatIsHitAtTheSpeedLimitReceivesThePermissibleForce) {
  for (const bool held : {false, true}) {
    Reference r;
    r.at(r.q_ref, held ? r.B : VectorXd());
    const Vector3d u = r.axis(2);
    constexpr double kHand = 0.6, kStiffness = 75e3, kMost = 280, h = 1e-6;
    const double v_max = speed_limit_of_force(kMost, kStiffness, reduced_mass(effective_mass(r.f, u), kHand));
    VectorXd q = r.q_ref, dq = r.f.J_over_M.topRows(3).transpose() * u, tau(7), ddq(7), held_g(7);
    dq *= v_max / u.dot(r.f.J.topRows(3) * dq);
    MatrixXd J(6, 7), M(7, 7);
    double x_hand = 0, v_hand = 0, most = 0;
    const Vector3d start = r.f.X_BF.p;
    for (int i = 0; i < 6000; ++i) {
      const Pose X = jacobian(r.mechanism, r.data, q, r.frame, J);
      const double force = std::max(0.0, kStiffness * (u.dot(X.p - start) - x_hand));
      most = std::max(most, force);
      mass_matrix_and_bias(r.mechanism, r.data, q, dq, M, tau);
      gravity(r.mechanism, r.data, q, held_g);  // the motors carry the arm
      if (held) M.diagonal() += r.B;
      ddq = M.ldlt().solve(held_g - tau - J.topRows(3).transpose() * (force * u));
      dq += h * ddq;
      q += h * dq;
      v_hand += h * force / kHand;
      x_hand += h * v_hand;
    }
    EXPECT_NEAR(most, kMost, 0.005 * kMost) << (held ? "held" : "free");
  }
}

TEST(Indices, AllocatesNothingAfterConstruction) {
  Draw draw(10);
  for (int i = 0; i < 8; ++i) {
    Arm arm(i == 7 ? random_pair(draw, 9).robot : draw.robot(static_cast<Kind>(i % 3), i == 6 ? 40 : 2 * i + 1));
    const int n = arm.robot.n();
    const VectorXd q = draw.numbers(n, -2, 2), B = draw.numbers(n, 0.1, 1);
    VectorXd gradient(n);
    const auto compute = [&] {
      frame_inertia(arm.mechanism, arm.data, q, B, arm.frame, arm.f);
      const Vector3d u = Vector3d(1, 2, 3).normalized();
      effective_mass_gradient(arm.mechanism, arm.data, q, arm.frame, arm.f, u, Direction::kInFrame, gradient);
      kinematic_manipulability(arm.f, arm.m);
      dynamic_manipulability(arm.mechanism, arm.data, q, B, arm.frame, arm.f, B, arm.m);
      return effective_inertia(arm.f, u);
    };
    const double first = compute();
    const std::uint64_t before = cotwin::testing::allocations();
    const double second = compute();
    EXPECT_EQ(cotwin::testing::allocations(), before) << n << " joints";
    EXPECT_EQ(first, second);
  }
}

}  // namespace
}  // namespace cotwin::robot::indices_test
