#include "tests/support/hard_scenes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <string>

#include "models/scene/shapes.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::testing {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846, kGravity = 9.81;

// A bar without shape from p_WA to p_WB: a square prism of 20 mm. Its frame is at the middle, parallel to W.
constexpr double kBarWidth = 0.02;  // m

Matrix3d bar_inertia(double mass, double length, const Vector3d& direction) {
  const Matrix3d along = direction * direction.transpose();
  return mass / 12 *
         ((length * length + kBarWidth * kBarWidth) * (Matrix3d::Identity() - along) + 2 * kBarWidth * kBarWidth * along);
}

scene::Body bar(const std::string& name, const Vector3d& p_WA, const Vector3d& p_WB, double mass) {
  scene::Body body;
  body.name = name;
  body.X_WB.p = 0.5 * (p_WA + p_WB);
  body.inertia.mass = mass;
  body.inertia.I_CC = bar_inertia(mass, (p_WB - p_WA).norm(), (p_WB - p_WA).normalized());
  return body;
}

// Both bodies are parallel to W at the start.
void hinge(scene::Scene& scene, int parent, int child, const Vector3d& p_WJ, const Vector3d& axis_W) {
  const auto origin = [&](int k) { return k < 0 ? Vector3d::Zero().eval() : scene.bodies[static_cast<std::size_t>(k)].X_WB.p; };
  scene::Joint joint;
  joint.name = "hinge_" + std::to_string(scene.joints.size());
  joint.parent = parent;
  joint.child = child;
  joint.X_PJ.p = p_WJ - origin(parent);
  joint.X_CJ.p = p_WJ - origin(child);
  joint.axis = axis_W;
  scene.joints.push_back(joint);
}

scene::Scene linkage(double base, double crank, double angle, std::span<const double> pivots) {
  scene::Scene scene;
  scene.name = "linkage";
  const Vector3d offset = crank * Vector3d(std::cos(angle), 0, std::sin(angle));
  for (const double x : pivots) {
    const Vector3d p(x, 0, 0);
    const auto k = static_cast<int>(scene.bodies.size());
    scene.bodies.push_back(bar("crank_" + std::to_string(k), p, p + offset, crank));
    hinge(scene, -1, k, p, Vector3d::UnitY());
  }
  const auto coupler = static_cast<int>(scene.bodies.size());
  scene.bodies.push_back(bar("coupler", offset, offset + Vector3d(base, 0, 0), base));
  for (int k = 0; k < coupler; ++k) {
    hinge(scene, k, coupler, offset + Vector3d(pivots[static_cast<std::size_t>(k)], 0, 0), Vector3d::UnitY());
  }
  for (int a = 0; a <= coupler; ++a) {
    for (int b = a + 1; b <= coupler; ++b) scene.no_contact.emplace_back(a, b);
  }
  return scene;
}

scene::Body static_plane(double mu, double restitution = 0) { return ground(mu, restitution); }

scene::Body static_wall(const std::string& name, const Vector3d& edges, const Vector3d& p_WB, double mu) {
  scene::Body body = box(name, edges, 1, p_WB, mu);
  body.motion = scene::Motion::kStatic;
  body.inertia = {};
  return body;
}

// A body whose frame is at the shape's centre of mass.
scene::Body solid(const std::string& name, scene::Shape shape, double density, const Pose& X_WS) {
  Inertia inertia = scene::solid_inertia(shape, density);
  shape.X_BS.p = -inertia.p_LC;
  scene::Body body;
  body.name = name;
  body.X_WB = X_WS * Pose{Matrix3d::Identity(), inertia.p_LC};
  inertia.p_LC.setZero();
  body.inertia = inertia;
  body.shapes = {std::move(shape)};
  return body;
}

}  // namespace

// ---- Closed loops

scene::Scene parallelogram(double base, double crank, double angle) {
  const double pivots[] = {0, base};
  return linkage(base, crank, angle, pivots);
}

scene::Scene double_parallelogram(double base, double crank, double angle) {
  const double pivots[] = {0, 0.5 * base, base};
  return linkage(base, crank, angle, pivots);
}

