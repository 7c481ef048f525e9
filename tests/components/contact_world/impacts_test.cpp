// Impacts with restitution: several bodies at once, friction, joints, for every method.

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

namespace cotwin::contact_world::impacts_test {
namespace {

using Eigen::Vector3d;

constexpr double kStep = 1e-3;  // s
constexpr double kRadius = 0.05, kMass = 0.2;

class Impacts : public cotwin::testing::EachMethod {};

/// Balls in a row along x without gravity, all but the first at rest; the first one moves at 1 m/s.
scene::Scene row(const std::vector<double>& masses, double gap, double restitution) {
  scene::Scene scene;
  scene.gravity.setZero();
  for (std::size_t i = 0; i < masses.size(); ++i) {
    const double x = static_cast<double>(i) * (2 * kRadius + gap) - (i == 0 ? 0.0037 : 0);
    scene.bodies.push_back(cotwin::testing::ball("ball" + std::to_string(i), kRadius, masses[i], {x, 0, 0}, 0.3, restitution));
  }
  scene.bodies[0].V_WB[0] = 1;
  return scene;
}

TEST_P(Impacts, PassThroughARowOfBallsWithAndWithoutGaps) {
  // Two equal balls exchange their velocities; so does each pair of a row with gaps.
  for (const double gap : {0.5e-3, 1e-4, 0.0}) {
    for (const std::size_t count : {5u, 20u}) {
      World w = world(row(std::vector<double>(count, kMass), gap, 1));
      for (int k = 0; k < 60; ++k) w.step(kStep);
      EXPECT_NEAR(w.twists().back()[0], 1, 1e-12) << gap;
      EXPECT_NEAR(energy(w), kMass / 2, 1e-14) << gap;
    }
  }
}

TEST_P(Impacts, TwoBallsThatStrikeARowDriveTwoBallsOut) {
  scene::Scene scene = row(std::vector<double>(6, kMass), 0, 1);
  scene.bodies[1].X_WB.p.x() = scene.bodies[0].X_WB.p.x() + 2 * kRadius;
  scene.bodies[1].V_WB[0] = 1;
  World w = world(scene);
  for (int k = 0; k < 60; ++k) w.step(kStep);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(w.twists()[i][0], i < 4 ? 0 : 1, 1e-12) << i;
}

TEST_P(Impacts, LoseTheEnergyThatNewtonsLawSaysInEachPair) {
  // The first pulse through a row whose masses fall: v_{i+1} = (1 + e) m_i / (m_i + m_{i+1}) v_i; no ball is struck twice.
  const std::vector<double> masses{1, 0.5, 0.25, 0.125};
  const double e = 0.6;
  World w = world(row(masses, 0.5e-3, e));
  for (int k = 0; k < 8; ++k) w.step(kStep);
  double v = 1;
  for (std::size_t i = 0; i + 1 < masses.size(); ++i) {
    const double next = (1 + e) * masses[i] / (masses[i] + masses[i + 1]) * v;
    EXPECT_NEAR(w.twists()[i][0], v - masses[i + 1] / masses[i] * next, 1e-12);
    v = next;
  }
  EXPECT_NEAR(w.twists().back()[0], v, 1e-12);
}

TEST_P(Impacts, SwingACradleOnHingesWithoutLoss) {
  const double start = 0.3;
  for (const double gap : {0.5e-3, 0.0}) {
    scene::Scene scene;
    for (int i = 0; i < 5; ++i) {
      const double angle = i == 0 ? start : 0;
      const Vector3d above(i * (2 * kRadius + gap), 0, 0);
      scene::Body body = cotwin::testing::ball("ball" + std::to_string(i), kRadius, kMass, above, 0, 1);
      body.X_WB.R = Eigen::AngleAxisd(angle, Vector3d::UnitY()).toRotationMatrix();
      body.X_WB.p -= body.X_WB.R.col(2);
      scene.bodies.push_back(body);
      scene::Joint joint;
      joint.name = "hinge" + std::to_string(i);
      joint.child = i;
      joint.axis = Vector3d::UnitY();
      joint.X_PJ.p = above;
      joint.X_CJ.p = {0, 0, 1};
      scene.joints.push_back(joint);
    }
    World w = world(scene);
    const double before = energy(w), fall = kMass * 9.81 * (1 - std::cos(start));
    double first = 0, last = 0;
    for (int k = 0; k < 10000; ++k) {
      w.step(kStep);
      if (k >= 900) continue;
      first = std::max(first, std::abs(w.twists()[0][0]));
      last = std::max(last, std::abs(w.twists()[4][0]));
    }
    EXPECT_NEAR(last, first, 1e-4 * first) << gap;
    EXPECT_NEAR(energy(w), before, 1e-3 * fall) << gap;
  }
}

TEST_P(Impacts, BreakATriangleOfBallsSymmetrically) {
  scene::Scene scene;
  scene.gravity.setZero();
  const double side = kRadius * std::sqrt(3.0);
  scene.bodies.push_back(cotwin::testing::ball("cue", kRadius, kMass, {-0.3, 0, 0}, 0, 1));
  scene.bodies[0].V_WB[0] = 5;
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k <= i; ++k) {
      const Vector3d p(i * side, (2 * k - i) * kRadius, 0);
      scene.bodies.push_back(cotwin::testing::ball("ball" + std::to_string(scene.bodies.size()), kRadius, kMass, p, 0, 1));
    }
  }
  World w = world(scene);
  const double before = energy(w);
  const Wrench momentum_before = momentum(w);
  for (int k = 0; k < 150; ++k) w.step(kStep);
  EXPECT_NEAR(energy(w), before, 1e-12 * before);
  EXPECT_LT((momentum(w) - momentum_before).norm(), 1e-13);
  std::size_t first = 1;
  for (std::size_t i = 0; i < 5; first += ++i) {
    for (std::size_t k = 0; k <= i; ++k) {
      EXPECT_NEAR(w.twists()[first + k][0], w.twists()[first + i - k][0], 1e-12);
      EXPECT_NEAR(w.twists()[first + k][1], -w.twists()[first + i - k][1], 1e-12);
    }
  }
}

