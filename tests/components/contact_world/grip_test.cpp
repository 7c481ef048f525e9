// Grippers: the load that friction holds, against the closed form μ Σ F = m g.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <string_view>

#include "tests/components/contact_world/methods.h"
#include "tests/support/allocations.h"

namespace cotwin::contact_world::grip_test {
namespace {

using Eigen::Vector3d;

constexpr double kForce = 12, kGravity = 9.81;  // force of each finger, N
constexpr double kRadius = 0.025;               // of the workpiece, m

enum class Workpiece { kBox, kCylinder, kCylinderAcross, kPrism, kBall };
enum class Pads { kBoxes, kUnequalBoxes, kCapsules, kBalls, kWall };

struct Grip {
  int fingers = 2;
  Workpiece workpiece = Workpiece::kBox;
  double tilt = 0;                      // of gravity about the axis of the first finger, rad
  double stiffness = scene::kInfinity;  // of the pads, N/m
  double offset = 0;                    // of the workpiece's centre below the fingers' centres, m
  double mu = 0.8;
  Pads pads = Pads::kBoxes;
  double gravity = kGravity;  // m/s²; a force on the workpiece does the rest
  double restitution = 0;     // of the pads
};

/// An octagonal prism about z whose faces are at the distance kRadius.
scene::Shape prism(double height) {
  scene::Shape shape;
  shape.type = scene::ShapeType::kHull;
  const double corner = kRadius / std::cos(std::numbers::pi / 8);
  for (int i = 0; i < 8; ++i) {
    const double angle = std::numbers::pi / 8 + i * std::numbers::pi / 4;
    for (const double z : {-height / 2, height / 2})
      shape.vertices.emplace_back(corner * std::cos(angle), corner * std::sin(angle), z);
  }
  return shape;
}

/// Changes the shapes of finger i.
void shape_pads(const Grip& grip, int i, scene::Body& finger) {
  scene::Shape& shape = finger.shapes[0];
  if (grip.pads == Pads::kUnequalBoxes && i == 0) shape.size = {0.02, 0.02, 0.03};
  if (grip.pads == Pads::kWall && i == 1) finger.motion = scene::Motion::kStatic;
  if (grip.pads == Pads::kWall) shape.size = i == 1 ? Vector3d(0.02, 1, 1) : Vector3d(0.02, 0.03, 0.06);
  if (grip.pads == Pads::kCapsules) {  // across
    shape.type = scene::ShapeType::kCapsule;
    shape.size = {0.01, 0.03, 0};
    shape.X_BS.R = Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX()).toRotationMatrix();
  }
  if (grip.pads != Pads::kBalls) return;
  shape.type = scene::ShapeType::kSphere;
  shape.size = {0.01, 0, 0};
  finger.shapes.resize(3, shape);
  for (int k = 0; k < 3; ++k) {
    const double angle = 0.4 + 2 * k * std::numbers::pi / 3;
    finger.shapes[static_cast<std::size_t>(k)].X_BS.p = {0, 0.012 * std::cos(angle), 0.012 * std::sin(angle)};
  }
}

/// The workpiece (body 0) between fingers on prismatic joints towards the z axis.
scene::Scene gripper(const Grip& grip, double mass) {
  scene::Scene scene;
  scene.name = "gripper";
  scene.gravity = Eigen::AngleAxisd(grip.tilt, Vector3d::UnitX()) * Vector3d(0, 0, -grip.gravity);
  scene::Body piece = cotwin::testing::box("piece", {2 * kRadius, 2 * kRadius, 0.08}, mass, {0, 0, -grip.offset}, grip.mu);
  scene::Shape& shape = piece.shapes[0];
  if (grip.workpiece == Workpiece::kCylinder || grip.workpiece == Workpiece::kCylinderAcross) {
    shape.type = scene::ShapeType::kCylinder;
    shape.size = {kRadius, 0.08, 0};
    if (grip.workpiece == Workpiece::kCylinderAcross) {
      shape.X_BS.R = Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX()).toRotationMatrix();
    }
  } else if (grip.workpiece == Workpiece::kBall) {
    shape.type = scene::ShapeType::kSphere;
    shape.size = {kRadius, 0, 0};
  } else if (grip.workpiece == Workpiece::kPrism) {
    const scene::Material material = shape.material;
    shape = prism(0.08);
    shape.material = material;
  }
  scene.bodies.push_back(piece);
  for (int i = 0; i < grip.fingers; ++i) {
    const double angle = 2 * std::numbers::pi * i / grip.fingers;
    const Eigen::Matrix3d R = Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix();
    scene::Body finger =
        cotwin::testing::box("finger" + std::to_string(i), {0.02, 0.04, 0.1}, 0.1, R * Vector3d(kRadius + 0.01, 0, 0), grip.mu);
    finger.X_WB.R = R;
    finger.shapes[0].material.stiffness = grip.stiffness;
    finger.shapes[0].material.damping = std::isinf(grip.stiffness) ? 0 : 20;
    finger.shapes[0].material.restitution = grip.restitution;
    shape_pads(grip, i, finger);
    scene.bodies.push_back(finger);
    if (finger.motion == scene::Motion::kStatic) continue;
    scene::Joint joint;
    joint.name = "slide" + std::to_string(i);
    joint.type = scene::JointType::kPrismatic;
    joint.child = i + 1;
    joint.X_PJ = finger.X_WB;
    joint.axis = -Vector3d::UnitX();
    scene.joints.push_back(joint);
  }
  for (int i = 1; i <= grip.fingers; ++i) {
    for (int j = i + 1; j <= grip.fingers; ++j) scene.no_contact.emplace_back(i, j);
  }
  return scene;
}

