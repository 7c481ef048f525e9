#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/anomaly/anomaly.h"
#include "models/identification/torque_data/preparation.h"
#include "models/robot/body_parameters.h"

namespace cotwin::anomaly {

/// Watches a robot for changes while the twin runs (I): measured torques against those of the tuned robot, as models/anomaly/anomaly.h compares
/// them, hundred samples a second behind the causal filter of the tuner. What is found goes to the outputs, to the notes of the run, and through
/// a gateway to whoever listens. Nothing acts on the robot.
///
/// The tunables are the robot as it is known: a tuner feeds them, and known tools change them. Where one changes, the session begins again with a
/// new baseline. An unknown tool is a change that is found.
///
/// Measurements that stay away for longer than `bridge`, and values that are not finite, are a gap: the filter begins again, and blocks do not
/// cross it. With `t_measured`, held values are not measurements.
class Anomaly final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  /// Throws Error for a robot without joints or with more than 64.
  explicit Anomaly(Settings& settings);

  void declare(Variables& v) override;
  /// Throws Error for parameters out of range and bodies that are not physical.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void save_memory(std::string& bytes) override;
  /// Throws Error for bytes that no such unit saved.
  void restore_memory(const std::string& bytes) override;
  void append_notes(std::vector<std::string>& sentences) const override;

 private:
  using Values = std::vector<double>;
  static constexpr double kEachStep = -1e10;  // s, before any time: the value of t_measured without a connection

  void make_watch();
  bool follow_robot();
  void sample(double t, double h);
  void check_robot();
  void write_outputs();

  std::string place_;  // for messages
  robot::RobotModel robot_;
  bool motor_;
  std::size_t n_;
  JointMeasures measures_;
  TorqueModel model_;
  robot::BodyParameters bodies_;
  robot::DriveParameters drives_;  // tunables; those in force are the model's
  std::unique_ptr<Watch> watch_;
  identification::CausalFilter filter_;

  Values q_, dq_, tau_;  // inputs
  bool enabled_ = true;
  double t_measured_ = kEachStep;                         // s
  double cutoff_ = 10, bridge_ = 0.1, baseline_ = 60;     // parameters
  double measured_ = 0, settled_ = 0, since_sample_ = 0;  // states, s
  bool gap_ = true;
  std::int32_t skipped_ = 0;

  std::int32_t comparing_ = 0, count_ = 0, joint_ = 0, hint_ = 0, kind_ = 0;  // outputs
  Values residual_, rms_, samples_, squares_, torque_squares_, changed_;
  std::string warning_;
  double since_ = 0, found_ = 0, size_ = 0, deviation_ = 0, torque_ = 0;
};

}  // namespace cotwin::anomaly
