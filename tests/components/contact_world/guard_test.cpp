// Runs whose joints part or whose energy grows without work end with an error; those whose energy work explains do not.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "tests/support/allocations.h"

namespace cotwin::contact_world::guard_test {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kGapLimit = 0.01, kEnergyLimit = 0.25;  // the defaults of the unit

int add_bar(scene::Scene& scene, const Vector3d& p, const Vector3d& along, double mass = 1) {
  scene::Body body;
  body.name = "bar" + std::to_string(scene.bodies.size());
  body.inertia.mass = mass;
  const Eigen::Matrix3d U = Eigen::Matrix3d::Identity();
  body.inertia.I_CC = mass / 12 * (along.squaredNorm() * U - along * along.transpose()) + 1e-4 * mass * U;
  body.X_WB.p = p + along / 2;
  scene.bodies.push_back(body);
  return static_cast<int>(scene.bodies.size()) - 1;
}

void add_hinge(scene::Scene& scene, int parent, int child, const Vector3d& p) {
  scene::Joint joint;
  joint.name = "hinge" + std::to_string(scene.joints.size());
  joint.parent = parent;
  joint.child = child;
  joint.axis = Vector3d::UnitY();
  const auto on = [&](int body) { return body < 0 ? p : Vector3d(p - scene.bodies[static_cast<std::size_t>(body)].X_WB.p); };
  joint.X_PJ.p = on(parent);
  joint.X_CJ.p = on(child);
  scene.joints.push_back(joint);
}

scene::Scene parallelogram() {
  scene::Scene scene;
  const Vector3d up(0.3 * std::cos(1.0), 0, 0.3 * std::sin(1.0)), across(0.5, 0, 0);
  add_bar(scene, Vector3d::Zero(), up);
  add_bar(scene, across, up);
  add_bar(scene, up, across);
  add_hinge(scene, -1, 0, Vector3d::Zero());
  add_hinge(scene, 0, 2, up);
  add_hinge(scene, -1, 1, across);
  add_hinge(scene, 1, 2, across + up);
  return scene;
}

scene::Scene chain(int bars, double length, double mass) {
  scene::Scene scene;
  for (int i = 0; i < bars; ++i) {
    const Vector3d p(length * i, 0, 0);
    add_bar(scene, p, {length, 0, 0}, mass);
    add_hinge(scene, i - 1, i, p);
  }
  return scene;
}

scene::Body block(const std::string& name, const Vector3d& p, const Vector3d& size, scene::Motion motion) {
  scene::Body body;
  body.name = name;
  body.motion = motion;
  body.X_WB.p = p;
  if (motion == scene::Motion::kDynamic) {
    body.inertia.mass = 1;
    body.inertia.I_CC = 0.01 * Eigen::Matrix3d::Identity();
  }
  scene::Shape shape;
  shape.name = "shape";
  shape.type = scene::ShapeType::kBox;
  shape.size = size;
  body.shapes.push_back(shape);
  return body;
}

/// Steps until the world reports a fault, at most for `duration`.
struct Outcome {
  std::string fault;
  double time;
  double gained = 0;  // largest energy above that at the start, J
};
Outcome run(World& world, double h, double duration, double gap_limit, double energy_limit,
            const std::function<void(World&)>& before_step = {}) {
  const double before = world.energy();
  double gained = 0;
  int k = 0;
  while (k < duration / h) {
    if (before_step) before_step(world);
    world.step(h);
    ++k;
    gained = std::max(gained, world.energy() - before);
    std::string fault = world.fault(gap_limit, energy_limit);
    if (!fault.empty()) return {fault, k * h, gained};
  }
  return {"", k * h, gained};
}

Options with(Method method) {
  Options options;
  options.method = method;
  return options;
}

// ---- Runs that must end

TEST(Guard, NamesTheJointOfAnAssemblyThatCannotClose) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    scene::Scene scene = parallelogram();
    scene.joints[2].X_PJ.p.x() += 0.8;  // 0.2 m more than the bars reach
    World world(scene, with(method));
    const Outcome outcome = run(world, 1e-3, 5, kGapLimit, kEnergyLimit);
    EXPECT_THAT(outcome.fault, HasSubstr("does not close: its gap remains 0."));
    EXPECT_NEAR(world.largest_gap(), 0.2, 0.01);
  }
}

TEST(Guard, LetsJointsThatStartApartClose) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    scene::Scene scene = parallelogram();
    scene.joints[2].X_PJ.p.x() += 0.1;
    World world(scene, with(method));
    EXPECT_EQ(run(world, 1e-3, 3, kGapLimit, kEnergyLimit).fault, "");
    EXPECT_LT(world.largest_gap(), 1e-3);
  }
}

