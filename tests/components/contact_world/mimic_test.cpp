// Robots with mimic joints in the contact world: gears between joints of the trees.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "components/contact_world/assemble.h"
#include "components/contact_world/engine/world.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::contact_world::mimic_test {
namespace {

using Eigen::Vector2d;
using Eigen::VectorXd;
using ::testing::HasSubstr;

const robot::RobotModel& finger() {
  static const robot::RobotModel robot = robot::load_urdf(places::source() + "/tests/components/data/finger.urdf");
  return robot;
}

scene::Scene scene_of(const robot::RobotModel& robot, const std::vector<double>& q, Assembled& parts) {
  scene::Scene scene;
  scene.gravity = robot.gravity;
  parts = assemble(scene, robot, {}, Base::kFixed, q, std::vector<double>(q.size()));
  return scene;
}

/// q̈ of the reduced robot by Runge and Kutta's method, in small steps.
void advance(const robot::Mechanism& mechanism, robot::Data& data, VectorXd& q, VectorXd& dq, double h) {
  const VectorXd none = VectorXd::Zero(q.size());
  VectorXd k[4] = {none, none, none, none};
  const auto f = [&](const VectorXd& at, const VectorXd& speed, VectorXd& a) {
    robot::forward_dynamics(mechanism, data, at, speed, none, a);
  };
  f(q, dq, k[0]);
  f(q + h / 2 * dq, dq + h / 2 * k[0], k[1]);
  f(q + h / 2 * dq + h * h / 4 * k[0], dq + h / 2 * k[1], k[2]);
  f(q + h * dq + h * h / 2 * k[1], dq + h * k[2], k[3]);
  q += h * dq + h * h / 6 * (k[0] + k[1] + k[2]);
  dq += h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3]);
}

TEST(ContactWorldMimic, MovesLikeTheReducedRobotToSecondOrder) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    double errors[2];
    for (const int refined : {0, 1}) {
      const double h = refined ? 2.5e-4 : 5e-4;
      Assembled parts;
      Options options;
      options.method = method;
      World world(scene_of(finger(), {0.3, 0.4}, parts), options);
      const robot::Mechanism mechanism(finger());
      robot::Data data(mechanism);
      VectorXd q = Vector2d(0.3, 0.4), dq = Vector2d::Zero();
      const double start = world.energy();
      double error = 0;
      for (int n = 0; n < (refined ? 2000 : 1000); ++n) {
        world.step(h);
        advance(mechanism, data, q, dq, h);
        for (std::size_t i = 0; i < 2; ++i)
          error = std::max(error, std::abs(world.q()[parts.joints[i]] - q[static_cast<Eigen::Index>(i)]));
        const double knuckle = world.q()[parts.joints[1]], bend = world.q()[parts.joints[2]], tip = world.q()[parts.joints[3]];
        ASSERT_NEAR(bend, 0.8 * knuckle + 0.1, 1e-8) << n;
        ASSERT_NEAR(tip, 0.5 * bend, 1e-8) << n;
        ASSERT_NEAR(world.energy(), start, refined ? 5e-5 : 2e-4) << n;
      }
      errors[refined] = error;
      EXPECT_GT(dq.norm(), 1);
    }
    EXPECT_LT(errors[0], 1e-4);
    EXPECT_NEAR(errors[0] / errors[1], 4, 0.4) << "second order, method " << static_cast<int>(method);
  }
}

TEST(ContactWorldMimic, LinksAndContactTorquesAreThoseOfTheReducedRobot) {
  const robot::Mechanism mechanism(finger());
  robot::Data data(mechanism);
  const VectorXd q = Vector2d(0.7, -0.4), dq = Vector2d(1.5, -2);
  std::vector<Pose> X_WL(4);
  std::vector<Twist> V_WL(4);
  scene::place_links(finger(), {}, {q.data(), 2}, {dq.data(), 2}, X_WL, V_WL);
  const Eigen::Vector3d f(3, 4, -5), p_B(0.01, 0.02, 0.03);
  for (int body = 0; body < 4; ++body) {
    const auto k = static_cast<std::size_t>(body);
    Eigen::MatrixXd J(6, 2);
    const Pose X = robot::jacobian(mechanism, data, q, {body, {}}, J);
    EXPECT_TRUE(X.R.isApprox(X_WL[k].R, 1e-14) && X.p.isApprox(X_WL[k].p, 1e-14)) << body;
    EXPECT_TRUE(V_WL[k].isApprox(J * dq, 1e-13)) << body;
    const Pose X_P = robot::jacobian(mechanism, data, q, {body, {Eigen::Matrix3d::Identity(), p_B}}, J);
    std::vector<double> tau(2);
    scene::add_joint_torques(finger(), X_WL, body, X_P.p, f, tau);
    const VectorXd expected = J.topRows<3>().transpose() * f;
    EXPECT_NEAR(tau[0], expected[0], 1e-14) << body;
    EXPECT_NEAR(tau[1], expected[1], 1e-14) << body;
  }
}

