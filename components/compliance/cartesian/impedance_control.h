#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <span>
#include <vector>

#include "components/compliance/cartesian/frame/rotation.h"
#include "components/compliance/cartesian/frame/translation.h"
#include "components/compliance/cartesian/impedance_limits.h"
#include "components/compliance/cartesian/impedance_self_motion.h"
#include "components/compliance/cartesian/joint_motion.h"
#include "components/compliance/cartesian/sampled_loop.h"
#include "components/compliance/joints/link_dynamics.h"
#include "components/compliance/joints/tracking.h"
#include "models/robot/drives/drive_parameters.h"

namespace cotwin::compliance {

/// Springs and dampers between the desired frame and frame E, in the base frame.
struct ElasticFrame {
  MovingPose desired;
  Twist acceleration = Twist::Zero();                  // of the desired frame
  Eigen::Matrix3d R_BA = Eigen::Matrix3d::Identity();  // axes of S_T and D_T
  Eigen::Matrix3d S_T = Eigen::Matrix3d::Zero(), D_T = Eigen::Matrix3d::Zero();
  Potential potential = Potential::kQuaternion;
  Eigen::Matrix3d K_o = Eigen::Matrix3d::Zero(), D_R = Eigen::Matrix3d::Zero();  // in the axes of the desired frame
  double zeta_T = 0, zeta_R = 0;  // damping ratios of all modes of the rendered directions, added to D_T and D_R
  double omega_free = 0;          // rad/s; of these ratios where there is no stiffness
  Eigen::Matrix3d P_R = Eigen::Matrix3d::Identity();  // rendered directions of rotation
  // The axes of S_T turn with E, so that the force has a moment about it: the spring is fixed to the tool.
  bool turns_with_tool = false;
};

/// Behaviour in the null space of the frame.
struct ElasticPosture {
  const Joints& q_0;    // rad
  double K = 0, D = 0;  // 1/s², 1/s: stiffness K (M + B/r) and damping D (M + B/r)
  // In place of them, with the gains and the desired joints (or nullptr) that it takes.
  ImpedanceSelfMotion* self_motion = nullptr;
  JointMotionGains gains = {};
  const Posture* desired = nullptr;
};

/// Limits of the motion (impedance_limits.h), of a step of h > 0 seconds.
struct ElasticLimits {
  ImpedanceLimits& limits;
  std::span<const Limits> joints;
  const Joints& tau_e;  // N.m; measured external torque on the robot
  double h;
};

/// Cartesian impedance by the motor torques (render=impedance), without a measured wrench and without shaping of the links'
/// inertia, for rigid and elastic joints:
///   τ_m = r u − (r − 1) τ_J,   τ_J = K (θ − q)                 so that (B/r) θ̈ + τ_J = u by (2b)
///   u = l(q̄) + (B/r) q̈_r − Jᵀ D (J θ̇ − ẋ_d) − Nᵀ (M + B/r) (D_n N θ̇ + K_n (q̄ − q_0))      or impedance_self_motion.h
///   l(q̄) = M q̈_r + C q̇_r + g − Jᵀ [S_T Δ; 2 EᵀK_o ε],   q̇_r = J̄ ẋ_d,   q̈_r = J̄ (ẍ_d − J̇ q̇_r)      all at q̄
///   K (θ − q̄) = l(q̄)                                                    q̄(θ): the links at rest for the motors at θ
/// (Ott, Albu-Schäffer, Kugi, Hirzinger, IEEE T-RO 24(2), 2008; desired motion as by Slotine and Li). Rigid joints have q̄ = q and
/// θ̇ = q̇. J̄ and N use the inertia M + B/r that u moves. The damping ratios are those of the modes of all rendered directions together, with this
/// inertia and the compliance of the gears: at ζ = 1 E does not swing beyond a desired pose that jumps along an axis of S.
///
/// For a desired frame at rest u is the gradient of a potential of θ, and a damping. So the robot is passive from external torques
/// to q̇ in continuous time, in contact with any passive environment, for any S, K_o, D ≥ 0 and K_n = 0 (docs/equations.md). The
/// stiffness S and K_o is that of the links, the springs of the gears included, hence the condition
///   ρ = λ_max(K^(−1/2) (JᵀSJ) K^(−1/2)) < 1
/// Newton's iteration for q̄ contracts then; with ρ > 0.8 the spring in l is multiplied by 0.8/ρ in the equation of q̄ alone, so that
/// the links are softer than S.
class ImpedanceControl {
 public:
  static constexpr double kSoftest = 0.8;
  static constexpr double kSwinging =
      0.35;  // ρ; above it E swings by more than 2 % also at ζ = 1, because motors alone cannot damp the gears

