#include "tests/support/closed_forms.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "models/scene/shapes.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/hard_scenes.h"

namespace cotwin::testing {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // m/s²

double larger(double so_far, double now) { return now <= so_far || std::isnan(so_far) ? so_far : now; }

/// The farthest that a body is from its start, m.
double way(const Motion& now) {
  double way = 0;
  for (std::size_t b = 0; b < now.X_WB.size(); ++b) way = larger(way, (now.X_WB[b].p - now.start[b].p).norm());
  return way;
}

double way_in_mm(const scene::Scene&, const Motion& now, double so_far) { return larger(so_far, 1e3 * way(now)); }

// ---- Gripper: a box between two fingers that are pressed together

constexpr double kForce = 12, kMu = 0.8;  // N of each finger

/// A share of the weight that the friction of both fingers holds.
scene::Scene gripper(double share) {
  const double mass = share * 2 * kMu * kForce / kGravity;
  scene::Scene scene;
  scene.name = "gripper";
  scene.bodies.push_back(box("piece", {0.05, 0.05, 0.08}, mass, Vector3d::Zero(), kMu));
  for (const double side : {1.0, -1.0}) {
    scene.bodies.push_back(box(side > 0 ? "right" : "left", {0.02, 0.04, 0.1}, 0.1, {side * 0.035, 0, 0}, kMu));
    scene::Joint joint;
    joint.name = "slide_" + scene.bodies.back().name;
    joint.type = scene::JointType::kPrismatic;
    joint.child = static_cast<int>(scene.bodies.size()) - 1;
    joint.X_PJ = scene.bodies.back().X_WB;
    joint.axis = Vector3d::UnitX();
    scene.joints.push_back(joint);
  }
  scene.no_contact.emplace_back(1, 2);
  return scene;
}

Wrench finger_force(std::size_t body) {
  Wrench F = Wrench::Zero();
  if (body > 0) F.x() = body == 1 ? -kForce : kForce;
  return F;
}

constexpr double kTooHeavy = 1.25;

/// Relative error of the way that the piece slides down, against (1 − 1/share) g t²/2.
double error_of_slide(const scene::Scene&, const Motion& now, double) {
  const double exact = (1 - 1 / kTooHeavy) * kGravity * now.t * now.t / 2;
  return std::abs((now.start[0].p.z() - now.X_WB[0].p.z()) / exact - 1);
}

// ---- Energy

double start_energy(const scene::Scene& scene, const Motion& now) {
  std::vector<Twist> V;
  for (const scene::Body& body : scene.bodies) V.push_back(body.V_WB);
  return energy(scene, now.start, V);
}

/// Largest change of the energy in percent of the energy at the start.
double change_of_energy(const scene::Scene& scene, const Motion& now, double so_far) {
  const double start = start_energy(scene, now);
  return larger(so_far, 100 * std::abs(energy(scene, now.X_WB, now.V_WB) - start) / std::abs(start));
}

constexpr double kRopeLoad = 10, kRopeLength = 1;

/// In percent of what the load gains when it falls by the rope's length.
double change_of_rope(const scene::Scene& scene, const Motion& now, double so_far) {
  const double change = energy(scene, now.X_WB, now.V_WB) - start_energy(scene, now);
  return larger(so_far, 100 * std::abs(change) / (kRopeLoad * kGravity * kRopeLength));
}

/// A disc of radius 0.1 m and 10 mm on its edge, 0.5 rad from lying flat, whose centre stays at rest.
scene::Scene euler_disc() {
  constexpr double kRadius = 0.1, kThickness = 0.01, kTilt = 0.5;
  scene::Scene scene;
  scene.name = "euler_disc";
  scene.bodies.push_back(ground(1));
  scene::Body disc;
  disc.name = "disc";
  disc.X_WB.R = Eigen::AngleAxisd(kTilt, Vector3d::UnitY()).toRotationMatrix();
  disc.X_WB.p.z() = kRadius * std::sin(kTilt) + kThickness / 2 * std::cos(kTilt);
  scene::Shape shape;
  shape.name = "shape";
  shape.type = scene::ShapeType::kCylinder;
  shape.size = {kRadius, kThickness, 0};
  shape.material.mu = 1;
  disc.shapes = {shape};
  disc.inertia = scene::solid_inertia(shape, 1000);
  const double precession = std::sqrt(4 * kGravity / (kRadius * std::sin(kTilt)));
  const Vector3d w = precession * (Vector3d::UnitZ() - std::cos(kTilt) * disc.X_WB.R.col(2));
  disc.V_WB << -w.cross(disc.X_WB.R * Vector3d(kRadius, 0, -kThickness / 2)), w;
  scene.bodies.push_back(disc);
  return scene;
}

// ---- Dominoes, bowl, limits

double standing(const scene::Scene&, const Motion& now, double) {
  double count = 0;
  for (std::size_t b = 1; b < now.X_WB.size(); ++b) count += now.X_WB[b].R(2, 2) < 0.7 ? 0 : 1;
  return count;
}

constexpr int kSides = 12, kRings = 4;
constexpr double kBowl = 0.3, kBall = 0.02;  // radii, m

/// Twenty balls fall into a bowl of flat plates that touch a sphere around the origin.
scene::Scene bowl() {
  scene::Scene scene;
  scene.name = "bowl";
  const auto add_plate = [&](const Matrix3d& R, double edge) {
    scene::Body plate =
        box("plate_" + std::to_string(scene.bodies.size()), {edge, edge, 0.1}, 1, R * Vector3d(0, 0, -kBowl - 0.05), 0.3);
    plate.X_WB.R = R;
    plate.motion = scene::Motion::kStatic;
    plate.inertia = {};
    scene.bodies.push_back(plate);
  };
  add_plate(Matrix3d::Identity(), 0.2);
  for (int ring = 1; ring <= kRings; ++ring) {
    for (int side = 0; side < kSides; ++side) {
      const Eigen::AngleAxisd about(2 * M_PI * side / kSides, Vector3d::UnitZ()), lean(0.4 * ring, Vector3d::UnitY());
      add_plate((about * lean).toRotationMatrix(), 0.2);
    }
  }
  for (int k = 0; k < 20; ++k) {
    const Vector3d p(0.06 * (k % 3 - 1) + 0.003 * k, 0.06 * (k / 3 % 3 - 1) - 0.002 * k,
                     -0.2 + 0.05 * (k / 9) + 0.001 * (k % 5));
    scene.bodies.push_back(ball("ball_" + std::to_string(k), kBall, 0.05, p, 0.3));
  }
  return scene;
}

/// Balls outside of the bowl, or with their centre nearer to a plate than 0.9 radii.
double lost_balls(const scene::Scene& scene, const Motion& now, double) {
  double lost = 0;
  for (std::size_t b = 0; b < now.X_WB.size(); ++b) {
    if (scene.bodies[b].motion == scene::Motion::kStatic) continue;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t plate = 0; plate < b; ++plate) {
      const scene::Body& other = scene.bodies[plate];
      if (other.motion == scene::Motion::kStatic)
        least = std::min(least, other.X_WB.R.col(2).dot(now.X_WB[b].p - other.X_WB.p) - 0.05);
    }
    lost += least > 0.9 * kBall && now.X_WB[b].p.norm() < kBowl ? 0 : 1;
  }
  return lost;
}

