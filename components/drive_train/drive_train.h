#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/partials.h"
#include "components/drive_train/rosenbrock.h"
#include "components/drive_train/sundials_solver.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::drive_train {

/// The flexible-joint drive train, and with the link side inside the whole robot, for n joints, all quantities seen behind the
/// gear:
///   M(q) q̈ + C(q, q̇) q̇ + g(q) + τ_l(q̇) + τ_s(q, q̇) = τ_J + τ_e   (2a)   link=inside; outside, q and q̇ are inputs
///   B θ̈ + τ_J = τ_m − τ_f                                          (2b)
///   τ_J = K d(θ − q) + D (θ̇ − q̇)                                   (2c)
/// Beyond the paper: D, joint damping; d, the gear's backlash (d(φ) = φ without); τ_l, friction behind the torque sensor; τ_s,
/// hard stops and springs beside the link (spring_sin, spring_cos). τ_f is LuGre friction, an elasto-plastic bristle, Coulomb
/// friction that sticks exactly, or the static curve that `cotwin tune` identifies (smooth: no presliding, no sticking; all in
/// models/robot/friction.h). Friction of the link may grow with the load: link_load times the torque of gravity.
/// transmission=rigid sets θ = q and adds (2b) to (2a); τ_J is what (2b) leaves for the link. Not in here: motor currents,
/// temperature.
///
/// The bodies, B and friction (but for the bristle's stiffness, damping and shape) may be changed while the robot moves
/// (method=rosenbrock); what is in force follows smoothly, so nothing jumps.
class DriveTrain final : public Unit {
 public:
  /// What may be chosen by the source of the unit; cotwin describe shows it.
  static void declare_settings(SettingList& s);
  explicit DriveTrain(Settings& settings);
  ~DriveTrain() override;
  void declare(Variables& variables) override;
  void initialise(Time start) override;
  /// Throws Error if an input is not finite. Discards, with its variables as they were, if the state would not be finite or
  /// SUNDIALS gives up.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  std::span<const Partial> partials() const override { return partials_.list(); }
  void evaluate_partials(std::span<double> values) override;

 private:
  struct Kind;
  DriveTrain(Settings& settings, const Kind& kind);
  void declare_parameters(Variables& variables);
  void check_parameters() const;
  std::span<double> drive(std::size_t k) { return {drives_.data() + k * n_, n_}; }
  void take_drives();
  bool follow_drives(double remaining);
  void adopt_drives();
  void check_inputs(Time now) const;
  void take_course(double h);
  void write_outputs(double h, const Point& end);
  bool uses_sundials() const { return sundials_ != nullptr; }

  std::string place_;  // for messages
  std::size_t n_;
  Equations equations_;
  Rosenbrock rosenbrock_;
  Partials partials_;
  std::unique_ptr<SundialsSolver> sundials_;

  Parameters wanted_;                                // as declared; what is in force is the equations'
  std::vector<double> drives_, drives_before_step_;  // in force, of those that may change
  std::vector<double> q0_, dq0_;
  double rtol_ = 0, atol_ = 3e-10, atol_speed_ = 2e-7;
  std::int32_t max_substeps_ = 64, input_order_ = 0, link_order_ = -1;

  std::vector<double> tau_m_, dtau_m_, tau_e_, dtau_e_, q_in_, dq_in_;  // inputs
  std::vector<double> tau_m_before_, tau_e_before_, q_before_, dq_before_;
  std::vector<double> x_, x_before_step_;  // (q | q̇ | θ | θ̇ | z)
  Modes modes_before_step_;
  std::vector<double> bodies_before_step_;
  double proposal_ = 0;
  double transition_ = 0.5;

  std::vector<double> ddq_, tau_J_, tau_f_;  // outputs
  double kinetic_ = 0, potential_ = 0, elastic_ = 0, dissipated_ = 0, work_m_ = 0, work_e_ = 0, power_m_ = 0, power_e_ = 0;
  double work_0_ = 0;
  double error_ = 0;
  std::int32_t substeps_ = 0, forced_ = 0, events_ = 0;
  std::string warning_;
};

}  // namespace cotwin::drive_train
