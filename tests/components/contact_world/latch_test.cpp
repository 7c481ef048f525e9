// Latches of the contact world against momentum, common velocities, springs and loads in closed form.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "components/unit/snapshot.h"
#include "models/numerics/random.h"
#include "models/robot/floating_base.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/contact_world/methods.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::contact_world::latch_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using scene::kInfinity;

/// A free body without shapes, whose frame is its centre of mass.
scene::Body body(const std::string& name, double mass, const Vector3d& moments, const Vector3d& p) {
  scene::Body b;
  b.name = name;
  b.inertia.mass = mass;
  b.inertia.I_CC = moments.asDiagonal();
  b.X_WB.p = p;
  return b;
}

/// Two bodies, whose latch is between them: at `a` on the first and at `b` on the second one.
scene::Scene pair(const Vector3d& a = {0.3, 0, 0}, const Vector3d& b = {-0.2, 0, 0}) {
  scene::Scene s;
  s.name = "pair";
  s.gravity.setZero();
  s.bodies = {body("first", 2, {0.1, 0.2, 0.25}, {0, 0, 0}), body("second", 3, {0.3, 0.1, 0.2}, {0.5, 0, 0})};
  scene::Joint latch;
  latch.name = "latch";
  latch.type = scene::JointType::kFixed;
  latch.parent = 0;
  latch.child = 1;
  latch.X_PJ.p = a;
  latch.X_CJ.p = b;
  s.latches = {latch};
  return s;
}

using Latches = testing::EachMethod;
INSTANTIATE_TEST_SUITE_P(All, Latches, testing::kMethods, testing::name_of_method);

/// Σ of the sizes of all momenta, about W's origin.
double size(const World& w) {
  double sum = 0;
  for (std::size_t i = 0; i < w.scene().bodies.size(); ++i) {
    const Inertia& inertia = w.scene().bodies[i].inertia;
    const double p = inertia.mass * w.twists()[i].head<3>().norm();
    sum += p * (1 + w.poses()[i].p.norm()) + inertia.I_CC.norm() * w.twists()[i].tail<3>().norm();
  }
  return sum;
}

// p = Σ m v and L about the common centre of mass are those before; then L = I ω with the inertia of both.
TEST_P(Latches, TwoBodiesThatLatchHaveTheirCommonVelocityAndKeepTheirMomentum) {
  for (const double h : {1e-4, 1e-3, 1e-2}) {
    scene::Scene s = pair();
    s.bodies[0].V_WB << 1, 0.2, -0.1, 0.3, -0.2, 0.5;
    s.bodies[1].V_WB << 0.1, -0.3, 0.2, -0.4, 0.6, 0.1;
    World w = world(s);
    const Wrench before = momentum(w);
    const double scale = size(w), energy_before = energy(w);
    ASSERT_TRUE(w.close_latch(0));
    const double mass = 5;
    const Vector3d v = before.head<3>() / mass, c = Vector3d(0.3, 0, 0);  // of the common centre of mass
    Matrix3d I = Matrix3d::Zero();
    for (const scene::Body& b : s.bodies) {
      const Vector3d r = b.X_WB.p - c;
      I += b.inertia.I_CC + b.inertia.mass * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
    }
    const Vector3d spin = I.inverse() * (before.tail<3>() - c.cross(before.head<3>()));
    w.step(h);
    const double common = energy(w);
    for (int i = 0; i < 2; ++i) {
      const Vector3d omega = w.twists()[static_cast<std::size_t>(i)].tail<3>();
      EXPECT_LT((omega - spin).norm(), 2 * h) << h;  // it precesses within the step
      const Vector3d r = w.poses()[static_cast<std::size_t>(i)].p - c - h * v;
      EXPECT_LT((w.twists()[static_cast<std::size_t>(i)].head<3>() - v - omega.cross(r)).norm(), 1e-3 * h + 1e-9) << h;
    }
    EXPECT_LT((w.twists()[0].tail<3>() - w.twists()[1].tail<3>()).norm(), 1e-9);
    EXPECT_LT(common, energy_before);
    for (int k = 0; k < 1000; ++k) w.step(h);
    EXPECT_LT((momentum(w) - before).norm(), 1e-12 * scale) << h;
    EXPECT_NEAR(energy(w), common, 30 * h * h * common) << h;
    EXPECT_LT(w.latches()[0].distance(), 3 * h * h) << h;
    EXPECT_EQ(w.fault(1e-3, 1e-3), "");
    w.open_latch(0);
    for (int k = 0; k < 100; ++k) w.step(h);
    EXPECT_LT((momentum(w) - before).norm(), 1e-12 * scale) << h;
    EXPECT_GT(w.latches()[0].distance(), 0);
  }
}

