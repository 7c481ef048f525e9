// Without gravity: what is pressed together holds as with it, what only touches does not, and no energy appears without a word.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "tests/components/contact_world/methods.h"

namespace cotwin::contact_world::weightless_test {
namespace {

using cotwin::testing::ball;
using cotwin::testing::box;
using Eigen::Vector3d;

constexpr double kStep = 1e-3;  // s

class Weightless : public cotwin::testing::EachMethod {
 protected:
  static World weightless(std::vector<scene::Body> bodies, std::vector<scene::Joint> joints = {}) {
    scene::Scene scene;
    scene.name = "weightless";
    scene.gravity.setZero();
    scene.bodies = std::move(bodies);
    scene.joints = std::move(joints);
    return world(std::move(scene));
  }
};

scene::Body moving(scene::Body body, const Vector3d& v) {
  body.V_WB.head<3>() = v;
  return body;
}

Wrench force(double x, double y, double z) {
  Wrench F = Wrench::Zero();
  F.head<3>() << x, y, z;
  return F;
}

TEST_P(Weightless, BlocksThatTouchFlyApart) {
  for (const double speed : {1e-12, 1e-6, 1e-3, 1.0}) {
    World w = weightless({moving(box("left", {0.1, 0.1, 0.1}, 1, {-0.05, 0, 0}, 0.8), {-speed, 0, 0}),
                          moving(box("right", {0.1, 0.1, 0.1}, 2, {0.05, 0, 0}, 0.8), {speed, 0, 0})});
    for (int k = 0; k < 200; ++k) w.step(kStep);
    EXPECT_NEAR(w.twists()[0][0], -speed, 1e-12 * speed);
    EXPECT_NEAR(w.twists()[1][0], speed, 1e-12 * speed);
  }
}

TEST_P(Weightless, WhatTouchesWithoutForceSlidesOn) {
  World w = weightless({box("plate", {1, 1, 0.1}, 5, {0, 0, -0.05}, 0.8),
                        moving(ball("ball", 0.05, 1, {-0.2, 0, 0.05}, 0.8), {0.3, 0.1, 0}),
                        moving(box("cube", {0.1, 0.1, 0.1}, 1, {0.3, 0, 0.05}, 0.8), {-0.1, 0, 0})});
  for (int k = 0; k < 500; ++k) w.step(kStep);
  EXPECT_NEAR((w.twists()[1].head<3>() - Vector3d(0.3, 0.1, 0)).norm(), 0, 1e-12);
  EXPECT_NEAR((w.twists()[2].head<3>() - Vector3d(-0.1, 0, 0)).norm(), 0, 1e-12);
  EXPECT_NEAR(w.twists()[0].norm(), 0, 1e-12);
}

// The row moves on as one; the last of it, pulled away, goes alone.
TEST_P(Weightless, APushOfOneStepIsSharedAndAPullIsNot) {
  for (const double newton : {1e-2, 1.0, 1e6}) {
    World w = weightless({box("first", {0.1, 0.1, 0.1}, 1, {0, 0, 0}, 0.8), box("second", {0.1, 0.1, 0.1}, 2, {0.1, 0, 0}, 0.8),
                          box("third", {0.1, 0.1, 0.1}, 3, {0.2, 0, 0}, 0.8)});
    w.apply(0, force(newton, 0, 0));
    for (int k = 0; k < 100; ++k) w.step(kStep);
    const double speed = newton * kStep / 6;
    for (std::size_t b = 0; b < 3; ++b) EXPECT_NEAR(w.twists()[b][0], speed, 1e-4 * speed) << newton << " N, body " << b;
    w.apply(2, force(newton, 0, 0));
    for (int k = 0; k < 100; ++k) w.step(kStep);
    EXPECT_NEAR(w.twists()[0][0], speed, 1e-4 * speed);
    EXPECT_NEAR(w.twists()[2][0], speed + newton * kStep / 3, 1e-4 * speed);
  }
}

// Coulomb's law: a block that is pressed against a plate by N holds a force along it up to μ N, beyond it accelerates by (T − μ N) / m.
TEST_P(Weightless, FrictionIsThatOfThePressingForce) {
  constexpr double kMu = 0.4, kMass = 2;
  for (const double pressing : {1e-3, 1.0, 1e3}) {
    for (const double share : {0.5, 0.98, 1.02, 2.0}) {
      scene::Body plate = box("plate", {4, 4, 0.1}, 1, {0, 0, -0.05}, kMu);
      plate.motion = scene::Motion::kStatic;
      World w = weightless({plate, box("block", {0.1, 0.1, 0.1}, kMass, {0, 0, 0.05}, kMu)});
      const double along = share * kMu * pressing, seconds = 0.1;
      for (int k = 0; k < std::lround(seconds / kStep); ++k) {
        Wrench F = force(along, 0, -pressing);
        F[4] = -0.05 * along;  // in the plane of contact, so that the block does not tilt
        w.apply(1, F);
        w.step(kStep);
      }
      const double speed = std::max(0.0, along - kMu * pressing) / kMass * seconds;
      EXPECT_NEAR(w.twists()[1][0], speed, 2e-3 * kMu * pressing / kMass * seconds) << pressing << " N, share " << share;
    }
  }
}

/// A free base whose two fingers hold a workpiece, accelerated across their direction.
TEST_P(Weightless, AFreeGripperThatAcceleratesHoldsWhatFrictionHolds) {
  constexpr double kMu = 0.6, kForce = 10, kPiece = 0.5, kRest = 1.2;  // N, kg; base and fingers
  for (const double share : {0.92, 0.98, 1.05}) {
    scene::Body base = box("base", {0.1, 0.1, 0.02}, 1, {0, 0, -0.2}, kMu);
    std::vector<scene::Body> bodies = {box("piece", {0.05, 0.05, 0.05}, kPiece, {0, 0, 0}, kMu), base,
                                       box("left", {0.02, 0.04, 0.04}, 0.1, {-0.035, 0, 0}, kMu),
                                       box("right", {0.02, 0.04, 0.04}, 0.1, {0.035, 0, 0}, kMu)};
    std::vector<scene::Joint> joints;
    for (const int finger : {2, 3}) {
      scene::Joint joint;
      joint.name = bodies[static_cast<std::size_t>(finger)].name;
      joint.type = scene::JointType::kPrismatic;
      joint.parent = 1;
      joint.child = finger;
      joint.X_PJ.p = bodies[static_cast<std::size_t>(finger)].X_WB.p - base.X_WB.p;
      joint.axis = finger == 2 ? Vector3d::UnitX() : Vector3d(-Vector3d::UnitX());
      joints.push_back(joint);
    }
    World w = weightless(bodies, joints);
    const double a = share * 2 * kMu * kForce / kPiece;
    const auto run = [&](double seconds, bool accelerates) {
      for (int k = 0; k < std::lround(seconds / kStep); ++k) {
        for (const std::size_t j : {0U, 1U}) w.set_tau(j, kForce);
        if (accelerates) w.apply(1, force(0, 0, a * kRest + std::min(a * kPiece, 2 * kMu * kForce)));
        w.step(kStep);
      }
    };
    run(0.1, false);
    const double z = w.poses()[0].p.z() - w.poses()[1].p.z();
    run(1, true);
    const double slip = std::abs(w.poses()[0].p.z() - w.poses()[1].p.z() - z);
    if (share < 1) {
      EXPECT_LT(slip, 1e-4) << share;
      EXPECT_NEAR(w.twists()[1][2], a, 1e-2 * a);
    } else {
      EXPECT_GT(slip, 0.01) << share;
    }
  }
}

/// Bodies of any shape and mass that meet, free or pressed together by springs; no work comes from outside.
scene::Scene closed_scene(unsigned seed) {
  std::mt19937_64 engine(seed);
  const auto number = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53;
  };
  const auto one_in = [&](unsigned count) { return engine() % count == 0; };
  scene::Scene scene;
  scene.name = "seed " + std::to_string(seed);
  scene.gravity.setZero();
  const int count = 2 + static_cast<int>(engine() % 5);
  const bool springs = one_in(2);
  const double size = one_in(3) ? 0.01 : 0.1, mu = number(0, 1), restitution = one_in(3) ? number(0, 1) : 0;
  for (int i = 0; i < count; ++i) {
    const double mass = std::pow(10, number(-2, 1));
    scene::Body body = box("body" + std::to_string(i), Vector3d::Constant(size), mass,
                           size * Vector3d(2.5 * i, number(-0.5, 0.5), number(-0.5, 0.5)), mu);
    scene::Shape& shape = body.shapes[0];
    shape.material.restitution = restitution;
    switch (engine() % 4) {
      case 0:
        break;
      case 1:
        shape.type = scene::ShapeType::kSphere;
        shape.size = {size * number(0.3, 1), 0, 0};
        break;
      case 2:
        shape.type = scene::ShapeType::kCapsule;
        shape.size = {size * number(0.2, 0.6), size * number(0.5, 2), 0};
        break;
      default:
        shape.type = scene::ShapeType::kCylinder;
        shape.size = {size * number(0.3, 1), size * number(0.2, 2), 0};
    }
    const Vector3d moments = Vector3d(0.2, 0.2, 0.2) + 0.1 * Vector3d(number(0, 1), number(0, 1), number(0, 1));
    body.inertia.I_CC = (mass * size * size * moments).asDiagonal();
    const bool held = springs && (i == 0 || i == count - 1);
    if (!held) {
      body.X_WB.R =
          Eigen::Quaterniond(number(-1, 1), number(-1, 1), number(-1, 1), number(-1, 1)).normalized().toRotationMatrix();
      const double v = 10 * size;
      body.V_WB << v * number(0, 1) * (count / 2.0 - i), v * number(-0.2, 0.2), v * number(-0.2, 0.2), number(-10, 10),
          number(-10, 10), number(-10, 10);
    }
    scene.bodies.push_back(body);
    if (!held) continue;
    scene::Joint joint;
    joint.name = "spring" + std::to_string(i);
    joint.type = scene::JointType::kPrismatic;
    joint.child = i;
    joint.X_PJ = body.X_WB;
    joint.axis = Vector3d::UnitX();
    joint.stiffness = std::pow(10, number(1, 3)) * mass;
    joint.q_spring = (i == 0 ? 1.5 : -1.5) * size * count;
    if (one_in(2)) joint.damping = std::sqrt(joint.stiffness * mass) * number(0, 1);
    scene.joints.push_back(joint);
  }
  return scene;
}

TEST_P(Weightless, ClosedScenesGainNoEnergyInSilence) {
  constexpr unsigned kScenes = 100;
  constexpr double kSeconds = 1;
  int met = 0;
  for (unsigned seed = 1; seed <= kScenes; ++seed) {
    World w = world(closed_scene(seed));
    const double start = w.energy();
    double least = start, rise = 0;
    bool touched = false;
    for (int k = 0; k < std::lround(kSeconds / kStep); ++k) {
      w.step(kStep);
      least = std::min(least, w.energy());
      rise = std::max(rise, w.energy() - least);
      touched = touched || w.status().contacts > 0;
    }
    met += touched;
    EXPECT_LT(rise, 1.3 * w.gain().joules + 1e-6 * start) << "seed " << seed << " of " << start << " J";
    EXPECT_LT(rise, 0.02 * start) << "seed " << seed;
  }
  EXPECT_GT(met, 60);
}

INSTANTIATE_TEST_SUITE_P(Methods, Weightless, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::weightless_test
