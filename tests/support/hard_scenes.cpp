#include "tests/support/hard_scenes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "models/scene/shapes.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::testing {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846, kGravity = 9.81;

// All bodies are parallel to W at the start; the axis is W's y.
void hinge(scene::Scene& scene, int parent, int child, const Vector3d& p_WJ) {
  const auto origin = [&](int k) { return k < 0 ? Vector3d::Zero().eval() : scene.bodies[static_cast<std::size_t>(k)].X_WB.p; };
  scene::Joint joint;
  joint.name = "hinge_" + std::to_string(scene.joints.size());
  joint.parent = parent;
  joint.child = child;
  joint.X_PJ.p = p_WJ - origin(parent);
  joint.X_CJ.p = p_WJ - origin(child);
  joint.axis = Vector3d::UnitY();
  scene.joints.push_back(joint);
}

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

// ---- Friction-critical statics

scene::Scene card_house(int levels, double lean, double mu) {
  constexpr double kLength = 0.1, kWidth = 0.07, kThickness = 0.002, kMass = 0.01;
  const double l = 0.5 * kLength, t = 0.5 * kThickness, s = std::sin(lean), c = std::cos(lean);
  const double across = l * s + t * c, half_height = l * c + t * s;  // of a leaning card: half of its extents
  const double pitch = 4 * across + 0.001;
  scene::Scene scene;
  scene.name = "card_house";
  scene.bodies.push_back(ground(mu));
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
  scene.bodies.push_back(ground(mu));
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
  scene.bodies.push_back(ground(mu));
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
  scene.bodies.push_back(ground(0.5));
  for (int k = 0; k < count; ++k) {
    scene.bodies.push_back(box("domino_" + std::to_string(k), {0.01, 0.05, kHeight}, 0.05, {0.05 * k, 0, 0.5 * kHeight}, 0.3));
  }
  scene.bodies[1].V_WB << 0.1, 0, 0, 0, 3, 0;
  return scene;
}

scene::Scene loaded_rope(int links, double load) {
  constexpr double kLength = 0.05, kWidth = 0.02;
  scene::Scene scene;
  scene.name = "loaded_rope";
  for (int k = 0; k < links; ++k) {
    const Vector3d p(k * kLength, 0, 0);
    scene::Body link =
        box("link_" + std::to_string(k), {kLength, kWidth, kWidth}, 0.01, p + kLength / 2 * Vector3d::UnitX(), 0);
    link.shapes.clear();
    scene.bodies.push_back(link);
    hinge(scene, k - 1, k, p);
  }
  const Vector3d end(links * kLength, 0, 0);
  scene.bodies.push_back(box("load", Vector3d::Constant(0.2), load, end + 0.1 * Vector3d::UnitX(), 0.5));
  scene.bodies.back().shapes.clear();
  hinge(scene, links - 1, links, end);
  return scene;
}

scene::Scene painleve_rod(double mu) {
  scene::Scene scene;
  scene.name = "painleve_rod";
  scene.bodies.push_back(ground(mu));
  scene.bodies.push_back(box("rod", {0.01, 0.2, 1}, 1, Vector3d::Zero(), mu));
  scene::Body& body = scene.bodies.back();
  // The lower end is ahead: friction presses it into the ground.
  body.X_WB.R = Eigen::AngleAxisd(-kPi / 4, Vector3d::UnitY()).toRotationMatrix();
  double low = 0;
  for (const double x : {-0.005, 0.005}) low = std::min(low, (body.X_WB.R * Vector3d(x, 0, -0.5)).z());
  body.X_WB.p.z() = -low;
  body.V_WB.x() = 5;
  return scene;
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
  scene.bodies.push_back(ground(kMuGround * kMuGround / kMuBoard));
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

}  // namespace cotwin::testing
