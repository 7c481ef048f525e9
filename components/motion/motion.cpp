#include "components/motion/motion.h"

#include <algorithm>
#include <cmath>

#include "models/robot/robot_model.h"
#include "models/support/choice.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::motion {

namespace {

std::vector<trajectory::Axis> axes_of(Settings& settings) {
  if (settings.text("robot").empty()) return trajectory::free_axes(static_cast<std::size_t>(settings.integer("joints", 1)));
  std::vector<trajectory::Axis> axes = trajectory::axes_of(settings.robot(Settings::Masses::kUnused));
  const long long n = static_cast<long long>(axes.size());
  if (const long long joints = settings.integer("joints", n); joints != n) {
    throw Error("unit:motion", "joints=" + std::to_string(joints) + ", but the robot has " + std::to_string(n));
  }
  return axes;
}

AnySource make_source(Settings& settings, const std::vector<trajectory::Axis>& axes) {
  const std::string kind = settings.choice("kind");
  if (kind == "polynomial") return PolynomialSource(settings, axes);
  if (kind == "csv") return RecordingSource(settings, axes);
  return WaypointSource(settings, axes);
}

}  // namespace

void Motion::declare_settings(SettingList& s) {
  s.robot("a name in models/robots, or a path to a URDF file, for the number of joints, their names and their limits", false);
  s.integer("joints", 1, 1, 1000, "number of joints").fallback_rule("the robot's, else 1");
  s.choice("kind", {"waypoints", "polynomial", "csv"}, "source of the motion; csv: a recording");
  declare_source_settings(s);
}

Motion::Motion(Settings& settings) : Motion(settings, axes_of(settings)) {}

Motion::Motion(Settings& settings, std::vector<trajectory::Axis> axes)
    : axes_(std::move(axes)),
      measures_(settings.robot_used().get()),
      source_(make_source(settings, axes_)),
      dq_limit_(axes_.size()),
      ddq_limit_(axes_.size()),
      dddq_limit_(axes_.size()),
      q_d_(axes_.size()),
      dq_d_(axes_.size()),
      ddq_d_(axes_.size()) {}

void Motion::declare(Variables& v) {
  JointVariables joints(v, measures_);
  joints.output("q_d", q_d_, "rad", "desired joint position");
  joints.output("dq_d", dq_d_, "rad/s", "desired joint velocity, the derivative of q_d").derivative_of("q_d");
  joints.output("ddq_d", ddq_d_, "rad/s2", "desired joint acceleration, the derivative of dq_d").derivative_of("dq_d");
  v.output("done", done_, "whether the motion has ended");
  v.output("duration", duration_, "s", "duration of the motion, without repetitions");
  v.output("stretch", stretch_, "1", "factor on all durations: time_scale, increased if limits = stretch requires it");
  v.output("warning", warning_, "warnings of the initialisation; empty: none");
  v.parameter("t_start", t_start_, "s", "start time of the motion; the joints rest before").range(0, 1e9);
  v.parameter("time_scale", time_scale_, "1", "factor on all durations: 2 is half as fast").range(1e-6, 1e6);
  v.parameter("soft_start", soft_start_, "s",
              "duration of the acceleration at the start, before stretching; 0: starts at full rate")
      .range(0, 1e9);
  v.parameter("soft_stop", soft_stop_, "s", "duration of the deceleration at the end, before stretching; 0: stops at once")
      .range(0, 1e9);
  v.parameter("loop", loop_, "after the end: no (rest), repeat, or there_and_back");
  v.parameter("limits", limits_,
              "if joint limits are violated: error, warn, stretch (until velocity, acceleration and jerk meet them) or ignore");
  joints.parameter("dq_limit", dq_limit_, "rad/s", "velocity limit; 0: the robot's").range(0, 1e9);
  joints.parameter("ddq_limit", ddq_limit_, "rad/s2", "acceleration limit; 0: none").range(0, 1e12);
  joints.parameter("dddq_limit", dddq_limit_, "rad/s3", "jerk limit; 0: none").range(0, 1e15);
  std::visit([&](auto& source) { source.declare(v, joints); }, source_);
}

void Motion::initialise(Time start) {
  warning_.clear();
  path_ = std::visit([](auto& source) { return source.path(); }, source_);
  if (const auto* recording = std::get_if<RecordingSource>(&source_)) warning_ = recording->warning();
  looping_ = text::choose<Loop>("motion: loop", loop_,
                                {{"no", Loop::kNo}, {"repeat", Loop::kRepeat}, {"there_and_back", Loop::kThereAndBack}});
  prepare_phase();
  check_ends();
  evaluate_at(start.seconds());
}