TEST(ContactWorldMimic, TwoFingersOnAFixedHandFallLikeOneMass) {
  // Two trees, as the hand is static: (m_l + r² m_r) q̈ = −10 (m_l − r m_r) for fingers that slide up and down
  constexpr double r = 2, m_l = 0.2, m_r = 0.3;
  robot::RobotModel hand;
  hand.name = "hand";
  hand.gravity = {0, 0, -10};
  robot::Joint left, right;
  left.name = "left";
  right.name = "right";
  left.type = right.type = robot::JointType::kPrismatic;
  right.axis = {0, 0, -1};
  hand.joints = {left};
  hand.mimics = {{right, 0, r, 0.01, 1}};
  hand.bodies = {{"l", {m_l, {0, 0, 0}, 1e-3 * Eigen::Matrix3d::Identity()}},
                 {"r", {m_r, {0, 0, 0}, 1e-3 * Eigen::Matrix3d::Identity()}}};
  const double a = -10 * (m_l - r * m_r) / (m_l + r * r * m_r);
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    Assembled parts;
    Options options;
    options.method = method;
    World world(scene_of(hand, {0.1}, parts), options);
    for (int n = 0; n < 200; ++n) world.step(1e-3);
    EXPECT_NEAR(world.q()[parts.joints[0]], 0.1 + 0.5 * a * 0.04, 1e-9);
    EXPECT_NEAR(world.q()[parts.joints[1]], r * (0.1 + 0.5 * a * 0.04) + 0.01, 1e-9);
  }
}

TEST(ContactWorldMimic, StepAllocatesNothingAndRestoresToTheSameBits) {
  Assembled parts;
  World world(scene_of(finger(), {0.3, 0.4}, parts), {});
  for (int n = 0; n < 10; ++n) world.step(1e-3);
  std::vector<double> state;
  world.save(state);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int n = 0; n < 50; ++n) world.step(1e-3);
  EXPECT_EQ(cotwin::testing::allocations(), before);
  const std::vector<double> q(world.q().begin(), world.q().end());
  World other(scene_of(finger(), {0.3, 0.4}, parts), {});
  other.restore(state);
  for (int n = 0; n < 50; ++n) other.step(1e-3);
  EXPECT_EQ(std::vector<double>(other.q().begin(), other.q().end()), q);
}

TEST(ContactWorldMimic, WhatCannotBeCoupledIsAnError) {
  Assembled parts;
  const scene::Scene scene = scene_of(finger(), {0.3, 0.4}, parts);
  const auto error = [&](const auto& change) {
    scene::Scene bad = scene;
    change(bad.gears[0]);
    return cotwin::testing::error_of([&] { World world(bad, {}); });
  };
  EXPECT_EQ(error([](scene::Gear&) {}), "");
  EXPECT_THAT(error([](scene::Gear& g) { g.leader = g.follower; }), HasSubstr("follows itself or two joints"));
  EXPECT_THAT(error([](scene::Gear& g) { g.leader = 99; }), HasSubstr("is no revolute or prismatic joint"));
  EXPECT_THAT(error([](scene::Gear& g) { g.offset += 0.1; }), HasSubstr("joint bend: starts at 0.42"));
  EXPECT_THAT(error([](scene::Gear& g) { g.ratio = std::nan(""); }), HasSubstr("not finite"));
}

}  // namespace
}  // namespace cotwin::contact_world::mimic_test