TEST(Guard, EndsAWhippingChainWhoseStepIsTooLong) {
  World by_gap(chain(60, 0.05, 0.01), {}), by_energy(chain(60, 0.05, 0.01), {});
  const std::string parted = run(by_gap, 0.01, 5, kGapLimit, 0).fault;
  EXPECT_THAT(parted, HasSubstr("joint 'hinge"));
  EXPECT_THAT(parted, HasSubstr("has parted by"));
  EXPECT_THAT(parted, HasSubstr("use shorter steps"));
  EXPECT_GT(by_gap.largest_gap(), kGapLimit);
  const Outcome outcome = run(by_energy, 0.01, 5, 0, kEnergyLimit);
  EXPECT_THAT(outcome.fault, HasSubstr("J without work (joint 'hinge"));
}

/// The angular momentum of a stick that turns about its stiff axis is conserved but its energy is not at 2 rad per step: it may
/// rise to that of a turn about the axis of least inertia.
TEST(Guard, NamesABodyWhoseRotationGainsEnergy) {
  scene::Scene scene;
  scene.gravity.setZero();
  scene.bodies.push_back(block("stick", Vector3d::Zero(), {0.1, 0.1, 1}, scene::Motion::kDynamic));
  scene.bodies[0].inertia.I_CC = Vector3d(1, 0.99, 0.01).asDiagonal();
  World world(scene, {});
  Twist V;
  V << 0, 0, 0, 0.01, 100, 3;
  world.set_twist(0, V);
  const double before = world.energy();
  const Outcome outcome = run(world, 0.02, 5, kGapLimit, kEnergyLimit);
  EXPECT_THAT(outcome.fault, HasSubstr("J without work (body 'stick'"));
  EXPECT_GT(world.energy(), 1.25 * before);
  World fine(scene, {});
  fine.set_twist(0, V);
  EXPECT_EQ(run(fine, 1e-3, 5, kGapLimit, kEnergyLimit).fault, "");
}

/// A stick as above beside one that turns slowly, a cube in flight and a pendulum whose damper takes energy.
TEST(Guard, TellsWhoGainedHowMuchBesideOthersThatLose) {
  scene::Scene scene = chain(1, 0.5, 3);
  scene.gravity.setZero();
  scene.joints[0].damping = 0.5;
  scene.bodies.push_back(block("slow", {5, 0, 0}, {0.1, 0.1, 1}, scene::Motion::kDynamic));
  scene.bodies.push_back(block("fast", {10, 0, 0}, {0.1, 0.1, 1}, scene::Motion::kDynamic));
  for (const std::size_t b : {1U, 2U}) scene.bodies[b].inertia.I_CC = Vector3d(1, 0.99, 0.01).asDiagonal();
  scene.bodies.push_back(block("cube", {15, 0, 0}, {0.1, 0.1, 0.1}, scene::Motion::kDynamic));
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    World world(scene, with(method));
    Twist V = Twist::Zero();
    V[4] = 20;
    world.set_twist(0, V);
    V << 0, 0, 0, 0.01, 1, 0.03;
    world.set_twist(1, V);
    V << 0, 0, 0, 0.01, 100, 3;
    world.set_twist(2, V);
    V << 30, 0, 0, 0, 0, 0;
    world.set_twist(3, V);
    const auto of_stick = [&] {
      const Vector3d w = world.poses()[2].R.transpose() * world.twists()[2].tail<3>();
      return w.dot(scene.bodies[2].inertia.I_CC * w) / 2;
    };
    const double before = of_stick();
    double least = before, most = 0;
    for (int k = 0; k < 50; ++k) {
      world.step(0.02);
      least = std::min(least, of_stick());
      most = std::max(most, of_stick() - least);
    }
    const World::Gain gain = world.gain();
    EXPECT_EQ(scene.bodies[gain.body].name, "fast");
    EXPECT_NEAR(gain.of_body, most, 0.01 * most);
    EXPECT_NEAR(gain.joules, most, 0.01 * most);
    EXPECT_NEAR(gain.share, most / before, 0.01 * most / before);
    EXPECT_GT(gain.share, 0.1);
  }
}

TEST(Guard, TellsNoGainOfFourBarsThatSwing) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    World world(parallelogram(), with(method));
    for (int k = 0; k < 5000; ++k) world.step(1e-3);
    EXPECT_LT(world.gain().share, 1e-3) << world.gain().joules << " J, method " << static_cast<int>(method);
  }
}

// ---- Runs that must not end. With this share each would end if its work were not counted.

constexpr double kSmallShare = 0.02;

