#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "models/anomaly/attribution.h"
#include "models/anomaly/cusum.h"
#include "models/anomaly/event.h"
#include "models/anomaly/whitening.h"
#include "models/foundation/support/bytes.h"

/// Has a robot changed since the beginning of a session? Residuals r = τ − τ̂ of measured and modelled torques, in blocks of half a second.
namespace cotwin::anomaly {

struct WatchOptions {
  double baseline = 60;  // s of motion at the beginning of the session, with which the rest is compared
};

/// Mean time between false alarms of the whole robot, were the blocks independent and normal, h.
inline constexpr double kFalseAlarm = 240;
inline constexpr double kBlock = 0.5;       // s
inline constexpr double kLeastBlocks = 10;  // of a baseline, that tell something about a cause

/// Compares a session with its own beginning. Per cause k (TorqueModel) and block the score of its matched filter, over joints i with deviations
/// σ_i of the beginning, and its CUSUM:
///   s = Σ φ_ik (r_i − β_i·x)/σ_i²    I = Σ φ_ik²/σ_i²    d = s − θ_0 I    z = d / √(v (I + 0.3 Ī))
/// β_i, the friction of the day (x = 1, tanh(q̇/0.02), q̇, |q̇| q̇), θ_0, v, Ī and the autoregression of z come from the baseline. So a block in which a cause could not show says nothing. The reference value
/// of the CUSUM is that of half the least change, at least 0.5, and grows with the uncertainty of θ_0. Per joint the same for ln Σ r², the
/// spread, and a limit for single values: 3 times the largest of the baseline.
///
/// Not judged are: joints with friction at rest (slower than 0.05 rad/s), where friction is anything; torques at their limit; motions 1.3 times as
/// fast or accelerated as any of the baseline; passive joints; causes that fewer than 10 blocks of the baseline tell something about.
///
/// A change is told as soon as its size is 5 times its deviation, or if it is 3 times 5 s after the alarm; its size is estimated again at that time.
/// Then a new baseline begins: what follows is compared with the robot as it is now. A blow that is over by then needs none.
class Watch {
 public:
  /// `robot`: its limits and joints. Throws Error for more than 32 joints.
  Watch(const robot::RobotModel& robot, const TorqueModel& model, bool motor, const WatchOptions& options);

  /// The robot was changed on purpose: a new baseline. Events are kept.
  void restart();
  /// The next sample, at t, `h` s after the one before; 0: there is none, or a gap between. Values must be finite. `model` must be evaluated at it.
  void add(double t, double h, const double* dq, const double* ddq, const double* tau);

  /// Ends the baseline early; false if it is too short. Takes longer than a step of a run may.
  bool finish();
  /// The baseline is long enough, and complete after some more samples, or with finish().
  bool due() const { return preparing_ != 0; }

  bool ready() const { return ready_ != 0; }       // the baseline is complete
  double baselines() const { return baselines_; }  // that were completed
  std::span<const Event> events() const { return events_; }
  const Event& latest() const { return last_; }                     // of them
  static constexpr std::size_t kMostJoints = 32, kMostEvents = 64;  // of which the first are kept
  double count() const { return found_; }                           // of all events
  double motion() const { return moving_; }                         // s in which at least one joint could be judged
  double outside() const { return outside_; }                       // s of motions beyond the baseline's
  double resting(std::size_t j) const { return resting_[j]; }       // s, of joint j,
  double saturated(std::size_t j) const { return saturated_[j]; }   // and at its limit of torque
  double compared(std::size_t j) const { return compared_[j]; }     // with a baseline
  /// Whether a sample of joint j says something: it moves, if friction could hold it, and its torque is below the limit.
  bool judges_now(std::size_t j, double dq, double tau) const;
  bool judges(int cause) const { return charts_[static_cast<std::size_t>(cause)].ready != 0; }

  /// All that add() changes.
  void write(ByteWriter& out) const;
  /// Throws Error for what no watch of the same robot and options wrote.
  void read(ByteReader& in);

 private:
  /// Of one cause, or of the spread of one joint.
  struct Chart {
    double ready = 0, theta = 0, information = 0, scale = 1, rho = 0, limit = 0, dead = 0, doubt = 0, before = 0, follows = 0;
    Cusum sum;
  };
  struct Score {
    double d = 0, information = 0;
  };

  bool rests(std::size_t j, double dq) const {
    return std::abs(dq) < slow_[j] && (motor_ || model_.has_friction(static_cast<int>(j)));
  }
  void fit(std::size_t j, std::size_t blocks);
  void learn(int k, std::size_t blocks);
  double learnt() const;  // causes with a chart
  void limit(Chart& chart, double usual) const;
  void standardise(int k, std::size_t blocks);
  void learn_spread(std::size_t j, std::size_t blocks);
  void prepare();
  double* block(std::size_t k) { return blocks_.data() + k % capacity_ * width_; }
  std::size_t term(int k, std::size_t i) const;
  /// Calls take(i) for each joint i whose torque cause k changes.
  template <class Take>
  void each_joint(int k, Take&& take) const {
    const Cause cause = model_.cause(k);
    if (cause == Cause::kFriction || cause == Cause::kContact) return take(static_cast<std::size_t>(model_.joint(k)));
    for (std::size_t i = 0; i < n_; ++i) take(i);
  }
  Score score(const double* block, int k) const;
  double spread(const double* block, std::size_t j) const;
  bool tells(const double* block, std::size_t j) const;
  void close_block(double t);
  bool advance(Chart& chart, double z, double information);
  void watch(double t);
  template <class Take>
  void over_window(Take&& take) const;
  double squares_of(const double* block, std::size_t j) const;
  Score squares(std::size_t j) const;
  double explain(Event& event);
  void describe_spread(Event& event) const;
  bool sure(const Event& event, double times) const;
  void tell(const Event& event);
  void conclude(double t);
  template <class Self, class Visit>
  static void visit(Self& self, Visit&& visit);

  const TorqueModel& model_;
  bool motor_;
  std::size_t n_, causes_, width_, capacity_;
  std::vector<double> limit_, floor_;  // N.m per joint: of torque, or infinity; least deviation
  std::vector<char> passive_;
  std::vector<double> slow_, sign_;  // rad/s: of rest, and over which friction changes its sign
  std::vector<double> x_;            // scratch

  // State.
  std::vector<double> blocks_;                      // the last `capacity_`
  std::vector<double> open_;                        // the one that grows
  std::vector<double> fastest_, steepest_;          // of the baseline
  std::vector<double> beta_;                        // of the baseline: kFits coefficients per joint,
  std::vector<double> sigma_, peak_, mean_spread_;  // per joint
  std::vector<double> resting_, saturated_, compared_;
  std::vector<Chart> charts_;  // causes, then spreads of joints
  std::vector<Event> events_;
  Event pending_, last_;  // that is being estimated; that was told last
  double ready_ = 0, baselines_ = 0, closed_ = 0, elapsed_ = 0, useful_ = 0, moving_ = 0, outside_ = 0, found_ = 0, hold_ = 0,
         from_ = 0, told_ = 0, preparing_ = 0, pooled_ = 0;
};

}  // namespace cotwin::anomaly
