#include "tests/support/foreign_scenes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "models/scene/shapes.h"
#include "tests/support/contact_scenes.h"

namespace cotwin::testing {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;

scene::Body rod(const std::string& name, const Vector3d& p_WA, const Vector3d& p_WB, double mass) {
  const Vector3d d = (p_WB - p_WA).normalized();
  const double length = (p_WB - p_WA).norm(), width = 0.02;
  const Matrix3d along = d * d.transpose();
  scene::Body body;
  body.name = name;
  body.X_WB.p = 0.5 * (p_WA + p_WB);
  body.inertia.mass = mass;
  body.inertia.I_CC =
      mass / 12 * ((length * length + width * width) * (Matrix3d::Identity() - along) + 2 * width * width * along);
  return body;
}

// All bodies are parallel to W at the start. p_child: the anchor on the child, if it is apart from the parent's.
void join(scene::Scene& scene, scene::JointType type, int parent, int child, const Vector3d& p_parent, const Vector3d& p_child,
          const Vector3d& axis) {
  const auto origin = [&](int k) { return k < 0 ? Vector3d::Zero().eval() : scene.bodies[static_cast<std::size_t>(k)].X_WB.p; };
  scene::Joint joint;
  joint.name = "joint_" + std::to_string(scene.joints.size());
  joint.type = type;
  joint.parent = parent;
  joint.child = child;
  joint.X_PJ.p = p_parent - origin(parent);
  joint.X_CJ.p = p_child - origin(child);
  joint.axis = axis;
  scene.joints.push_back(joint);
}

void hinge(scene::Scene& scene, int parent, int child, const Vector3d& p) {
  join(scene, scene::JointType::kRevolute, parent, child, p, p, Vector3d::UnitY());
}

scene::Body fixed(scene::Body body) {
  body.motion = scene::Motion::kStatic;
  body.inertia = {};
  return body;
}

scene::Scene on_ground(const std::string& name, double mu, double restitution = 0) {
  scene::Scene scene;
  scene.name = name;
  scene.bodies.push_back(ground(mu, restitution));
  return scene;
}

}  // namespace

scene::Scene slider_crank(double speed) {
  constexpr double kCrank = 0.2, kRod = 0.5;
  scene::Scene scene;
  scene.name = "slider_crank";
  const Vector3d tip(kCrank, 0, 0), end(kCrank + kRod, 0, 0);
  scene.bodies = {rod("crank", Vector3d::Zero(), tip, 1), rod("rod", tip, end, 1),
                  rod("slider", end, end + 0.1 * Vector3d::UnitX(), 1)};
  scene.bodies[0].V_WB << 0, 0, -speed * 0.5 * kCrank, 0, speed, 0;
  const double w = speed * kCrank / kRod;  // the rod's, backwards
  scene.bodies[1].V_WB << 0, 0, -0.5 * speed * kCrank, 0, -w, 0;
  hinge(scene, -1, 0, Vector3d::Zero());
  hinge(scene, 0, 1, tip);
  hinge(scene, 1, 2, end);
  join(scene, scene::JointType::kPrismatic, -1, 2, end, end, Vector3d::UnitX());
  return scene;
}

scene::Scene necklace(int count) {
  constexpr double kLength = 0.1;
  scene::Scene scene;
  scene.name = "necklace";
  const double radius = 0.5 * kLength / std::sin(kPi / count);
  const auto corner = [&](int k) {
    const double angle = kPi / 2 + 2 * kPi * (k - 0.5) / count;
    return Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0);
  };
  for (int k = 0; k < count; ++k) scene.bodies.push_back(rod("rod_" + std::to_string(k), corner(k), corner(k + 1), 0.1));
  join(scene, scene::JointType::kSpherical, -1, 0, scene.bodies[0].X_WB.p, scene.bodies[0].X_WB.p, Vector3d::UnitZ());
  for (int k = 0; k < count; ++k) {
    join(scene, scene::JointType::kSpherical, k, (k + 1) % count, corner(k + 1), corner(k + 1), Vector3d::UnitZ());
  }
  return scene;
}

