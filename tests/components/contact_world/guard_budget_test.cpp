// The budget of energy on random scenes with every term, each with and without a gain that no work explains.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "components/contact_world/engine/accounts/accounts.h"
#include "components/contact_world/engine/world.h"
#include "tests/components/contact_world/methods.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::contact_world::guard_budget_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kStep = 1e-3;     // s
constexpr double kGapLimit = 0.1;  // m; this test is about energy
/// Share of the energy that may be gained: half of what is injected, per energy that becomes motion.
constexpr double kShare = 0.005;
constexpr double kInjected = 0.01;  // of the energy that is exchanged

/// An arm of bars with springs, a slider with a spring, and a box and a ball on the ground; what acts on them is drawn from the seed.
class Draw {
 public:
  explicit Draw(unsigned seed) : engine_(seed) {
    scene_.name = "seed " + std::to_string(seed);
    if (one_in(4)) scene_.gravity.setZero();
    if (one_in(4)) scene_.gravity = Vector3d(3, -2, -8);
    scene_.bodies.push_back(cotwin::testing::ground(number(0.1, 0.8), one_in(3) ? number(0, 0.9) : 0));
    ground_ = scene_.bodies.back().shapes[0].material;
    add_arm(1 + static_cast<int>(engine_() % 3));
    add_slider();
    add_loose();
    tool_ = one_in(2);
    field_ = one_in(2);
    drive_ = static_cast<Drive>(engine_() % 5);
    describe();
  }

  const scene::Scene& scene() const { return scene_; }
  const std::string& terms() const { return terms_; }

  /// What acts in the step that begins at t.
  void act(World& world, double t) {
    const double wave = std::sin(7 * t);
    switch (drive_) {
      case Drive::kNone:
        break;
      case Drive::kTorque:
        world.set_tau(0, 30 * wave);
        break;
      case Drive::kServo:
        world.set_tau(0, 20 * wave, 400, 5, 3 * wave);
        break;
      case Drive::kMotor:
        world.set_motor(0, wave > 0 ? 6 : -6, 25);
        break;
      case Drive::kStrongMotor:
        world.set_motor(0, 5 * wave, scene::kInfinity);
        break;
    }
    if (field_) {  // a spring to a place and a wind
      for (std::size_t b = 1; b < scene_.bodies.size(); ++b) {
        Wrench F = Wrench::Zero();
        F.head<3>() = 40 * (Vector3d(0, 0, 1) - world.poses()[b].p) + Vector3d(4, 0, 0);
        world.apply(b, F);
      }
    }
    if (tool_ && std::lround(t / kStep) % 400 == 200) {
      held_ = !held_;
      Inertia inertia = scene_.bodies[tip_].inertia;
      if (held_) {
        inertia.mass += 0.7;
        inertia.I_CC += 0.01 * Matrix3d::Identity();
      }
      world.set_body(tip_, inertia);
    }
  }

 private:
  enum class Drive { kNone, kTorque, kServo, kMotor, kStrongMotor };