// Masses from 1 g to 1 t, frames up to 1 m away; some pairs turn by 10 mrad a step.
TEST_P(Latches, HoldRandomPairs) {
  std::uint32_t draw = 0;
  const auto uniform = [&] { return 2 * numerics::uniform({.seed = 51, .draw = draw++}) - 1; };
  const auto vector = [&](double scale) -> Vector3d { return scale * Vector3d(uniform(), uniform(), uniform()); };
  for (int i = 0; i < 200; ++i) {
    SCOPED_TRACE(i);
    const Vector3d a = vector(1), b = vector(1);
    scene::Scene s = pair(a, b);
    s.bodies[1].X_WB.R = Eigen::AngleAxisd(3 * uniform(), vector(1).normalized()).toRotationMatrix();
    s.latches[0].X_CJ.R = s.bodies[1].X_WB.R.transpose();
    s.bodies[1].X_WB.p = a - s.bodies[1].X_WB.R * b;
    for (scene::Body& one : s.bodies) {
      one.inertia.mass = std::pow(10, 3 * uniform());
      one.inertia.I_CC = one.inertia.mass * (Vector3d(0.1, 0.1, 0.1) + vector(0.04)).asDiagonal();
      one.V_WB << vector(1), vector(5);
    }
    World w = world(s);
    const Wrench before = momentum(w);
    const double scale = size(w);
    ASSERT_TRUE(w.close_latch(0)) << w.latches()[0].distance() << " " << w.latches()[0].angle();
    w.step(1e-3);
    const double common = energy(w);
    for (int k = 0; k < 300; ++k) w.step(1e-3);
    ASSERT_LT((momentum(w) - before).norm(), 1e-12 * std::max(scale, size(w)));
    ASSERT_NEAR(energy(w), common, 1e-3 * common);
    ASSERT_LT(w.latches()[0].distance(), 1e-4);
    ASSERT_EQ(w.fault(1e-2, 1e-2), "");
  }
}

// Three bodies in a ring and a doubled latch: 24 rows for 12 relative degrees of freedom.
TEST_P(Latches, HoldInLoopsAndTwice) {
  scene::Scene s = pair();
  s.bodies.push_back(body("third", 1, {0.02, 0.03, 0.04}, {0.2, 0.4, 0}));
  scene::Joint between = s.latches[0];
  between.name = "second to third";
  between.parent = 1;
  between.child = 2;
  between.X_PJ.p = {-0.1, 0.3, 0};
  between.X_CJ.p = {0.2, -0.1, 0};
  s.latches.push_back(between);
  between.name = "third to first";
  between.parent = 2;
  between.child = 0;
  between.X_PJ.p = {-0.1, -0.2, 0.1};
  between.X_CJ.p = {0.1, 0.2, 0.1};
  s.latches.push_back(between);
  s.latches.push_back(s.latches[0]);
  s.bodies[0].V_WB << 0.5, -0.2, 0.1, 0.3, 0.4, -0.6;
  World w = world(s);
  const Wrench before = momentum(w);
  for (std::size_t i = 0; i < 4; ++i) ASSERT_TRUE(w.close_latch(i)) << i;
  w.step(1e-3);
  const double common = energy(w);
  for (int k = 0; k < 2000; ++k) w.step(1e-3);
  EXPECT_LT((momentum(w) - before).norm(), 1e-12 * size(w));
  EXPECT_NEAR(energy(w), common, 1e-5 * common);
  for (const Latch& latch : w.latches()) EXPECT_LT(latch.distance(), 1e-5);
  EXPECT_EQ(w.fault(1e-3, 1e-3), "");
}

