// Bodies that move farther in a step than they are large: they meet what is in their way, and nothing else.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "tests/components/contact_world/methods.h"
#include "tests/support/allocations.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::contact_world::fast_test {
namespace {

using Eigen::Vector3d;

constexpr double kStep = 1e-3;                    // s
constexpr double kRadius = 0.005, kMass = 0.004;  // of the bullet
constexpr double kSpeed = 300;                    // m/s
constexpr double kWall = 0.005;                   // thickness, m

scene::Scene empty() {
  scene::Scene scene;
  scene.gravity.setZero();
  return scene;
}

scene::Body plate(const std::string& name, const Vector3d& edges, const Vector3d& p, double mu = 0, double restitution = 0) {
  scene::Body body = cotwin::testing::box(name, edges, 1, p, mu);
  body.motion = scene::Motion::kStatic;
  body.shapes[0].material.restitution = restitution;
  return body;
}

scene::Body bullet(const Vector3d& p, const Vector3d& v, double restitution = 0) {
  scene::Body body = cotwin::testing::ball("bullet", kRadius, kMass, p, 0, restitution);
  body.V_WB.head<3>() = v;
  return body;
}

class Fast : public cotwin::testing::EachMethod {};

TEST_P(Fast, ABulletBouncesOffAThinWallByItsRestitution) {
  // v⁺ = −e v⁻. Starts all over the way of a step, so that every phase of the impact in the step occurs.
  for (const double e : {0.0, 0.5, 1.0}) {
    for (int start = 0; start < 31; ++start) {
      scene::Scene scene = empty();
      scene.bodies.push_back(plate("wall", {kWall, 2, 2}, {2, 0, 0}, 0, e));
      scene.bodies.push_back(bullet({0.01003 * start, 0, 0}, {kSpeed, 0, 0}, e));
      World w = world(scene);
      double farthest = 0;
      for (int k = 0; k < 12; ++k) {
        w.step(kStep);
        farthest = std::max(farthest, w.poses()[1].p.x());
      }
      EXPECT_NEAR(w.twists()[1][0], -e * kSpeed, e > 0 ? 1e-9 : 3e-3) << e << " " << start;
      EXPECT_LE(farthest, 2 - kWall / 2 - kRadius + 1e-6) << e << " " << start;
      if (e == 0) {
        EXPECT_NEAR(w.poses()[1].p.x(), 2 - kWall / 2 - kRadius, 1e-5) << start;
      }
    }
  }
}

TEST_P(Fast, ABulletPassesAHoleThatIsBarelyWider) {
  // No contact: a straight line at constant speed.
  const double clearance = 1e-4;
  for (int start = 0; start < 31; ++start) {
    scene::Scene scene = empty();
    for (const double side : {-1, 1}) {
      const double y = side * (0.5 + kRadius + clearance);
      scene.bodies.push_back(plate(side < 0 ? "left" : "right", {0.05, 1, 1}, {1, y, 0}));
    }
    scene.bodies.push_back(bullet({0.01 * start, 0, 0}, {kSpeed, 0, 0}));
    World w = world(scene);
    for (int k = 0; k < 8; ++k) w.step(kStep);
    EXPECT_EQ(w.twists()[2].head<3>(), Vector3d(kSpeed, 0, 0)) << start;
    EXPECT_NEAR(w.poses()[2].p.x(), 0.01 * start + 8 * kStep * kSpeed, 1e-12) << start;
  }
}

TEST_P(Fast, ABulletThatGrazesABallIsDeflectedAsByTheClosedForm) {
  // At the distance b of the line from the centre, n = (−√(1 − s²), s) with s = b / (r₁ + r₂); v⁺ = v − (1 + e) (n · v) n.
  const double large = 0.05, both = large + kRadius;
  for (const double s : {0.1, 0.7, 0.99, 1.001, 1.05}) {
    for (int start = 0; start < 13; ++start) {
      scene::Scene scene = empty();
      scene::Body post = cotwin::testing::ball("post", large, 1, {1.3, 0, 0}, 0, 1);
      post.motion = scene::Motion::kStatic;
      scene.bodies.push_back(post);
      scene.bodies.push_back(bullet({0.023 * start, s * both, 0}, {kSpeed, 0, 0}, 1));
      World w = world(scene);
      for (int k = 0; k < 8; ++k) w.step(kStep);
      const Vector3d n(s < 1 ? -std::sqrt(1 - s * s) : 0, s, 0);
      const Vector3d v(kSpeed, 0, 0), after = s < 1 ? Vector3d(v - 2 * n.dot(v) * n) : v;
      // The bullet stops up to 2e-6 m before it touches: s is off by up to 2e-6 / both, the angle by that / cos.
      EXPECT_LT((w.twists()[1].head<3>() - after).norm(), kSpeed * 4 * 4e-5 / std::max(0.1, -n.x())) << s << " " << start;
      EXPECT_NEAR(w.twists()[1].head<3>().norm(), kSpeed, 1e-9);
    }
  }
}

TEST_P(Fast, TwoBulletsExchangeTheirVelocities) {
  for (int start = 0; start < 21; ++start) {
    scene::Scene scene = empty();
    scene.bodies.push_back(bullet({-1 - 0.0137 * start, 0, 0}, {kSpeed, 0, 0}, 1));
    scene.bodies.push_back(bullet({1, 0, 0}, {-0.8 * kSpeed, 0, 0}, 1));
    scene.bodies[1].name = "other";
    World w = world(scene);
    for (int k = 0; k < 10; ++k) w.step(kStep);
    EXPECT_NEAR(w.twists()[0][0], -0.8 * kSpeed, 1e-9) << start;
    EXPECT_NEAR(w.twists()[1][0], kSpeed, 1e-9) << start;
    EXPECT_LT(w.poses()[0].p.x(), w.poses()[1].p.x()) << start;
  }
}

TEST_P(Fast, ABulletStrikesASlowBlockThatComesAlong) {
  // Elastic impact of masses m and M: v⁺ = v − 2 M / (m + M) (v − V).
  for (const double V : {-9.0, 9.0}) {
    for (int start = 0; start < 21; ++start) {
      scene::Scene scene = empty();
      scene::Body block = cotwin::testing::box("block", {0.1, 0.4, 0.4}, 1, {1.2, 0, 0}, 0);
      block.shapes[0].material.restitution = 1;
      block.V_WB[0] = V;
      scene.bodies.push_back(block);
      scene.bodies.push_back(bullet({0.0141 * start, 0, 0}, {kSpeed, 0, 0}, 1));
      World w = world(scene);
      for (int k = 0; k < 8; ++k) w.step(kStep);
      EXPECT_NEAR(w.twists()[1][0], kSpeed - 2 / (kMass + 1) * (kSpeed - V), 1e-8) << V << " " << start;
      EXPECT_NEAR(momentum(w)[0], V + kMass * kSpeed, 1e-10);
    }
  }
}

TEST_P(Fast, AFastRodStrikesAPlateAndKeepsItsEnergy) {
  // 300 rad/s and 200 m/s: the tips of a rod of 1.2 m move up to 380 mm in a step. e = 1 without friction:
  // energy is kept, and the rod does not get through the plate.
  for (int start = 0; start < 16; ++start) {
    scene::Scene scene = empty();
    scene.bodies.push_back(plate("plate", {4, 2, 0.004}, {0, 0, -0.1}, 0, 1));
    scene::Body rod = cotwin::testing::box("rod", {1.2, 0.008, 0.008}, 0.2, {0, 0, 0.3 + 0.017 * start}, 0);
    rod.shapes[0].material.restitution = 1;
    rod.V_WB[4] = 300;
    rod.V_WB[2] = -200;
    rod.X_WB.R = Eigen::AngleAxisd(0.013 * start, Vector3d::UnitY()).toRotationMatrix();
    scene.bodies.push_back(rod);
    World w = world(scene);
    const double before = energy(w);
    for (int k = 0; k < 40; ++k) {
      w.step(kStep);
      const Vector3d tip = w.poses()[1].R.col(0) * 0.6;
      const double lowest = w.poses()[1].p.z() - std::abs(tip.z());
      ASSERT_GT(lowest, -0.1 + 0.002 - 0.001) << start << " step " << k;
    }
    EXPECT_NEAR(energy(w), before, 1e-9 * before) << start;
    EXPECT_GT(w.twists()[1][2], 0) << start;
  }
}

TEST_P(Fast, NothingLeavesAClosedRoomOfThinWalls) {
  // Balls, boxes, rods, capsules and cylinders at up to 300 m/s and 500 rad/s, or a hundredth of it. With e < 1 and friction the energy never grows.
  // e = 1 without friction: it stays to rounding.
  for (int run = 0; run < 24; ++run) {
    const double e = run % 2 == 0 ? 1.0 : 0.6, share = run % 4 < 2 ? 1 : 0.01;
    scene::Scene scene = empty();
    const double half = 0.4, mu = e < 1 ? 0.3 : 0;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double side : {-1.0, 1.0}) {
        Vector3d edges = Vector3d::Constant(2 * half + 2 * kWall);
        edges[axis] = kWall;
        const std::string name = "wall" + std::to_string(scene.bodies.size());
        scene.bodies.push_back(plate(name, edges, side * (half + kWall / 2) * Vector3d::Unit(axis), mu, e));
      }
    }
    std::mt19937 random(static_cast<unsigned>(run / 2 + 1));
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto direction = [&] {  // in the same order with every compiler
      const double z = unit(random), y = unit(random), x = unit(random);
      return Vector3d(x, y, z);
    };
    for (int i = 0; i < 12; ++i) {
      const Vector3d p(-0.3 + 0.2 * (i % 4), -0.2 + 0.2 * (i / 4), 0.05 * unit(random));
      // Bodies with two equal moments of inertia: the free rotation of others keeps its energy to second order only.
      const Vector3d edges = i % 4 == 1 ? Vector3d(0.016, 0.016, 0.006) : Vector3d(0.006, 0.006, 0.06);
      scene::Body body =
          i % 4 == 0 ? cotwin::testing::ball("x", kRadius, kMass, p, mu) : cotwin::testing::box("x", edges, kMass, p, mu);
      if (i % 4 == 3) {
        body.shapes[0].type = i % 8 == 3 ? scene::ShapeType::kCapsule : scene::ShapeType::kCylinder;
        body.shapes[0].size = {0.003, 0.05, 0};
      }
      body.name = "body" + std::to_string(i);
      body.shapes[0].material.restitution = e;
      body.V_WB.head<3>() = share * 200 * direction();
      body.V_WB.tail<3>() = share * 300 * direction();
      scene.bodies.push_back(body);
    }
    World w = world(scene);
    const double start = energy(w);
    double least = start, gain = 0;
    for (int k = 0; k < 400; ++k) {
      w.step(kStep);
      const double now = energy(w);
      gain = std::max(gain, now / least - 1);
      least = std::min(least, now);
      for (std::size_t b = 6; b < w.poses().size(); ++b) {
        ASSERT_LT(w.poses()[b].p.cwiseAbs().maxCoeff(), half) << run << " body " << b << " step " << k;
      }
    }
    EXPECT_LT(gain, 1e-9) << run;
    if (e == 1) {
      EXPECT_GT(least, start * (1 - 1e-9)) << run;
    }
  }
}

