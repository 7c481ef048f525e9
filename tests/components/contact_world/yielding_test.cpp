// Contacts by area (elastic foundation) and contacts that yield, against closed forms.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "components/contact_world/engine/soft_contact.h"
#include "components/contact_world/engine/world.h"
#include "models/collision/contact/detector.h"
#include "tests/components/contact_world/shapes.h"
#include "tests/support/allocations.h"

namespace cotwin::contact_world::yielding_test {
namespace {

using contact_world::testing::make;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

constexpr double kModulus = 5e6, kThickness = 0.05, kStress = 1e5, kRadius = 0.01;  // Pa, m, Pa, m: specifications, section 6
constexpr double kFoundation = kModulus / kThickness;

Shape pad_shape(double yield = scene::kInfinity, double breakthrough = scene::kInfinity) {
  Shape shape = make(ShapeType::kBox, {0.2, 0.2, kThickness});
  shape.material.foundation = kFoundation;
  shape.material.yield = yield;
  shape.material.breakthrough = breakthrough;
  return shape;
}

scene::Body body_of(const std::string& name, const Shape& shape, const Vector3d& p, scene::Motion motion) {
  scene::Body body;
  body.name = name;
  body.motion = motion;
  body.X_WB.p = p;
  body.inertia.mass = 1;
  body.inertia.I_CC = 0.01 * Eigen::Matrix3d::Identity();
  body.shapes.push_back(shape);
  body.shapes.back().name = name;
  return body;
}

// ---- Patches

struct Load {
  double volume = 0;         // m³
  Vector3d moment{0, 0, 0};  // ∫ d x dA, m⁴
};

/// Sums over the contact points of a shape in a pose on the pad, whose top is z = 0.
Load patch_of(const Shape& shape, const Pose& X) {
  scene::Scene scene;
  scene.bodies = {body_of("pad", pad_shape(), {0, 0, -kThickness / 2}, scene::Motion::kStatic),
                  body_of("punch", shape, X.p, scene::Motion::kDynamic)};
  scene.bodies[1].X_WB = X;
  collision::Detector detector(scene);
  detector.detect(std::vector<Pose>{scene.bodies[0].X_WB, X}, 1e-6);
  Load load;
  for (const ContactPoint& point : detector.points()) {
    EXPECT_NEAR(point.n_W.z(), 1, 1e-9);
    load.volume += point.area * point.load;
    load.moment += point.area * point.load * point.p_W;
  }
  return load;
}

/// The same by columns of `cell` m.
Load columns_of(const Shape& shape, const Pose& X, double cell) {
  Load load;
  const auto inside = [&](const Vector3d& p_W) {
    const Vector3d p = X.inverse() * p_W;
    const double r = shape.size.x(), half = shape.size.y() / 2;
    switch (shape.type) {
      case ShapeType::kSphere:
        return p.norm() <= r;
      case ShapeType::kBox:
        return (p.cwiseAbs().array() <= shape.size.array() / 2).all();
      case ShapeType::kCylinder:
        return p.head<2>().norm() <= r && std::abs(p.z()) <= half;
      case ShapeType::kCapsule:
        return (p - Vector3d(0, 0, std::clamp(p.z(), -half, half))).norm() <= r;
      default:
        return p.cwiseQuotient(shape.size).norm() <= 1;
    }
  };
  constexpr int kCells = 200, kLevels = 100;
  constexpr double kDeepest = 0.01;  // m
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      const double x = X.p.x() + cell * (i + 0.5 - kCells / 2), y = X.p.y() + cell * (j + 0.5 - kCells / 2);
      if (std::abs(x) > 0.1) continue;  // the border of the pad
      // The foundation is pressed down to the lowest point of the column.
      double depth = 0;
      for (int k = kLevels; k > 0 && depth == 0; --k) {
        if (inside({x, y, -kDeepest * (k - 0.5) / kLevels})) depth = kDeepest * k / kLevels;
      }
      load.volume += depth * cell * cell;
      load.moment += depth * cell * cell * Vector3d(x, y, 0);
    }
  }
  return load;
}