TEST_P(Latches, StayWhereTheyAreWhenABodyGetsAnotherMass) {
  scene::Scene s = pair();
  for (scene::Body& b : s.bodies) b.V_WB << 0.2, -0.1, 0.3, 0, 0, 0;
  World w = world(s);
  ASSERT_TRUE(w.close_latch(0));
  w.step(1e-3);
  Inertia heavier = s.bodies[1].inertia;
  heavier.mass = 4;
  heavier.p_LC << 0.05, 0.1, -0.1;
  w.set_body(1, heavier);
  const Wrench before = momentum(w);
  for (int k = 0; k < 500; ++k) w.step(1e-3);
  EXPECT_LT(w.latches()[0].distance(), 1e-9);
  EXPECT_LT((momentum(w) - before).norm(), 1e-12 * size(w));
}

// Reduced mass μ = m₁ m₂/(m₁ + m₂): the distance is v/ω sin ω t with ω = √(k/μ).
TEST_P(Latches, ASoftLatchSwingsAtItsFrequencyWithoutLoss) {
  constexpr double kOmega = 20, kSpeed = 0.02, kPeriod = 2 * 3.14159265358979 / kOmega;
  World w = world(pair());
  w.set_twist(1, (Twist() << kSpeed, 0, 0, 0, 0, 0).finished());
  LatchLaw law;
  law.stiffness = 1.2 * kOmega * kOmega;
  w.set_latch(0, law);
  ASSERT_TRUE(w.close_latch(0));
  const double h = kPeriod / 400;
  for (int k = 0; k < 100; ++k) w.step(h);
  EXPECT_NEAR(w.latches()[0].distance(), kSpeed / kOmega, 1e-4 * kSpeed / kOmega);
  for (int k = 100; k < 4000; ++k) w.step(h);  // nine more periods
  EXPECT_LT(w.latches()[0].distance(), 2e-3 * kSpeed / kOmega);
  const double d = w.latches()[0].distance();
  EXPECT_NEAR(energy(w) + law.stiffness * d * d / 2, 3 * kSpeed * kSpeed / 2, 1e-9 * kSpeed * kSpeed);
  EXPECT_EQ(w.fault(1e-3, 1e-3), "");
}

/// A body of 3 kg, whose centre is latched to the world.
scene::Scene hung() {
  scene::Scene s = pair();
  s.bodies.erase(s.bodies.begin());
  s.bodies[0].X_WB = {};
  s.latches[0].parent = -1;
  s.latches[0].child = 0;
  s.latches[0].X_PJ = s.latches[0].X_CJ = {};
  return s;
}

TEST_P(Latches, BreaksAwayAtItsForceOrMomentInAnyDirection) {
  for (const Vector3d& direction : {Vector3d(0, 0, 1), Vector3d(1, 1, 0), Vector3d(1, -2, 0.5)}) {
    for (const bool turns : {false, true}) {
      for (const double stiffness : {0.0, 1e5}) {
        World w = world(hung());
        LatchLaw law;
        law.force = 20;
        law.moment = 7;
        law.stiffness = law.turn_stiffness = stiffness;
        w.set_latch(0, law);
        ASSERT_TRUE(w.close_latch(0));
        double load = 0;
        for (int k = 0; w.latches()[0].closed && k < 100000; ++k) {
          load = 0.001 * k;
          Wrench F = Wrench::Zero();
          F.segment<3>(turns ? 3 : 0) = load * direction.normalized();
          w.apply(0, F);
          w.step(1e-3);
          if (stiffness == 0 && w.latches()[0].closed) {
            const Motion6& sum = w.latches()[0].sum;
            ASSERT_NEAR((turns ? sum.angular : sum.linear).norm() / 1e-3, load, 1e-6);
          }
        }
        EXPECT_NEAR(load, turns ? 7 : 20, stiffness == 0 ? 0.002 : 0.2) << turns << " " << direction.transpose();
      }
    }
  }
}

// The latch slips at its force: it stops v in m v/F, within m v²/2F.
TEST_P(Latches, SlipsWhileItClosesAndLosesWhatIsTooFast) {
  for (const double h : {1e-4, 1e-3}) {
    for (const double force : {500.0, 100.0}) {
      World w = world(pair());
      w.set_twist(1, (Twist() << 1, 0, 0, 0, 0, 0).finished());
      LatchLaw law;
      law.force = force;
      w.set_latch(0, law);
      ASSERT_TRUE(w.close_latch(0));
      for (int k = 0; k < std::lround(0.05 / h); ++k) w.step(h);
      EXPECT_EQ(w.latches()[0].closed, 1.2 / (2 * force) < law.reach) << force;
      EXPECT_EQ(w.fault(1e-3, 1e-3), "");
    }
  }
}

