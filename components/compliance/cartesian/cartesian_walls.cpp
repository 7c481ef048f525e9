// Limits of the compliant frame: its own box and speeds, the limits of the joints, and the torques of the motors.
#include <algorithm>
#include <cmath>
#include <string>

#include "components/compliance/cartesian/cartesian_motion.h"
#include "components/compliance/joints/views.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::compliance {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Impedance turned(const Impedance& z, const Matrix3d& R) {
  return {R * z.M * R.transpose(), R * z.D * R.transpose(), R * z.S * R.transpose()};
}

}  // namespace

/// `turn`, `x`, `dx`: at the beginning of the step; `F_mean` in the axes of the deviations.
bool CartesianMotion::confine_frame(const Motion& d, const Turn& turn, const Vector3d& x, const Vector3d& dx,
                                    const Wrench& F_mean, double h) {
  const FrameLimits limits{vector(p_min_), vector(p_max_), v_max_, w_max_, braking_};
  if (!limits.any()) return false;
  Tank tank{tank_, tank_max_};
  Turn turned_to{quaternion(quat_dc_), w_dc_};
  const Matrix3d R_d = d.pose.Q.toRotationMatrix();
  const Limit by_turn = confine(limits, R_d.transpose() * d.pose.V.tail<3>(), potential_, rendered_R_, turn, F_mean.tail<3>(),
                                h, turned_to, tank);
  quat_dc_ = array(turned_to.Q);
  w_dc_ = turned_to.w;
  const Matrix3d R_WA = X_WB_.R * axes(d.pose.Q, d.pose.Q * turned_to.Q);
  const Vector3d p_d = X_WB_ * d.pose.p, v_d = X_WB_.R * d.pose.V.head<3>(), w_d = X_WB_.R * d.pose.V.tail<3>();
  FrameDeviation end{R_WA * Delta_, R_WA * dDelta_};
  const Limit by_way =
      confine(limits, {p_d, v_d, w_d}, turned(rendered_T_, R_WA), {R_WA * x, R_WA * dx}, R_WA * F_mean.head<3>(), h, end, tank);
  tank_ = tank.energy;
  if (by_turn == Limit::kNone && by_way == Limit::kNone) return false;
  note(kWall);
  if (by_way != Limit::kNone) {
    Delta_ = R_WA.transpose() * end.x;
    dDelta_ = R_WA.transpose() * end.dx;
  }
  return true;
}

/// Where the joints cannot follow, at their limits or out of reach, the compliant frame stays close to them: a wall, which takes
/// kinetic energy only.
void CartesianMotion::hold_frame_at_joints(LinkDynamics& links, const Motion& d, Motion& c) {
  const bool limited = std::ranges::any_of(joints_.met, [](std::int32_t met) { return met != 0; });
  if (!limited && joints_.lambda == 0) return;
  // m. Damped joints need a distance that pulls them out of a singular pose; at a limit they would jump back by it afterwards.
  const double far = joints_.lambda > 0 ? 5e-3 : 5e-4;
  const Pose X = links.jacobian(joints_.q, joints_.frame(), J_);
  Vector3d off = P_T_ * (c.pose.p - X.p), turned_off = P_R_ * axis_angle(c.pose.Q * Quaterniond(X.R).conjugate());
  // Tasks that are followed stay where they are; the first one that is not moves with those below it.
  double square = 0;
  for (const TaskEntry& task : self_motion_.tasks()) {
    if (task.held) continue;
    for (const int i : task.directions) square += std::pow(i < 3 ? off[i] : JointMotion::kLength * turned_off[i - 3], 2);
    if (square >= far * far) break;
    for (const int i : task.directions) (i < 3 ? off[i] : turned_off[i - 3]) = 0;
  }
  const double distance = std::hypot(off.norm(), JointMotion::kLength * turned_off.norm());
  if (distance < far) return;
  note(kTask);
  const auto energy = [&] {
    return (dDelta_.dot(rendered_T_.M * dDelta_) + Delta_.dot(rendered_T_.S * Delta_) + w_dc_.dot(rendered_R_.M * w_dc_)) / 2 +
           potential_energy(potential_, rendered_R_.S, quaternion(quat_dc_));
  };
  const double before = energy(), back = 1 - far / distance;
  const Matrix3d R_d = d.pose.Q.toRotationMatrix();
  const Quaterniond Q_c = quaternion_of(-back * turned_off) * c.pose.Q;
  Quaterniond Q_dc = (d.pose.Q.conjugate() * Q_c).normalized();
  if (Q_dc.w() < 0) Q_dc.coeffs() *= -1;
  quat_dc_ = array(Q_dc);
  const Matrix3d R = axes(d.pose.Q, Q_c);
  Delta_ -= R.transpose() * (back * off);
  // The speed at which the frame leaves the joints.
  Twist V, direction;
  V.noalias() = J_.lazyProduct(joints_.dq);
  constexpr double L2 = JointMotion::kLength * JointMotion::kLength;
  direction << off / distance, L2 / distance * turned_off;
  const double leaving = direction.dot(c.pose.V - V);
  if (leaving > 0) {
    dDelta_ -= R.transpose() * (leaving * off / distance);
    w_dc_ -= R_d.transpose() * (leaving * turned_off / distance);
  }
  brake(energy() - before);
  const Vector3d p = c.pose.p;
  const Quaterniond Q = c.pose.Q;
  c = compliant(d, Wrench::Zero());
  c.pose.p = p - back * off;
  if (c.pose.Q.dot(Q) < 0) c.pose.Q.coeffs() *= -1;
}

void CartesianMotion::brake(double energy) {
  if (!(energy > 0)) return;
  const double kinetic = (dDelta_.dot(rendered_T_.M * dDelta_) + w_dc_.dot(rendered_R_.M * w_dc_)) / 2;
  const double share = kinetic > energy ? std::sqrt(1 - energy / kinetic) : 0.0;
  dDelta_ *= share;
  w_dc_ *= share;
}

}  // namespace cotwin::compliance
