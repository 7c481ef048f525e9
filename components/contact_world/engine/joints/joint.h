#pragma once
#include <Eigen/Core>
#include <span>

#include "components/contact_world/engine/body/body.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

/// A small displacement or a relative twist of two bodies at a point.
struct Motion6 {
  Vector3d linear = Vector3d::Zero();
  Vector3d angular = Vector3d::Zero();
};

/// A joint between two rigid bodies: its frames on both bodies and its error. The z axis of both frames is the joint's axis.
class Joint {
 public:
  /// Throws Error if the bodies do not exist or are the same, the axis is no unit vector, or a frame is no rotation.
  Joint(const scene::Joint& joint, std::span<const RigidBody> bodies);

  bool has_axis() const { return type == scene::JointType::kPrismatic || turns(); }
  bool turns() const { return type == scene::JointType::kRevolute || type == scene::JointType::kScrew; }

  /// Takes the joint's frames on the bodies again, after their mass distributions have changed.
  void refit(std::span<const RigidBody> bodies);

  /// Computes anchors and axes from the bodies' present poses (body −1 is the world), then q. A revolute q continues from its
  /// last value and thus counts turns.
  void place(std::span<const RigidBody> bodies);
  void measure();
  /// q̇ of the bodies' present twists.
  double speed(std::span<const RigidBody> bodies) const;

  /// Displacement of the child from its position in the joint, at the parent's anchor; the angle as its sine. Free directions
  /// are zero. Bodies that start far apart approach each other by a limited distance per step; the rest is not part of the
  /// error.
  Motion6 error() const;
  void begin_step();
  bool far() const { return far_; }  // a part of the error is left to later steps
  double gap() const;                // m, of the anchors
  double alignment() const;          // least cosine of the angles between axes that the joint holds parallel

  scene::JointType type;
  int parent, child;
  double q_min, q_max, friction, damping;
  double stiffness, q_spring;  // of the spring
  double pitch;                // m/rad; 0 unless a screw

  Vector3d p_parent, p_child;  // anchors in W
  Matrix3d R_parent, R_child;  // joint frames in W
  double q = 0;

  Vector3d axis() const { return R_parent.col(2); }  // in W

 private:
  Motion6 distance() const;
  double angle() const;  // nearest to the last q

  bool far_ = false;
  Motion6 left_;                   // part of the error left to later steps; in the joint's frame on the parent
  Pose X_BJ_parent_, X_BJ_child_;  // joint frames on the bodies' frames B …
  Pose X_PJ_, X_CJ_;               // … and on their frames P
};

}  // namespace cotwin::contact_world