TEST(Patch, GivesTheVolumeOfClosedForms) {
  const double d = 1e-3;
  const Pose down{Eigen::Matrix3d::Identity(), {0.01, 0.02, 0.05 - d}};
  EXPECT_NEAR(patch_of(make(ShapeType::kCylinder, {kRadius, 0.1, 0}), down).volume, M_PI * kRadius * kRadius * d, 1e-16);
  EXPECT_NEAR(patch_of(make(ShapeType::kBox, {0.03, 0.02, 0.1}), down).volume, 0.03 * 0.02 * d, 1e-16);
  const double R = 0.05;
  EXPECT_NEAR(patch_of(make(ShapeType::kSphere, {R, 0, 0}), down).volume, M_PI * d * d * (3 * R - d) / 3, 1e-16);
  EXPECT_NEAR(patch_of(make(ShapeType::kEllipsoid, {R, R, R}), down).volume, M_PI * d * d * (3 * R - d) / 3, 1e-16);
}

TEST(Patch, GivesVolumeAndMomentOfAnyShapeAtAnyAngle) {
  struct Case {
    Shape shape;
    Pose X;
  };
  const auto turned = [](double about_x, double about_y, double about_z) {
    return Eigen::Matrix3d(Eigen::AngleAxisd(about_x, Vector3d::UnitX()) * Eigen::AngleAxisd(about_y, Vector3d::UnitY()) *
                           Eigen::AngleAxisd(about_z, Vector3d::UnitZ()));
  };
  const Shape box = make(ShapeType::kBox, {0.03, 0.02, 0.04}), cylinder = make(ShapeType::kCylinder, {kRadius, 0.04, 0}),
              capsule = make(ShapeType::kCapsule, {kRadius, 0.03, 0}), ball = make(ShapeType::kSphere, {kRadius, 0, 0}),
              egg = make(ShapeType::kEllipsoid, {0.01, 0.015, 0.02});
  std::vector<Case> cases{{box, {turned(0, 0, 0.3), {0, 0, 0.018}}},       // a face
                          {box, {turned(0.05, 0, 0), {0, 0, 0.0195}}},     // partly submerged
                          {box, {turned(0.3, 0, 0.2), {0, 0, 0.02}}},      // two faces of a tilted box
                          {box, {turned(M_PI / 4, 0, 0), {0, 0, 0.019}}},  // an edge
                          {box, {turned(0.6, 0.5, 0), {0, 0, 0.022}}},     // a vertex
                          {box, {turned(0, 0, 0), {0.095, 0, 0.018}}},     // beyond the border of the pad
                          {cylinder, {turned(0, 0, 0), {0, 0, 0.018}}},
                          {cylinder, {turned(0.08, 0, 0), {0, 0, 0.0195}}},
                          {cylinder, {turned(M_PI / 2, 0, 0), {0, 0, 0.008}}},
                          {cylinder, {turned(0, 0, 0), {0.097, 0, 0.018}}},
                          {capsule, {turned(M_PI / 2, 0, 0), {0, 0, 0.008}}},
                          {capsule, {turned(0, 0, 0), {0, 0, 0.023}}},
                          {ball, {turned(0, 0, 0), {0, 0, 0.006}}},
                          {egg, {turned(0.4, 0.3, 0), {0, 0, 0.014}}}};
  for (std::size_t k = 0; k < cases.size(); ++k) {
    const Load patch = patch_of(cases[k].shape, cases[k].X), columns = columns_of(cases[k].shape, cases[k].X, 2.5e-4);
    ASSERT_GT(columns.volume, 0) << k;
    EXPECT_NEAR(patch.volume / columns.volume, 1, 0.02) << "case " << k;  // of the columns
    const Vector3d off = (patch.moment / patch.volume - columns.moment / columns.volume);
    EXPECT_LT(off.head<2>().norm(), 2e-4) << "case " << k;
  }
}

TEST(Patch, DoesNotDependOnTheNumberOfCornersOfAFace) {
  const double d = 1e-3, side = 0.02;
  std::vector<double> areas;
  for (const int corners : {3, 4, 8, 40}) {
    Shape prism = make(ShapeType::kHull, Vector3d::Zero());
    const double radius = std::sqrt(2 * side * side / (corners * std::sin(2 * M_PI / corners)));
    for (int k = 0; k < corners; ++k) {
      const double a = 2 * M_PI * k / corners;
      for (const double z : {0.0, 0.05}) prism.vertices.emplace_back(radius * std::cos(a), radius * std::sin(a), z);
    }
    EXPECT_NEAR(patch_of(prism, {Eigen::Matrix3d::Identity(), {0, 0, -d}}).volume, side * side * d, 1e-6 * side * side * d)
        << corners;
  }
}

