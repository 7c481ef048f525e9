// The public tests that are used to compare contact engines, for every method. tests/benchmarks/contact_world.cpp measures the
// same scenes in other engines.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "tests/components/contact_world/methods.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::contact_world::public_test {
namespace {

constexpr double kStep = 1e-3;     // s
constexpr double kGravity = 9.81;  // m/s²
const double kFrictionAngle = std::atan(0.5);

class PublicTest : public cotwin::testing::EachMethod {};

TEST_P(PublicTest, BallPushedObliquelySlipsAlongAParabolaAndThenRolls) {
  World w = world(cotwin::testing::pushed_ball());
  double path = 0, velocity = 0;
  for (int k = 1; k <= 2000; ++k) {
    w.step(kStep);
    Eigen::Vector3d p_WB;
    const Twist V_WB = cotwin::testing::pushed_ball_at(k * kStep, p_WB);
    path = std::max(path, (w.poses()[1].p - p_WB).norm());
    velocity = (w.twists()[1] - V_WB).norm();
  }
  EXPECT_LT(velocity, 4e-7);  // the best published error of engines with a cone; pyramids have errors of 1e-2 and more
  EXPECT_LT(path, 2e-6);      // half of the step in which it begins to roll: μ g h² / 2
}

TEST_P(PublicTest, ElasticBallBouncesToItsHeightAgain) {
  World w = world(cotwin::testing::bouncing_ball());
  const double before = energy(w);
  double highest = 0;
  for (int k = 0; k < 10000; ++k) {
    w.step(kStep);
    if (k > 9000) highest = std::max(highest, w.poses()[1].p.z());
  }
  EXPECT_LT(std::abs(energy(w) - before), 1e-9 * kGravity);  // the fall is 1 m of 1 kg
  EXPECT_NEAR(highest, 1.1, 1e-5);                           // m; h² g / 8 is the largest error between two samples
}

// Four corners strike at once, and one of them is redundant: sweeps that follow rounding errors along it would throw the box
// up.
TEST_P(PublicTest, BoxThatFallsFlatTakesNoMoreEnergyThanItBrings) {
  std::mt19937_64 engine(1);
  const auto draw = [&](double low, double high) { return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int box = 0; box < 300; ++box) {
    const double width = draw(0.05, 0.4), depth = draw(0.05, 0.4), height = draw(0.05, 0.4);  // m
    const double mass = draw(0.1, 50), speed = draw(1, 20), above = speed * kStep * draw(0.2, 3);
    scene::Scene scene;
    scene.bodies.push_back(cotwin::testing::ground(0, box % 2));
    scene.bodies.push_back(cotwin::testing::box("box", {width, depth, height}, mass, {0, 0, height / 2 + above}, 0));
    scene.bodies[1].V_WB[2] = -speed;
    World w = world(scene);
    const double before = energy(w), brought = mass * speed * speed / 2;
    for (int k = 0; k < 8; ++k) w.step(kStep);
    EXPECT_LT(energy(w) - before, 1e-3 * brought) << "box " << box;
    if (box % 2 == 1) {
      EXPECT_NEAR(energy(w), before, 1e-3 * brought) << "box " << box;
    }
  }
}

TEST_P(PublicTest, DroppedBallsHardlyPenetrate) {
  World w = world(cotwin::testing::balls(GetParam() == Method::kDantzig ? 40 : 120, 2));
  double deepest = 0;
  for (int k = 0; k < 400; ++k) {
    w.step(2e-3);
    for (const ContactPoint& point : w.contacts()) deepest = std::max(deepest, -point.gap);
  }
  EXPECT_LT(deepest, 1.5e-4);
}

TEST_P(PublicTest, BoxSticksJustBelowTheFrictionAngleAndSlipsJustAbove) {
  const double half_degree = 0.5 * M_PI / 180;
  World sticks = world(cotwin::testing::box_on_slope(kFrictionAngle - half_degree));
  for (int k = 0; k < 500; ++k) sticks.step(kStep);
  const Eigen::Vector3d there = sticks.poses()[1].p;
  for (int k = 0; k < 1000; ++k) sticks.step(kStep);
  EXPECT_LT((sticks.poses()[1].p - there).norm(), 1e-6);  // m in 1 s

  const double angle = kFrictionAngle + half_degree;
  World slips = world(cotwin::testing::box_on_slope(angle));
  const Eigen::Vector3d start = slips.poses()[1].p;
  for (int k = 0; k < 1000; ++k) slips.step(kStep);
  const double expected = 0.5 * kGravity * (std::sin(angle) - 0.5 * std::cos(angle));  // m in 1 s
  EXPECT_NEAR((slips.poses()[1].p - start).norm(), expected, 1e-3 * expected);
}

TEST_P(PublicTest, BoxHeldByFrictionDoesNotCreep) {
  World w = world(cotwin::testing::held_box());
  Eigen::Vector3d there = Eigen::Vector3d::Zero();
  for (int k = 0; k < 3000; ++k) {
    w.apply(2, (Wrench() << -50, 0, 0, 0, 0, 0).finished());
    w.step(kStep);
    if (k == 999) there = w.poses()[1].p;
  }
  EXPECT_LT((w.poses()[1].p - there).norm() / 2, 1e-6);  // m/s
}

TEST_P(PublicTest, FloatingArmKeepsMomentumAndEnergy) {
  const std::array<double, 7> q{0.3, -0.9, 0.4, 1.2, -0.5, 0.8, 0.2}, dq{0.5, -0.4, 0.6, 0.5, -0.7, 0.4, 0.6};
  World w = world(cotwin::testing::floating_arm(q, dq));
  const double E = energy(w);
  const Wrench P = momentum(w);
  double lost = 0;
  for (int k = 0; k < 10000; ++k) {
    w.step(kStep);
    lost = std::max(lost, std::abs(energy(w) / E - 1));
  }
  EXPECT_LT((momentum(w) - P).norm() / P.norm(), 1e-12);
  EXPECT_LT(lost, 1e-3);             // symplectic: bounded, of order h²
  EXPECT_LT(w.largest_gap(), 1e-9);  // m
}

TEST_P(PublicTest, BodyTurningAboutItsMiddleAxisKeepsMomentumAndEnergy) {
  World w = world(cotwin::testing::spinning_box());
  const double E = energy(w);
  const Wrench P = momentum(w);
  double lost = 0, most = 0;
  for (int k = 0; k < 10000; ++k) {
    w.step(kStep);
    lost = std::max(lost, std::abs(energy(w) / E - 1));
    most = std::max(most, std::abs(w.twists()[0].tail<3>().dot(w.poses()[0].R.col(0))));
  }
  EXPECT_LT((momentum(w) - P).norm() / P.norm(), 1e-12);
  EXPECT_LT(lost, 1e-4);
  EXPECT_GT(most, 1);  // it does tumble: the rotation about the middle axis is unstable
}

TEST_P(PublicTest, TossedBoxComesToRest) {
  World w = world(cotwin::testing::tossed_box());
  for (int k = 0; k < 4000; ++k) w.step(kStep);
  EXPECT_LT(w.twists()[1].norm(), 1e-8);
  EXPECT_NEAR(std::abs(w.poses()[1].R.row(2).cwiseAbs().maxCoeff()), 1, 1e-6);  // on a face
}

TEST_P(PublicTest, StackOfTenStaysWhereItIs) {
  World w = world(cotwin::testing::stack(10));
  const Eigen::Vector3d edges = Eigen::Vector3d::Constant(cotwin::testing::kStackEdge);
  double depth = 0, drift = 0;
  for (int k = 0; k < 2000; ++k) {
    w.step(kStep);
    for (std::size_t i = 2; i <= 10; ++i)
      depth = std::max(depth, cotwin::testing::depth_on_top(w.poses()[i], w.poses()[i - 1], edges));
    for (std::size_t i = 1; i <= 10; ++i) drift = std::max(drift, w.poses()[i].p.head<2>().norm());
  }
  EXPECT_LT(depth, 2e-5);  // m
  EXPECT_LT(drift, 1e-4);  // m
}

// With pivoting alone each box would rest on two of its corners; with sweeps alone the tower would sway slowly.
TEST_P(PublicTest, StackOfTenLoadsAllItsCornersAndIsSolvedFromTheLastStep) {
  Options options;
  options.method = GetParam();
  options.iterations = 10;
  World w(cotwin::testing::stack(10), options);
  for (int k = 0; k < 2000; ++k) w.step(kStep);
  ASSERT_EQ(w.contacts().size(), 40u);
  for (std::size_t c = 0; c < 40; ++c) {
    const double carried = 10 - static_cast<double>(c / 4);  // kg on this pair, and N on the corner
    const double share = GetParam() == Method::kDantzig ? 0.01 : 0.005;
    EXPECT_GT(w.contacts()[c].n_W.dot(w.forces()[c]), share * carried * kGravity);
  }
  int pivots = 0;
  double residual = 0;
  for (int k = 0; k < 100; ++k) {
    w.step(kStep);
    pivots = std::max(pivots, w.status().iterations);
    residual = std::max(residual, w.status().residual);
  }
  if (GetParam() == Method::kDantzig) {
    EXPECT_LE(pivots, 1);        // the sweep that finds nothing to do
    EXPECT_LT(residual, 1e-14);  // m/s
  } else {
    EXPECT_LT(residual, 5e-8);  // m/s; without the best step along each sweep 4e-7
  }
}

TEST_P(PublicTest, ABoxPressesOnTheGroundWithItsWeightWhileOthersAreMovedApart) {
  // Fast steps in a pile end in depths that are corrected at once, which must not touch what happens elsewhere.
  Options options;
  options.method = GetParam();
  options.contacts = 1024;
  scene::Scene scene = cotwin::testing::pile(40, 1);
  scene.bodies.push_back(cotwin::testing::box("beside", {0.2, 0.2, 0.2}, 2, {20, 0, 0.1}, 0.5));
  const auto beside = static_cast<int>(scene.bodies.size()) - 1;
  World w(scene, options);
  int deep = 0;
  for (int k = 0; k < 400; ++k) {
    w.step(2e-3);
    double force = 0;
    for (std::size_t c = 0; c < w.contacts().size(); ++c) {
      deep += w.contacts()[c].gap < -1e-4;
      if (w.contacts()[c].body_b == beside) force += w.forces()[c].z();
    }
    if (k > 5) {
      ASSERT_NEAR(force, 2 * kGravity, 0.01 * 2 * kGravity) << k;
    }
  }
  EXPECT_GT(deep, 10);
}

TEST_P(PublicTest, MotorsHoldTheArmBesideAStack) {
  const std::array<double, 7> start{0.3, -0.9, 0.4, 1.2, -0.5, 0.8, 0.2};
  scene::Scene scene = cotwin::testing::arm(start);
  const scene::Scene stack = cotwin::testing::stack(5);
  for (scene::Body body : stack.bodies) {
    body.X_WB.p.x() += 2;
    scene.bodies.push_back(body);
  }
  World w = world(scene);
  for (std::size_t i = 0; i < start.size(); ++i) w.set_motor(i, 0, 1000);
  for (int k = 0; k < 2000; ++k) w.step(kStep);
  for (std::size_t i = 0; i < start.size(); ++i) EXPECT_NEAR(w.q()[i], start[i], 1e-5);
  EXPECT_LT(w.largest_gap(), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Methods, PublicTest, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::public_test