TEST_P(Latches, DrawsItsFramesTogetherInItsTimeAndKeepsThemApartWithoutOne) {
  scene::Scene s = pair({0.304, -0.002, 0.001});
  s.bodies[1].X_WB.R = Eigen::AngleAxisd(0.05, Vector3d(1, 2, 2) / 3).toRotationMatrix();
  s.bodies[1].X_WB.p += s.bodies[1].X_WB.R * Vector3d(0.2, 0, 0) - Vector3d(0.2, 0, 0);
  for (const double time : {0.2, 0.0}) {
    World w = world(s);
    LatchLaw law;
    law.time = time;
    w.set_latch(0, law);
    ASSERT_TRUE(w.close_latch(0));
    const double distance = w.latches()[0].distance(), angle = w.latches()[0].angle();
    for (int k = 0; k < 100; ++k) w.step(1e-3);
    EXPECT_NEAR(w.latches()[0].distance(), (time > 0 ? 0.5 : 1) * distance, 2e-2 * distance);
    EXPECT_NEAR(w.latches()[0].angle(), (time > 0 ? 0.5 : 1) * angle, 2e-2 * angle);
    for (int k = 0; k < 150; ++k) w.step(1e-3);
    EXPECT_NEAR(w.latches()[0].distance(), time > 0 ? 0 : distance, 1e-7);
    EXPECT_NEAR(w.latches()[0].angle(), time > 0 ? 0 : angle, 1e-7);
    EXPECT_LT(momentum(w).norm(), 1e-13);
    EXPECT_LT(energy(w), 1e-12);
    EXPECT_EQ(w.fault(1e-3, 1e-3), "");
  }
}

TEST_P(Latches, StayOpenBeyondTheirReachAndTilt) {
  World apart = world(pair({0.3051, 0, 0}));
  EXPECT_FALSE(apart.close_latch(0));
  scene::Scene s = pair({0, 0, 0}, {0, 0, 0});
  s.bodies[1].X_WB.p.setZero();
  s.bodies[1].X_WB.R = Eigen::AngleAxisd(0.11, Vector3d::UnitY()).toRotationMatrix();
  World turned = world(s);
  EXPECT_FALSE(turned.close_latch(0));
  LatchLaw law;
  law.tilt = 0.12;
  turned.set_latch(0, law);
  EXPECT_TRUE(turned.close_latch(0));
}

TEST_P(Latches, GoOnFromARestoredStateToTheSameBits) {
  scene::Scene s = pair({0.303, 0, 0});
  s.bodies[0].V_WB << 0.1, 0.2, -0.1, 0.3, -0.2, 0.5;
  LatchLaw law;
  law.time = 0.1;
  law.force = 1000;
  law.turn_stiffness = 300;
  World w = world(s), other = world(s);
  w.set_latch(0, law);
  ASSERT_TRUE(w.close_latch(0));
  for (int k = 0; k < 50; ++k) w.step(1e-3);
  std::vector<double> state, then;
  w.save(state);
  other.restore(state);
  other.set_latch(0, law);
  for (int k = 0; k < 100; ++k) {
    w.step(1e-3);
    other.step(1e-3);
  }
  w.save(state);
  other.save(then);
  EXPECT_EQ(state, then);
  EXPECT_TRUE(other.latches()[0].closed);
}

/// A block of 2 kg at p, with the frame `grip` 3 cm above its centre and a peg beside it.
std::string block(const std::string& p, const std::string& gravity = "0 0 -9.81") {
  return "<?xml version=\"1.0\"?><sdf version=\"1.11\"><world name=\"w\"><gravity>" + gravity + "</gravity>" +
         "<frame name=\"peg\"><pose>1 0 0 0 0 0</pose></frame>" + "<model name=\"block\"><pose>" + p + " 0 0 0</pose>" +
         "<link "
         "name=\"body\"><inertial><mass>2</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial></"
         "link>" +
         "<frame name=\"grip\" attached_to=\"body\"><pose>0 0 0.03 0 0 0</pose></frame></model></world></sdf>";
}

using Subject = testing::UnitSubject;
const std::string kSatellite = places::source() + "/tests/components/data/satellite.urdf";
using ::testing::HasSubstr;