class GripTest : public cotwin::testing::EachMethod {
 protected:
  /// How far the workpiece moves, m, `share` of the mass that friction holds, after it has settled for 0.2 s.
  static double way(const Grip& grip, double share, double seconds) {
    World w = world(gripper(grip, share * grip.fingers * grip.mu * kForce / kGravity));
    Wrench weight = Wrench::Zero();
    weight.head<3>() = w.scene().bodies[0].inertia.mass * (kGravity - grip.gravity) *
                       (Eigen::AngleAxisd(grip.tilt, Vector3d::UnitX()) * -Vector3d::UnitZ());
    const auto run = [&](double duration) {
      for (int k = 0; k < std::lround(1000 * duration); ++k) {
        w.apply(0, weight);
        for (std::size_t j = 0; j < w.scene().joints.size(); ++j) w.set_tau(j, kForce);
        w.step(1e-3);
      }
    };
    run(0.2);
    const Vector3d start = w.poses()[0].p;
    run(seconds);
    EXPECT_LT(w.gain().share, 1e-3) << w.scene().bodies[w.gain().body].name << " gains " << w.gain().joules << " J";
    return (w.poses()[0].p - start).norm();
  }
};

// The fingers move along one direction only: every distribution of their force over the points in contact balances them, but only an
// even one holds the workpiece.
const Grip kGrips[] = {{},
                       {.offset = 0.02},
                       {.tilt = 0.5},
                       {.workpiece = Workpiece::kPrism},
                       {.fingers = 3, .workpiece = Workpiece::kCylinder},
                       {.fingers = 3, .workpiece = Workpiece::kBall},
                       {.fingers = 4, .workpiece = Workpiece::kPrism},
                       {.workpiece = Workpiece::kCylinder},
                       {.stiffness = 1e5},
                       {.mu = 0.2},
                       {.tilt = 0.6, .mu = 0.2},
                       {.workpiece = Workpiece::kCylinderAcross, .mu = 0.5},
                       {.pads = Pads::kUnequalBoxes},
                       {.workpiece = Workpiece::kCylinderAcross, .pads = Pads::kUnequalBoxes},
                       {.tilt = -1.2, .mu = 0.5, .pads = Pads::kCapsules},
                       {.mu = 0.3, .pads = Pads::kBalls},
                       {.pads = Pads::kWall},
                       {.workpiece = Workpiece::kCylinderAcross, .tilt = 0.6, .mu = 0.2, .pads = Pads::kWall}};

TEST_P(GripTest, HoldsWhatFrictionHoldsAndDropsMore) {
  for (const Grip& grip : kGrips) {
    const std::string what = "grip " + std::to_string(&grip - kGrips);
    EXPECT_LT(way(grip, 0.98, 2), 1e-5) << what;
    EXPECT_GT(way(grip, 1.02, 2), 0.1) << what;
  }
}

// The fingers' drives give them in half a step speeds at which bodies bounce: the workpiece fell out.
TEST_P(GripTest, HoldsWithPadsThatBounce) {
  for (const Grip& rigid : kGrips) {
    for (const double gravity : {0.0, kGravity}) {
      Grip grip = rigid;
      grip.restitution = 0.5;
      grip.gravity = gravity;
      EXPECT_LT(way(grip, 0.98, 0.2), 1e-5) << "grip " << &rigid - kGrips << ", gravity " << gravity;
    }
  }
}

TEST_P(GripTest, HoldsWithoutGravityAsWithIt) {
  for (const Grip& with : kGrips) {
    for (const double gravity : {0.0, 1e-9}) {
      if (gravity > 0 && !std::string_view(COTWIN_SANITIZERS).empty()) continue;  // a sanitizer makes it ten times slower
      Grip grip = with;
      grip.gravity = gravity;
      const std::string what = "grip " + std::to_string(&with - kGrips);
      EXPECT_LT(way(grip, 0.98, 0.3), 1e-5) << what << ", gravity " << gravity;
      EXPECT_GT(way(grip, 1.02, 0.5), 0.01) << what << ", gravity " << gravity;
    }
  }
}

TEST_P(GripTest, AllocatesNothingWhileItSharesTheLoad) {
  for (const Grip& grip : kGrips) {
    World w = world(gripper(grip, 0.98 * grip.fingers * grip.mu * kForce / kGravity));
    const std::uint64_t before = cotwin::testing::allocations();
    for (int k = 0; k < 50; ++k) {
      for (std::size_t j = 0; j < w.scene().joints.size(); ++j) w.set_tau(j, kForce);
      w.step(1e-3);
    }
    EXPECT_EQ(cotwin::testing::allocations(), before) << "grip " << &grip - kGrips;
  }
}

TEST_P(GripTest, StandsStillForAMinute) {
  const double seconds = std::string_view(COTWIN_SANITIZERS).empty() ? 60 : 6;  // a sanitizer makes it ten times slower
  for (const std::size_t i : {0u, 10u, 11u, 13u, 17u}) EXPECT_LT(way(kGrips[i], 0.92, seconds), 1e-6) << "grip " << i;
}

INSTANTIATE_TEST_SUITE_P(All, GripTest, cotwin::testing::kMethods, cotwin::testing::name_of_method);

}  // namespace
}  // namespace cotwin::contact_world::grip_test
