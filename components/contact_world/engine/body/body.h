#pragma once
#include <Eigen/Core>
#include <span>
#include <string>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// A rigid body in the solver: frame P has its origin in the centre of mass and the principal axes. For a body that is not
/// dynamic, P is its own frame B.
struct RigidBody {
  /// Throws Error if a dynamic body has no physical inertia.
  explicit RigidBody(const scene::Body& body);

  bool dynamic() const { return motion == scene::Motion::kDynamic; }
  Pose pose() const;    // X_WB
  Twist twist() const;  // V_WB of B's origin
  void set_pose(const Pose& X_WB);
  void set_twist(const Twist& V_WB);
  void place();  // updates R from Q
  /// Replaces the mass distribution of a dynamic body, given in B, which keeps its pose and twist. `shapes`: of the body. Throws Error
  /// `name: …` for an unphysical inertia. Allocates nothing.
  void set_inertia(const Inertia& inertia, std::span<const scene::Shape> shapes, const std::string& name);

  /// Adds an impulse and an angular impulse about P's origin, in W, to a dynamic body.
  void apply_impulse(const Vector3d& impulse, const Vector3d& moment);
  void set_spin(const Vector3d& w_W);
  void update_spin();  // w from L
  double kinetic_energy() const;
  /// J M⁻¹ Jᵀ of a unit impulse d at p with an angular impulse m, in W, on the body without joints; 0 if it is not dynamic.
  double mobility(const Vector3d& d, const Vector3d& m, const Vector3d& p) const;

  /// Moves the body from t to t + h with constant velocity of P and constant angular momentum; updates w. A driven body keeps
  /// its twist.
  void drift(double h);

  scene::Motion motion;
  double mass = 0, inverse_mass = 0, inverse_root_mass = 0;
  Vector3d moments = Vector3d::Zero();          // principal
  Vector3d inverse_moments = Vector3d::Zero();  // 0 where the moment is 0
  Vector3d root_moments = Vector3d::Zero(), inverse_root_moments = Vector3d::Zero();
  Pose X_BP, X_PB;
  double radius = 0;  // of the sphere about P's origin that contains all shapes; 0 without shapes

  Vector3d p = Vector3d::Zero();                        // p_WP
  Eigen::Vector4d Q{1, 0, 0, 0};                        // unit quaternion of R_WP, (w, x, y, z)
  Matrix3d R = Matrix3d::Identity();                    // R_WP, that of Q
  Vector3d v = Vector3d::Zero(), w = Vector3d::Zero();  // of P, expressed in W
  Vector3d L = Vector3d::Zero();                        // angular momentum about P in W: constant to the bit without moments

 private:
  void turn(double h);
  void take(const Inertia& inertia);
  int reference_axis_ = 0;
};

}  // namespace cotwin::contact_world