// The arm hangs on its prescribed joints, stretched upwards and then bent: τ_e = −∂(m g z)/∂q.
TEST(Latch, ARobotFeelsTheWeightOfWhatItHolds) {
  const testing::TemporaryFile scene(block("0.39 0 0.37"), "scene.sdf");
  const robot::RobotModel lwr = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  Subject world("unit:contact_world?robot=lwr4&robot_shapes=none&actuation=prescribed&latches=grip|link_7|block/grip&scene=" +
                scene.path());
  const std::vector<double> q{0, 0, 0, 1.5707963267948966, 0, 0, 0};
  world.set("q", q).set("grip.tilt", {4});
  world.variables().at("grip.close").booleans()[0] = true;
  world.initialise();
  for (int k = 0; k < 500; ++k) world.step(1e-3);
  ASSERT_TRUE(world.boolean("grip.closed")) << world.real("grip.distance");
  EXPECT_NEAR(world.real("grip.f", 2), 2 * 9.81, 1e-6);
  const double x = world.real("block.p");  // of its centre of mass
  EXPECT_NEAR(world.real("grip.m", 1), 2 * 9.81 * (0.39 - x), 1e-6);
  EXPECT_NEAR(world.real("tau_e", 1), -2 * 9.81 * x, 1e-4);
  EXPECT_NEAR(world.real("tau_e", 0), 0, 1e-4);
}

TEST(Latch, TellsWhenItClosesOnNothingAndWhenItBreaks) {
  const testing::TemporaryFile scene(block("1 0 0.2", "0 0 0"), "scene.sdf");
  Subject world("unit:contact_world?scene=" + scene.path() + "&latches=hook|peg|block");
  bool& close = world.variables().at("hook.close").booleans()[0];
  close = true;
  world.initialise();
  const auto notes = [&] {
    std::vector<std::string> all;
    world.unit().append_notes(all);
    return all.empty() ? "" : all.front();
  };
  for (int k = 0; k < 3; ++k) world.step(1e-3);
  EXPECT_FALSE(world.boolean("hook.closed"));
  EXPECT_THAT(notes(),
              HasSubstr("latch 'hook' closed on nothing at 0 s, and stayed open: its frames were 0.2 m and 0 rad apart, "
                        "expected at most 0.005 m and 0.1 rad"));
  world.set("hook.reach", {0.3});
  world.step(1e-3);
  EXPECT_FALSE(world.boolean("hook.closed")) << "it closes when `close` becomes true, and not by itself later";
  close = false;
  world.step(1e-3);
  close = true;
  const auto before = testing::allocations();
  world.step(1e-3);
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_TRUE(world.boolean("hook.closed"));
  world.set("hook.breakaway_force", {5.0}).set("block.f", {0, 6, 0}).set("hook.reach", {0.1});
  world.step(1e-3);
  EXPECT_FALSE(world.boolean("hook.closed"));
  std::vector<std::string> all;
  world.unit().append_notes(all);
  EXPECT_THAT(all, ::testing::Contains("latch 'hook' broke away at 0.007 s"));
  world.initialise();
  EXPECT_EQ(notes(), "") << "a new run";
  world.set("hook.breakaway_force", {0.0}).set("hook.reach", {0.3});
  world.step(1e-3);
  EXPECT_TRUE(world.boolean("hook.closed"));
}

TEST(Latch, RefusesFramesThatDoNotExistAndValuesThatAreNoNumbers) {
  const testing::TemporaryFile scene(block("1 0 0.2"), "scene.sdf");
  const auto refusal = [&](const std::string& latches) {
    return testing::error_of([&] { Subject("unit:contact_world?robot=lwr4&scene=" + scene.path() + "&latches=" + latches); });
  };
  EXPECT_THAT(refusal("a|link_9|block"), HasSubstr("'link_9' is no frame of a robot and no body or frame of scene 'w'"));
  EXPECT_THAT(refusal("a|link_7|block/gripp"), HasSubstr("'block/gripp' is no frame"));
  EXPECT_THAT(refusal("a|link_7"), HasSubstr("expected name|frame|frame"));
  EXPECT_THAT(refusal("|link_7|block"), HasSubstr("no name"));
  EXPECT_THAT(refusal("a|block|block/grip"), HasSubstr("on the same body"));
  EXPECT_THAT(refusal("a|link_7|block;a|link_7|peg"), HasSubstr("latch 'a' and latch 'a'"));
  Subject world("unit:contact_world?scene=" + scene.path() + "&latches=hook|peg|block");
  world.initialise();
  world["hook.stiffness"][0] = std::nan("");
  EXPECT_THAT(testing::error_of([&] { (void)world.unit().step(Time{}, Duration{1'000'000}); }),
              HasSubstr("hook: has a tunable"));
}

