#pragma once
#include "models/robot/floating_base.h"

namespace cotwin::robot {

/// q̈ and A_B of a floating robot under τ and W, by articulated bodies: the base is six joints at zero before the robot's own.
inline void floating_forward_dynamics(const FloatingMechanism& mechanism, FloatingData& d, const VectorIn& q,
                                      const VectorIn& dq, const VectorIn& tau, const Twist& V_B, const Wrench& W,
                                      const Eigen::Vector3d& gravity, VectorOut ddq, Twist& A_B) {
  const Eigen::Index n = mechanism.n();
  const Eigen::Vector3d w = V_B.tail<3>();
  d.q.tail(n) = q;
  d.dq << V_B, dq;
  d.tau << W, tau;
  forward_dynamics(mechanism.with_base(), d.data, d.q, d.dq, d.tau, d.ddq);
  // The axes of the base's revolute joints move with the joints before them.
  A_B << d.ddq.head<3>() + gravity, d.ddq.segment<3>(3) + Eigen::Vector3d(w.y() * w.z(), -w.x() * w.z(), w.x() * w.y());
  ddq = d.ddq.tail(n);
}

}  // namespace cotwin::robot