// ---- Motion

/// A punch of 1 kg on a vertical slide that a spring and damper move: a robot's compliance along one axis.
struct Press {
  explicit Press(const Shape& punch, std::vector<scene::Body> below, Method method = Method::kTree, double start = 1e-4,
                 double mass = 1) {
    scene::Scene scene;
    scene.gravity.setZero();
    scene.bodies = std::move(below);
    const double half = punch.type == ShapeType::kSphere ? punch.size.x()
                        : punch.type == ShapeType::kBox  ? punch.size.z() / 2
                                                         : punch.size.y() / 2;
    scene.bodies.push_back(body_of("punch", punch, {0, 0, half + start}, scene::Motion::kDynamic));
    scene.bodies.back().inertia.mass = mass;
    scene::Joint slide;
    slide.name = "slide";
    slide.type = scene::JointType::kPrismatic;
    slide.child = static_cast<int>(scene.bodies.size()) - 1;
    slide.axis = -Vector3d::UnitZ();
    slide.X_PJ.p = scene.bodies.back().X_WB.p;
    scene.joints.push_back(slide);
    Options options;
    options.method = method;
    world.emplace(scene, options);
    from = start;
  }

  /// Steps with the desired depth x_d(t) below the pad's top, spring S and damper D.
  void run(double seconds, double h, double S, double D, const std::function<double(double)>& x_d,
           const std::function<void()>& each = {}) {
    const int steps = static_cast<int>(std::lround(seconds / h));
    for (int k = 0; k < steps; ++k) {
      const double t = k * h, now = x_d(t), rate = (x_d(t + h) - now) / h;
      world->set_tau(0, S * (now - depth()), S, D, rate);
      world->step(h);
      if (each) each();
    }
  }
  double depth() const { return world->q()[0] - from; }
  double force() const {
    double sum = 0;
    for (const Vector3d& f : world->forces()) sum += f.z();
    return sum;
  }
  const Yielding& pad() const { return world->yielding()[0]; }

  std::optional<World> world;
  double from = 0;
};

scene::Body pad(double yield, double breakthrough = scene::kInfinity) {
  return body_of("pad", pad_shape(yield, breakthrough), {0, 0, -kThickness / 2}, scene::Motion::kStatic);
}

const Shape kPunch = make(ShapeType::kCylinder, {kRadius, 0.1, 0});
const double kArea = M_PI * kRadius * kRadius;

/// 0 to 1 in `seconds` without jumps of the velocity.
double smooth(double t, double seconds) {
  const double s = std::clamp(t / seconds, 0.0, 1.0);
  return s * s * s * (10 - 15 * s + 6 * s * s);
}

TEST(Yielding, FollowsTheCurveOfLoadingUnloadingAndReloading) {
  // Elastic to F_y / K, then F_y; unloading and reloading along K from the dent.
  const double K = kFoundation * kArea, F_y = kStress * kArea;
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    for (const double h : {5e-4, 1e-3, 2e-3}) {
      Press press(kPunch, {pad(kStress)}, method);
      double dent = 0, before = 0;
      int compared = 0;
      const auto path = [&](double t) {
        if (t < 1) return -1e-4 + 4.1e-3 * smooth(t, 1);
        if (t < 2) return 4e-3 - 2e-3 * smooth(t - 1, 1);
        return 2e-3 + 4e-3 * smooth(t - 2, 1);
      };
      press.run(4, h, 1e6, 2e3, path, [&] {
        const double x = press.depth();
        dent = std::max(dent, x - F_y / K);
        const double now = x < dent ? 0 : std::min(F_y, K * (x - dent));
        EXPECT_NEAR(press.force(), (now + before) / 2, 2e-3 * F_y) << "at " << x << " m, h = " << h;  // a mean over the step
        before = now;
        ++compared;
      });
      EXPECT_EQ(compared, std::lround(4 / h));
      EXPECT_NEAR(press.depth(), 6e-3 - F_y / 1e6, 1e-9);
      EXPECT_NEAR(press.force(), F_y, 1e-5 * F_y);
      EXPECT_NEAR(press.pad().depth, press.depth() - F_y / K, 1e-8);
      EXPECT_NEAR(press.pad().work / (F_y * press.pad().depth), 1, 1e-6) << h;
    }
  }
}