TEST(Guard, CountsTheWorkOfWrenches) {
  scene::Scene scene;
  scene.gravity.setZero();
  scene.bodies.push_back(block("cube", {1, 2, 3}, {0.1, 0.1, 0.1}, scene::Motion::kDynamic));
  World world(scene, {});
  const auto push = [](World& w) {
    Wrench F;
    F << 10, 0, 5, 0, 0.1, 0.1;
    w.apply(0, F);
  };
  EXPECT_EQ(run(world, 1e-3, 2, kGapLimit, kSmallShare, push).fault, "");
  EXPECT_NEAR(world.twists()[0].head<3>().norm(), 2 * std::sqrt(125), 1e-9);
}

TEST(Guard, CountsTheWorkOfDrivesSpringsDampersAndMotors) {
  struct Case {
    const char* name;
    std::function<void(World&)> drive;
  };
  const Case cases[] = {{"torque", [](World& w) { w.set_tau(0, 60); }},
                        {"torque on an inertia",
                         [](World& w) {
                           w.set_inertia(0, 2);
                           w.set_tau(0, 60);
                         }},
                        {"spring and damper", [](World& w) { w.set_tau(0, 20 * std::sin(w.q()[0]), 1e4, 20, 4); }},
                        {"motor", [](World& w) { w.set_motor(0, 5, 200); }},
                        {"motor without limit", [](World& w) { w.set_motor(0, 5, HUGE_VAL); }}};
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    for (const Case& one : cases) {
      // Sweeps do not converge with an inertia a hundred times that of the body.
      World world(chain(2, 0.5, 1), with(method));
      const double share = kSmallShare;
      const Outcome outcome = run(world, 1e-3, 2, kGapLimit, share, one.drive);
      EXPECT_EQ(outcome.fault, "") << one.name << ", method " << static_cast<int>(method);
      EXPECT_GT(outcome.gained, 5) << one.name << ", method " << static_cast<int>(method);
    }
  }
}

TEST(Guard, CountsTheWorkOfDrivenBodies) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    scene::Scene scene;
    scene.bodies.push_back(block("belt", {0, 0, -0.5}, {50, 1, 1}, scene::Motion::kDriven));
    scene.bodies.push_back(block("cube", {0, 0, 0.05}, {0.1, 0.1, 0.1}, scene::Motion::kDynamic));
    World belt(scene, with(method));
    const auto convey = [](World& w) {
      Twist V = Twist::Zero();
      V.x() = 4;
      w.set_twist(0, V);
    };
    EXPECT_EQ(run(belt, 1e-3, 2, kGapLimit, kSmallShare, convey).fault, "");
    EXPECT_NEAR(belt.twists()[1].x(), 4, 1e-3);

    scene.gravity.setZero();
    scene.bodies[0].shapes[0].size = {0.1, 1, 1};
    scene.bodies[0].X_WB.p = {-0.5, 0, 0};
    for (scene::Body& body : scene.bodies) body.shapes[0].material.restitution = 1;
    World paddle(scene, with(method));
    EXPECT_EQ(run(paddle, 1e-3, 0.5, kGapLimit, kSmallShare, convey).fault, "");
    EXPECT_NEAR(paddle.twists()[1].x(), 8, 1e-6);  // twice the paddle's speed
  }
}

TEST(Guard, CountsStatesThatAreSetAndOverlapsThatArePushedApart) {
  scene::Scene scene;
  scene.bodies.push_back(block("floor", {0, 0, -0.5}, {5, 5, 1}, scene::Motion::kStatic));
  scene.bodies.push_back(block("low", {0, 0, -0.2}, {0.5, 0.5, 0.5}, scene::Motion::kDynamic));
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    World world(scene, with(method));
    EXPECT_EQ(run(world, 1e-3, 6, kGapLimit, kSmallShare).fault, "");
    EXPECT_GT(world.poses()[1].p.z(), 0.24);
    int k = 0;
    const auto set = [&](World& w) {
      if (++k % 100 != 0) return;
      w.set_pose(1, {Eigen::Matrix3d::Identity(), {0, 0, 20}});
      Twist V = Twist::Zero();
      V.x() = k;
      w.set_twist(1, V);
    };
    EXPECT_EQ(run(world, 1e-3, 1, kGapLimit, kSmallShare, set).fault, "");
  }
}

TEST(Guard, CountsTheSpringsOfSoftContacts) {
  scene::Scene scene;
  scene.bodies.push_back(block("floor", {0, 0, -0.5}, {5, 5, 1}, scene::Motion::kStatic));
  scene.bodies.push_back(block("cube", {0, 0, 1}, {0.1, 0.1, 0.1}, scene::Motion::kDynamic));
  scene.bodies[1].shapes[0].material.stiffness = 1e4;
  World world(scene, {});
  EXPECT_EQ(run(world, 1e-3, 10, kGapLimit, kSmallShare).fault, "");
}

// ---- State