scene::Scene loaded_rope(int links, double load) {
  constexpr double kLength = 0.05;
  scene::Scene scene;
  scene.name = "loaded_rope";
  for (int k = 0; k < links; ++k) {
    const Vector3d p(k * kLength, 0, 0);
    scene.bodies.push_back(rod("link_" + std::to_string(k), p, p + kLength * Vector3d::UnitX(), 0.01));
    hinge(scene, k - 1, k, p);
  }
  const Vector3d end(links * kLength, 0, 0);
  scene.bodies.push_back(box("load", Vector3d::Constant(0.2), load, end + 0.1 * Vector3d::UnitX(), 0.5));
  scene.bodies.back().shapes.clear();
  hinge(scene, links - 1, links, end);
  return scene;
}

scene::Scene open_triangle(double gap) {
  scene::Scene scene;
  scene.name = "open_triangle";
  const Vector3d a(0, 0, 0), b(0.5, 0, 0), c(0.25, 0, -0.4), far = c + Vector3d(0, 0, -gap);
  scene.bodies = {rod("ab", a, b, 1), rod("bc", b, c, 1), rod("ca", far, a, 1)};
  hinge(scene, -1, 0, a);
  hinge(scene, 0, 1, b);
  hinge(scene, 0, 2, a);
  join(scene, scene::JointType::kRevolute, 1, 2, c, far, Vector3d::UnitY());
  return scene;
}

scene::Scene stack_of_edge(int boxes, double edge) {
  scene::Scene scene = on_ground("stack_of_edge", 0.5);
  for (int k = 0; k < boxes; ++k) {
    scene.bodies.push_back(
        box("box_" + std::to_string(k), Vector3d::Constant(edge), 1000 * edge * edge * edge, {0, 0, (k + 0.5) * edge}, 0.5));
  }
  return scene;
}

scene::Scene ball_on_ball(double ratio) {
  scene::Scene scene = on_ground("ball_on_ball", 0, 1);
  scene.bodies.push_back(ball("large", 0.1, 1, {0, 0, 1.1}, 0, 1));
  scene.bodies.push_back(ball("small", 0.03, ratio, {0, 0, 1.2 + 0.03 + 1e-3}, 0, 1));
  return scene;
}

