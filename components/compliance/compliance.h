#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/compliance/cartesian/cartesian_motion.h"
#include "components/compliance/joints/admittance.h"
#include "components/compliance/joints/torque_terms.h"
#include "components/compliance/joints/tracking.h"
#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/foundation/support/parameter_table.h"
#include "models/robot/body_parameters.h"
#include "models/robot/drives/drive_parameters.h"

namespace cotwin::compliance {

/// The gains of compliance and tracking, which may be changed while the robot moves. kGains describes each vector.
struct GainParameters {
  GainParameters() = default;
  explicit GainParameters(std::size_t joints);
  Joints M_a, S_a, D_a, zeta_a, omega_free;  // admittance
  Joints omega, zeta;                        // computed torque
  Joints Lambda, K_s;                        // passivity-based tracking
  Joints shaping;                            // of the motor inertia
  Joints passivity;                          // one value: the weight of passivity-based tracking, 0 … 1
};

/// In the order of declaration. The tank limits how M_a and S_a follow their tunables.
inline constexpr auto kGains = [] {
  using P = GainParameters;
  using Row = ParameterRow<P>;
  constexpr double least = Row::kPositive, most = Row::kLargest;
  constexpr Mutability tunable = Mutability::kFollowed, by_tank = Mutability::kByUnit;
  return std::to_array<Row>({
      {"M_a", &P::M_a, "kg.m2", "desired inertia of the joint admittance, cf. (3a)", 1, least, most, by_tank},
      {"D_a", &P::D_a, "N.m.s/rad", "desired damping of the joint admittance, beside that of zeta_a", 0, 0, most, tunable},
      {"zeta_a", &P::zeta_a, "1",
       "damping ratio of the joint admittance: adds 2 zeta_a sqrt(S_a M_a) to D_a; 1: aperiodic limit", 1, 0, most, tunable},
      {"S_a", &P::S_a, "N.m/rad", "desired stiffness of the joint admittance; 0: freely guided", 200, 0, most, by_tank},
      {"omega", &P::omega, "rad/s", "natural frequency of the tracking error under computed torque", 30, 0, most, tunable, 1,
       false},
      {"zeta", &P::zeta, "1", "damping ratio of the tracking error under computed torque", 1, 0, most, tunable},
      {"Lambda", &P::Lambda, "1/s", "decay rate of the tracking error on s = 0, passivity-based tracking", 30, 0, most,
       tunable},
      {"K_s", &P::K_s, "N.m.s/rad", "gain on s of passivity-based tracking", 20, 0, most, tunable},
      {"shaping", &P::shaping, "1",
       "torque feedback makes the motors of elastic joints lighter by this factor, which damps vibrating links; 1: none", 1, 1,
       100, tunable},
      {"passivity", &P::passivity, "1", "tracking: 0 computed torque, 1 passivity-based (Slotine and Li), or a blend", 0, 0, 1,
       tunable, 0},
      {"omega_free", &P::omega_free, "rad/s", "damping is at least 2 zeta_a M_a omega_free, also for S_a = 0", 2, 0, most,
       tunable, 1, false},
  });
}();

/// The first rows of kGains, which only compliance of the joints uses (M_a, D_a, zeta_a, S_a).
inline constexpr std::size_t kAdmittanceGains = 4;

/// Compliant motion of the joints and its tracking (IV-A3):
///   admittance.h   the joint admittance M_a Δ̈ + D Δ̇ + S_a Δ = τ_e, Δ = q_c − q_d, like (3a), passive also while S_a rises
///   cartesian/     with space=cartesian, in its place the compliance (3a), (3b) of a frame of the robot
///   limits.h       limits of position and speed as one-sided walls on q_c
///   tracking.h     the motor torques that make links and motors follow q_c, of rigid and elastic joints
/// Friction of both sides is fed forward at the speed of the compliant motion.
///
/// As in a robot's controller, the desired motion holds at the end of a step (its source steps first), measurements at its
/// beginning. Admittance, gains, bodies and the tunables of robot::kDriveParameters may be changed while the robot moves. The
/// values in force follow smoothly.
class Compliance final : public Unit {
 public:
  /// The settings in the source of the unit.
  static void declare_settings(SettingList& s);
  explicit Compliance(Settings& settings);
  ~Compliance() override;

