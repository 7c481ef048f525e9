#include "tests/support/random_scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace cotwin::testing {

using Eigen::Matrix3d;
using Eigen::Vector3d;

RandomScene::RandomScene(std::uint64_t seed) : engine_(seed) { build(); }
RandomScene::RandomScene(std::span<const std::uint8_t> bytes) : bytes_(bytes), from_bytes_(true) { build(); }

std::uint64_t RandomScene::next() {
  if (!from_bytes_) return engine_();
  std::uint64_t value = 0;  // two bytes per number, spread over the whole range
  const std::size_t count = std::min<std::size_t>(2, bytes_.size());
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | bytes_[i];
  bytes_ = bytes_.subspan(count);
  return value * 0x0001000100010001u;
}

double RandomScene::number(double low, double high) { return low + (high - low) * static_cast<double>(next() >> 11) * 0x1p-53; }
double RandomScene::scale(double low, double high) { return low * std::pow(high / low, number(0, 1)); }
Vector3d RandomScene::vector(double limit) {
  const double x = number(-limit, limit), y = number(-limit, limit), z = number(-limit, limit);
  return {x, y, z};
}

Matrix3d RandomScene::rotation() {
  if (one_in(3)) return Matrix3d::Identity();
  const Vector3d axis = vector(1);
  const double angle = one_in(3) ? 0.5 * M_PI * index(4) : number(-M_PI, M_PI);
  return axis.norm() < 1e-3 ? Matrix3d(Matrix3d::Identity()) : Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

void RandomScene::build() {
  scene_.name = "random";
  if (one_in(5)) scene_.gravity.setZero();
  if (!one_in(6)) add_ground();
  const int bodies = 1 + index(8);
  for (int k = 0; k < bodies; ++k) add_body();
  const std::size_t count = scene_.bodies.size();
  if (one_in(2)) {
    const int joints = 1 + index(count);
    for (int k = 0; k < joints; ++k) {
      const int child = index(count), parent = index(count + 1) - 1;
      if (parent != child && scene_.bodies[static_cast<std::size_t>(child)].motion == scene::Motion::kDynamic) {
        add_joint(parent, child);
      }
    }
  }
}

void RandomScene::add_ground() {
  const bool slopes = one_in(4);
  const double mu = number(0, 1.5);
  scene_.bodies.push_back(slopes ? slope(number(-1, 1), mu) : ground(mu));
  scene_.bodies.back().shapes[0].material = material();
}

scene::Material RandomScene::material() {
  scene::Material m;
  m.mu = one_in(5) ? 0 : number(0, 1.5);
  m.restitution = one_in(4) ? number(0, 1) : 0;
  if (one_in(4)) {
    m.stiffness = scale(1e2, 1e7);
    m.damping = one_in(3) ? 0 : scale(1, 1e4);
  }
  return m;
}

scene::Shape RandomScene::shape() {
  using Type = scene::ShapeType;
  scene::Shape s;
  s.name = "shape";
  const double size = scale(5e-3, 0.5);
  s.type =
      std::array{Type::kSphere, Type::kBox, Type::kBox, Type::kBox, Type::kCylinder, Type::kCapsule, Type::kHull}[next() % 7];
  switch (s.type) {
    case Type::kBox:
      s.size = size * Vector3d(1, 0, one_in(4) ? 1e-6 : number(0.1, 1));
      s.size.y() = size * number(0.1, 1);
      break;
    case Type::kHull:
      for (int k = 0; k < 6; ++k) s.vertices.push_back(size * (vector(0.4) + Vector3d::Unit(k % 3) * (k < 3 ? 0.7 : -0.7)));
      break;
    default:
      s.size = Vector3d(0.5 * size, one_in(4) ? 1e-6 : size, 0);
  }
  if (one_in(3)) s.X_BS = {rotation(), vector(size)};
  s.material = material();
  return s;
}

// At the last body, directly above it, or anywhere.
Pose RandomScene::place() {
  Pose X{rotation(), vector(0.4) + Vector3d(0, 0, 0.5)};
  if (scene_.bodies.size() < 2 || one_in(3)) return X;
  X = scene_.bodies.back().X_WB;
  if (one_in(3)) return X;
  X.p.z() += scene_.bodies.back().shapes.front().size.z();
  return X;
}

void RandomScene::add_body() {
  scene::Body body;
  body.name = "body_" + std::to_string(scene_.bodies.size());
  body.X_WB = place();
  if (one_in(10)) body.motion = one_in(2) ? scene::Motion::kStatic : scene::Motion::kDriven;
  const int shapes = one_in(4) ? 1 + index(3) : 1;
  for (int k = 0; k < shapes; ++k) body.shapes.push_back(shape());
  const Vector3d edges = vector(0.1).cwiseAbs() + Vector3d::Constant(0.01);
  body.inertia = box("", edges, one_in(3) ? scale(1e-4, 1e4) : 1, Vector3d::Zero(), 0).inertia;
  if (one_in(3)) body.inertia.p_LC = vector(0.05);
  if (body.motion != scene::Motion::kStatic && one_in(2)) {
    body.V_WB << vector(one_in(6) ? 300 : 3), vector(one_in(6) ? 500 : 20);
  }
  scene_.bodies.push_back(body);
}

void RandomScene::add_joint(int parent, int child) {
  scene::Joint joint;
  joint.name = "joint_" + std::to_string(scene_.joints.size());
  joint.type = std::array{scene::JointType::kRevolute, scene::JointType::kRevolute, scene::JointType::kPrismatic,
                          scene::JointType::kSpherical, scene::JointType::kFixed}[next() % 5];
  joint.parent = parent;
  joint.child = child;
  joint.X_CJ = {rotation(), vector(0.1)};
  const Pose X_WP = parent < 0 ? Pose{} : scene_.bodies[static_cast<std::size_t>(parent)].X_WB;
  joint.X_PJ = X_WP.inverse() * scene_.bodies[static_cast<std::size_t>(child)].X_WB * joint.X_CJ;
  if (one_in(5)) joint.X_PJ.p += vector(0.02);  // pulled apart
  joint.axis = Vector3d::Unit(index(3));
  if (one_in(3)) {
    joint.q_min = -number(0, 1);
    joint.q_max = one_in(4) ? joint.q_min : number(0, 1);
  }
  if (one_in(3)) joint.friction = scale(1e-3, 10);
  if (one_in(3)) joint.damping = scale(1e-3, 100);
  scene_.joints.push_back(joint);
}

void RandomScene::disturb(contact_world::World& world) {
  // Draws of one call are made one after the other: compilers evaluate arguments in different orders.
  if (one_in(3)) {
    const Wrench F = (Wrench() << vector(100), vector(10)).finished();
    world.apply(static_cast<std::size_t>(index(scene_.bodies.size())), F);
  }
  if (!scene_.joints.empty() && one_in(3)) {
    const auto joint = static_cast<std::size_t>(index(scene_.joints.size()));
    const bool has_axis =
        scene_.joints[joint].type == scene::JointType::kRevolute || scene_.joints[joint].type == scene::JointType::kPrismatic;
    if (has_axis && one_in(2)) {
      const double rate = number(-1, 1), damping = one_in(2) ? scale(1e-2, 1e3) : 0, stiffness = one_in(2) ? scale(1, 1e6) : 0;
      world.set_tau(joint, number(-10, 10), stiffness, damping, rate);
    }
    if (has_axis && one_in(2)) {
      const double most = one_in(4) ? scene::kInfinity : scale(1e-2, 1e3);
      world.set_motor(joint, number(-2, 2), most);
    }
  }
  if (one_in(8)) {
    const auto body = static_cast<std::size_t>(index(scene_.bodies.size()));
    if (scene_.bodies[body].motion != scene::Motion::kStatic) {
      world.set_pose(body, {rotation(), vector(0.5)});
      world.set_twist(body, (Twist() << vector(3), vector(20)).finished());
    }
  }
}

}  // namespace cotwin::testing
