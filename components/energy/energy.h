#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/energetics/books.h"

namespace cotwin::energy {

/// What a run costs (V-B, VI-G): the books of models/energetics/books.h from the signals of a drive train. Nothing acts on the robot.
///
/// Over a step, τ_m is held or a ramp as in the drive train, and θ the cubic through θ and θ̇ at both ends, so that ∫ τ_m θ̇ dt is the drive
/// train's work_m: to rounding for a held torque, else to the fourth order of its sub-steps. With books=true the difference of work_m is
/// the work, and the difference to the joints' work is booked with the first joint.
///
/// Servo: after `servo_off_after` seconds at rest and `t_close` more the brakes hold the robot: P_off in place of P_0 + P_brake, no
/// currents. The first motion after that costs E_release. The motors hold for `t_release` while the brakes open; the unit learns of a motion
/// when it begins, so what they took in the last t_release seconds before it beyond P_off is booked in as many seconds after it.
class Energy final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  explicit Energy(Settings& settings);

  void declare(Variables& v) override;
  /// Throws Error for parameters out of range and an unknown name in `assumed`.
  void initialise(Time start) override;
  /// Throws Error for inputs and tunables that are not finite or out of range.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void append_notes(std::vector<std::string>& sentences) const override;

 private:
  using Joints = std::vector<double>;

  /// Energies that the drive train reports, with books=true.
  struct DriveBooks {
    double work_m = 0, work_e = 0, work_0 = 0, kinetic = 0, potential = 0, elastic = 0, dissipated = 0, bodies = 0;
    double inner() const { return kinetic + potential + elastic; }
  };

  Energy(Settings& settings, const robot::RobotModel* robot);
  void declare_drives(Variables& v, JointVariables& joints);
  void check() const;
  void adopt_drives();
  void write_nodes(double h);
  double idle_power(double h);
  void write_outputs(double h, double drawn_before);
  void write_warning();

  std::string place_;  // for messages
  JointMeasures measures_;
  std::size_t n_;
  bool measured_, with_books_;
  std::vector<bool> passive_;  // joints without a motor
  energetics::Accountant accountant_;

  // Inputs.
  Joints tau_m_, dtau_m_, theta_, dtheta_, i_;
  DriveBooks drive_;
  // Parameters and tunables.
  energetics::Standby standby_;
  double V_start_ = 0, servo_off_after_ = 0, rest_speed_ = 1e-3;
  std::int32_t input_order_ = 0;
  std::string current_ = "rms", sources_, assumed_ = "all";
  // States.
  Joints tau_before_, theta_before_, dtheta_before_, i_before_;
  DriveBooks drive_before_, drive_start_;
  double rest_ = 0;           // s
  double opening_ = 0;        // s of the brakes' opening that are still to be booked
  double opening_power_ = 0;  // W, what the opening takes beyond P_off
  double unexplained_ = 0;    // J, Σ |work_m − joints' work|
  double moved_ = 0;          // J, Σ |work_m|
  // Outputs.
  energetics::EnergyBooks books_;
  double V_ = 0, power_ = 0, cost_ = 0, co2_ = 0, friction_ = 0, residual_ = 0;
  std::int32_t servo_ = 1, warned_ = 0;
  std::string warning_;
};

}  // namespace cotwin::energy