TEST_P(Impacts, OfALightBallBetweenAHeavyOneAndAWallKeepTheEnergy) {
  // With masses 1 : 10⁴ the three collide ⌊π / arctan(1/100)⌋ = 314 times.
  scene::Scene scene = row({1e4, 1}, 0.5e-3, 1);
  scene::Body wall = cotwin::testing::box("wall", {0.1, 1, 1}, 1, {3 * kRadius + 0.5e-3 + 0.05, 0, 0}, 0);
  wall.motion = scene::Motion::kStatic;
  wall.X_WB.p.x() = scene.bodies[1].X_WB.p.x() + kRadius + 0.05;
  scene.bodies.push_back(wall);
  World w = world(scene);
  int impacts = 0;
  for (int k = 0; k < 60; ++k) {
    w.step(kStep);
    impacts += w.status().impacts;
  }
  EXPECT_EQ(impacts, 314);
  EXPECT_NEAR(energy(w), 5e3, 1e-9 * 5e3);
  EXPECT_LT(w.twists()[0][0], -0.99);
}

TEST_P(Impacts, LeaveABoxThatFallsFlatUpright) {
  std::mt19937_64 engine(1);
  const auto draw = [&](double low, double high) { return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int i = 0; i < 100; ++i) {
    const Vector3d edges(draw(0.05, 0.4), draw(0.05, 0.4), draw(0.05, 0.4));
    const double mass = draw(0.1, 5), speed = draw(1, 6);
    scene::Scene scene;
    scene.bodies.push_back(cotwin::testing::ground(0.5, 1));
    scene.bodies.push_back(cotwin::testing::box("box", edges, mass, {0, 0, edges.z() / 2 + draw(0, 0.02)}, 0.5));
    scene.bodies[1].V_WB[2] = -speed;
    World w = world(scene);
    const double before = energy(w);
    for (int k = 0; k < 50; ++k) w.step(kStep);
    EXPECT_NEAR(energy(w), before, 1e-10 * before) << i;
    EXPECT_LT(w.twists()[1].tail<3>().norm(), 1e-9) << i;
  }
}

