#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/drive_train/cvode_solver.h"
#include "components/drive_train/equations.h"
#include "components/drive_train/integrator.h"
#include "components/drive_train/limit_watch.h"
#include "components/drive_train/partials.h"
#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::drive_train {

/// The flexible-joint drive train and, with the link side inside, the whole robot, for n joints, with all quantities seen
/// behind the gear:
///   M(q) q̈ + C(q, q̇) q̇ + g(q) + τ_l(q, q̇) + τ_s(q, q̇) = τ_J + τ_e   (2a)   link_side=inside; outside, q and q̇ are inputs
///   B θ̈ + τ_J = τ_m − τ_f                                             (2b)
///   τ_J = K d(θ − q) + D (θ̇ − q̇)                                      (2c)
/// Beyond the paper: D, joint damping; d, the gear's backlash (d(φ) = φ without); τ_l, friction and springs behind the torque
/// sensor (robot::LinkSideParameters); τ_s, hard stops. τ_f is LuGre friction, an elasto-plastic bristle, Coulomb friction with exact
/// sticking, or the static curve that `cotwin tune` identifies (smooth: no presliding, no sticking); see
/// models/robot/drives/friction.h. transmission=rigid sets θ = q and adds (2b) to (2a); τ_J then follows from (2b). Motor currents and
/// temperature are not modelled.
///
/// The bodies and the tunables of robot::kDriveParameters may be changed while the robot moves (with CVODE they are fixed). The values
/// in force follow smoothly.
///
/// Link inside, bodies that another unit connects with the links (the contact world's latches and grips) may be part of (2a): with their inertia L = Fᵀ F,
/// the torque τ_L = L q̈ for the q̈ that this unit expects, and the damping that its step needs at the gears,
///   (M + L) q̈ + … = τ_J + τ_e + τ_L
/// The difference from τ_e is L (q̈ − q̈ expected): light links then move stably with heavy bodies on them.
class DriveTrain final : public Unit {
 public:
  /// The settings in the source of the unit.
  static void declare_settings(SettingList& s);
  explicit DriveTrain(Settings& settings);
  ~DriveTrain() override;
  void declare(Variables& variables) override;
  void initialise(Time start) override;
  /// Throws Error if an input is not finite. Discards the step and restores the variables if the state is not finite at its end
  /// or CVODE fails.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  std::span<const Partial> partials() const override;
  void evaluate_partials(std::span<double> values) override;

 private:
  struct Kind;
  DriveTrain(Settings& settings, const Kind& kind);
  void declare_parameters(Variables& variables);
  void check_parameters() const;
  void declare_stops_and_solver(Variables& variables);
  void free_passive_joints();
  void update_drives();
  bool follow_drives(double remaining);
  bool follow_bodies(double remaining);
  bool follow_load();
  double energy_of_links();
  void write_drives();
  void adopt_drives();
  void check_inputs(Time now) const;
  void update_course(double h);
  void write_outputs(double h, const Point& end);
  void write_warning();
  bool uses_cvode() const { return cvode_ != nullptr; }

  std::string place_;                 // for messages
  std::vector<std::size_t> passive_;  // joints without a motor
  std::size_t n_;
  JointMeasures measures_;
  Equations equations_;
  Integrator integrator_;
  Partials partials_;
  std::unique_ptr<CvodeSolver> cvode_;

  Parameters wanted_;                                // as declared; equations_ has the parameters in force
  std::vector<double> drives_, drives_before_step_;  // the tunables in force, one after the other
  std::vector<double> q0_, dq0_;
  double rtol_ = 0, atol_ = 3e-10, atol_speed_ = 2e-7;
  std::int32_t max_substeps_ = 64, input_order_ = 0, link_order_ = -1;
  std::string sources_, assumed_;

  std::vector<double> tau_m_, dtau_m_, tau_e_, dtau_e_, q_in_, dq_in_;  // inputs
  double takes_loads_ = 1;
  std::vector<double> load_factor_, load_torque_, load_damping_;  // likewise
  std::vector<double> tau_m_before_, tau_e_before_, q_before_, dq_before_;
  std::vector<double> x_, x_before_step_;  // (q | q̇ | θ | θ̇ | z)
  Modes modes_before_step_;
  std::vector<double> bodies_before_step_;
  double tool_changes_ = 0, tool_changes_seen_ = 0;
  double energy_bodies_ = 0;
  Point at_start_;  // of a step in which bodies change
  double proposal_ = 0;
  double transition_ = 0.5;

  std::vector<double> ddq_, tau_J_, tau_f_;  // outputs
  bool with_terms_ = false;
  TorqueTerms terms_;  // outputs with terms=true
  double kinetic_ = 0, potential_ = 0, elastic_ = 0, dissipated_ = 0, work_m_ = 0, work_e_ = 0, power_m_ = 0, power_e_ = 0;
  double work_0_ = 0;
  double error_ = 0, worst_error_ = 0;
  std::int32_t substeps_ = 0, forced_ = 0, events_ = 0, forced_steps_ = 0;
  LimitWatch limits_;
  std::int32_t warned_steps_ = 0;  // those in the text of warning_
  std::size_t warned_limits_ = 0;  // likewise: joints that have passed a limit
  std::string warning_;
};

}  // namespace cotwin::drive_train