  double number(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  bool one_in(unsigned count) { return engine_() % count == 0; }

  void add_joint(scene::JointType type, int parent, int child, const Vector3d& p, const Vector3d& axis) {
    scene::Joint joint;
    joint.name = "joint" + std::to_string(scene_.joints.size());
    joint.type = type;
    joint.parent = parent;
    joint.child = child;
    joint.axis = axis;
    joint.X_PJ.p = parent < 0 ? p : Vector3d(p - scene_.bodies[static_cast<std::size_t>(parent)].X_WB.p);
    joint.X_CJ.p = p - scene_.bodies[static_cast<std::size_t>(child)].X_WB.p;
    if (!one_in(3)) {
      joint.stiffness = number(20, 400);
      joint.q_spring = number(-1, 1);
    }
    if (one_in(3)) joint.damping = number(0.01, 0.3);
    if (one_in(3)) joint.friction = number(0.1, 2);
    if (one_in(4)) {
      joint.q_min = -number(0.5, 2);
      joint.q_max = number(0.5, 2);
    }
    scene_.joints.push_back(joint);
  }

  void add_arm(int bars) {
    const double length = 0.4;
    for (int i = 0; i < bars; ++i) {
      scene::Body bar = cotwin::testing::box("bar" + std::to_string(i), {length, 0.04, 0.06}, number(0.5, 3),
                                             Vector3d(length * (i + 0.5), 0, 2), 0.5);
      bar.shapes.clear();
      scene_.bodies.push_back(bar);
      tip_ = scene_.bodies.size() - 1;
      const Vector3d axis = one_in(2) ? Vector3d::UnitY() : Vector3d(0, 0.6, 0.8);
      add_joint(scene::JointType::kRevolute, i == 0 ? -1 : static_cast<int>(tip_) - 1, static_cast<int>(tip_),
                {length * i, 0, 2}, axis);
    }
  }

  void add_slider() {
    scene::Body weight = cotwin::testing::box("weight", {0.1, 0.1, 0.1}, number(0.5, 3), {-1, 0, 1.5}, 0.5);
    weight.shapes.clear();
    scene_.bodies.push_back(weight);
    add_joint(scene::JointType::kPrismatic, -1, static_cast<int>(scene_.bodies.size()) - 1, {-1, 0, 1.5}, Vector3d::UnitZ());
    scene_.joints.back().q = 0;
  }

  void add_loose() {
    for (int i = 0; i < 2; ++i) {
      const Vector3d p(2, 1.5 * i, number(0.2, 1.5));
      const double mass = number(0.5, 3);
      scene::Body body = i == 0 ? cotwin::testing::box("box", {0.3, 0.2, 0.2}, mass, p, 0.5)
                                : cotwin::testing::ball("ball", 0.1, mass, p, 0.5);
      if (one_in(3)) {
        body.shapes[0].material.stiffness = number(5e3, 1e5);
        soft_ = true;
      }
      body.V_WB << number(-6, 6), number(-6, 6), number(-1, 4), number(-10, 10), number(-10, 10), number(-10, 10);
      scene_.bodies.push_back(body);
    }
  }

  void describe() {
    terms_ = scene_.name + ", " + std::to_string(scene_.joints.size()) + " joints";
    for (const scene::Joint& joint : scene_.joints) {
      terms_ += " [k " + std::to_string(joint.stiffness) + " d " + std::to_string(joint.damping) + " f " +
                std::to_string(joint.friction) + (joint.q_max < 100 ? " limits" : "") + "]";
    }
    terms_ += std::string(tool_ ? ", tool" : "") + (field_ ? ", field" : "") + (soft_ ? ", soft" : "") + ", restitution " +
              std::to_string(ground_.restitution) + ", drive " + std::to_string(static_cast<int>(drive_));
  }

  std::mt19937_64 engine_;
  scene::Scene scene_;
  scene::Material ground_;
  std::size_t tip_ = 1;
  bool tool_ = false, field_ = false, soft_ = false, held_ = false;
  Drive drive_ = Drive::kNone;
  std::string terms_;
};

double kinetic_energy(const World& world) {
  const double height = [&] {
    double sum = 0;
    for (std::size_t b = 0; b < world.poses().size(); ++b) {
      const scene::Body& body = world.scene().bodies[b];
      if (body.motion == scene::Motion::kDynamic)
        sum -= body.inertia.mass * world.scene().gravity.dot(world.poses()[b].p + world.poses()[b].R * body.inertia.p_LC);
    }
    return sum;
  }();
  return cotwin::testing::energy(world.scene(), world.poses(), world.twists()) - height;
}

/// Multiplies all velocities, in the state: the world takes this for its own motion.
void scale_speeds(World& world, double factor, std::vector<double>& state) {
  constexpr std::size_t kBefore = 8, kPerBody = 16, kVelocities = 7;  // World::save
  world.save(state);
  for (std::size_t b = 0; b < world.poses().size(); ++b) {
    for (std::size_t k = kVelocities; k < kPerBody; ++k) state[kBefore + kPerBody * b + k] *= factor;
  }
  world.restore(state);
}

struct Seen {
  std::string fault;
  double time = 0, exchanged = 0, injected = 0;
};

Seen run(unsigned seed, Method method, double share, double duration) {
  Draw draw(seed);
  Options options;
  options.method = method;
  World world(draw.scene(), options);
  std::vector<double> state;
  Seen seen;
  for (int k = 0; k < std::lround(duration / kStep) && seen.fault.empty(); ++k) {
    draw.act(world, k * kStep);
    const double before = kinetic_energy(world), all = world.energy();  // a tool may have changed them
    world.step(kStep);
    const double now = kinetic_energy(world), change = std::max(std::abs(now - before), std::abs(world.energy() - all));
    seen.exchanged += change;
    seen.fault = world.fault(kGapLimit, kShare);
    seen.time = (k + 1) * kStep;
    if (share == 0 || now < 1e-3) continue;
    scale_speeds(world, std::sqrt(1 + share * change / now), state);
    seen.injected += share * change;
  }
  return seen;
}

class Budget : public cotwin::testing::EachMethod {};

TEST_P(Budget, EndsRandomScenesOnlyIfEnergyIsInjected) {
  constexpr unsigned kScenes = 60;
  for (unsigned seed = 1; seed <= kScenes; ++seed) {
    const std::string terms = Draw(seed).terms();
    const Seen without = run(seed, GetParam(), 0, 1.5);
    EXPECT_EQ(without.fault, "") << terms << ", after " << without.time << " s";
    const Seen with = run(seed, GetParam(), kInjected, 10);
    EXPECT_THAT(with.fault, HasSubstr("without work"))
        << terms << ", injected " << with.injected << " J of " << with.exchanged << " J";
  }
}

// A ball that strikes a driven plate: in the frame of the plate it bounces with e, in which the plate gives or takes energy.
TEST_P(Budget, CountsWhatDrivenBodiesTakeAndGiveInImpactsOnce) {
  for (const double e : {0.1, 0.5, 0.9}) {
    for (const double v : {-5.0, -2.0, 0.0, 3.0}) {
      for (const double step : {1e-3, 1e-4}) {
        scene::Scene scene;
        scene.name = "plate";
        scene.gravity.setZero();
        scene.bodies.push_back(cotwin::testing::box("plate", {1, 1, 0.1}, 1, {0, 0, 0}, 0.3));
        scene.bodies.back().motion = scene::Motion::kDriven;
        scene.bodies.push_back(cotwin::testing::ball("ball", 0.1, 1, {0, 0, 0.35}, 0.3, e));
        scene.bodies.back().V_WB << 0, 0, -6, 0, 0, 0;
        Options options;
        options.method = GetParam();
        World world(scene, options);
        std::string fault;
        Twist V = Twist::Zero();
        V[2] = v;
        for (double t = 0; t < 0.4 && fault.empty(); t += step) {
          world.set_twist(0, V);
          world.step(step);
          fault = world.fault(kGapLimit, kShare);
        }
        EXPECT_EQ(fault, "") << "e = " << e << ", plate at " << v << " m/s, steps of " << step << " s";
        EXPECT_NEAR(world.twists()[1][2], v + e * (6 + v), 1e-9);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Budget, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::guard_budget_test