TEST_P(Impacts, OfCornersNeverCreateEnergyWithFrictionNorLoseAnyWithoutIt) {
  std::mt19937_64 engine(2);
  const auto draw = [&](double low, double high) { return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int i = 0; i < 120; ++i) {
    const double mu = i % 2 == 0 ? draw(0.2, 1) : 0, e = i % 4 < 2 ? 1 : 0.5;
    scene::Scene scene;
    scene.bodies.push_back(cotwin::testing::ground(mu, e));
    scene.bodies.push_back(cotwin::testing::box("box", {0.1, 0.2, 0.3}, 1, {0, 0, 0.25}, mu));
    Eigen::Quaterniond turned(draw(-1, 1), draw(-1, 1), draw(-1, 1), draw(-1, 1));
    scene.bodies[1].X_WB.R = turned.normalized().toRotationMatrix();
    for (int k = 0; k < 6; ++k) scene.bodies[1].V_WB[k] = draw(-1, 1) * (k < 3 ? 2 : 8);
    World w = world(scene);
    const double before = energy(w);
    for (int k = 0; k < 600; ++k) w.step(kStep);
    EXPECT_LT(energy(w), before + 1e-4) << i;  // J; free tumbling exchanges 6e-6
    if (mu == 0 && e == 1) {
      EXPECT_NEAR(energy(w), before, 1e-4) << i;
    }
  }
}

TEST_P(Impacts, OfABallWithRestingBodiesWithoutRestitutionFollowNewton) {
  // The box rests on the ground without restitution and carries the impact as one body with the ground.
  scene::Scene scene;
  scene.bodies.push_back(cotwin::testing::ground(0.5));
  scene.bodies.push_back(cotwin::testing::box("box", {0.2, 0.2, 0.1}, 0.5, {0, 0, 0.05}, 0.5));
  scene.bodies.push_back(cotwin::testing::ball("ball", kRadius, 2, {0, 0, 0.1 + kRadius + 0.2}, 0.5, 0.7));
  World w = world(scene);
  double down = 0, up = 0;
  for (int k = 0; k < 250; ++k) {
    w.step(kStep);
    down = std::min(down, w.twists()[2][2]);
    up = std::max(up, w.twists()[2][2]);
  }
  EXPECT_NEAR(up, -0.7 * down, 2 * 9.81 * kStep);  // up to the gravity of one step
  EXPECT_LT(w.twists()[1].norm(), 1e-6);
}

TEST_P(Impacts, StrikeAnArmThroughAllItsJoints) {
  // A free chain of two links, struck at its end: with (2a), the ball sees the inertia 1 / (J M⁻¹ Jᵀ) of the articulated chain.
  scene::Scene scene;
  scene.gravity.setZero();
  for (int i = 0; i < 2; ++i)
    scene.bodies.push_back(cotwin::testing::box("link" + std::to_string(i), {1, 0.1, 0.1}, 1, {1.0 * i, 0, 0}, 0));
  scene::Joint joint;
  joint.name = "hinge";
  joint.parent = 0;
  joint.child = 1;
  joint.axis = Vector3d::UnitZ();
  joint.X_PJ.p = {0.5, 0, 0};
  joint.X_CJ.p = {-0.5, 0, 0};
  scene.joints.push_back(joint);
  scene.bodies.push_back(cotwin::testing::ball("ball", kRadius, 1, {1.4, 0.1 + 0.0137, 0}, 0, 1));
  scene.bodies[2].V_WB[1] = -2;
  // Impulses J at the tip and H at the hinge, along y, with I the moment of a link about z:
  //   link 1: v₁ = J + H, ω₁ I = 0.4 J − 0.5 H;   link 0: v₀ = −H, ω₀ I = −0.5 H;   v₀ + 0.5 ω₀ = v₁ − 0.5 ω₁
  const double I = (1 + 0.01) / 12;
  const double H = (0.2 / I - 1) / (2 + 0.5 / I);
  const double mobility = 1 + H + 0.4 / I * (0.4 - 0.5 * H);
  const double J = -2 * 2 / (1 + mobility);  // 1 kg at 2 m/s, e = 1
  World w = world(scene, 1000);
  for (int k = 0; k < 20; ++k) w.step(kStep);
  EXPECT_NEAR(w.twists()[2][1], -2 - J, 1e-9);
  EXPECT_NEAR(energy(w), 2, 1e-6);
}