constexpr int kRods = 5;
constexpr double kLimit = 0.2;  // rad

/// Five rods in a row that fall from the horizontal onto the limits of their hinges.
scene::Scene rods_on_limits() {
  scene::Scene scene = loaded_rope(kRods, 0.01);
  scene.name = "rods_on_limits";
  scene.bodies.pop_back();
  scene.joints.pop_back();
  for (scene::Joint& joint : scene.joints) {
    joint.q_min = -kLimit;
    joint.q_max = kLimit;
  }
  return scene;
}

/// The largest angle of a hinge beyond its limit so far, or how far a hinge is from its limit at the end, rad.
double beyond_limits(const scene::Scene& scene, const Motion& now, double so_far) {
  double beyond = 0, away = 0;
  for (std::size_t j = 0; j < scene.joints.size(); ++j) {
    const double angle = std::abs(joint_angle(scene, j, now.X_WB));
    beyond = larger(beyond, angle - kLimit);
    away = larger(away, kLimit - angle);
  }
  constexpr double kAtRest = 2;  // s
  return larger(so_far, now.t > kAtRest ? std::max(beyond, away) : beyond);
}

}  // namespace

scene::Scene scaled(scene::Scene scene, double scale) {
  const double time = std::sqrt(scale), mass = std::pow(scale, 3), force = mass, moment = force * scale;
  for (scene::Body& body : scene.bodies) {
    body.X_WB.p *= scale;
    body.V_WB.head<3>() *= scale / time;
    body.V_WB.tail<3>() /= time;
    body.inertia.mass *= mass;
    body.inertia.p_LC *= scale;
    body.inertia.I_CC *= mass * scale * scale;
    for (scene::Shape& shape : body.shapes) {
      const double thickness = shape.type == scene::ShapeType::kTriangle ? shape.size.y() : 0;
      shape.size *= scale;
      if (shape.type == scene::ShapeType::kTriangle) shape.size.y() = thickness;
      for (Vector3d& vertex : shape.vertices) vertex *= scale;
      shape.X_BS.p *= scale;
      shape.material.stiffness *= force / scale;
      shape.material.damping *= force / scale * time;
      shape.material.patch_radius *= scale;
      shape.material.surface_radius *= scale;
    }
  }
  for (scene::Joint& joint : scene.joints) {
    const bool slides = joint.type == scene::JointType::kPrismatic;
    const double load = slides ? force : moment, travel = slides ? scale : 1;
    joint.X_PJ.p *= scale;
    joint.X_CJ.p *= scale;
    joint.pitch *= scale;
    for (double* length : {&joint.q, &joint.q_min, &joint.q_max, &joint.q_spring}) *length *= travel;
    joint.friction *= load;
    joint.stiffness *= load / travel;
    joint.damping *= load / travel * time;
  }
  return scene;
}

