#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/compliance/cartesian/frame/contact_stiffness.h"
#include "components/compliance/cartesian/frame/parameters.h"
#include "components/compliance/cartesian/frame/rotation.h"
#include "components/compliance/cartesian/frame/translation.h"
#include "components/compliance/cartesian/frame/walls.h"
#include "components/compliance/cartesian/impedance_control.h"
#include "components/compliance/cartesian/joint_motion.h"
#include "components/compliance/cartesian/sampled_loop.h"
#include "components/compliance/cartesian/self_motion.h"
#include "components/unit/settings.h"
#include "components/unit/variables.h"

namespace cotwin::compliance {

/// The motion of the joints that gives frame E of the robot a desired compliance (IV-A3), with Δ = x_c − x_d in the chosen axes:
///   M_T Δ̈ + D Δ̇ + S_T Δ = f          (3a)
///   M_R Δω̇ + D Δω + 2 Eᵀ K_o ε = m    (3b), in the axes of the desired frame
/// translation.h, rotation.h and joint_motion.h have the equations; a wrench f, m acts on the robot.
///
/// Ports are in W, states in the base frame B.
class CartesianMotion {
 public:
  static void declare_settings(SettingList& s);
  /// Throws Error for directions that the robot cannot render.
  CartesianMotion(Settings& settings, const robot::RobotModel& robot);

  /// Joint ports that the settings ask for.
  bool desired_joints() const { return desired_joints_; }
  bool wrench_of_joints() const { return wrench_of_joints_; }

  void declare(Variables& v);
  /// Variables that were added later, after all others of the unit.
  void declare_search(Variables& v);
  void check(const std::string& place);
  /// The desired motion of the joints and measured positions and torques, in the order of the joints.
  struct FromJoints {
    const std::vector<double>&q_d, &dq_d, &ddq_d, &q, &tau_e, &tau_e_rate;
  };
  /// The compliant frame starts where the robot is.
  void start(LinkDynamics& links, const FromJoints& in);
  /// Parameters move towards the tunables: `remaining` of each difference is left, in a step of h seconds.
  void follow(double remaining, double h);
  void advance(LinkDynamics& links, const FromJoints& in, std::span<const Limits> limits, double h);
  /// Takes the wrench and the measured pose at the beginning of a step. Of a sensor's wrench the joint torques J(q)ᵀ [f; m] and
  /// their rates are written into `tau`, `rate`.
  void update_wrench(LinkDynamics& links, const FromJoints& in, std::vector<double>& tau, std::vector<double>& rate);
  /// Takes `energy`, J, from the motion of the compliant frame: what the motors could not give.
  void brake(double energy);
  bool brakes_saturated() const { return brake_saturated_; }
  /// render=impedance: whether impede() takes the place of advance() and tracking.
  bool impedance() const { return impedance_ != nullptr; }
  void start_impedance(const Measured& measured, std::span<const Limits> limits);
  /// The motor torques over a step of h seconds, without friction. `tau_e`, N.m: the measured torque that acts on the robot. joints()
  /// is q̄ and the desired motion in the joints.
  void impede(LinkDynamics& links, const FromJoints& in, const robot::DriveParameters& drives, const Measured& measured,
              const Joints& shaping, std::span<const Limits> limits, const Joints& tau_e, double h, Joints& tau_m);
  /// Goes on with the search for the largest stiffness of an environment (contact_stiffness.h). `bandwidth`: of the winding-up of
  /// elastic joints; `tau_max`, N.m: 0: no limit. After advance().
  void find_contact_stiffness(LinkDynamics& links, const robot::DriveParameters& drives, const Gains& gains, double bandwidth,
                              bool feeds_wrench_forward, const Joints& tau_max, double h);
  /// After the states were written.
  void restored();

  const JointMotion& joints() const { return joints_; }
  /// Whether something happened in the last call for the first time since the start.
  bool warnings_changed() const { return warnings_changed_; }
  void append_warning(std::string& warning) const;
  static std::size_t longest_warning();

 private:
  enum class Axes { kWorld, kDesired, kTool };
  enum WarningBit : std::int32_t {
    kSingular = 1,
    kTask = 2,
    kTank = 4,
    kRunsAway = 8,
    kStart = 16,
    kContradiction = 32,
    kSoftGears = 64,
    kStatics = 128,
    kStiffContact = 256,
    kWall = 512,
    kGains = 1024,
    kSwings = 2048,
    kSampling = 4096
  };
  struct Motion {
    MovingPose pose;
    Twist acceleration = Twist::Zero();
  };

  void update_frames();
  Motion desired(LinkDynamics& links, const FromJoints& in);
  Wrench inertia_of_tool(LinkDynamics& links, const Pose& X_S);
  Wrench rendered(const Wrench& F) const;
  void prepare(const Eigen::Matrix3d& R_BA, const Eigen::Matrix3d& R_d, double h);
  Eigen::Vector3d moment_in_desired(const Eigen::Matrix3d& R_d, const Wrench& F, const Eigen::Vector3d& x) const;
  Motion compliant(const Motion& d, const Wrench& F);
  void write_outputs(LinkDynamics& links, const MovingPose& c);
  bool confine_frame(const Motion& d, const Turn& turn, const Eigen::Vector3d& x, const Eigen::Vector3d& dx,
                     const Wrench& F_mean, double h);
  void hold_frame_at_joints(LinkDynamics& links, const Motion& d, Motion& c);
  void note(WarningBit what);
  bool needs_check(double h) const;
  void check_sampling(LinkDynamics& links, const ElasticFrame& frame, const ElasticPosture& posture,
                      const robot::DriveParameters& drives, const Joints& shaping, double h);
  void append_sampling(std::string& warning) const;
  void check_following(const robot::DriveParameters& drives, double h);
  void update_robot_in_contact(LinkDynamics& links, const robot::DriveParameters& drives, const Gains& gains,
                               const Eigen::Matrix3d& R_T, const Eigen::Matrix3d& R_R);
  JointMotionGains gains() const;
  Eigen::Matrix3d axes(const Eigen::Quaterniond& Q_d, const Eigen::Quaterniond& Q_c) const;