// Free robots that latch: all momentum comes from a's joints, which move at the start.
TEST(Latch, TwoFreeRobotsKeepTheirMomentumThroughCaptureAndRelease) {
  Subject world("unit:contact_world?base=floating&robot_shapes=none&link_side=outside&robots=a:" + kSatellite +
                ",b:" + kSatellite + "&latches=dock|a/hull|b/hull");
  world.set("gravity", {0, 0, 0}).set("dock.reach", {3.0}).set("b.base_p0", {2, 0.5, 0}).set("a.dq0", {0.5, -0.4});
  world.initialise();
  const robot::RobotModel model = robot::load_urdf(kSatellite);
  const auto momentum = [&] {
    Wrench sum = Wrench::Zero();
    for (const std::string name : {"a.", "b."}) {
      const robot::FloatingMechanism mechanism(model);
      robot::FloatingData data(mechanism);
      robot::FloatingInertia inertia(2);
      robot::floating_inertia(mechanism, data, world.joints(name + "q"), inertia);
      const auto Q = world[name + "base_quat"];
      const Matrix3d R = Quaterniond(Q[0], Q[1], Q[2], Q[3]).toRotationMatrix();
      Twist V;
      V << R.transpose() * world.vector(name + "base_v"), R.transpose() * world.vector(name + "base_w");
      const Wrench h = inertia.momentum(V, world.joints(name + "dq"));
      const Vector3d p = R * h.head<3>();
      sum.head<3>() += p;
      sum.tail<3>() += R * h.tail<3>() + world.vector(name + "base_p").cross(p);
    }
    return sum;
  };
  const Wrench before = momentum();
  bool& close = world.variables().at("dock.close").booleans()[0];
  for (int k = 0; k < 300; ++k) {
    close = k >= 100 && k < 200;
    world.step(1e-3);
    ASSERT_EQ(world.boolean("dock.closed"), close);
    if (k == 150) {
      EXPECT_LT((world.vector("a.base_w") - world.vector("b.base_w")).norm(), 1e-9);
    }
  }
  EXPECT_LT((momentum() - before).norm(), 1e-12 * 3) << "of momenta of some N.s";
  EXPECT_GT(world.vector("b.base_v").norm(), 1e-3);
}

// As a host of an FMU does it that saves and restores the state in each step.
TEST(Latch, StepsToTheSameBitsWithItsStateRestoredBeforeEachStep) {
  const std::string folder = places::source() + "/examples/23_latch/";
  const std::string source = "unit:contact_world?actuation=prescribed&robot_shapes=none&robot=" + folder +
                             "robot.urdf&scene=" + folder + "cell.sdf&latches=grip|gripper|block/grip";
  Subject plain(source), restored(source);
  for (Subject* world : {&plain, &restored}) {
    world->set("q", {-0.291, -0.6273, 0, 1.6864, 0, -0.828, -0.291}).set("grip.reach", {0.05}).set("grip.tilt", {0.5});
    world->initialise();
  }
  for (int k = 0; k < 60; ++k) {
    for (Subject* world : {&plain, &restored}) world->variables().at("grip.close").booleans()[0] = k >= 20 && k < 40;
    Snapshot snapshot;
    snapshot.take(restored.variables(), restored.unit());
    snapshot.restore(restored.variables(), restored.unit());
    plain.step(1e-3);
    restored.step(1e-3);
    ASSERT_EQ(plain.boolean("grip.closed"), k >= 20 && k < 40)
        << plain.real("grip.distance") << " " << plain.real("grip.angle");
    ASSERT_EQ(plain.values("world"), restored.values("world")) << k;
    ASSERT_EQ(plain.values("tau_e"), restored.values("tau_e")) << k;
  }
}

}  // namespace
}  // namespace cotwin::contact_world::latch_test