// A ball in a hollow box that is free, too: what all have together stays, at 20 m/s also where both are fast.
TEST_P(Fast, AFreeRoomAndItsBallKeepEnergyAndMomentum) {
  for (const double speed : {1.0, 20.0}) {
    scene::Scene scene = empty();
    scene::Body room = cotwin::testing::box("room", {0.4, 0.4, 0.4}, 2, {0, 0, 0}, 0);
    const scene::Shape wall = room.shapes[0];
    room.shapes.clear();
    for (int axis = 0; axis < 3; ++axis) {
      for (const double side : {-1.0, 1.0}) {
        room.shapes.push_back(wall);
        room.shapes.back().size = Vector3d::Constant(0.4 + 2 * kWall);
        room.shapes.back().size[axis] = kWall;
        room.shapes.back().X_BS.p = side * (0.2 + kWall / 2) * Vector3d::Unit(axis);
        room.shapes.back().material.restitution = 1;
      }
    }
    room.V_WB << 3, -2, 1, 0.1, 0.2, -0.1;
    scene::Body ball = cotwin::testing::ball("ball", 0.03, 0.5, {0.05, 0.02, -0.04}, 0, 1);
    ball.V_WB.head<3>() = Vector3d(3, -2, 1) + speed * Vector3d(1, 0.3, -0.7);
    scene.bodies = {room, ball};
    World w = world(scene);
    const double before = energy(w);
    const Wrench start = momentum(w);
    int impacts = 0;
    for (int k = 0; k < 20'000; ++k) {
      w.step(kStep);
      impacts += w.status().impacts;
    }
    EXPECT_GT(impacts, 50 * speed);
    EXPECT_NEAR(energy(w) / before, 1, 1e-12) << speed;
    EXPECT_LT((momentum(w) - start).head<3>().norm(), 1e-12) << speed;
    EXPECT_LT((momentum(w) - start).tail<3>().norm(), 1e-8) << speed;  // corrections of depth move them at their speeds
    EXPECT_LT((w.poses()[1].p - w.poses()[0].p).norm(), 0.35) << speed;
  }
}