TEST(Yielding, BeginsAtTheStiffnessOfTheClosedForm) {
  // At rest S (δ − x) = K x; the pad yields where K x > F_y: S = F_y K / (K δ − F_y), 3440 N/m for these values.
  const double K = kFoundation * kArea, F_y = kStress * kArea, target = 0.01;
  const double critical = F_y * K / (K * target - F_y);
  EXPECT_NEAR(critical, 3440, 60);
  for (const Method method : {Method::kTree, Method::kDantzig}) {
    for (const double share : {0.999, 1.001}) {
      Press press(kPunch, {pad(kStress)}, method);
      const double S = share * critical;
      press.run(4, 1e-3, S, 2 * std::sqrt(S), [&](double t) { return -1e-4 + (target + 1e-4) * smooth(t, 3); });
      EXPECT_EQ(press.pad().depth > 0, share > 1) << share;
      const double at_rest = share < 1 ? S * target * K / (S + K) : F_y;
      EXPECT_NEAR(press.force(), at_rest, 1e-4 * F_y);
    }
  }
}

TEST(Yielding, TurnsTheEnergyOfAnImpactIntoAccountedWorkAndRebound) {
  // m v²/2 = F_y · dent + m v'²/2, and the rebound is the energy of the spring at the limit, F_y²/(2 K).
  const double K = kFoundation * kArea, F_y = kStress * kArea;
  for (const Method method : {Method::kTree, Method::kDantzig}) {
    for (const double h : {5e-4, 1e-3, 2e-3}) {
      for (const double mass : {0.5, 20.0}) {
        Press press(kPunch, {pad(kStress)}, method, 1e-3, mass);
        const double v = 0.3 / std::sqrt(mass);
        press.world->set_twist(1, (Twist() << 0, 0, -v, 0, 0, 0).finished());
        for (int k = 0; k < std::lround(1 / h); ++k) {
          press.world->step(h);
          ASSERT_EQ(press.world->fault(0.01, 0.01), "");
        }
        const double left = press.world->energy(), start = mass * v * v / 2;
        EXPECT_NEAR(press.pad().work, F_y * press.pad().depth, 1e-6 * F_y * press.pad().depth);
        EXPECT_NEAR(press.pad().work + left, start, 1e-6 * start) << h << " s, " << mass << " kg";
        EXPECT_NEAR(left, F_y * F_y / (2 * K), 5e-3 * start) << h << " s, " << mass << " kg";
        EXPECT_GT(press.world->twists()[1][2], 0);
      }
    }
  }
}

TEST(Yielding, FindsTheVelocityUnderItsLawAtAnyStiffness) {
  // The law is not convex: the work of the mean force bends where the contact begins and where it yields.
  for (double stiffness = 1e3; stiffness < 1e15; stiffness *= 10) {
    for (const double gap : {1.4e-4, 5e-5, 1e-6, 0.0, -1e-7, -1e-5, -1e-3}) {
      for (const double limit : {1e-3, 1.0, 1e3, 1e9}) {
        for (const double w : {-3.0, -0.147, -1e-4, 0.2}) {
          SoftContact contact{gap, stiffness, 0, 1e-3};
          contact.conserves = true;
          contact.limit = limit;
          const double u = contact.solve(w, 2.0);
          // The rounding of u times the slope of a stiff spring's impulse.
          const double rounding = 1e-9 * (std::abs(u) + std::abs(w)) * (1 + std::abs(contact.slope(u)));
          EXPECT_NEAR(u, w + 2 * std::max(0.0, contact.impulse(u)), rounding)
              << stiffness << " N/m, gap " << gap << " m, limit " << limit << " N, from " << w << " m/s";
        }
      }
    }
  }
}

