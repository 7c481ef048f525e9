#include "components/contact_world/engine/joints/joint.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/foundation/support/error.h"

namespace cotwin::contact_world {
namespace {

using scene::JointType;

/// Largest distance that one step corrects, m or rad.
constexpr double kLargestCorrection = 2e-3;

int body_index(const scene::Joint& joint, int body, std::span<const RigidBody> bodies) {
  if (body >= -1 && body < static_cast<int>(bodies.size())) return body;
  throw Error("joint " + joint.name, "body " + std::to_string(body) + " does not exist, expected -1 to " +
                                         std::to_string(static_cast<int>(bodies.size()) - 1));
}

Pose on_body(int body, const Pose& X_BJ, std::span<const RigidBody> bodies) {
  return body < 0 ? X_BJ : bodies[static_cast<std::size_t>(body)].X_PB * X_BJ;
}

}  // namespace

Joint::Joint(const scene::Joint& joint, std::span<const RigidBody> bodies)
    : type(joint.type),
      parent(body_index(joint, joint.parent, bodies)),
      child(body_index(joint, joint.child, bodies)),
      q_min(joint.q_min),
      q_max(joint.q_max),
      friction(joint.friction),
      damping(joint.damping),
      stiffness(joint.stiffness),
      q_spring(joint.q_spring),
      pitch(joint.type == JointType::kScrew ? joint.pitch : 0) {
  const std::string where = "joint " + joint.name;
  if (parent == child) throw Error(where, "parent and child are the same body, expected two bodies");
  if (!is_rotation(joint.X_PJ.R) || !is_rotation(joint.X_CJ.R)) throw Error(where, "the matrix of a frame is not a rotation");
  if (!joint.X_PJ.p.allFinite() || !joint.X_CJ.p.allFinite()) throw Error(where, "the position of a frame is not finite");
  Pose X_JZ;
  if (has_axis()) {
    if (!(std::abs(joint.axis.norm() - 1) < 1e-9)) throw Error(where, "the axis is not a unit vector");
    X_JZ.R = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), joint.axis).toRotationMatrix();
    if (!(q_min <= q_max)) throw Error(where, "the lower limit is above the upper limit");
    if (!(friction >= 0) || !(damping >= 0) || !(stiffness >= 0))
      throw Error(where, "friction, damping or stiffness is negative, expected >= 0");
  }
  X_BJ_parent_ = joint.X_PJ * X_JZ;
  X_BJ_child_ = joint.X_CJ * X_JZ;
  refit(bodies);
  place(bodies);
  q = joint.q;
  measure();
}

void Joint::refit(std::span<const RigidBody> bodies) {
  X_PJ_ = on_body(parent, X_BJ_parent_, bodies);
  X_CJ_ = on_body(child, X_BJ_child_, bodies);
}

void Joint::place(std::span<const RigidBody> bodies) {
  if (parent < 0) {
    R_parent = X_PJ_.R;
    p_parent = X_PJ_.p;
  } else {
    const RigidBody& body = bodies[static_cast<std::size_t>(parent)];
    R_parent.noalias() = body.R * X_PJ_.R;
    p_parent = body.p;
    p_parent.noalias() += body.R * X_PJ_.p;
  }
  if (child < 0) {
    R_child = X_CJ_.R;
    p_child = X_CJ_.p;
  } else {
    const RigidBody& body = bodies[static_cast<std::size_t>(child)];
    R_child.noalias() = body.R * X_CJ_.R;
    p_child = body.p;
    p_child.noalias() += body.R * X_CJ_.p;
  }
}

void Joint::measure() {
  if (type == JointType::kPrismatic) {
    q = axis().dot(p_child - p_parent);
  } else if (turns()) {
    q = angle();
  }
}

double Joint::angle() const {
  const Vector3d x = R_child.col(0);
  const double angle = std::atan2(R_parent.col(1).dot(x), R_parent.col(0).dot(x));
  return angle + 2 * std::numbers::pi * std::round((q - angle) / (2 * std::numbers::pi));
}

double Joint::speed(std::span<const RigidBody> bodies) const {
  static const Vector3d kZero = Vector3d::Zero();
  const RigidBody* a = parent < 0 ? nullptr : &bodies[static_cast<std::size_t>(parent)];
  const RigidBody* b = child < 0 ? nullptr : &bodies[static_cast<std::size_t>(child)];
  const Vector3d& w_a = a == nullptr ? kZero : a->w;
  if (turns()) return axis().dot((b == nullptr ? kZero : b->w) - w_a);
  if (type != JointType::kPrismatic) return 0;
  Vector3d v = Vector3d::Zero();
  if (b != nullptr) v += b->v + b->w.cross(p_child - b->p);
  if (a != nullptr) v -= a->v + a->w.cross(p_child - a->p);  // velocity of the parent's point at the child's anchor
  return axis().dot(v);
}

Motion6 Joint::error() const {
  Motion6 e = distance();
  if (far_) {
    e.linear -= R_parent * left_.linear;
    e.angular -= R_parent * left_.angular;
  }
  return e;
}

void Joint::begin_step() {
  const Motion6 e = distance();
  const auto left = [](const Vector3d& apart) {
    const double length = apart.norm();
    return length > kLargestCorrection ? Vector3d((1 - kLargestCorrection / length) * apart) : Vector3d(Vector3d::Zero());
  };
  left_.linear = R_parent.transpose() * left(e.linear);
  left_.angular = R_parent.transpose() * left(e.angular);
  far_ = !left_.linear.isZero(0) || !left_.angular.isZero(0);
}

Motion6 Joint::distance() const {
  Motion6 e;
  e.linear = p_child - p_parent;
  if (type == JointType::kPrismatic) e.linear -= axis().dot(e.linear) * axis();
  if (type == JointType::kScrew) e.linear -= pitch * angle() * axis();
  if (type == JointType::kSpherical) return e;
  e.angular = R_parent.col(2).cross(R_child.col(2));
  if (turns()) return e;
  e.angular = (e.angular + R_parent.col(0).cross(R_child.col(0)) + R_parent.col(1).cross(R_child.col(1))) / 2;
  return e;
}

double Joint::alignment() const {
  if (type == JointType::kSpherical) return 1;
  const double z = R_parent.col(2).dot(R_child.col(2));
  return turns() ? z : std::min(z, R_parent.col(0).dot(R_child.col(0)));
}

double Joint::gap() const {
  Vector3d apart = p_child - p_parent;
  if (type == JointType::kPrismatic) apart -= axis().dot(apart) * axis();
  if (type == JointType::kScrew) apart -= pitch * angle() * axis();
  return apart.norm();
}

}  // namespace cotwin::contact_world