// J θ̈ = −G cos θ with J about the pivots.
double parallelogram_angle(double base, double crank, int cranks, double angle, double t) {
  const double J =
      cranks * (crank * (crank * crank + kBarWidth * kBarWidth) / 12 + crank * crank * crank / 4) + base * crank * crank;
  const double G = kGravity * (cranks * crank * crank / 2 + base * crank);
  const int steps = static_cast<int>(std::ceil(t / 1e-4));
  double theta = angle, omega = 0;
  const double h = steps > 0 ? t / steps : 0;
  for (int k = 0; k < steps; ++k) {  // Störmer–Verlet
    omega -= 0.5 * h * G / J * std::cos(theta);
    theta += h * omega;
    omega -= 0.5 * h * G / J * std::cos(theta);
  }
  return theta;
}

scene::Scene bricard() {
  scene::Scene scene;
  scene.name = "bricard";
  scene.gravity = {0, -kGravity, 0};
  const Vector3d steps[] = {Vector3d::UnitX(),  Vector3d::UnitY(),  Vector3d::UnitZ(),
                            -Vector3d::UnitX(), -Vector3d::UnitY(), -Vector3d::UnitZ()};
  Vector3d p = Vector3d::UnitX();  // the first edge of the cube is the world's
  for (int k = 1; k < 6; ++k) {
    scene.bodies.push_back(bar("rod_" + std::to_string(k), p, p + steps[k], 1));
    p += steps[k];
  }
  p = Vector3d::UnitX();
  for (int k = 0; k < 5; ++k) {
    hinge(scene, k - 1, k, p, steps[k].cross(steps[k + 1]));
    p += steps[k + 1];
  }
  hinge(scene, -1, 4, p, steps[5].cross(steps[0]));
  return scene;
}

scene::Scene chain(int links) {
  constexpr double kLength = 0.1, kMass = 0.1;
  scene::Scene scene;
  scene.name = "chain";
  for (int k = 0; k < links; ++k) {
    const Vector3d p(kLength * k, 0, 0);
    scene.bodies.push_back(bar("link_" + std::to_string(k), p, p + kLength * Vector3d::UnitX(), kMass));
    hinge(scene, k - 1, k, p, Vector3d::UnitY());
  }
  return scene;
}

// ---- Several impacts at once

namespace {

constexpr double kCradleRadius = 0.025, kCradleMass = 0.1, kCradleLength = 0.3, kCradleAngle = 0.5;

}  // namespace

scene::Scene cradle(int count, double gap) {
  scene::Scene scene;
  scene.name = "cradle";
  for (int k = 0; k < count; ++k) {
    const Vector3d pivot(k * (2 * kCradleRadius + gap), 0, 0);
    const double angle = k == 0 ? kCradleAngle : 0;
    const Vector3d p = pivot - kCradleLength * Vector3d(std::sin(angle), 0, std::cos(angle));
    scene.bodies.push_back(ball("ball_" + std::to_string(k), kCradleRadius, kCradleMass, p, 0, 1));
    hinge(scene, -1, k, pivot, Vector3d::UnitY());
  }
  return scene;
}

// The energy of a physical pendulum, with a ball's moment of inertia 0.4 m r².
double cradle_speed() {
  const double J = 1 + 0.4 * kCradleRadius * kCradleRadius / (kCradleLength * kCradleLength);
  return std::sqrt(2 * kGravity * kCradleLength * (1 - std::cos(kCradleAngle)) / J);
}

scene::Scene row_of_balls(int count, double gap) {
  constexpr double kRadius = 0.05;
  scene::Scene scene;
  scene.name = "row_of_balls";
  scene.bodies.push_back(static_plane(0));
  for (int k = 0; k <= count; ++k) {
    const double x = k == 0 ? -2 * kRadius - 0.05 : (k - 1) * (2 * kRadius + gap);
    scene.bodies.push_back(ball("ball_" + std::to_string(k), kRadius, 0.5, {x, 0, kRadius}, 0, 1));
  }
  scene.bodies[1].V_WB.x() = 1;
  return scene;
}