TEST_P(Impacts, AllocateNothingAndGiveTheSameBitsAgain) {
  const auto scene = [] {
    scene::Scene made = cotwin::testing::balls(60, 3);
    for (scene::Body& body : made.bodies) {
      for (scene::Shape& shape : body.shapes) shape.material.restitution = 0.9;
    }
    return made;
  };
  World w = world(scene()), other = world(scene());
  int most = 0;
  for (int k = 0; k < 400; ++k) {
    const auto before = cotwin::testing::allocations();
    w.step(kStep);
    EXPECT_EQ(cotwin::testing::allocations(), before);
    most = std::max(most, w.status().impacts);
  }
  for (int k = 0; k < 400; ++k) other.step(kStep);
  EXPECT_GT(most, 1);
  for (std::size_t b = 0; b < w.poses().size(); ++b) {
    EXPECT_EQ(w.poses()[b].p, other.poses()[b].p);
    EXPECT_EQ(w.twists()[b], other.twists()[b]);
  }
}

TEST_P(Impacts, OfElasticSpringsKeepTheSpeedAtAnyStiffness) {
  for (const double k : {1e4, 1e6, 1e7, 1e9}) {
    for (int phase = 0; phase < 10; ++phase) {
      scene::Scene scene;
      scene.gravity.setZero();
      const double speed = 0.991;
      scene.bodies.push_back(cotwin::testing::ground(0));
      scene.bodies.push_back(cotwin::testing::ball("ball", 0.1, 1, {0, 0, 0.11 + phase * speed * kStep / 10}, 0));
      scene.bodies[1].shapes[0].material.stiffness = k;
      scene.bodies[1].V_WB[2] = -speed;
      World w = world(scene);
      double force = 0;
      for (int i = 0; i < 100; ++i) {
        w.step(kStep);
        for (const Vector3d& f : w.forces()) force = std::max(force, f.norm());
      }
      EXPECT_NEAR(w.twists()[1][2], speed, 1e-9) << k << " " << phase;
      const double peak = speed * std::sqrt(k);  // of the closed form, 1 kg
      EXPECT_LT(force, 1.001 * peak);
      if (k < 1e5) {
        EXPECT_GT(force, 0.995 * peak);
      }
    }
  }
}

TEST_P(Impacts, OfADampedSpringOnAStifferOneHaveTheRestitutionOfTheClosedForm) {
  // Springs in series; contact ends where the force is 0: e = exp(−ζ/√(1−ζ²) (π − atan(2ζ√(1−ζ²)/(1 − 2ζ²)))).
  const double k_a = 1e9, d_a = 1, k_b = 1e4, d_b = 20;
  const double k = 1 / (1 / k_a + 1 / k_b), s = k_a / (k_a + k_b), d = d_b * s * s + d_a * (1 - s) * (1 - s);
  const double z = d / 2 / std::sqrt(k), root = std::sqrt(1 - z * z);
  const double expected = std::exp(-z / root * (M_PI - std::atan(2 * z * root / (1 - 2 * z * z))));
  scene::Scene scene;
  scene.gravity.setZero();
  scene.bodies.push_back(cotwin::testing::ground(0));
  scene.bodies.push_back(cotwin::testing::ball("ball", 0.1, 1, {0, 0, 0.1103}, 0));
  scene.bodies[0].shapes[0].material.stiffness = k_a;
  scene.bodies[0].shapes[0].material.damping = d_a;
  scene.bodies[1].shapes[0].material.stiffness = k_b;
  scene.bodies[1].shapes[0].material.damping = d_b;
  scene.bodies[1].V_WB[2] = -1;
  World w = world(scene);
  for (int i = 0; i < 100; ++i) w.step(kStep);
  EXPECT_NEAR(w.twists()[1][2], expected, 0.01);
  World fine = world(scene);
  for (int i = 0; i < 1000; ++i) fine.step(kStep / 10);
  EXPECT_NEAR(fine.twists()[1][2], expected, 1e-3);
}

TEST_P(Impacts, LeaveAStackOfStiffSoftBoxesAtRest) {
  for (const double k : {1e7, 1e9}) {
    scene::Scene scene = cotwin::testing::stack(10);
    for (scene::Body& body : scene.bodies) {
      for (scene::Shape& shape : body.shapes) {
        shape.material.stiffness = 2 * k;
        shape.material.damping = 1;
      }
    }
    World w = world(scene);
    const double before = energy(w);
    for (int i = 0; i < 1000; ++i) w.step(kStep);
    EXPECT_LT(energy(w), before);
    for (const Twist& V : w.twists()) EXPECT_LT(V.norm(), 0.05) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Impacts, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::impacts_test