  std::string place_;
  bool desired_joints_, wrench_of_joints_;
  Axes axes_;
  Potential potential_;
  robot::FrameOnBody frame_;
  bool sensor_;              // the wrench is that of a force sensor
  robot::FrameOnBody S_;     // its frame
  Eigen::Vector3d gravity_;  // m/s² in B
  std::vector<int> directions_;
  Eigen::Matrix3d P_T_, P_R_;  // rendered directions in B
  SelfMotion self_motion_;
  JointMotion joints_;

  // Inputs.
  using Three = std::array<double, 3>;
  using Four = std::array<double, 4>;
  Three p_d_{}, v_d_{}, w_d_{}, dv_d_{}, dw_d_{};
  Four quat_d_{1, 0, 0, 0};
  Three f_e_{}, m_e_{}, f_rate_{}, m_rate_{};  // in W at E, or in the axes of the sensor
  // Parameters.
  Three p_FE_{}, p_WB_{};
  Four quat_FE_{1, 0, 0, 0}, quat_WB_{1, 0, 0, 0};
  double tool_mass_ = 0;  // kg
  Three tool_centre_{};
  double tank_start_ = 1, tank_max_ = 10;  // J
  CartesianParameters wanted_, checked_;
  bool is_checked_ = false;
  bool settled_ = false,
       in_force_is_checked_ = false;  // the values in force are those wanted; are definite and in their ranges
  // States.
  CartesianParameters in_force_;
  Eigen::Vector3d Delta_ = Eigen::Vector3d::Zero(), dDelta_ = Eigen::Vector3d::Zero();  // in the chosen axes
  Four quat_dc_{1, 0, 0, 0};
  Eigen::Vector3d w_dc_ = Eigen::Vector3d::Zero();
  Four quat_d_before_{1, 0, 0, 0}, quat_before_{1, 0, 0, 0};  // in B
  Eigen::Vector3d p_before_ = Eigen::Vector3d::Zero();
  Twist V_before_ = Twist::Zero();
  double tank_ = 0;
  std::int32_t met_ = 0;
  // Outputs.
  Three p_c_{}, v_c_{}, w_c_{}, Delta_p_{}, epsilon_{};
  Four quat_c_{1, 0, 0, 0};
  double sigma_min_ = 0, lambda_ = 0, task_error_ = 0;
  Three p_q_{}, epsilon_q_{};
  Four quat_q_{1, 0, 0, 0};

  Three p_min_{}, p_max_{};  // m, in W
  double v_max_ = 0, w_max_ = 0, braking_ = 2;
  bool brake_saturated_ = false;
  double alpha_ = 0;                             // 1/s; 0: the tank
  std::unique_ptr<ImpedanceControl> impedance_;  // nullptr: render=admittance
  std::unique_ptr<ImpedanceSelfMotion> impedance_self_motion_;
  std::unique_ptr<ImpedanceLimits> impedance_limits_;
  SampledLoop sampled_loop_;
  double delay_ = 0;  // s
  // States: the step that was checked last and, where the robot vibrates, the values up to which it does not.
  double checked_step_ = 0;  // s; 0: none
  std::int32_t gears_undamped_ = 0, follower_vibrates_ = 0;
  double delay_border_ = 0, shaping_border_ = 0, stiffness_border_ = 0;  // s, 1, 1
  std::array<double, 6> K_e_{};                                          // N/m, N.m/rad; 0: unknown
  double omega_t_ = 0, zeta_t_ = 1;                                      // rad/s, 1
  ContactSweep contact_;
  std::int32_t contact_turn_ = 0;

  // At the beginning of the step, in B.
  Wrench F_ = Wrench::Zero(), dF_ = Wrench::Zero();
  // Computed from parameters.
  Pose X_WB_;
  Eigen::Quaterniond Q_WB_{1, 0, 0, 0};
  // For the values in force.
  CartesianParameters prepared_, towards_;
  bool is_prepared_ = false;
  Impedance translation_, rotation_;   // with the damping of zeta
  Impedance rendered_T_, rendered_R_;  // of the rendered directions
  double k_min_ = 0;                   // N.m/rad
  Eigen::Matrix3d inverse_M_T_ = Eigen::Matrix3d::Identity(), inverse_M_R_ = Eigen::Matrix3d::Identity();  // of these
  Propagator propagator_;
  RotationStep rotation_step_;
  Eigen::VectorXd q_scratch_, dq_scratch_, ddq_scratch_, tau_scratch_;
  Eigen::Matrix<double, 6, Eigen::Dynamic> J_, J_S_;
  bool warnings_changed_ = false;
  FollowingRobot following_;
  SampledRobot sampled_;
  Joints shaping_scratch_;
  Eigen::MatrixXd contact_total_;
};

}  // namespace cotwin::compliance