scene::Scene square_break(int n) {
  constexpr double kRadius = 0.03;
  scene::Scene scene;
  scene.name = "square_break";
  scene.bodies.push_back(static_plane(0));
  const double middle = (n - 1) * kRadius + 0.1 * kRadius;
  scene.bodies.push_back(ball("cue", kRadius, 0.17, {-2 * kRadius - 0.02, middle, kRadius}, 0, 1));
  scene.bodies[1].V_WB.x() = 3;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      scene.bodies.push_back(
          ball("ball_" + std::to_string(n * i + j), kRadius, 0.17, {2 * kRadius * i, 2 * kRadius * j, kRadius}, 0, 1));
    }
  }
  return scene;
}

// ---- Friction-critical statics

scene::Scene card_house(int levels, double lean, double mu) {
  constexpr double kLength = 0.1, kWidth = 0.07, kThickness = 0.002, kMass = 0.01;
  const double l = 0.5 * kLength, t = 0.5 * kThickness, s = std::sin(lean), c = std::cos(lean);
  const double across = l * s + t * c, half_height = l * c + t * s;  // of a leaning card: half of its extents
  const double pitch = 4 * across + 0.001;
  scene::Scene scene;
  scene.name = "card_house";
  scene.bodies.push_back(static_plane(mu));
  double z = 0;
  for (int level = 0; level < levels; ++level) {
    const int pairs = levels - level;
    for (int k = 0; k < pairs; ++k) {
      const double apex = (k - 0.5 * (pairs - 1)) * pitch;
      for (const double side : {-1.0, 1.0}) {
        scene::Body card = box("card_" + std::to_string(scene.bodies.size()), {kThickness, kWidth, kLength}, kMass,
                               {apex + side * across, 0, z + half_height}, mu);
        card.X_WB.R = Eigen::AngleAxisd(-side * lean, Vector3d::UnitY()).toRotationMatrix();
        scene.bodies.push_back(card);
      }
    }
    z += 2 * half_height;
    for (int k = 0; k + 1 < pairs; ++k) {
      const double middle = (k + 1 - 0.5 * pairs) * pitch;
      scene.bodies.push_back(box("platform_" + std::to_string(scene.bodies.size()), {pitch - 0.0002, kWidth, kThickness}, kMass,
                                 {middle, 0, z + t}, mu));
    }
    z += kThickness;
  }
  return scene;
}

scene::Scene arch(int wedges, double mu) {
  constexpr double kInner = 0.5, kOuter = 0.65, kWidth = 0.2, kDensity = 2000;
  scene::Scene scene;
  scene.name = "arch";
  scene.bodies.push_back(static_plane(mu));
  for (int k = 0; k < wedges; ++k) {
    scene::Shape shape;
    shape.name = "wedge";
    shape.type = scene::ShapeType::kHull;
    shape.material.mu = mu;
    for (const double angle : {kPi * k / wedges, kPi * (k + 1) / wedges}) {
      for (const double radius : {kInner, kOuter}) {
        for (const double y : {-0.5 * kWidth, 0.5 * kWidth}) {
          shape.vertices.emplace_back(radius * std::cos(angle), y, radius * std::sin(angle));
        }
      }
    }
    scene.bodies.push_back(solid("wedge_" + std::to_string(k), shape, kDensity, {}));
  }
  return scene;
}

namespace {

constexpr double kLadderLength = 2, kLadderThickness = 0.02, kLadderMass = 10, kLadderAngle = kPi / 3;

}  // namespace

scene::Scene ladder(double mu) {
  constexpr double l = 0.5 * kLadderLength, t = 0.5 * kLadderThickness;
  const double c = std::cos(kLadderAngle), s = std::sin(kLadderAngle);
  scene::Scene scene;
  scene.name = "ladder";
  scene.bodies.push_back(static_plane(mu));
  scene.bodies.push_back(static_wall("wall", {0.2, 2, 4}, {-0.1, 0, 2}, 0));
  // The ladder's z axis points up along it, to the wall; its lower face touches ground and wall.
  scene::Body body = box("ladder", {kLadderThickness, 0.3, kLadderLength}, kLadderMass, {l * c + t * s, 0, l * s + t * c}, mu);
  body.X_WB.R = Eigen::AngleAxisd(kLadderAngle - 0.5 * kPi, Vector3d::UnitY()).toRotationMatrix();
  scene.bodies.push_back(body);
  scene.no_contact = {{0, 1}};
  return scene;
}

