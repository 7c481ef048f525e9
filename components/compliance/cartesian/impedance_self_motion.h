#pragma once
#include <Eigen/Core>
#include <vector>

#include "components/compliance/cartesian/joint_motion.h"
#include "components/compliance/cartesian/self_motion.h"
#include "components/compliance/joints/link_dynamics.h"
#include "models/control/cascade.h"

namespace cotwin::compliance {

/// Self-motion with render=impedance: what the motors do in the null space of frame E, as joint accelerations in the metric M + B/r
/// that they move (models/control/cascade.h, E's directions first and at rest):
///   held frames      a = omega_held² (p_start + shift − p) − 2 omega_held ṗ
///   below them       N (−k_nu q̇ − M⁻¹ ∇V)       V: the goals of the setting null_space
///   desired joints   N (q̈_d + k_nu (q̇_d − q̇) + k_nu²/4 (q_d − q) − M⁻¹ ∇V)
/// None of it moves E. The damping alone is passive; goals and held frames are not a potential of the motors, because N turns with q.
class ImpedanceSelfMotion {
 public:
  /// `self_motion` must outlive this and not be moved.
  ImpedanceSelfMotion(const robot::RobotModel& robot, SelfMotion& self_motion);

  /// `q`, `dq`: n; `J6`: of E at q (6 x n, linear first); `M`: n x n. `posture`: the desired motion of the joints, or nullptr. Writes
  /// the accelerations into `ddq` (n).
  void evaluate(LinkDynamics& links, const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const robot::FrameOnBody& E,
                const Eigen::MatrixXd& J6, const Eigen::MatrixXd& M, const JointMotionGains& gains, const Posture* posture,
                Eigen::VectorXd& ddq);

 private:
  SelfMotion& self_motion_;
  const std::vector<TaskEntry>& tasks_;
  control::Cascade cascade_;
  Eigen::MatrixXd held_J6_;
  Eigen::VectorXd gradient_, nu_, M_nu_;
};

}  // namespace cotwin::compliance