  void declare(Variables& v) override;
  /// Throws Error for parameters outside their ranges, e.g. M_a = 0 (with which q̇_c would jump).
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;

 private:
  Compliance(Settings& settings, const robot::RobotModel& robot, bool floating);
  /// Events that the run's summary names, as bits of `met`.
  enum WarningBit : std::int32_t { kTorque = 1, kPosition = 2, kSpeed = 4, kDesired = 8, kTank = 16 };

  void check();
  void update_spin();
  void start_motion();
  void follow_tunables(double h);
  void move_compliantly(double h);
  void brake_by_saturation(double h);
  void move_frame_compliantly(double h);
  void update_cartesian_motion();
  void note_limits();
  void impede(double h);
  CartesianMotion::FromJoints from_joints() const { return {q_d_, dq_d_, ddq_d_, q_, tau_e_, tau_e_rate_}; }
  void add_load(double h);
  void finish_torques(double h);
  void note(std::size_t i, WarningBit what);
  void write_warning();
  Limits limits(std::size_t i) const { return {q_min_[i], q_max_[i], dq_max_[i], braking_[i]}; }
  Reference reference() const { return {q_c_, dq_c_, ddq_c_, a_q_}; }
  Load load() const { return {load_mean_, load_end_}; }
  Measured measured() const { return {q_, dq_, theta_, dtheta_}; }
  Gains gains() const {
    const GainParameters& p = in_force_;
    return {p.omega, p.zeta, p.Lambda, p.K_s, p.shaping, p.passivity[0]};
  }
  double motor_friction(std::size_t i, double h);
  void update_gravity();
  void update_links();

  std::string place_;  // for messages
  std::size_t n_ = 0;
  JointMeasures measures_;
  LinkDynamics links_;
  bool floating_;
  std::unique_ptr<CartesianMotion> cartesian_;  // nullptr: compliance of the joints

  // Inputs.
  Joints q_d_, dq_d_, ddq_d_, q_, dq_, theta_, dtheta_, tau_e_, tau_e_rate_;
  Joints base_quat_{1, 0, 0, 0}, spin_{0, 0, 0};  // of a floating base
  // Parameters.
  Joints tau_max_;
  Joints q_min_, q_max_, dq_max_, braking_;  // limits of the compliant motion
  Joints tau_wind_up_;
  Joints tank_start_, tank_max_;  // J
  bool tau_e_acts_on_robot_ = true;
  double transition_ = 0.05;        // s
  double elastic_bandwidth_ = 500;  // rad/s
  robot::DriveParameters drive_;
  GainParameters wanted_;
  // States.
  robot::DriveParameters drive_in_force_;
  GainParameters in_force_;
  Joints Delta_, dDelta_;                 // q_c − q_d
  Joints ddq_d_before_;                   // at the beginning of the step
  Joints z_;                              // bristle
  Joints tau_fl_before_, tau_fm_before_;  // friction of the link and the motor side at the beginning of the step
  Joints tank_;                           // J
  Joints tau_cut_;                        // tau_excess of the last step
  std::vector<std::int32_t> met_;
  Tracking tracking_;  // with states of its own
  // Outputs.
  Joints q_c_, dq_c_, ddq_c_, tau_m_, tau_id_, tau_f_, tau_excess_;
  bool saturated_ = false;
  std::string warning_;
  std::vector<std::int32_t> limit_;
  std::unique_ptr<TorqueTerms> terms_;                 // terms=true
  std::vector<robot::LinkSideParameters> link_sides_;  // of drive_in_force_
  // Handed from one phase of a step to the next.
  bool settled_ = false;         // gains and drive in force are those wanted: they need not follow
  bool checked_ = false;         // those in force are in their ranges
  Joints tau_fl_, tau_fm_;       // friction of the link (with its springs) and the motor side at the end of the step
  Joints gravity_;               // N.m: g(q_c), only where friction grows with the load
  Joints load_mean_, load_end_;  // friction and springs of the link less τ_e, over the step and at its end
  Joints a_q_;                   // mean of q̈_c over the step
  std::vector<Limits> limits_;   // of all joints, for Cartesian compliance
  Joints tau_acting_;            // N.m: τ_e as far as it acts on the robot
};

}  // namespace cotwin::compliance
