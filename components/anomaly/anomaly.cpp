#include "components/anomaly/anomaly.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "models/anomaly/maturity.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::anomaly {

namespace {

constexpr const char* kOther =
    "the torques are not those of this robot: another one, other units or signs, or friction that is missing";
constexpr double kPeriod = 0.01;   // s between samples
constexpr double kSettle = 200;    // samples, after which it is told that the torques are another robot's
constexpr double kForgotten = 10;  // delays of the filter, after which nothing before a gap is left in it

bool all_finite(const std::vector<double>& v) {
  return std::ranges::all_of(v, [](double x) { return std::isfinite(x); });
}

}  // namespace

void Anomaly::declare_settings(SettingList& s) {
  s.set_first_variables(
      {"q", "dq", "tau", "residual", "rms", "comparing", "event_count", "event_joint", "event_hint", "event_size"});
  s.robot("the robot as it was tuned: a name in models/robots, or a path to a URDF file").required();
  s.choice("torques", {"motor", "joint"}, "where they are measured: at the motors, times the gear ratio, or behind the gears");
}

Anomaly::Anomaly(Settings& settings)
    : place_(settings.unit()),
      robot_(settings.robot()),
      motor_(settings.choice("torques") == "motor"),
      n_(robot_.joints.size()),
      measures_(&robot_),
      model_(robot_, motor_),
      bodies_(robot_),
      drives_(model_.drives),
      filter_(n_, 10) {
  if (n_ == 0) throw Error(place_, "robot '" + robot_.name + "' has no movable joint, expected at least one");
  for (Values* v : {&q_, &dq_, &tau_, &residual_, &rms_, &samples_, &squares_, &torque_squares_, &changed_}) v->assign(n_, 0.0);
  make_watch();
}

void Anomaly::make_watch() {
  WatchOptions options;
  options.baseline = baseline_;
  watch_ = std::make_unique<Watch>(robot_, model_, motor_, options);
}

void Anomaly::declare(Variables& v) {
  JointVariables joints(v, measures_);
  joints.input("q", q_, "rad", "measured joint position").essential();
  joints.input("dq", dq_, "rad/s", "measured joint speed").essential();
  joints.input("tau", tau_, "N.m", "measured joint torque, gravity's included").essential();
  v.input("enabled", enabled_, "whether measurements are taken; without a connection: true");
  v.input("t_measured", t_measured_, "s",
          "time at which q, dq and tau were measured, by any clock: unchanged means held; without a connection: measured in "
          "each step");

  joints.output("residual", residual_, "N.m", "filtered torque less that of the robot, of the last sample");
  joints.output("rms", rms_, "N.m", "its RMS in motion, since the robot was last changed on purpose");
  v.output("changed_since", changed_, "s", "per joint: time since which it has changed; -1: no change was found");
  v.output("comparing", comparing_,
           "0: the baseline is being taken, or nothing is measured; 1: what is measured is compared with it");
  v.output("event_count", count_, "changes that were found");
  v.output("event_joint", joint_, "of the last one: the joint that shows it most, from 1; 0: there was none");
  v.output("event_hint", hint_, "its cause: 1 load, 2 friction, 3 contact, 4 encoder");
  v.output("event_kind", kind_, "1 a lasting change, 2 residuals scatter more, 3 a blow");
  v.output("event_since", since_, "s", "when it began");
  v.output("event_t", found_, "s", "when it was found");
  v.output(
      "event_size", size_, "1",
      "load: kg; friction: share of that of the joint, or N.m where it has none; contact: N.m; encoder: rad; scatter: factor");
  v.output("event_deviation", deviation_, "1", "standard deviation of event_size");
  v.output("event_torque", torque_, "N.m", "its torque at event_joint: RMS, of a blow the largest");

  v.parameter("cutoff", cutoff_, "Hz", "cutoff of the critically damped filter of q, dq and tau").range(1e-3, 1e4);
  v.parameter("bridge", bridge_, "s", "longest time without a measurement that is not a gap").range(1e-6, 10);
  v.parameter("baseline", baseline_, "s", "of motion, with which what follows is compared").range(kLeastBlocks * kBlock, 1e5);
  for (const auto& row : robot::kDriveParameters) joints.parameter(drives_, row);
  declare_bodies(v, bodies_, true);

  v.state("filter", filter_.state(), "1", "inputs before, filtered values and their rates of q, dq and tau");
  v.state("measured", measured_, "s", "t_measured of the last measurement");
  v.state("settled", settled_, "s", "time since the last gap");
  v.state("since_sample", since_sample_, "s", "time since the last sample");
  v.state("samples", samples_, "1", "in rms, per joint");
  v.state("gap", gap_, "whether the filter begins again with the next measurement");
  joints.state("squares", squares_, "1", "sum of the squared residuals in rms");
  joints.state("torque_squares", torque_squares_, "1", "the same of the measured torques");
  v.output("warning", warning_, "what the user should know; empty if nothing");
  v.output("skipped", skipped_, "measurements that were not finite");
}