TEST_P(Fast, GravityGivesNoEnergyInTheTimeThatABodyLoses) {
  // Between floor and ceiling with e = 1: energy of the closed form throughout.
  scene::Scene scene;
  scene.bodies.push_back(plate("floor", {1, 1, kWall}, {0, 0, -0.5}, 0, 1));
  scene.bodies.push_back(plate("ceiling", {1, 1, kWall}, {0, 0, 0.5}, 0, 1));
  scene.bodies.push_back(bullet({0, 0, 0.1}, {0, 0, -kSpeed}, 1));
  World w = world(scene);
  const double before = energy(w);
  for (int k = 0; k < 3000; ++k) w.step(kStep);
  EXPECT_NEAR(energy(w), before, 1e-6 * before);
  EXPECT_LE(energy(w), before * (1 + 1e-10));
}

TEST_P(Fast, ABulletStrikesAHingedDoor) {
  // Plastic: angular momentum about the hinge, m v r = (I + m r²) ω at once.
  scene::Scene scene = empty();
  scene::Body door = cotwin::testing::box("door", {kWall, 0.8, 0.8}, 2, {1, 0.4, 0}, 0);
  scene.bodies.push_back(door);
  scene::Joint hinge;
  hinge.name = "hinge";
  hinge.child = 0;
  hinge.axis = Vector3d::UnitZ();
  hinge.X_PJ.p = {1, 0, 0};
  hinge.X_CJ.p = {0, -0.4, 0};
  scene.joints.push_back(hinge);
  scene.bodies.push_back(bullet({0.133, 0.6, 0}, {kSpeed, 0, 0}));
  World w = world(scene);
  int steps = 0;
  while (w.dq()[0] == 0 && steps < 10) w.step(kStep), ++steps;
  EXPECT_EQ(steps, 3);
  const double I = 2 * (0.8 * 0.8 + kWall * kWall) / 12 + 2 * 0.4 * 0.4, r = 0.6;
  EXPECT_NEAR(w.dq()[0], -kMass * kSpeed * r / (I + kMass * r * r), 1e-3);
  EXPECT_LT(w.poses()[1].p.x(), 1);
}

