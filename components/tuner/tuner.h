#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/identification/identification.h"

namespace cotwin::tuner {

/// Brings the twin's joint torques to the measured ones while it runs (IV-A4): gathers q, q̇ and τ of the robot, and every
/// `interval` seeks the dynamics parameters that explain them best, by a particle swarm over physically consistent robots.
///   τ = Y(q, q̇, q̈) π + B q̈ + τ_f(q̇)         q, q̇, τ through one causal filter, of which q̈ comes (CausalFilter)
/// Samples are compressed as they come (QR, constant memory); the swarm runs on a thread of the unit's own. What a tuning finds
/// comes to the outputs `latency` seconds of simulated time after its data ended, no sooner and no later: so results do not
/// depend on the machine. If the thread is not ready by then the step waits for it (wait=true), or takes the result as soon as
/// it is there and counts that in `late` (wait=false, for runs on a clock). Outputs feed the tunables `mass`, `first_moment`,
/// `inertia` (and friction) of drive train and compliance, which follow them without a jump.
///
/// What it remembers are the compressed samples, those of an incomplete block, and while it seeks the compressed samples that
/// it seeks with: a finding is a function of these, so a restored tuner seeks once more and finds the same bits. Only with
/// wait=false the machine's speed decides when a finding is adopted, so that such a tuner cannot be taken back; its texts are
/// empty.
class Tuner final : public Unit {
 public:
  /// What may be chosen by the source of the unit; cotwin describe shows it.
  static void declare_settings(SettingList& s);
  explicit Tuner(Settings& settings);
  ~Tuner() override;

  void declare(Variables& v) override;
  /// Forgets everything and starts afresh. Throws Error for parameters without meaning.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  /// Throws Error for states that no tuner wrote, and with wait=false.
  void restored() override;
  bool restorable() const override { return wait_; }

  /// The robot as the last adopted tuning left it, with each tuning in its history; after a snapshot was restored, the history
  /// begins with the last one before.
  const robot::RobotModel& robot() const { return robot_; }

 private:
  class Worker;
  using Values = std::vector<double>;

  void prepare();
  void clear_texts();
  void check_restored();
  bool gather(double h);
  void take_sample();
  void store();
  void load();
  void seek(Time now);
  void adopt();

  robot::RobotModel prior_, robot_;
  identification::ModelOptions model_;
  bool wait_;
  std::size_t n_;
  std::unique_ptr<Worker> worker_;
  std::unique_ptr<identification::TorqueData> data_;
  identification::CausalFilter filter_;
  Values numbers_, sample_;  // scratch: of data_, and of one sample

  Values q_, dq_, tau_;  // inputs
  bool enabled_ = true;
  double cutoff_ = 10, settle_ = 1, interval_ = 5, latency_ = 1, prior_weight_ = 0.1, threshold_ = 0,
         forgetting_ = 1;  // parameters
  std::int32_t decimation_ = 5, rounds_ = 200, particles_ = 64, seed_ = 1, least_ = 200;

  Values least_B_;  // kg.m2, what is told where B was found to be none
  Values mass_, first_moment_, inertia_, tau_C_, tau_S_, v_S_, v_R_, sigma2_, tau_0_, B_, rms_, rms_prior_,
      rms_floor_;  // outputs
  double cost_ = 0, condition_ = 0;
  std::int32_t samples_ = 0, tunings_ = 0, late_ = 0, skipped_ = 0, rank_ = 0;
  std::string warning_, log_;

  double gathering_ = 0;                   // s since enabled and settled
  std::int32_t countdown_ = 0;             // steps to the next sample
  double next_ = 0, due_ = 0, asked_ = 0;  // s, of the next tuning, of the end of the one that is sought, and of its beginning
  bool seeking_ = false, overdue_ = false;
  bool gap_ = false;                         // nothing usable since the last sample: the filter begins anew
  std::int32_t pending_samples_ = 0;         // of an incomplete block
  std::string gathered_, pending_, sought_;  // memory.h: data_; the pending samples; data_ as they were when the search began
};

}  // namespace cotwin::tuner
