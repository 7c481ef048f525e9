#include "components/motion/motion.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

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

std::string number(double x) { return text::to_text(x, 6); }

}  // namespace

void Motion::declare_settings(SettingList& s) {
  s.set_first_variables({"q_d", "dq_d", "ddq_d", "done", "duration", "waypoint_t", "waypoint_q", "t_start", "loop", "limits"});
  s.robot("a name in models/robots, or a path to a URDF file, for the number of joints, their names and their limits");
  s.integer("joints", 1, 1, 1000, "number of joints").fallback_rule("the robot's, else 1");
  s.choice("kind", {"waypoints", "polynomial", "csv"}, "source of the motion; csv: a recording");
  declare_source_settings(s);
  s.choice("space", {"joint", "cartesian"}, "whether the source gives the motion of the joints or of a frame in W");
  s.boolean("override", false, "an input slows the motion along its path, down to rest, and lets it go on");
  s.boolean("pose", false, "space=joint: also the pose of the frame as output, by forward kinematics; needs a robot");
  s.text("frame", "", "the frame of the robot whose pose is an output; empty: its end-effector");
  s.choice(
      "from", {"waypoint", "start", "relative"},
      "space=cartesian: where the motion begins; start: at the pose that the robot has at q_start instead of the first "
      "waypoint's; relative: there, and the other waypoints and arcs are given in the frame's axes at the start instead of W");
  JointsOfPoses::declare_settings(s);
}

Motion::Motion(Settings& settings) : Motion(settings, settings.choice("space") == "cartesian") {}

Motion::Motion(Settings& settings, bool cartesian) {
  if (cartesian) {
    if (const std::string kind = settings.choice("kind"); kind != "waypoints") {
      throw Error("unit:motion", "kind=" + kind + " with space=cartesian, expected kind=waypoints");
    }
    poses_.emplace(settings);
    const std::string from = settings.choice("from");
    from_start_ = from != "waypoint";
    relative_ = from == "relative";
    const bool inverse = settings.boolean("inverse");
    if (inverse || from_start_) read_robot(settings, inverse ? "inverse=true" : "from=" + from);
    if (inverse) {
      inverse_.emplace(settings, *settings.robot_used());
      axes_ = trajectory::axes_of(*settings.robot_used());
    }
    if (robot_) q_start_.resize(static_cast<std::size_t>(settings.robot_used()->n()));
  } else {
    axes_ = axes_of(settings);
    source_.emplace(make_source(settings, axes_));
    if (settings.boolean("pose")) read_robot(settings, "pose=true");
  }
  if (settings.boolean("override")) override_.emplace();
  measures_ = JointMeasures(settings.robot_used().get());
  for (std::vector<double>* x : {&dq_limit_, &ddq_limit_, &dddq_limit_, &q_d_, &dq_d_, &ddq_d_}) x->resize(axes_.size());
}

void Motion::read_robot(Settings& settings, const std::string& reason) {
  if (settings.text("robot").empty()) throw Error("unit:motion", reason + " needs a robot, as in robot=lwr4");
  if (settings.robot_used() == nullptr) settings.robot(Settings::Masses::kUnused);
  robot_.emplace(settings, *settings.robot_used());
  frame_ = robot_->frame();
}

void Motion::declare(Variables& v) {
  JointVariables joints(v, measures_);
  if (poses_) pose_d_.declare(v, frame_);
  if (!axes_.empty()) {
    joints.output("q_d", q_d_, "rad", "desired joint position");
    joints.output("dq_d", dq_d_, "rad/s", "desired joint velocity, the derivative of q_d").derivative_of("q_d");
    joints.output("ddq_d", ddq_d_, "rad/s2", "desired joint acceleration, the derivative of dq_d").derivative_of("dq_d");
  }
  timing_.declare(v, warning_);
  if (override_) override_->declare(v);
  if (!axes_.empty()) {
    joints.parameter("dq_limit", dq_limit_, "rad/s", "velocity limit; 0: the robot's").range(0, 1e9);
    joints.parameter("ddq_limit", ddq_limit_, "rad/s2", "acceleration limit; 0: that of the robot, if it has one")
        .range(0, 1e12);
    joints.parameter("dddq_limit", dddq_limit_, "rad/s3", "jerk limit; 0: that of the robot, if it has one").range(0, 1e15);
  }
  if (source_) std::visit([&](auto& source) { source.declare(v, joints); }, *source_);
  if (poses_) poses_->declare(v);
  if (!robot_) return;
  robot_->declare(v);
  if (!poses_) pose_d_.declare(v, frame_);
  if (!q_start_.empty()) {
    joints.parameter("q_start", q_start_, "rad",
                     from_start_ ? "joint positions at the start" : "reference posture, from which the search begins");
  }
  if (!inverse_) return;
  inverse_->declare_parameters(v, from_start_);
  inverse_->declare_outputs(v);
}