bool ClosedForm::is_right(double value, const Setting& setting) const {
  const double relative = second_order ? std::max(1.0, setting.unscaled_h() / 1e-3) : 1;
  return value >= least && value <= most * relative * relative;
}

std::vector<ClosedForm> closed_forms() {
  return {
      {"gripper, 0.98 of what friction holds", "motion in 2 s", "mm", "0", 0, 0.2, 2, false, [] { return gripper(0.98); },
       finger_force, way_in_mm},
      {"gripper, 1.25 of what friction holds", "error of the way in 0.1 s", "1", "0", 0, 0.05, 0.1, false,
       [] { return gripper(kTooHeavy); }, finger_force, error_of_slide},
      {"card house of 3 levels, lean 0.3 (μ = 0.35)", "motion in 2 s", "mm", "0", 0, 1, 2, false,
       [] { return card_house(3, 0.3, 0.35); }, nullptr, way_in_mm},
      {"card house of 3 levels, lean 0.36", "motion in 2 s", "mm", "falls", 10, HUGE_VAL, 2, false,
       [] { return card_house(3, 0.36, 0.35); }, nullptr, way_in_mm},
      {"tower of 40 cubes", "motion in 5 s", "mm", "0", 0, 1, 5, false, [] { return stack(40); }, nullptr, way_in_mm},
      {"1 kg below 10 t", "motion in 2 s", "mm", "0", 0, 1, 2, false,
       [] {
         constexpr double kMasses[] = {1, 1e4};
         return stack_of_masses(kMasses);
       },
       nullptr, way_in_mm},
      {"30 dominoes", "standing after 2.5 s", "1", "0", 0, 0, 2.5, false, [] { return dominoes(30); }, nullptr, standing},
      {"rope of 20 with 10 kg", "change of the energy in 2 s", "%", "0", 0, 0.5, 2, true,
       [] { return loaded_rope(20, kRopeLoad); }, nullptr, change_of_rope},
      {"Euler's disc", "change of the energy in 5 s", "%", "0", 0, 0.1, 5, true, euler_disc, nullptr, change_of_energy},
      {"bowl with 20 balls", "lost balls after 2 s", "1", "0", 0, 0, 2, false, bowl, nullptr, lost_balls},
      {"5 rods on limits", "beyond or off the limits", "rad", "0", 0, 0.01, 4, false, rods_on_limits, nullptr, beyond_limits}};
}

}  // namespace cotwin::testing