TEST_P(Fast, StepsDoNotAllocateAndRestoreToTheBit) {
  scene::Scene scene = empty();
  scene.bodies.push_back(plate("wall", {kWall, 1, 1}, {0.5, 0, 0}, 0.3, 0.9));
  scene.bodies.push_back(plate("other wall", {kWall, 1, 1}, {-0.5, 0, 0}, 0.3, 0.9));
  for (int i = 0; i < 4; ++i) {
    scene::Body body = cotwin::testing::box("box" + std::to_string(i), {0.02, 0.01, 0.006}, kMass, {0, 0.05 * i - 0.1, 0}, 0.3);
    body.V_WB << 200 - 100 * i, 1, 2, 100, 200, 50 * i;
    scene.bodies.push_back(body);
  }
  World a = world(scene), b = world(scene);
  for (int k = 0; k < 3; ++k) a.step(kStep);
  std::vector<double> state(a.state_size());
  for (int k = 0; k < 60; ++k) {
    a.save(state);
    b.restore(state);
    const std::size_t before = cotwin::testing::allocations();
    a.step(kStep);
    EXPECT_EQ(cotwin::testing::allocations(), before) << k;
    b.step(kStep);
    for (std::size_t i = 0; i < a.poses().size(); ++i) {
      ASSERT_TRUE(a.poses()[i] == b.poses()[i]) << k;
      ASSERT_TRUE(a.twists()[i] == b.twists()[i]) << k;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Fast, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::fast_test