// Moments about the centre of mass of N and μ N at the foot and μ N at the wall.
double critical_ladder_mu() {
  constexpr double l = 0.5 * kLadderLength, t = 0.5 * kLadderThickness;
  return (l * std::cos(kLadderAngle) - t * std::sin(kLadderAngle)) / (2 * l * std::sin(kLadderAngle));
}

// Planar motion with both ends in contact: θ from the horizontal is the only freedom,
//   (−I + m z_t a − m c b) θ̈ = m z_t x_c θ̇² + m c (g − z_c θ̇²)
// with p_C = (x_c, z_c), a = dx_c/dθ, b = dz_c/dθ, z_t the upper contact's height above C and c the arm of the ground's force.
double ladder_path(double mu, double duration) {
  constexpr double l = 0.5 * kLadderLength, t = 0.5 * kLadderThickness, m = kLadderMass;
  constexpr double I = m / 12 * (kLadderLength * kLadderLength + kLadderThickness * kLadderThickness);
  const auto acceleration = [&](double theta, double dtheta) {
    const double C = std::cos(theta), S = std::sin(theta);
    const double x_c = l * C + t * S, z_c = l * S + t * C, a = -l * S + t * C, b = l * C - t * S;
    const double z_t = l * S - t * C, c = l * C - t * S - 2 * mu * l * S;
    return (m * z_t * x_c * dtheta * dtheta + m * c * (kGravity - z_c * dtheta * dtheta)) / (-I + m * z_t * a - m * c * b);
  };
  const auto centre = [&](double theta) {
    return Eigen::Vector2d(l * std::cos(theta) + t * std::sin(theta), l * std::sin(theta) + t * std::cos(theta));
  };
  constexpr int kSteps = 20000;
  const double h = duration / kSteps;
  double theta = kLadderAngle, dtheta = 0;
  for (int k = 0; k < kSteps; ++k) {  // midpoint rule
    const double half = dtheta + 0.5 * h * acceleration(theta, dtheta), middle = theta + 0.5 * h * dtheta;
    dtheta += h * acceleration(middle, half);
    theta += h * half;
  }
  return (centre(theta) - centre(kLadderAngle)).norm();
}

scene::Scene stack_of_masses(std::span<const double> masses) {
  scene::Scene scene = stack(static_cast<int>(masses.size()));
  for (std::size_t k = 0; k < masses.size(); ++k) {
    scene.bodies[k + 1].inertia.mass *= masses[k];
    scene.bodies[k + 1].inertia.I_CC *= masses[k];
  }
  return scene;
}

scene::Scene dominoes(int count) {
  constexpr double kHeight = 0.1;
  scene::Scene scene;
  scene.name = "dominoes";
  scene.bodies.push_back(static_plane(0.5));
  for (int k = 0; k < count; ++k) {
    scene.bodies.push_back(box("domino_" + std::to_string(k), {0.01, 0.05, kHeight}, 0.05, {0.05 * k, 0, 0.5 * kHeight}, 0.3));
  }
  scene.bodies[1].V_WB << 0.1, 0, 0, 0, 3, 0;
  return scene;
}

// ---- Shapes, speed, overlap, softness