TEST(Guard, ContinuesFromASavedStateToTheSameError) {
  World world(chain(60, 0.05, 0.01), {}), other(chain(60, 0.05, 0.01), {});
  std::vector<double> state;
  for (int k = 0; k < 150; ++k) world.step(0.01);
  world.save(state);
  other.restore(state);
  const Outcome a = run(world, 0.01, 5, 0, kEnergyLimit), b = run(other, 0.01, 5, 0, kEnergyLimit);
  EXPECT_THAT(a.fault, HasSubstr("without work"));
  EXPECT_EQ(a.fault, b.fault);
  EXPECT_EQ(a.time, b.time);
}

// An infinite torque is part of the state; it was refused as damaged.
TEST(Guard, RestoresAMotorWithoutLimit) {
  World world(chain(2, 0.5, 1), {}), other(chain(2, 0.5, 1), {});
  world.set_motor(0, 5, HUGE_VAL);
  world.step(1e-3);
  std::vector<double> state, after, after_restoring;
  world.save(state);
  other.restore(state);
  world.step(1e-3);
  other.step(1e-3);
  world.save(after);
  other.save(after_restoring);
  EXPECT_EQ(after, after_restoring);
}

TEST(Guard, AllocatesNothing) {
  for (const Method method : {Method::kTree, Method::kDantzig, Method::kPgs}) {
    World world(parallelogram(), with(method));
    world.step(1e-3);
    const auto before = cotwin::testing::allocations();
    for (int k = 0; k < 100; ++k) {
      world.step(1e-3);
      EXPECT_TRUE(world.fault(kGapLimit, kEnergyLimit).empty());
    }
    EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
  }
}

// Springs of joints store energy; they do no work. Each joint of each scene has one, and the scenes start far from rest.
TEST(Guard, LetsSpringsOfJointsExchangeTheirEnergy) {
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    scene::Scene slider;
    add_bar(slider, Vector3d::Zero(), {0.1, 0, 0});
    scene::Joint joint;
    joint.name = "slider";
    joint.type = scene::JointType::kPrismatic;
    joint.parent = -1;
    joint.child = 0;
    joint.axis = Vector3d::UnitZ();
    joint.X_CJ.p = {-0.05, 0, 0};
    joint.stiffness = 4000;
    joint.q_spring = 0.05;
    slider.joints.push_back(joint);
    scene::Scene arm = chain(3, 0.4, 2);
    for (std::size_t j = 0; j < arm.joints.size(); ++j) {
      arm.joints[j].stiffness = 200 / (1 + static_cast<double>(j));
      arm.joints[j].q_spring = 0.7 - static_cast<double>(j);
    }
    int number = 0;
    for (const scene::Scene& scene : {slider, arm}) {
      World world(scene, with(method));
      const double stored = world.energy();
      const Outcome outcome = run(world, 1e-3, 6, kGapLimit, kEnergyLimit);
      EXPECT_EQ(outcome.fault, "") << "scene " << number;
      EXPECT_NEAR(world.energy(), stored, (method == Method::kTree ? 1e-3 : 0.2) * std::abs(stored)) << "scene " << number;
      ++number;
    }
  }
}

// The whipping chain of too long steps, with springs whose energy hides no gain.
TEST(Guard, EndsRunsWhoseEnergyGrowsBesideTheirSprings) {
  for (const double stiffness : {1e-4, 1e-3, 1e-2}) {  // N m/rad
    scene::Scene scene = chain(60, 0.05, 0.01);
    for (scene::Joint& joint : scene.joints) joint.stiffness = stiffness;
    World world(scene, {});
    EXPECT_THAT(run(world, 0.01, 5, 0, kEnergyLimit).fault, HasSubstr("J without work")) << stiffness;
  }
}

// Links in line between two pins hold no load across, and bend either way.
TEST(Guard, TellsThatAChainIsStretchedBetweenItsPins) {
  scene::Scene scene;
  const Vector3d link(0.2, 0, 0);
  constexpr int kLinks = 5;
  for (int i = 0; i < kLinks; ++i) {
    add_bar(scene, i * link, link, 0.1);
    add_hinge(scene, i - 1, i, i * link);
  }
  add_hinge(scene, -1, kLinks - 1, kLinks * link);
  World world(scene, {});
  std::string fault;
  for (int k = 0; k < 3000 && fault.empty(); ++k) {
    world.step(1e-3);
    fault = world.fault(kGapLimit, kEnergyLimit);
  }
  EXPECT_THAT(fault, HasSubstr("the loop that joint 'hinge5' closes is in a nearly singular position, as are links in line"));
  EXPECT_THAT(fault, ::testing::Not(HasSubstr("use shorter steps")));
}

}  // namespace
}  // namespace cotwin::contact_world::guard_test