TEST(Yielding, KeepsTheEnergyOfAnImpactOnASurfaceThatTheStepDoesNotResolve) {
  // Four points at once, from a tenth to ten thousand times the stiffness that the step resolves: m v²/2 = F_y · dent + m v'²/2.
  const double side = 0.1, F_y = kStress * side * side, v = 0.14;
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    for (double foundation = 1e8; foundation < 1e15; foundation *= 10) {
      scene::Scene scene;
      scene.gravity.setZero();
      scene.bodies = {pad(kStress), body_of("block", make(ShapeType::kBox, {side, side, side}), {0, 0, side / 2 + 1e-3},
                                            scene::Motion::kDynamic)};
      scene.bodies[0].shapes[0].material.foundation = foundation;
      scene.bodies[1].V_WB[2] = -v;
      Options options;
      options.method = method;
      World world(scene, options);
      for (int k = 0; k < 40; ++k) world.step(1e-3);
      const double work = world.yielding()[0].work;
      EXPECT_NEAR(work + world.energy(), v * v / 2, 1e-6 * v * v) << foundation << " Pa/m";
      EXPECT_NEAR(work, F_y * world.yielding()[0].depth, 1e-6 * v * v) << foundation << " Pa/m";
      EXPECT_GE(world.twists()[1][2], 0) << foundation << " Pa/m";
    }
  }
}

TEST(Yielding, BreaksThroughALayerAndThenPressesOnTheNext) {
  // The pad yields at F_y up to its breakthrough; then the plate below it yields at its own, higher limit.
  const double h = 1e-3, thin = 0.005, F_y = kStress * kArea;
  Shape layer = pad_shape(kStress, thin), plate = pad_shape(5 * kStress);
  layer.size.z() = thin;
  layer.material.foundation = kModulus / thin;
  plate.material.foundation = 10 * kFoundation;
  Press press(kPunch, {body_of("layer", layer, {0, 0, -thin / 2}, scene::Motion::kStatic),
                       body_of("plate", plate, {0, 0, -thin - kThickness / 2}, scene::Motion::kStatic)});
  double of_layer = 0, of_plate = 0, deepest = 0;
  press.run(
      4, h, 1e6, 2e3, [](double t) { return -1e-4 + 8.1e-3 * smooth(t, 4); },
      [&] {
        (press.world->yielding()[0].pierced ? of_plate : of_layer) =
            std::max(press.world->yielding()[0].pierced ? of_plate : of_layer, press.force());
        if (!press.world->yielding()[0].pierced) deepest = press.depth();
      });
  const auto both = press.world->yielding();
  EXPECT_TRUE(both[0].pierced);
  EXPECT_FALSE(both[1].pierced);
  EXPECT_NEAR(of_layer, F_y, 1e-6 * F_y);
  EXPECT_NEAR(of_plate, 5 * F_y, 1e-4 * F_y);
  EXPECT_NEAR(deepest, thin, 4e-6);  // one step of the motion
  // All work on the layer is dissipated: F_y (t − F_y / (2 K)).
  EXPECT_NEAR(both[0].work, F_y * (thin - F_y / (2 * layer.material.foundation * kArea)), 1e-3 * F_y * thin);
  EXPECT_NEAR(both[1].work, 5 * F_y * both[1].depth, 1e-6 * both[1].work);
}

TEST(Yielding, OfABallFollowsItsFootprint) {
  // Elastic: k π δ² (3 R − δ)/3. Then the mean pressure on the footprint π (2 R δ − δ²) is the limit; unloading along k A.
  const double R = 0.03;
  Press press(make(ShapeType::kSphere, {R, 0, 0}), {pad(kStress)});
  const auto area = [&](double d) { return M_PI * (2 * R * d - d * d); };
  double yielded = 0, dented = 0, most = 0;
  press.run(
      2, 1e-3, 1e7, 1e4, [](double t) { return -1e-4 + 4.1e-3 * smooth(t, 2); },
      [&] {
        const double d = press.depth();
        if (d <= 0) return;
        const double elastic = kFoundation * M_PI * d * d * (3 * R - d) / 3;
        EXPECT_NEAR(press.force(), std::min(elastic, kStress * area(d)), 0.01 * kStress * area(4e-3)) << d;
        yielded = elastic > kStress * area(d) ? yielded + 1 : yielded;
        most = d;
      });
  EXPECT_GT(yielded, 500);
  dented = press.pad().depth;
  EXPECT_NEAR(dented, most - kStress / kFoundation, 1e-6);
  press.run(1, 1e-3, 1e7, 1e4, [&](double) { return dented + 4e-4; });
  EXPECT_NEAR(press.force(), kFoundation * area(most) * (press.depth() - dented), 0.02 * press.force());
}