void Motion::initialise(Time start) {
  warning_.clear();
  if (robot_) robot_->initialise();
  if (poses_) {
    prepare_poses();
  } else {
    path_ = std::visit([](auto& source) { return source.path(); }, *source_);
    if (const auto* recording = std::get_if<RecordingSource>(&*source_)) warning_ = recording->warning();
  }
  prepare_phase();
  check_ends();
  sign_ = 1;
  if (robot_ && !poses_) {
    evaluate({}, q_d_, dq_d_, ddq_d_);
    const Eigen::Map<const Eigen::VectorXd> q(q_d_.data(), static_cast<Eigen::Index>(q_d_.size()));
    if ((robot_->Q_WB() * robot_->kinematics().at(q, q, q).Q).w() < 0) sign_ = -1;
  }
  ddq_most_.clear();
  for (const trajectory::Axis& axis : limited_axes()) ddq_most_.push_back(axis.ddq_max);
  if (override_) override_->begin();
  evaluate_at(start.seconds());
}

StepResult Motion::step(Time now, Duration h) {
  if (override_) {
    override_->advance(h.seconds(), [&](double delay, double rate) { return allowed((now + h).seconds() - delay, rate); });
  }
  evaluate_at((now + h).seconds());
  return StepResult::kDone;
}

void Motion::prepare_poses() {
  trajectory::PoseMotion start;
  const Eigen::Map<const Eigen::VectorXd> q(q_start_.data(), static_cast<Eigen::Index>(q_start_.size()));
  if (!q.allFinite()) throw Error("motion.q_start", "is not finite, expected joint positions");
  if (from_start_) {
    const robot::FrameMotion m = robot_->kinematics().at(q, q, q);
    const Eigen::Quaterniond Q = robot_->Q_WB() * m.Q;
    start.p = robot_->p_WB() + robot_->Q_WB() * m.p;
    start.Q << Q.w(), Q.vec();
  }
  pose_path_ = poses_->path(from_start_ ? &start : nullptr, relative_);
  closed_sign_ = pose_path_.at(pose_path_.begin()).Q.dot(pose_path_.at(pose_path_.end()).Q);
  if (inverse_) {
    inverse_->prepare(pose_path_, *robot_, q_start_, from_start_, warning_);
    path_ = inverse_->table();
  }
  pose_peaks_ = poses_->limits() == trajectory::PoseLimits{} ? trajectory::PosePeaks{} : trajectory::find_peaks(pose_path_);
}

double Motion::stretch_needed() const {
  double factor = 1;
  if (poses_) factor = std::max(factor, trajectory::stretch_to(pose_peaks_, timing_.phase(), poses_->limits()));
  if (axes_.empty()) return factor;
  std::vector<trajectory::Limits> limits;
  for (const trajectory::Axis& axis : limited_axes()) limits.push_back({axis.dq_max, axis.ddq_max, axis.dddq_max});
  return std::max(factor, trajectory::stretch_to(path_, timing_.phase(), limits));
}

std::vector<trajectory::Axis> Motion::limited_axes() const {
  std::vector<trajectory::Axis> axes = axes_;
  for (std::size_t j = 0; j < axes.size(); ++j) {
    if (dq_limit_[j] > 0) axes[j].dq_max = dq_limit_[j];
    if (ddq_limit_[j] > 0) axes[j].ddq_max = ddq_limit_[j];
    if (dddq_limit_[j] > 0) axes[j].dddq_max = dddq_limit_[j];
  }
  return axes;
}

std::string Motion::violation() const {
  std::string found;
  if (!axes_.empty()) found = trajectory::limit_violation(path_, timing_.phase(), limited_axes());
  if (poses_ && found.empty()) {
    found = trajectory::limit_violation(pose_peaks_, pose_path_, timing_.phase(), poses_->limits());
  }
  return found;
}

