// Closed loops of joints: singular poses, redundant constraints, loops that cannot close.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "tests/support/allocations.h"

namespace cotwin::contact_world::loops_test {
namespace {

using Eigen::Vector3d;

class Linkage {
 public:
  explicit Linkage(const Eigen::Matrix3d& R = Eigen::Matrix3d::Identity()) : R_(R) { scene_.gravity = R_ * scene_.gravity; }

  /// A thin bar from p along `along`; returns its index.
  int bar(const Vector3d& p, const Vector3d& along, double mass = 1) {
    scene::Body body;
    body.name = "bar" + std::to_string(scene_.bodies.size());
    body.inertia.mass = mass;
    const Vector3d way = R_ * along;
    const Eigen::Matrix3d U = Eigen::Matrix3d::Identity();
    body.inertia.I_CC = mass / 12 * (way.squaredNorm() * U - way * way.transpose()) + 1e-4 * mass * U;
    body.X_WB.p = R_ * (p + along / 2);
    scene_.bodies.push_back(body);
    return static_cast<int>(scene_.bodies.size()) - 1;
  }

  scene::Joint& joint(int parent, int child, const Vector3d& p, const Vector3d& axis = Vector3d::UnitY(),
                      scene::JointType type = scene::JointType::kRevolute) {
    scene::Joint joint;
    joint.name = "joint" + std::to_string(scene_.joints.size());
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.axis = R_ * axis;
    const auto on = [&](int body) {
      return body < 0 ? Vector3d(R_ * p) : Vector3d(R_ * p - scene_.bodies[static_cast<std::size_t>(body)].X_WB.p);
    };
    joint.X_PJ.p = on(parent);
    joint.X_CJ.p = on(child);
    scene_.joints.push_back(joint);
    return scene_.joints.back();
  }

  scene::Scene& scene() { return scene_; }