  /// `directions` as JointMotion.
  ImpedanceControl(const robot::RobotModel& robot, std::vector<int> directions);

  /// q̄ at the start: the links at `q`.
  void start(const Joints& q, const Joints& theta);
  /// The motor torque at the beginning of a step, without friction, into `tau_m`. `limits`: or nullptr.
  void torque(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame, const ElasticPosture& posture,
              const robot::DriveParameters& drives, const Measured& measured, const Joints& shaping,
              const ElasticLimits* limits, Joints& tau_m);

  /// After torque(), also with another stiffness and shaping: the linearised robot, links and law, without goals, held frames and limits,
  /// into `robot`; not its step and delay. Changes the results.
  void linearise(LinkDynamics& links, const ElasticFrame& frame, const ElasticPosture& posture,
                 const robot::DriveParameters& drives, const Joints& shaping, SampledRobot& robot);

  // State.
  Eigen::VectorXd twist;  // rad; θ − q̄ where the iteration starts
  // Results of torque().
  Eigen::VectorXd q_bar, dq_r, ddq_r;  // rad, rad/s, rad/s²
  Pose X;                              // of E at q̄
  Twist V = Twist::Zero();             // of E with J θ̇
  double stiffness_ratio = 0;          // ρ (an upper bound, at most 1.25 ρ)
  double static_error = 0;             // rad; residual of K (θ − q̄) = l(q̄) in units of θ
  double dissipated = 0;               // W, by D
  double sigma_min = 0;                // m; as JointMotion

 private:
  void update_inertia(LinkDynamics& links, const robot::DriveParameters& drives, const Joints& shaping);
  void update_reference(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame);
  void update_stiffness(const ElasticFrame& frame, const robot::DriveParameters& drives);
  void update_joint_stiffness(const ElasticFrame& frame);
  Wrench spring(const ElasticFrame& frame) const;
  const Eigen::Matrix3d& axes_of(const ElasticFrame& frame) const { return frame.turns_with_tool ? X.R : frame.R_BA; }
  void solve_statics(LinkDynamics& links, const robot::FrameOnBody& E, const ElasticFrame& frame,
                     const robot::DriveParameters& drives, const Joints& theta);
  using Square = Eigen::Matrix<double, 6, 6>;
  using Six = Eigen::Matrix<double, 6, 1>;
  using ModeColumns = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor, 6, 6>;
  Six factors_behind_gears(const Eigen::Ref<const ModeColumns>& V, const Six& values, const robot::DriveParameters& drives,
                           const Joints& shaping);
  Square damping(const ElasticFrame& frame, const robot::DriveParameters& drives, const Joints& shaping);

  std::vector<int> directions_;
  // Scratch.
  bool elastic_ = false, moving_ = false;
  double relief_ = 1;  // 0.8/ρ
  Eigen::MatrixXd J6_, SJ_, J_, M_, Y_, A_, S_q_, square_, fourth_;
  Eigen::LLT<Eigen::MatrixXd> M_llt_, A_llt_, statics_;
  Eigen::VectorXd l_, r_, x_, dtheta_, u_;
  Eigen::VectorXd task_;
  Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> modes_x_;  // a column per mode
};

}  // namespace cotwin::compliance