scene::Scene mixed_pile(int count, std::uint64_t seed) {
  constexpr double kWidth = 0.6, kWall = 0.1, kHeight = 3, kPitch = 0.14, kDensity = 1000;
  constexpr int kAcross = 4;
  scene::Scene scene;
  scene.name = "mixed_pile";
  scene.bodies.push_back(static_plane(0.5));
  const double offset = 0.5 * (kWidth + kWall);
  for (const double side : {-1.0, 1.0}) {
    const std::string of_side = side < 0 ? "_0" : "_1";
    scene.bodies.push_back(
        static_wall("wall_x" + of_side, {kWall, kWidth + 2 * kWall, kHeight}, {side * offset, 0, 0.5 * kHeight}, 0.5));
    scene.bodies.push_back(
        static_wall("wall_y" + of_side, {kWidth + 2 * kWall, kWall, kHeight}, {0, side * offset, 0.5 * kHeight}, 0.5));
  }
  std::mt19937_64 engine(seed);
  const auto draw = [&](double low, double high) { return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int k = 0; k < count; ++k) {
    scene::Shape shape;
    shape.name = "shape";
    const double a = draw(0.05, 0.1), b = draw(0.05, 0.1), c = draw(0.05, 0.1);
    switch (k % 4) {
      case 0:
        shape.type = scene::ShapeType::kBox;
        shape.size << 0.8 * a, 0.8 * b, 0.8 * c;
        break;
      case 1:
        shape.type = scene::ShapeType::kCylinder;
        shape.size << 0.5 * a, b, 0;
        break;
      case 2:
        shape.type = scene::ShapeType::kCapsule;
        shape.size << 0.35 * a, 0.7 * b, 0;
        break;
      default:
        shape.type = scene::ShapeType::kSphere;
        shape.size << 0.5 * a, 0, 0;
        break;
    }
    const int layer = k / (kAcross * kAcross), row = k / kAcross % kAcross, column = k % kAcross;
    const double middle = 0.5 * (kAcross - 1);
    Pose X_WS;
    X_WS.p << kPitch * (column - middle), kPitch * (row - middle), kPitch * (layer + 0.6);
    X_WS.R = (Eigen::AngleAxisd(draw(0, 2 * kPi), Vector3d::UnitX()) * Eigen::AngleAxisd(draw(0, 2 * kPi), Vector3d::UnitZ()))
                 .toRotationMatrix();
    scene.bodies.push_back(solid("body_" + std::to_string(k), shape, kDensity, X_WS));
  }
  for (int a = 0; a < 5; ++a) {
    for (int b = a + 1; b < 5; ++b) scene.no_contact.emplace_back(a, b);
  }
  return scene;
}

scene::Scene bullet(double speed, double thickness) {
  scene::Scene scene;
  scene.name = "bullet";
  scene.gravity.setZero();
  scene.bodies = {static_wall("wall", {thickness, 1, 1}, {0.5 * thickness, 0, 0}, 0.3),
                  ball("bullet", 0.005, 0.004, {-1, 0, 0}, 0.3)};
  scene.bodies[1].V_WB.x() = speed;
  return scene;
}

scene::Scene overlapping_boxes(double depth) {
  scene::Scene scene;
  scene.name = "overlapping_boxes";
  scene.gravity.setZero();
  scene.bodies = {box("left", Vector3d::Constant(0.1), 1, {-0.05, 0, 0}, 0.5),
                  box("right", Vector3d::Constant(0.1), 1, {0.05 - depth, 0, 0}, 0.5)};
  return scene;
}

scene::Scene soft_ball(double stiffness) {
  constexpr double kHeight = kSoftBallSpeed * kSoftBallSpeed / (2 * kGravity);
  scene::Scene scene;
  scene.name = "soft_ball";
  scene.bodies = {static_plane(0), ball("ball", kSoftBallRadius, 1, {0, 0, kSoftBallRadius + kHeight}, 0)};
  scene.bodies[1].shapes[0].material.stiffness = stiffness;
  return scene;
}

// ½ m v² + m g x = ½ k x², F = k x
double soft_ball_peak(double stiffness) {
  return kGravity + std::sqrt(kGravity * kGravity + stiffness * kSoftBallSpeed * kSoftBallSpeed);
}

// ---- SimBenchmark

namespace {

constexpr double kBoardMass = 10, kRollingGravity = 9.8, kMuGround = 0.4, kMuBoard = 0.8;
constexpr int kRollingBalls = 25;

}  // namespace

scene::Scene rolling() {
  // The pairs' friction is the geometric mean: balls touch the board alone.
  scene::Scene scene;
  scene.name = "rolling";
  scene.gravity = {0, 0, -kRollingGravity};
  scene.bodies.push_back(static_plane(kMuGround * kMuGround / kMuBoard));
  scene.bodies.push_back(box("board", {20, 20, 1}, kBoardMass, {0, 0, 0.5}, kMuBoard));
  for (int k = 0; k < kRollingBalls; ++k) {
    scene.bodies.push_back(ball("ball_" + std::to_string(k), 0.5, 1, {2.0 * (k / 5) - 4, 2.0 * (k % 5) - 4, 1.5}, kMuBoard));
  }
  return scene;
}