void Anomaly::initialise(Time) {
  filter_.set_cutoff(cutoff_);
  make_watch();
  check_values(drives_, robot::kDriveParameters, place_);
  model_.drives = drives_;
  bodies_.take(place_, model_.mechanism());
  model_.update();
  std::ranges::fill(filter_.state(), 0.0);
  filter_.restored();
  measured_ = std::isfinite(t_measured_) ? t_measured_ : 0;
  settled_ = since_sample_ = 0;
  gap_ = true;
  skipped_ = 0;
  warning_.reserve(std::string_view(kOther).size());
  warning_.clear();
  for (Values* v : {&residual_, &rms_, &samples_, &squares_, &torque_squares_}) std::ranges::fill(*v, 0.0);
  write_outputs();
}

/// Takes tunables that have changed. Returns whether any has.
bool Anomaly::follow_robot() {
  const bool drives = !same(model_.drives, drives_, robot::kDriveParameters),
             bodies = bodies_.follow(place_, 0, model_.mechanism());
  if (!drives && !bodies) return false;
  check_values(drives_, robot::kDriveParameters, place_);
  for (const auto& row : robot::kDriveParameters) std::ranges::copy(drives_.*row.values, (model_.drives.*row.values).begin());
  model_.update();
  watch_->restart();
  for (Values* v : {&samples_, &squares_, &torque_squares_}) std::ranges::fill(*v, 0.0);
  return true;
}

StepResult Anomaly::step(Time now, Duration h) {
  const double end = (now + h).seconds();
  if (follow_robot()) gap_ = true;  // the filter still has the torque before the change
  const bool told = t_measured_ != kEachStep;
  if (enabled_ && !(told && t_measured_ == measured_)) {
    double interval = h.seconds();
    bool usable = all_finite(q_) && all_finite(dq_) && all_finite(tau_);
    if (told) {
      usable = usable && std::isfinite(t_measured_);
      interval = t_measured_ - measured_;
      if (std::isfinite(t_measured_)) measured_ = t_measured_;
    }
    if (!(interval > 0 && interval <= std::max(bridge_, 2 * h.seconds()))) gap_ = true;
    if (usable && !gap_) {
      filter_.step(interval, q_, dq_, tau_);
      usable = std::ranges::all_of(filter_.state(), [](double x) { return std::isfinite(x); });  // huge values may overflow
    }
    if (!usable) {
      gap_ = true;
      skipped_ = std::min(skipped_, std::numeric_limits<std::int32_t>::max() - 1) + 1;
      std::ranges::fill(filter_.state(), 0.0);
    } else if (std::exchange(gap_, false)) {
      filter_.reset(q_, dq_, tau_);
      settled_ = since_sample_ = 0;
      watch_->add(end, 0, nullptr, nullptr, nullptr);
    } else if ((settled_ += interval) > kForgotten * filter_.delay()) {
      since_sample_ += interval;
      if (since_sample_ > kPeriod * (1 - 1e-6)) sample(end, std::exchange(since_sample_, 0));
    }
  } else if (!enabled_) {
    gap_ = true;
  }
  write_outputs();
  return StepResult::kDone;
}