scene::Scene painleve_rod(double mu) {
  scene::Scene scene = on_ground("painleve_rod", mu);
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

scene::Scene spinning_disc(double speed) {
  scene::Scene scene = on_ground("spinning_disc", 0.2);
  scene::Body disc = box("disc", {0.1, 0.1, 0.01}, 1, {0, 0, 0.005}, 0.2);
  disc.shapes[0].type = scene::ShapeType::kCylinder;
  disc.shapes[0].size << 0.1, 0.01, 0;
  disc.inertia.I_CC.diagonal() << 0.25 * 0.01 + 1e-4 / 12, 0.25 * 0.01 + 1e-4 / 12, 0.5 * 0.01;
  disc.V_WB(5) = speed;
  scene.bodies.push_back(disc);
  return scene;
}

scene::Scene wedged_ball(double half_angle, double mu) {
  constexpr double kRadius = 0.05, kThickness = 0.1;
  scene::Scene scene;
  scene.name = "wedged_ball";
  for (const double side : {-1.0, 1.0}) {
    // The inner face's normal points to the ball and up.
    const Vector3d normal(-side * std::cos(half_angle), 0, std::sin(half_angle));
    scene::Body wall =
        fixed(box(side < 0 ? "left" : "right", {kThickness, 1, 1}, 1, -(kRadius + 0.5 * kThickness) * normal, mu));
    wall.X_WB.R = Eigen::AngleAxisd(side * half_angle, Vector3d::UnitY()).toRotationMatrix();
    scene.bodies.push_back(wall);
  }
  scene.bodies.push_back(ball("ball", kRadius, 1, Vector3d::Zero(), mu));
  scene.bodies.back().V_WB(5) = 20;  // it spins about the vertical
  scene.no_contact = {{0, 1}};
  return scene;
}

scene::Scene coincident_boxes() {
  scene::Scene scene = on_ground("coincident_boxes", 0.5);
  for (const double x : {0.0, 0.0, 1.0}) {
    scene.bodies.push_back(
        box("box_" + std::to_string(scene.bodies.size()), Vector3d::Constant(0.1), 1, {x, 0, x > 0 ? 0 : 0.05}, 0.5));
  }
  return scene;
}

scene::Scene fast_box(double speed) {
  scene::Scene scene = on_ground("fast_box", 0.5);
  scene.bodies.push_back(box("box", Vector3d::Constant(0.1), 1, {0, 0, 1}, 0.5));
  scene.bodies.back().V_WB << 0.5 * speed, 0, -speed, 100, 20, 30;
  return scene;
}

scene::Scene fast_rod() {
  constexpr double kSpeed = 300;
  scene::Scene scene;
  scene.name = "fast_rod";
  scene.gravity.setZero();
  scene.bodies.push_back(box("rod", {1, 0.02, 0.02}, 1, {0.5, 0, 0}, 0.3));
  scene.bodies.push_back(fixed(box("plate", {0.4, 0.4, 0.005}, 1, {0.9, 0, -0.8}, 0.3)));
  scene.bodies[0].V_WB << 0, 0, -kSpeed * 0.5, 0, kSpeed, 0;
  hinge(scene, -1, 0, Vector3d::Zero());
  return scene;
}

scene::Scene two_bullets(double speed) {
  scene::Scene scene;
  scene.name = "two_bullets";
  scene.gravity.setZero();
  for (const double side : {-1.0, 1.0}) {
    scene.bodies.push_back(ball(side < 0 ? "left" : "right", 0.005, 0.004, {side * 1.0001, 0, 0}, 0.3, 1));
    scene.bodies.back().V_WB.x() = -side * speed;
  }
  return scene;
}

scene::Scene brick_wall(int rows) {
  constexpr int kAcross = 5;
  scene::Scene scene = on_ground("brick_wall", 0.6);
  for (int row = 0; row < rows; ++row) {
    for (int k = 0; k < kAcross; ++k) {
      scene.bodies.push_back(box("brick_" + std::to_string(scene.bodies.size()), {0.2, 0.1, 0.1}, 4,
                                 {0.2 * k + (row % 2) * 0.06, 0, 0.1 * (row + 0.5)}, 0.6));
    }
  }
  return scene;
}

scene::Scene pyramid_on_tip() {
  scene::Scene scene = on_ground("pyramid_on_tip", 0.5);
  scene::Shape shape;
  shape.name = "pyramid";
  shape.type = scene::ShapeType::kHull;
  shape.vertices = {{0, 0, 0}, {0.1, 0.1, 0.2}, {-0.1, 0.1, 0.2}, {-0.1, -0.1, 0.2}, {0.1, -0.1, 0.2}};
  Inertia inertia = scene::solid_inertia(shape, 1000);
  scene::Body body;
  body.name = "pyramid";
  body.X_WB.p = inertia.p_LC;
  shape.X_BS.p = -inertia.p_LC;
  inertia.p_LC.setZero();
  body.inertia = inertia;
  body.shapes = {shape};
  scene.bodies.push_back(body);
  return scene;
}

scene::Scene thin_plates(int count) {
  scene::Scene scene = on_ground("thin_plates", 0.4);
  for (int k = 0; k < count; ++k) {
    scene.bodies.push_back(
        box("plate_" + std::to_string(k), {0.2, 0.2, 1e-4}, 0.008, {0.003 * k, -0.002 * k, 0.02 * (k + 1)}, 0.4));
  }
  return scene;
}

scene::Scene soft_stack(double stiffness) {
  scene::Scene scene = stack(11);
  scene.bodies[1].shapes[0].material.stiffness = stiffness;
  return scene;
}

}  // namespace cotwin::testing
