// The contact world with constraints: motors, limits, friction, loops, contacts; and its state.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "models/foundation/support/error.h"
#include "tests/support/allocations.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::contact_world::constraints_test {
namespace {

using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kStep = 1e-3;     // s
constexpr double kGravity = 9.81;  // m/s²

class Constraints : public ::testing::TestWithParam<Method> {
 protected:
  World world(scene::Scene scene, int iterations = 200) {
    Options options;
    options.method = GetParam();
    options.iterations = iterations;
    options.tolerance = 1e-12;
    return World(std::move(scene), options);
  }
};

/// A wheel of 0.1 kg m² about a fixed horizontal axis, with an arm that has a weight torque of 5 N.m when level; q = 0: level.
scene::Scene wheel() {
  scene::Scene scene;
  scene::Body body;
  body.name = "wheel";
  body.inertia.mass = 5 / kGravity;
  body.inertia.p_LC = {1, 0, 0};
  body.inertia.I_CC = Vector3d(0.1, 0.1, 0.1).asDiagonal();
  scene.bodies.push_back(body);
  scene::Joint joint;
  joint.name = "axle";
  joint.child = 0;
  joint.axis = -Vector3d::UnitY();  // q grows upwards
  scene.joints.push_back(joint);
  return scene;
}

TEST_P(Constraints, MotorHoldsAJointUpToItsTorqueAndNoFurther) {
  for (const double torque : {5.1, kInfinity}) {
    World w = world(wheel());
    w.set_motor(0, 0, torque);
    for (int k = 0; k < 1000; ++k) w.step(kStep);
    EXPECT_NEAR(w.q()[0], 0, 1e-9);
  }
  World w = world(wheel());
  w.set_motor(0, 0, 4);
  w.step(kStep);
  const double inertia = 0.1 + 5 / kGravity;
  EXPECT_NEAR(w.dq()[0], -(5 - 4) / inertia * kStep, 1e-8);
}

TEST_P(Constraints, MotorMovesAJointAtItsSpeed) {
  World w = world(wheel());
  w.set_motor(0, 0.5, 1000);
  for (int k = 0; k < 1000; ++k) w.step(kStep);
  EXPECT_NEAR(w.dq()[0], 0.5, 1e-8);
  EXPECT_NEAR(w.q()[0], 0.5, 1e-6);
}

TEST_P(Constraints, FrictionHoldsAJointBelowItsTorqueAndSlowsItAbove) {
  scene::Scene scene = wheel();
  scene.joints[0].friction = 5.5;
  World held = world(scene);
  for (int k = 0; k < 500; ++k) held.step(kStep);
  EXPECT_NEAR(held.q()[0], 0, 1e-9);

  scene.gravity.setZero();
  scene.joints[0].friction = 1;
  scene.bodies[0].V_WB << 0, 0, 0, 0, -2, 0;  // q̇ = 2; it stops after 2 I / 1
  World slows = world(scene);
  const double inertia = 0.1 + 5 / kGravity;
  for (int k = 0; k < 500; ++k) slows.step(kStep);
  EXPECT_NEAR(slows.dq()[0], 2 - 0.5 / inertia, GetParam() == Method::kPgs ? 1e-8 : 1e-9);
  for (int k = 0; k < 1000; ++k) slows.step(kStep);
  EXPECT_NEAR(slows.dq()[0], 0, 1e-12);
  EXPECT_NEAR(slows.q()[0], 2 * 2 * inertia / 2, 1e-5);
}

TEST_P(Constraints, DampedJointSlowsExponentially) {
  scene::Scene scene = wheel();
  scene.gravity.setZero();
  scene.joints[0].damping = 0.7;
  scene.bodies[0].V_WB << 0, 0, 0, 0, -2, 0;
  World w = world(scene);
  for (int k = 0; k < 1000; ++k) w.step(kStep);
  EXPECT_NEAR(w.dq()[0], 2 * std::exp(-0.7 / (0.1 + 5 / kGravity)), 1e-3);  // first order in the damper
}

TEST_P(Constraints, LimitStopsAJointAndCarriesIt) {
  scene::Scene scene = wheel();
  scene.joints[0].q_min = -0.3;
  World w = world(scene);
  double lowest = 0;
  for (int k = 0; k < 3000; ++k) {
    w.step(kStep);
    lowest = std::min(lowest, w.q()[0]);
  }
  EXPECT_NEAR(lowest, -0.3, 1e-6);
  EXPECT_NEAR(w.q()[0], -0.3, 1e-6);
  EXPECT_NEAR(w.dq()[0], 0, 1e-9);
}

TEST_P(Constraints, ALimitThatIsViolatedAtTheStartIsReachedWithoutALeap) {
  const double inertia = 0.1 + 5 / kGravity, fastest = 0.1;  // kg.m2, rad/s
  for (const double h : {1e-3, 1e-4}) {
    scene::Scene scene = wheel();
    scene.gravity.setZero();
    scene.joints[0].q_min = 0.06;
    World w = world(scene);
    double largest = 0;
    for (int k = 0; k < std::lround(1 / h); ++k) {
      w.step(h);
      largest = std::max(largest, w.energy());
    }
    EXPECT_LE(largest, inertia * fastest * fastest / 2 * (1 + 1e-6)) << h;
    EXPECT_GE(w.q()[0], 0.06 - 1e-6) << h;
  }
}

/// Four bars that form a parallelogram in the plane perpendicular to y, suspended at both ends.
scene::Scene four_bars(bool doubled) {
  scene::Scene scene;
  const auto bar = [&](const Vector3d& p, const Vector3d& half) {
    scene::Body body;
    body.name = "bar" + std::to_string(scene.bodies.size());
    body.inertia.mass = 1;
    body.inertia.I_CC = Vector3d(0.02, 0.02, 0.02).asDiagonal();
    body.X_WB.p = p + half;
    scene.bodies.push_back(body);
  };
  const auto hinge = [&](int parent, int child, const Vector3d& p_W) {
    scene::Joint joint;
    joint.name = "hinge" + std::to_string(scene.joints.size());
    joint.parent = parent;
    joint.child = child;
    joint.axis = Vector3d::UnitY();
    joint.X_PJ.p = parent < 0 ? p_W : Vector3d(p_W - scene.bodies[static_cast<std::size_t>(parent)].X_WB.p);
    joint.X_CJ.p = p_W - scene.bodies[static_cast<std::size_t>(child)].X_WB.p;
    scene.joints.push_back(joint);
    if (doubled) scene.joints.push_back(joint);
  };
  const Vector3d left(0, 0, 0), right(1, 0, 0), down(0.3, 0, -0.4);
  bar(left, down / 2);
  bar(left + down, (right - left) / 2);
  bar(right, down / 2);
  hinge(-1, 0, left);
  hinge(0, 1, left + down);
  hinge(1, 2, right + down);
  hinge(-1, 2, right);
  return scene;
}

TEST_P(Constraints, ClosedLoopStaysClosedAlsoWithEveryJointTwice) {
  // A planar loop of revolute joints is over-determined in space: dependent rows must not disturb the solution.
  for (const bool doubled : {false, true}) {
    World w = world(four_bars(doubled), 500);
    const double before = w.energy();
    for (int k = 0; k < 1000; ++k) w.step(kStep);
    EXPECT_LT(w.largest_gap(), 1e-5) << doubled;
    EXPECT_NEAR(w.energy(), before, 5e-2) << doubled;  // of a fall of 3 J; dependent rows are soft
    // Bars 0 and 2 stay parallel, bar 1 level.
    EXPECT_LT((w.poses()[0].R - w.poses()[2].R).norm(), 1e-4) << doubled;
    EXPECT_LT((w.poses()[1].R - Eigen::Matrix3d::Identity()).norm(), 1e-4) << doubled;
  }
}

TEST_P(Constraints, SoftContactSettlesWhereItsSpringCarriesTheWeightAndSwingsAsTheClosedForm) {
  scene::Scene scene;
  scene.gravity = {0, 0, -kGravity};
  scene.bodies.push_back(cotwin::testing::ground(0.5));
  scene.bodies.push_back(cotwin::testing::ball("ball", 0.1, 1, {0, 0, 0.1}, 0.5));
  const double k = 1e4, d = 10;
  scene.bodies[1].shapes[0].material.stiffness = k;
  scene.bodies[1].shapes[0].material.damping = d;
  World w = world(scene);
  const double omega = std::sqrt(k - d * d / 4);
  double worst = 0;
  for (int i = 1; i <= 3000; ++i) {
    w.step(kStep);
    const double t = i * kStep;
    const double z = -kGravity / k * (1 - std::exp(-d / 2 * t) * (std::cos(omega * t) + d / 2 / omega * std::sin(omega * t)));
    if (i <= 100) worst = std::max(worst, std::abs(w.poses()[1].p.z() - 0.1 - z));
  }
  EXPECT_LT(worst, 1.2e-5);  // of a swing of 2e-3 m: the implicit midpoint rule is late by (h ω)²/12
  EXPECT_NEAR(w.poses()[1].p.z() - 0.1, -kGravity / k, 1e-8);
}

TEST_P(Constraints, HeavyBoxRestsOnALightOne) {
  scene::Scene scene;
  scene.bodies.push_back(cotwin::testing::ground(0.5));
  scene.bodies.push_back(cotwin::testing::box("light", {0.1, 0.1, 0.1}, 1, {0, 0, 0.05}, 0.5));
  scene.bodies.push_back(cotwin::testing::box("heavy", {0.1, 0.1, 0.1}, 1000, {0, 0, 0.15}, 0.5));
  World w = world(scene);
  for (int k = 0; k < 2000; ++k) w.step(kStep);
  EXPECT_NEAR(w.poses()[1].p.z(), 0.05, 2e-5);
  EXPECT_NEAR(w.poses()[2].p.z(), 0.15, 4e-5);
  double weight = 0;
  for (std::size_t i = 0; i < w.contacts().size(); ++i) {
    if (w.contacts()[i].body_a == 0) weight += w.forces()[i].z();
  }
  EXPECT_NEAR(weight, 1001 * kGravity, 1e-3 * 1001 * kGravity);
}

TEST_P(Constraints, ContactForceOfAPushingArmFollowsFromItsTorque) {
  // The tip of the wheel's arm, a ball of 0.05 m at 1 m, rests on the ground: N · 1 m = 5 N.m + drive.
  scene::Scene scene = wheel();
  scene.bodies[0].shapes = cotwin::testing::ball("tip", 0.05, 1, {0, 0, 0}, 0).shapes;
  scene.bodies[0].shapes[0].X_BS.p = {1, 0, 0};
  scene.bodies.push_back(cotwin::testing::ground(0));
  scene.bodies[1].X_WB.p.z() = -0.05;
  World w = world(scene);
  for (int k = 0; k < 500; ++k) {
    w.set_tau(0, -3);
    w.step(kStep);
  }
  ASSERT_EQ(w.contacts().size(), 1u);
  const double sign = w.contacts()[0].body_b == 0 ? 1 : -1;
  EXPECT_NEAR(sign * w.forces()[0].z(), 8, 1e-6);
  EXPECT_LT(w.largest_gap(), 1e-9);
}

TEST_P(Constraints, RestoredWorldStepsToTheSameBits) {
  scene::Scene scene = cotwin::testing::stack(4);
  scene::Scene loop = four_bars(false);
  const auto first = static_cast<int>(scene.bodies.size());
  for (scene::Body& body : loop.bodies) {
    body.X_WB.p.x() += 3;
    body.X_WB.p.z() += 2;
    scene.bodies.push_back(body);
  }
  for (scene::Joint& joint : loop.joints) {
    if (joint.parent < 0) joint.X_PJ.p += Vector3d(3, 0, 2);
    joint.parent += joint.parent < 0 ? 0 : first;
    joint.child += first;
    scene.joints.push_back(joint);
  }
  World w = world(scene, 20), other = world(scene, 20);
  w.set_motor(1, 0.1, 0.2);
  for (int k = 0; k < 20; ++k) w.step(kStep);
  std::vector<double> state, a, b;
  w.save(state);
  EXPECT_EQ(state.size(), w.state_size());
  for (int k = 0; k < 20; ++k) w.step(kStep);
  w.save(a);
  for (int k = 0; k < 3; ++k) other.step(2 * kStep);  // a different problem before
  other.restore(state);
  for (int k = 0; k < 20; ++k) other.step(kStep);
  other.save(b);
  EXPECT_EQ(a, b);
}

TEST_P(Constraints, StepAllocatesNothing) {
  World w = world(cotwin::testing::stack(5), 20);
  for (int k = 0; k < 5; ++k) w.step(kStep);
  const auto before = cotwin::testing::allocations();
  for (int k = 0; k < 100; ++k) w.step(kStep);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

INSTANTIATE_TEST_SUITE_P(Methods, Constraints, ::testing::Values(Method::kTree, Method::kPgs, Method::kDantzig),
                         [](const auto& method) {
                           return method.param == Method::kTree ? "tree" : method.param == Method::kPgs ? "pgs" : "dantzig";
                         });

TEST(ContactWorldErrors, NameTheBodyOrJoint) {
  const auto message = [](const scene::Scene& scene) {
    try {
      World world(scene, {});
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  scene::Scene massless = wheel();
  massless.bodies[0].inertia.mass = 0;
  EXPECT_EQ(message(massless), "body wheel: mass 0 kg, expected > 0");
  scene::Scene nobody = wheel();
  nobody.joints[0].child = 3;
  EXPECT_EQ(message(nobody), "joint axle: body 3 does not exist, expected -1 to 0");
  scene::Scene itself = wheel();
  itself.joints[0].parent = 0;
  EXPECT_EQ(message(itself), "joint axle: parent and child are the same body, expected two bodies");
  scene::Scene axis = wheel();
  axis.joints[0].axis *= 2;
  EXPECT_EQ(message(axis), "joint axle: the axis is not a unit vector");
}

}  // namespace
}  // namespace cotwin::contact_world::constraints_test