void Motion::prepare_phase() {
  using Reaction = Timing::Reaction;
  timing_.prepare(poses_ ? pose_path_.end() - pose_path_.begin() : path_.end() - path_.begin());
  if (timing_.reaction() == Reaction::kStretch) timing_.stretch_by(stretch_needed());
  if (timing_.reaction() == Reaction::kIgnore) return;
  const std::string found = violation();
  if (found.empty()) return;
  if (timing_.reaction() != Reaction::kWarn) throw Error("motion", found);
  warning_ += (warning_.empty() ? "motion: " : "; motion: ") + found;
}

// A loop must be continuous: compares q and q̇, or pose and twist, at both ends, with a tolerance for rounded recordings.
void Motion::check_ends() {
  if (timing_.loop() == Timing::Loop::kNo) return;
  if (poses_) check_pose_ends();
  const std::size_t n = axes_.size();
  std::vector<double> q0(n), dq0(n), q1(n), dq1(n), ddq(n);
  if (n == 0) return;
  const trajectory::Phase& phase = timing_.phase();
  evaluate(phase.at(0), q0, dq0, ddq);
  evaluate(phase.at(phase.duration()), q1, dq1, ddq);
  constexpr double kPosition = 1e-6, kVelocity = 1e-4;  // rad, rad/s
  for (std::size_t j = 0; j < n; ++j) {
    if (timing_.loop() == Timing::Loop::kThereAndBack) {
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

// A path of poses rests at both ends.
void Motion::check_pose_ends() const {
  if (timing_.loop() != Timing::Loop::kRepeat) return;
  const trajectory::PoseMotion a = pose_path_.at(pose_path_.begin()), b = pose_path_.at(pose_path_.end());
  const double distance = (b.p - a.p).norm(), angle = trajectory::shortest_rotation(a.Q, b.Q).norm();
  constexpr double kDistance = 1e-6, kAngle = 1e-6;  // m, rad
  if (distance <= kDistance && angle <= kAngle) return;
  throw Error("motion: loop", "the pose at the end is " + number(distance) + " m and " + number(angle) +
                                  " rad from that at the start, expected the same, or loop = there_and_back");
}

void Motion::evaluate(const trajectory::Phase::Value& s, std::span<double> q, std::span<double> dq, std::span<double> ddq) {
  const double t = std::min(path_.begin() + s.s, path_.end());
  inverse_ ? inverse_->at(t, q, dq, ddq) : path_.at(t, q, dq, ddq);
  trajectory::apply_chain_rule(s, dq, ddq);
}

/// |q̈ r² + q̇ ṙ| ≤ the limit of each joint, with the planned q̇ and q̈ at path time t. Where q̈ r² alone is beyond it, ṙ = 0 is still allowed.
Override::Range Motion::allowed(double t, double rate) {
  constexpr double kFastest = 1e12;  // 1/s
  Override::Range range{-kFastest, kFastest};
  if (std::ranges::none_of(ddq_most_, [](double most) { return most < kFastest; })) return range;
  evaluate(timing_.at(t).s, q_d_, dq_d_, ddq_d_);
  for (std::size_t j = 0; j < ddq_most_.size(); ++j) {
    const double planned = ddq_d_[j] * rate * rate, most = std::max(ddq_most_[j], std::abs(planned)),
                 speed = std::abs(dq_d_[j]);
    if (!(speed > 0)) continue;
    const double with_speed = std::copysign(planned, planned * dq_d_[j]);
    range.low = std::max(range.low, std::min(0.0, (-most - with_speed) / speed));
    range.high = std::min(range.high, std::max(0.0, (most - with_speed) / speed));
  }
  return range;
}

void Motion::evaluate_at(double t) {
  Timing::Instant instant = timing_.at(override_ ? t - override_->delay() : t);
  if (override_) instant.s = override_->slowed(instant.s);
  if (!axes_.empty()) evaluate(instant.s, q_d_, dq_d_, ddq_d_);
  if (poses_) {
    const double sign = instant.odd_repetition && closed_sign_ < 0 ? -1 : 1;
    pose_d_.set(pose_path_.at(std::min(pose_path_.begin() + instant.s.s, pose_path_.end())), instant.s, sign);
  } else if (robot_) {
    using Vector = Eigen::Map<const Eigen::VectorXd>;
    const auto n = static_cast<Eigen::Index>(axes_.size());
    const robot::FrameMotion m =
        robot_->kinematics().at(Vector(q_d_.data(), n), Vector(dq_d_.data(), n), Vector(ddq_d_.data(), n));
    pose_d_.set(m, robot_->p_WB(), robot_->Q_WB(), sign_);
  }
}

}  // namespace cotwin::motion