// A ball of mass m that rolls on the board: a_ball = 2/7 a_board.
double rolling_board_acceleration() {
  const double friction = kMuGround * (kBoardMass + kRollingBalls) * kRollingGravity;
  return (kRollingForce - friction) / (kBoardMass + kRollingBalls * 2.0 / 7);
}
double rolling_ball_acceleration() { return 2.0 / 7 * rolling_board_acceleration(); }

scene::Scene falling_ball(double restitution) {
  scene::Scene scene;
  scene.name = "falling_ball";
  scene.gravity = {0, 0, -kRollingGravity};
  scene.bodies = {static_plane(0, restitution), ball("ball", 0.5, 1, {0, 0, 10}, 0, restitution)};
  return scene;
}

scene::Scene cube_of_balls(double restitution, double mu) {
  constexpr int kAcross = 6;
  constexpr double kPitch = 0.21, kPerturbation = 1e-3;
  scene::Scene scene;
  scene.name = "cube_of_balls";
  scene.bodies.push_back(static_plane(mu, restitution));
  std::mt19937_64 engine(42);
  const auto draw = [&] { return kPerturbation * static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int k = 0; k < kAcross * kAcross * kAcross; ++k) {
    const int layer = k / (kAcross * kAcross), row = k / kAcross % kAcross, column = k % kAcross;
    const double x = kPitch * column + draw(), y = kPitch * row + draw(), z = kPitch * layer + draw() + 1.101;
    scene.bodies.push_back(ball("ball_" + std::to_string(k), 0.1, 10, {x, y, z}, mu, restitution));
  }
  return scene;
}

scene::Scene quadruped() {
  constexpr double kThigh = 0.25, kShank = 0.3, kFoot = 0.03, kKnee = 0.4;  // m; angle of the thigh, rad
  constexpr double kTrunkMass = 16, kHipMass = 1.4, kThighMass = 1.6, kShankMass = 0.5;
  scene::Scene scene;
  scene.name = "quadruped";
  scene.bodies.push_back(static_plane(0.8));
  const double height = (kThigh + kShank) * std::cos(kKnee) + kFoot;
  scene.bodies.push_back(box("trunk", {0.53, 0.27, 0.24}, kTrunkMass, {0, 0, height}, 0.8));
  for (const double front : {1.0, -1.0}) {
    for (const double left : {1.0, -1.0}) {
      const std::string leg = "leg_" + std::to_string(scene.joints.size() / 3);
      const Vector3d hip(front * 0.28, left * 0.12, height), thigh = hip + Vector3d(front * 0.06, left * 0.1, 0);
      const Vector3d knee = thigh + kThigh * Vector3d(front * std::sin(kKnee), 0, -std::cos(kKnee));
      const Vector3d foot = knee + kShank * Vector3d(-front * std::sin(kKnee), 0, -std::cos(kKnee));
      const auto first = static_cast<int>(scene.bodies.size());
      scene.bodies.push_back(bar(leg + "_hip", hip, thigh, kHipMass));
      scene.bodies.push_back(bar(leg + "_thigh", thigh, knee, kThighMass));
      scene.bodies.push_back(bar(leg + "_shank", knee, foot, kShankMass));
      scene::Shape sphere = ball("foot", kFoot, 1, Vector3d::Zero(), 0.8).shapes[0];
      sphere.X_BS.p = foot - scene.bodies.back().X_WB.p;
      scene.bodies.back().shapes = {sphere};
      hinge(scene, 1, first, hip, Vector3d::UnitX());
      hinge(scene, first, first + 1, thigh, Vector3d::UnitY());
      hinge(scene, first + 1, first + 2, knee, Vector3d::UnitY());
    }
  }
  for (int a = 1; a < static_cast<int>(scene.bodies.size()); ++a) {
    for (int b = a + 1; b < static_cast<int>(scene.bodies.size()); ++b) scene.no_contact.emplace_back(a, b);
  }
  return scene;
}

}  // namespace cotwin::testing