StepResult Motion::step(Time now, Duration h) {
  evaluate_at((now + h).seconds());
  return StepResult::kDone;
}

void Motion::prepare_phase() {
  std::vector<trajectory::Axis> axes = axes_;
  for (std::size_t j = 0; j < axes.size(); ++j) {
    if (dq_limit_[j] > 0) axes[j].dq_max = dq_limit_[j];
    if (ddq_limit_[j] > 0) axes[j].ddq_max = ddq_limit_[j];
    if (dddq_limit_[j] > 0) axes[j].dddq_max = dddq_limit_[j];
  }
  const double length = path_.end() - path_.begin();
  stretch_ = time_scale_;
  phase_ = trajectory::Phase(length, stretch_, soft_start_, soft_stop_);
  enum class Reaction { kError, kWarn, kStretch, kIgnore };
  const Reaction reaction = text::choose<Reaction>(
      "motion: limits", limits_,
      {{"error", Reaction::kError}, {"warn", Reaction::kWarn}, {"stretch", Reaction::kStretch}, {"ignore", Reaction::kIgnore}});
  if (reaction == Reaction::kStretch) {
    std::vector<trajectory::Limits> limits;
    for (const trajectory::Axis& axis : axes) limits.push_back({axis.dq_max, axis.ddq_max, axis.dddq_max});
    stretch_ *= std::max(1.0, trajectory::stretch_to(path_, phase_, limits));
    phase_ = trajectory::Phase(length, stretch_, soft_start_, soft_stop_);
  }
  duration_ = phase_.duration();
  if (reaction == Reaction::kIgnore) return;
  const std::string violation = trajectory::limit_violation(path_, phase_, axes);
  if (violation.empty()) return;
  if (reaction != Reaction::kWarn) throw Error("motion", violation);
  warning_ += (warning_.empty() ? "motion: " : "; motion: ") + violation;
}

// A loop must be continuous: compares q and q̇ at both ends, with a tolerance for rounded recordings.
void Motion::check_ends() {
  if (looping_ == Loop::kNo) return;
  const std::size_t n = axes_.size();
  std::vector<double> q0(n), dq0(n), q1(n), dq1(n), ddq(n);
  evaluate(phase_.at(0), q0, dq0, ddq);
  evaluate(phase_.at(duration_), q1, dq1, ddq);
  constexpr double kPosition = 1e-6, kVelocity = 1e-4;  // rad, rad/s
  const auto number = [](double x) { return text::to_text(x, 6); };
  for (std::size_t j = 0; j < n; ++j) {
    if (looping_ == Loop::kThereAndBack) {
      if (std::abs(dq0[j]) <= kVelocity && std::abs(dq1[j]) <= kVelocity) continue;
      throw Error("motion: loop", axes_[j].name + " reverses at speeds of " + number(dq0[j]) + " and " + number(dq1[j]) +
                                      " rad/s, expected rest at both ends (soft_start, soft_stop)");
    }
    if (std::abs(q1[j] - q0[j]) <= kPosition && std::abs(dq1[j] - dq0[j]) <= kVelocity) continue;
    throw Error("motion: loop", axes_[j].name + " starts at " + number(q0[j]) + " rad with " + number(dq0[j]) +
                                    " rad/s and ends at " + number(q1[j]) + " rad with " + number(dq1[j]) +
                                    " rad/s, expected the same, or loop = there_and_back");
  }
}

void Motion::evaluate(const trajectory::Phase::Value& s, std::span<double> q, std::span<double> dq,
                      std::span<double> ddq) const {
  path_.at(std::min(path_.begin() + s.s, path_.end()), q, dq, ddq);
  trajectory::apply_chain_rule(s, dq, ddq);
}

void Motion::evaluate_at(double t) {
  double u = t - t_start_;  // since the start
  double direction = 1;
  if (looping_ == Loop::kRepeat && u > duration_) u = std::fmod(u, duration_);
  if (looping_ == Loop::kThereAndBack && u > duration_) {
    u = std::fmod(u, 2 * duration_);
    if (u > duration_) {
      u = 2 * duration_ - u;
      direction = -1;
    }
  }
  trajectory::Phase::Value s = phase_.at(u);
  s.ds *= direction;  // reversed s(t): odd derivatives change their sign
  evaluate(s, q_d_, dq_d_, ddq_d_);
  done_ = looping_ == Loop::kNo && u >= duration_;
}

}  // namespace cotwin::motion