 private:
  Eigen::Matrix3d R_;
  scene::Scene scene_;
};

/// A level bar on `posts` parallel posts that stand `spacing` apart, inclined by `angle` above the horizontal. It becomes
/// collinear where the posts lie.
Linkage on_posts(int posts, double length, double spacing, double angle,
                 const Eigen::Matrix3d& R = Eigen::Matrix3d::Identity()) {
  Linkage made(R);
  const Vector3d up(length * std::cos(angle), 0, length * std::sin(angle));
  for (int i = 0; i < posts; ++i) made.bar({spacing * i, 0, 0}, up);
  const int top = made.bar(up, {spacing * (posts - 1), 0, 0});
  for (int i = 0; i < posts; ++i) {
    made.joint(-1, i, {spacing * i, 0, 0});
    made.joint(i, top, Vector3d(spacing * i, 0, 0) + up);
  }
  return made;
}

/// Crank and connecting rod of equal lengths: the slider's centre lies on the crank's axis where both are upright.
Linkage slider_crank(double length, double angle) {
  Linkage made;
  const Vector3d up(length * std::cos(angle), 0, length * std::sin(angle));
  const Vector3d end(2 * up.x(), 0, 0);
  const int crank = made.bar({0, 0, 0}, up), rod = made.bar(up, end - up), slider = made.bar(end, {0.05, 0, 0});
  made.joint(-1, crank, {0, 0, 0});
  made.joint(crank, rod, up);
  made.joint(rod, slider, end);
  made.joint(-1, slider, end, Vector3d::UnitX(), scene::JointType::kPrismatic);
  return made;
}

/// Bennett's linkage: four skew hinges that move with one freedom although counting gives −2. sin α / a = sin β / b.
Linkage bennett() {
  const double a = 0.3, alpha = 0.6, b = 0.45, beta = std::asin(b * std::sin(alpha) / a), first = 1;
  const double second = 2 * std::atan(std::sin((beta + alpha) / 2) / std::sin((beta - alpha) / 2) / std::tan(first / 2));
  const double angles[4] = {first, second, -first, -second}, lengths[4] = {a, b, a, b}, twists[4] = {alpha, beta, alpha, beta};
  Eigen::Affine3d X = Eigen::Affine3d::Identity();
  std::vector<Vector3d> p, z;
  for (int i = 0; i < 4; ++i) {
    p.emplace_back(X.translation());
    z.emplace_back(X.rotation().col(2));
    X.rotate(Eigen::AngleAxisd(angles[i], Vector3d::UnitZ()));
    X.translate(Vector3d(lengths[i], 0, 0));
    X.rotate(Eigen::AngleAxisd(twists[i], Vector3d::UnitX()));
  }
  EXPECT_LT((X.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
  Linkage made;
  for (std::size_t i = 0; i < 3; ++i) made.bar(p[i], p[i + 1] - p[i]);
  made.joint(-1, 0, p[0], z[0]);
  made.joint(0, 1, p[1], z[1]);
  made.joint(1, 2, p[2], z[2]);
  made.joint(-1, 2, p[3], z[3]);
  return made;
}

struct Seen {
  double gap = 0;                  // largest, m
  double highest = 0, lowest = 0;  // of the energy, relative to the start, J
};

Seen watch(World& world, double h, double duration) {
  Seen seen;
  const double before = world.energy();
  for (int k = 0; k < duration / h; ++k) {
    world.step(h);
    seen.gap = std::max(seen.gap, world.largest_gap());
    seen.highest = std::max(seen.highest, world.energy() - before);
    seen.lowest = std::min(seen.lowest, world.energy() - before);
  }
  return seen;
}

class ClosedLoops : public ::testing::TestWithParam<Method> {
 protected:
  World world(scene::Scene scene) {
    Options options;
    options.method = GetParam();
    return World(std::move(scene), options);
  }
};

TEST_P(ClosedLoops, PassTheirSingularPosesWithoutGapOrGainOfEnergy) {
  const Eigen::Matrix3d skew = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  struct Case {
    const char* name;
    Linkage linkage;
    double loss;  // bound, of a fall of 5 J (posts: 13 J)
  };
  Case cases[] = {{"parallelogram", on_posts(2, 0.3, 0.5, 1.0), 0.01},
                  {"rhombus", on_posts(2, 0.5, 0.5, 1.0), 0.01},
                  {"inclined parallelogram", on_posts(2, 0.3, 0.5, 1.2, skew), 0.01},
                  {"three redundant loops", on_posts(4, 0.3, 0.4, 1.0), 0.02},
                  {"slider crank", slider_crank(0.2, 1.0), 0.01}};
  for (Case& one : cases) {
    for (const double h : {1e-3, 1e-4}) {
      World w = world(one.linkage.scene());
      const Seen seen = watch(w, h, 5);
      EXPECT_LT(seen.gap, 5e-6) << one.name << ", h " << h;
      EXPECT_LT(seen.highest, 1e-4) << one.name << ", h " << h;
      EXPECT_GT(seen.lowest, -one.loss) << one.name << ", h " << h;
    }
  }
}

TEST_P(ClosedLoops, StartAtASingularPose) {
  World w = world(on_posts(2, 0.3, 0.5, 0).scene());
  const Seen seen = watch(w, 1e-3, 5);
  EXPECT_LT(seen.gap, 5e-6);
  EXPECT_LT(seen.highest, 1e-4);
  EXPECT_GT(seen.lowest, -0.01);
  EXPECT_LT(w.poses()[2].p.z(), -0.01);  // it fell
}

TEST_P(ClosedLoops, MoveAlthoughTheyAreOverconstrained) {
  World w = world(bennett().scene());
  const double before = w.q()[0];
  const Seen seen = watch(w, 1e-3, 5);
  EXPECT_LT(seen.gap, 1e-8);
  EXPECT_LT(seen.highest, 1e-4);
  EXPECT_GT(seen.lowest, -5e-3);
  EXPECT_GT(std::abs(w.q()[0] - before), 0.5);
}

TEST_P(ClosedLoops, StayClosedWithBarsOfVeryDifferentMass) {
  for (const double ratio : {1e-6, 1e-3, 1e3}) {
    Linkage linkage = on_posts(2, 0.3, 0.5, 1.0);
    linkage.scene().bodies[1].inertia.mass *= ratio;
    linkage.scene().bodies[1].inertia.I_CC *= ratio;
    World w = world(linkage.scene());
    const Seen seen = watch(w, 1e-3, 3);
    const double fall = 5 * std::max(1.0, ratio);  // J
    EXPECT_LT(seen.gap, 3e-5) << ratio;
    EXPECT_LT(seen.highest, 1e-4 * fall) << ratio;
    EXPECT_GT(seen.lowest, -0.01 * fall) << ratio;
  }
}

TEST_P(ClosedLoops, ALimitAtTheJointThatClosesALoopStopsIt) {
  Linkage linkage = on_posts(2, 0.3, 0.5, 1.0);
  scene::Joint& last = linkage.scene().joints[2];
  last.q_min = -0.4;
  last.q_max = 0.4;
  World w = world(linkage.scene());
  const Seen seen = watch(w, 1e-3, 5);
  EXPECT_LT(seen.gap, 1e-4);  // at the blow of the limit; sweeps leave most
  EXPECT_LT(seen.highest, 1e-4);
  EXPECT_NEAR(std::abs(w.q()[2]), 0.4, 1e-4);
  EXPECT_NEAR(w.dq()[2], 0, 1e-6);
}

TEST_P(ClosedLoops, ThatCannotCloseComeToRest) {
  Linkage linkage = on_posts(2, 0.3, 0.5, 1.0);
  linkage.scene().joints[2].X_PJ.p.x() += 0.8;  // 0.2 m more than the bars reach
  World w = world(linkage.scene());
  const double before = w.energy();
  for (int k = 0; k < 5000; ++k) w.step(1e-3);
  EXPECT_LT(w.energy(), before);
  EXPECT_NEAR(w.largest_gap(), 0.2, 0.02);
}

TEST_P(ClosedLoops, AllocateNothingInAStep) {
  World w = world(on_posts(4, 0.3, 0.4, 1.0).scene());
  w.step(1e-3);
  const auto before = cotwin::testing::allocations();
  for (int k = 0; k < 1000; ++k) w.step(1e-3);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

INSTANTIATE_TEST_SUITE_P(Methods, ClosedLoops, ::testing::Values(Method::kTree, Method::kDantzig, Method::kPgs),
                         [](const auto& method) {
                           return method.param == Method::kTree ? "tree" : method.param == Method::kPgs ? "pgs" : "dantzig";
                         });

/// A chain of hinges about y, stretched along x, fixed at its first end.
scene::Scene chain(int bars, double length) {
  Linkage made;
  for (int i = 0; i < bars; ++i) {
    const Vector3d p(length * i, 0, 0);
    made.bar(p, {length, 0, 0});
    made.joint(i - 1, i, p);
  }
  return made.scene();
}

// Joints are eliminated before the sweeps, so their number does not matter: what is left of a whipping chain is the error of the step.
TEST(Sweeps, LeaveTheJointsOfAFallingChainClosed) {
  scene::Scene light = chain(20, 0.1), loaded = light;
  loaded.bodies.back().inertia.mass += 10;
  for (const scene::Scene& scene : {light, loaded}) {
    World by_tree(scene, {});
    const Seen exact = watch(by_tree, 1e-3, 3);
    double fall = 0;
    for (const scene::Body& body : scene.bodies) fall += body.inertia.mass * 9.81 * 2;
    EXPECT_GT(exact.lowest, -0.005 * fall);
    for (const int sweeps : {1, 20}) {
      Options options;
      options.method = Method::kPgs;
      options.iterations = sweeps;
      World w(scene, options);
      const Seen seen = watch(w, 1e-3, 3);
      EXPECT_NEAR(seen.highest, exact.highest, 1e-6 * fall) << sweeps;
      EXPECT_NEAR(seen.lowest, exact.lowest, 1e-6 * fall) << sweeps;
      EXPECT_LT(seen.gap, 1e-8) << sweeps;
      for (std::size_t i = 0; i < w.q().size(); ++i) EXPECT_NEAR(w.q()[i], by_tree.q()[i], 1e-6) << i;
    }
  }
}

/// An arm of 3 to 8 hinges about random axes, some with friction or limits, some driven by motors of little torque.
scene::Scene random_arm(std::mt19937& source) {
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution(low, high)(source); };
  scene::Scene scene = chain(static_cast<int>(uniform(3, 9)), 0.25);
  for (scene::Joint& joint : scene.joints) {
    joint.axis = Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized();
    if (uniform(0, 1) < 0.4) joint.friction = uniform(0, 3);
    if (uniform(0, 1) < 0.4) {
      joint.q_min = -uniform(0.05, 0.6);
      joint.q_max = uniform(0.05, 0.6);
    }
  }
  for (scene::Body& body : scene.bodies) body.inertia.mass *= uniform(0.3, 3);
  return scene;
}

TEST(Sweeps, OverMotorsLimitsAndFrictionOfArmsMoveAsPivoting) {
  std::mt19937 source(5);
  for (int arm = 0; arm < 60; ++arm) {
    const scene::Scene scene = random_arm(source);
    std::vector<World> worlds;
    for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
      Options options;
      options.method = method;
      worlds.emplace_back(scene, options);
    }
    for (std::size_t i = 0; i < scene.joints.size(); ++i) {
      const double speed = std::uniform_real_distribution(-1.0, 1.0)(source);
      const double torque = std::uniform_real_distribution(0.0, 40.0)(source);
      if (torque > 20) continue;
      for (World& w : worlds) w.set_motor(i, speed, torque);
    }
    double by_tree = 0, by_sweeps = 0;  // rad
    for (int k = 0; k < 500; ++k) {
      for (World& w : worlds) w.step(1e-3);
      for (std::size_t i = 0; i < scene.joints.size(); ++i) {
        by_tree = std::max(by_tree, std::abs(worlds[0].q()[i] - worlds[2].q()[i]));
        by_sweeps = std::max(by_sweeps, std::abs(worlds[1].q()[i] - worlds[2].q()[i]));
      }
    }
    EXPECT_LT(by_tree, 1e-9) << arm;
    EXPECT_LT(by_sweeps, 1e-4) << arm;
    EXPECT_LT(worlds[1].largest_gap(), 1e-8) << arm;
  }
}

}  // namespace
}  // namespace cotwin::contact_world::loops_test