void Anomaly::sample(double t, double h) {
  model_.evaluate(filter_.q().data(), filter_.dq().data(), filter_.ddq().data());
  for (std::size_t j = 0; j < n_; ++j) {
    residual_[j] = robot_.joints[j].passive ? 0 : filter_.tau()[j] - model_.tau()[static_cast<Eigen::Index>(j)];
    if (!watch_->judges_now(j, filter_.dq()[j], filter_.tau()[j])) continue;
    samples_[j] += 1;
    squares_[j] += residual_[j] * residual_[j];
    torque_squares_[j] += filter_.tau()[j] * filter_.tau()[j];
    rms_[j] = std::sqrt(squares_[j] / samples_[j]);
  }
  watch_->add(t, h, filter_.dq().data(), filter_.ddq().data(), filter_.tau().data());
  if (warning_.empty()) check_robot();
}

/// Tells it at once if the model does not render the torques of half of the joints that move.
void Anomaly::check_robot() {
  std::size_t moving = 0, off = 0;
  for (std::size_t j = 0; j < n_; ++j) {
    if (samples_[j] < kSettle) continue;
    ++moving;
    off += beyond(rms_[j], std::sqrt(torque_squares_[j] / samples_[j]), robot_.joints[j].tau_max) ? 1 : 0;
  }
  if (off > 0 && 2 * off >= moving) warning_.assign(kOther);
}

void Anomaly::write_outputs() {
  comparing_ = watch_->ready() ? 1 : 0;
  count_ = static_cast<std::int32_t>(std::min(watch_->count(), 2e9));
  std::ranges::fill(changed_, -1.0);
  for (const Event& event : watch_->events()) {
    for (std::size_t j = 0; j < n_; ++j)
      if (event.concerns(j)) changed_[j] = event.since;
  }
  if (count_ == 0) {
    joint_ = hint_ = kind_ = 0;
    since_ = found_ = size_ = deviation_ = torque_ = 0;
    return;
  }
  const Event& last = watch_->latest();
  joint_ = last.joint + 1;
  hint_ = static_cast<std::int32_t>(last.cause) + 1;
  kind_ = last.brief ? 3 : last.spread ? 2 : 1;
  since_ = last.since;
  found_ = last.found;
  size_ = last.size;
  deviation_ = last.deviation;
  torque_ = last.torque;
}

void Anomaly::save_memory(std::string& bytes) {
  ByteWriter out(std::move(bytes));
  watch_->write(out);
  bytes = out.take();
}

void Anomaly::restore_memory(const std::string& bytes) {
  filter_.set_cutoff(cutoff_);
  make_watch();
  model_.drives = drives_;
  bodies_.restored(model_.mechanism());
  model_.update();
  filter_.restored();
  ByteReader in(as_bytes(bytes), "memory of the unit anomaly");
  watch_->read(in);
  in.expect_end();
}

void Anomaly::append_notes(std::vector<std::string>& sentences) const {
  const auto add = [&](const std::string& sentence) { sentences.push_back(sentence); };
  if (watch_->baselines() == 0) {
    add("no change could be found: the baseline takes " + text::to_text(baseline_, 4) + " s of motion, and there were " +
        text::to_text(watch_->motion(), 4) + " s");
  } else if (watch_->count() == 0) {
    add("no change was found; one from the beginning on would be in the baseline, and not seen");
  }
  for (const Event& event : watch_->events())
    add("since " + text::to_text(event.since, 5) + " s (found at " + text::to_text(event.found, 5) +
        " s): " + describe(event, model_, robot_.joints));
  if (watch_->count() > static_cast<double>(Watch::kMostEvents))
    add(text::to_text(watch_->count(), 9) + " changes were found, of which these are the first");
  if (watch_->outside() > 0)
    add("not judged: " + text::to_text(watch_->outside(), 3) + " s of motions beyond those of the baseline");
  std::string compared;
  for (std::size_t j = 0; j < n_; ++j) compared += (j > 0 ? " " : "") + text::to_text(std::round(watch_->compared(j)), 9);
  if (watch_->baselines() > 0) add("seconds of motion compared with a baseline, per joint: " + compared);
  std::string indices;
  for (std::size_t j = 0; j < n_; ++j) {
    const std::optional<double> index = maturity(rms_[j], robot_.joints[j].tau_max);
    indices += (j > 0 ? " " : "") + (index && samples_[j] > 0 ? text::to_text(100 * *index, 2) : "unknown");
  }
  add("maturity, RMS of the residual in motion in percent of the limit of torque per joint: " + indices);
}

}  // namespace cotwin::anomaly
