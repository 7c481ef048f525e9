#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <span>
#include <vector>

#include "components/compliance/cartesian/self_motion.h"
#include "components/compliance/joints/limits.h"
#include "components/compliance/joints/link_dynamics.h"
#include "components/compliance/joints/tracking.h"
#include "models/control/cascade.h"
#include "models/control/null_space.h"
#include "models/mechanics/pose.h"
#include "models/robot/dynamics.h"

namespace cotwin::compliance {

/// A pose in the base frame, m, with its twist [v; ω], m/s, rad/s.
struct MovingPose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Quaterniond Q{1, 0, 0, 0};
  Twist V = Twist::Zero();
};

/// A motion of the joints that self-motion follows.
struct Posture {
  const Eigen::VectorXd &q, &dq, &ddq;
};

struct JointMotionGains {
  double omega_k = 100;   // 1/s; rate at which the drift of the pose decays
  double sigma_0 = 0.03;  // m; below this least singular value the task is damped
  double lambda_0 = 1;    // 1; damping of a lost direction, in units of sigma_0
  double k_nu = 4;        // 1/s; damping of the null space
};

/// The motion of the joints that moves frame E with a given motion, at the acceleration level (IV-A3):
///   q̈_c = J̄ (ẍ_c − J̇ q̇_c + K_v (ẋ_c − J q̇_c) + K_p e) + N ξ       J̄ = M⁻¹ Jᵀ Λ,   N = I − J̄ J,   K_v = 2 omega_k, K_p = omega_k²
/// at (q_c, q̇_c), so that measured noise does not enter J. e: the error of the pose; its rotation is 2 η ε. With several tasks
/// J̄ and N are those of their cascade (models/control/cascade.h), which also damps directions whose singular value is below
/// sigma_0: the joints stay slow, and the pose is reached only in part. ξ: models/control/null_space.h.
class JointMotion {
 public:
  /// m; makes rotations comparable with translations.
  static constexpr double kLength = 0.3;

  /// `self_motion` must outlive this and not be moved.
  JointMotion(const robot::RobotModel& robot, SelfMotion& self_motion);

  void set_frame(const robot::FrameOnBody& E) { E_ = E; }
  const robot::FrameOnBody& frame() const { return E_; }
  /// At rest in `pose` or, if V ≠ 0, with the speed of least kinetic energy.
  void start(LinkDynamics& links, const Eigen::VectorXd& at, const Twist& V, const JointMotionGains& gains);
  /// A step of h seconds, in which E moves from `before` to `after`, where its acceleration is `end_acceleration`. `tau_e`: mean
  /// external joint torque, N.m. `posture` (or nullptr): N (q̈_d + k_nu q̇_d + k_nu²/4 (q_d − q_c)) is added to self-motion, so
  /// that it follows q_d at the aperiodic limit.
  void advance(LinkDynamics& links, const MovingPose& before, const MovingPose& after, const Twist& end_acceleration,
               const Eigen::VectorXd& tau_e, const Posture* posture, std::span<const Limits> limits,
               const JointMotionGains& gains, double h);
  /// The accelerations of the joints for one of E alone, J̄ ẍ, at the position of the last step: after advance().
  void accelerations_of(const Twist& acceleration, Eigen::Ref<Eigen::VectorXd> ddq_of);
  /// J̄ᵀ τ at q_c: the wrench at E that has the effect of `tau` on the task; 0 in directions that are not rendered.
  Wrench wrench_of(LinkDynamics& links, const robot::VectorIn& tau, const JointMotionGains& gains);

  // States.
  Eigen::VectorXd q, dq, ddq;  // rad, rad/s, rad/s²; n, at the end of the last step
  // Results of advance().
  double sigma_min = 0;           // m; least of the tasks of E
  double lambda = 0;              // 1; largest of the tasks of E
  std::vector<std::int32_t> met;  // Limit that acted, by joint

 private:
  /// Poses, Jacobians and M at q, and, if `dq` is not a nullptr, their rates.
  void evaluate(LinkDynamics& links, const Eigen::VectorXd& at, const Eigen::VectorXd* dq, const JointMotionGains& gains);
  void select_rows(const TaskEntry& task, const Eigen::MatrixXd& from, Eigen::MatrixXd& J) const;
  /// Wanted accelerations of the tasks of E; those of held frames are 0.
  void want(const Twist& acceleration);
  void part(LinkDynamics& links, const MovingPose& before, const Twist& acceleration, const Eigen::VectorXd& tau_e,
            std::span<const Limits> limits, const JointMotionGains& gains, double h);
  bool update_bounds(std::span<const Limits> limits, double h);
  double beyond(Eigen::Index i) const;
  bool make_room(std::size_t kept);
  void note(Eigen::Index i, bool high);
  void bound(std::span<const Limits> limits, double h);

  SelfMotion& self_motion_;
  const std::vector<TaskEntry>& tasks_;
  robot::FrameOnBody E_;
  control::Cascade cascade_;
  control::NullSpace null_space_;
  const Posture* posture_ = nullptr;  // within advance()
  // Scratch.
  Pose X_;                          // of E at the last evaluation
  std::vector<Eigen::Vector3d> p_;  // of held frames, by task
  Eigen::MatrixXd J6_, dJ6_, held_J6_, held_dJ6_, M_, dM_, C_;
  Eigen::VectorXd q_mid_, dq_mid_, gradient_, tau_;  // n
  std::vector<Allowed> allowed_;                     // of each joint's speed
  Eigen::MatrixXd mobility_;                         // n x n
  Eigen::VectorXd then_, own_, push_;                // n: speeds, of M⁻¹ the diagonal, and impulses
  std::vector<Eigen::VectorXd> forces_;              // by task
};

}  // namespace cotwin::compliance
