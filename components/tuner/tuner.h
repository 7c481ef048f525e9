#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/identification/identification.h"
#include "models/robot/dynamics.h"

namespace cotwin::tuner {

class Worker;

/// Fits the twin's dynamics parameters to measured joint torques while the twin runs (IV-A4). Every `interval` it estimates,
/// by a particle swarm over physically consistent robots, the parameters that explain the measurements best.
///   τ = Y(q, q̇, q̈) π + B q̈ + τ_f(q̇)         q, q̇, τ pass the same causal filter, which also gives q̈ (CausalFilter)
/// Samples are compressed as they come (QR, constant memory). An estimation runs on a thread of the unit's own, on a copy of
/// the compressed samples. Its estimate goes to the outputs `latency` seconds of simulated time after it started, so results do
/// not depend on the machine. If the thread is not ready by then, the step waits for it (wait=true), or the estimate is adopted
/// as soon as it is ready and counted in `late` (wait=false, for runs on a clock). The outputs feed the tunables `mass`,
/// `first_moment`, `inertia` (and friction) of drive train and compliance, which follow them without a jump.
///
/// A source that does not measure in every step (a robot behind a network) says in the input `t_measured` when it has: the inputs are
/// a new measurement where it has changed since the last step, whatever the tuner's period is. Held values are not samples: the
/// filter goes from one measurement to the next in a straight line, by the difference of `t_measured`. It begins again behind a gap,
/// with `settle` before the next sample. A gap is longer than `bridge`, 2.5 times the interval before (of at most 0.1 s) and two
/// steps of the tuner. After a shorter irregularity there are no samples until the filter has forgotten it.
///
/// A tool that is attached during the run is known or not. The tunables `tool_mass`, `tool_first_moment`, `tool_inertia` are what
/// known tools add to the bodies: their torque is subtracted from the measured one, so that earlier samples remain valid, and
/// they are added to the estimate. After an unknown tool, `restart` changes: the samples and a running estimation are dropped.
/// Samples then begin again after `settle`.
///
/// A snapshot holds the compressed samples, and those of the estimation that runs (save_memory). An estimate is a function of
/// the samples, so a restored tuner repeats the estimation and gets the same bits. With wait=false the machine's speed decides
/// when an estimate is adopted, so the state cannot be restored.
class Tuner final : public Unit {
 public:
  /// The settings that a source of the unit may have.
  static void declare_settings(SettingList& s);
  explicit Tuner(Settings& settings);
  ~Tuner() override;

  void declare(Variables& v) override;
  /// Removes all samples and starts again from the prior. Throws Error for invalid parameters.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void save_memory(std::string& bytes) override;
  /// Throws Error for values and bytes that no tuner saved, and with wait=false.
  void restore_memory(const std::string& bytes) override;
  bool restorable() const override { return wait_; }
  void append_notes(std::vector<std::string>& sentences) const override;

  /// The robot with the last adopted estimate, without known tools; its history names each estimate. After a restore the history starts with the
  /// last estimate before the snapshot.
  const robot::RobotModel& robot() const { return robot_; }

 private:
  using Values = std::vector<double>;

  static constexpr double kEachStep = -1e10;  // s, before any time: the value of t_measured without a connection

  void free_passive_joints();
  bool follow_tools();
  void update_tools();
  void write_bodies();
  void prepare();
  void check_restored();
  bool is_told() const;
  double longest_wait(double h) const;
  bool gather(Time end, double h);
  void start_estimation(Time now);
  void adopt();

  robot::RobotModel prior_, robot_;
  identification::ModelOptions model_;
  bool wait_;
  std::size_t n_;
  std::unique_ptr<Worker> worker_;
  std::unique_ptr<identification::TorqueData> data_;
  identification::CausalFilter filter_;

  Values q_, dq_, tau_;  // inputs
  bool enabled_ = true;
  double t_measured_ = kEachStep;  // s
  double cutoff_ = 10, settle_ = 1, interval_ = 5, latency_ = 1, threshold_ = 0, forgetting_ = 1,
         bridge_ = 0.01;  // parameters
  double prior_weight_ = identification::kPriorWeightOfShortData;
  std::int32_t decimation_ = 5, rounds_ = 200, particles_ = 64, seed_ = 1, least_ = 200;

  Values tool_mass_, tool_first_moment_, tool_inertia_;  // tunables
  double restart_ = 0;
  Values estimate_;               // 10 per body: the last estimate without tools
  Values tools_;                  // 10 per body: the tools in force
  double restarted_ = 0;          // restart_ at the last step
  bool outdated_ = false;         // the running estimation is of samples that were dropped
  robot::RobotModel tool_robot_;  // has the tools as its bodies
  std::unique_ptr<robot::Mechanism> tool_mechanism_;
  std::unique_ptr<robot::Data> tool_data_;
  Eigen::VectorXd tool_tau_;
  bool has_tools_ = false;

  Values least_B_;  // kg.m2, least value of the output B
  Values mass_, first_moment_, inertia_, tau_C_, tau_S_, v_S_, v_R_, sigma2_, tau_0_, B_, rms_, rms_prior_,
      rms_floor_;  // outputs
  double cost_ = 0, condition_ = 0;
  std::int32_t samples_ = 0, tunings_ = 0, late_ = 0, skipped_ = 0, rank_ = 0;
  std::string warning_, log_;

  double gathering_ = 0, measured_ = 0, heard_ = 0, cadence_ = 0, calm_ = 0, fruitless_ = 0;  // s, see the declared states
  std::int32_t measurements_ = 0;
  std::int32_t countdown_ = 0;                        // steps to the next sample
  double next_ = 0, due_ = 0, estimation_start_ = 0;  // s
  bool estimating_ = false, overdue_ = false;
  bool gap_ = false;  // no usable input since the last sample: the filter starts again
};

}  // namespace cotwin::tuner