TEST(Yielding, RemembersDentsByPlace) {
  // A slab is pressed at a place, moved aside, pressed again and moved back: only the first place is indented there.
  const double K = kFoundation * kArea, F_y = kStress * kArea;
  scene::Body slab = pad(kStress);
  slab.motion = scene::Motion::kDriven;
  Press press(kPunch, {slab});
  const auto in_and_out = [&](double depth) {
    press.run(1, 1e-3, 1e6, 2e3,
              [&](double t) { return -1e-4 + (depth + 1e-4) * (t < 0.5 ? smooth(t, 0.5) : 1 - smooth(t - 0.5, 0.5)); });
  };
  const auto shift = [&](double by) {
    press.world->set_pose(0, {Eigen::Matrix3d::Identity(), press.world->poses()[0].p + Vector3d(by, 0, 0)});
  };
  in_and_out(3e-3);
  const double work = press.pad().work;
  EXPECT_NEAR(press.pad().depth, 3e-3 - F_y / 1e6 - F_y / K, 2e-6);
  in_and_out(2.9e-3);
  EXPECT_EQ(press.pad().work, work);  // it fits into its dent
  shift(0.04);
  in_and_out(2e-3);
  const double second = press.pad().work - work;
  EXPECT_NEAR(second, F_y * (2e-3 - F_y / 1e6 - F_y / K), 2e-3 * second);
  shift(-0.04);
  in_and_out(2.9e-3);
  EXPECT_EQ(press.pad().work, work + second);
}

TEST(Yielding, IsRestoredToTheBitAndAllocatesNothing) {
  for (const double tilt : {0.0, 0.02}) {
    const auto scene = [&] {
      scene::Scene made;
      made.bodies = {pad(kStress, 5e-3),
                     body_of("block", make(ShapeType::kBox, {0.04, 0.03, 0.05}), {0, 0, 0.03}, scene::Motion::kDynamic)};
      made.bodies[1].X_WB.R = Eigen::AngleAxisd(tilt, Vector3d(1, 0.5, 0).normalized()).toRotationMatrix();
      made.bodies[1].inertia.mass = 3;
      made.bodies[1].V_WB << 0.1, 0, -2.5, 0, 0.3, 0;
      return made;
    };
    World world(scene(), {}), other(scene(), {});
    std::vector<double> state, state_of_other;
    world.save(state);
    for (int k = 0; k < 300; ++k) {
      other.restore(state);
      const auto before = cotwin::testing::allocations();
      world.step(1e-3);
      EXPECT_EQ(cotwin::testing::allocations(), before);
      other.step(1e-3);
      world.save(state);
      other.save(state_of_other);
      ASSERT_EQ(state, state_of_other) << "step " << k;
      ASSERT_EQ(world.fault(0.01, 0.25), "") << "step " << k;
    }
    EXPECT_GT(world.yielding()[0].depth, 1e-4);
  }
}

TEST(Yielding, OfAWholeContactDoesNotDependOnItsArea) {
  Shape buffer = pad_shape();
  buffer.material.foundation = 2e4;  // N/m
  buffer.material.yield = 50;        // N
  buffer.material.whole = true;
  for (const Shape& punch : {kPunch, make(ShapeType::kBox, {0.05, 0.03, 0.1}), make(ShapeType::kSphere, {0.05, 0, 0})}) {
    Press press(punch, {body_of("pad", buffer, {0, 0, -kThickness / 2}, scene::Motion::kStatic)});
    press.run(2, 1e-3, 1e6, 2e3, [](double t) { return -1e-4 + 2.1e-3 * smooth(t, 2); });
    EXPECT_NEAR(press.force(), 2e4 * press.depth(), 1e-3);
    press.run(2, 1e-3, 1e6, 2e3, [](double t) { return 2e-3 + 2e-3 * smooth(t, 2); });
    EXPECT_NEAR(press.force(), 50, 1e-3);
    EXPECT_NEAR(press.pad().work, 50 * press.pad().depth, 50 * 1e-6 * press.pad().depth);
  }
}

}  // namespace
}  // namespace cotwin::contact_world::yielding_test
