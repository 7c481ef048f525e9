#include "components/io/links/recording_link.h"

#include <algorithm>
#include <numbers>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

enum class Limits { kWarn, kError, kIgnore };

}  // namespace

RecordingLink::RecordingLink(const Settings& settings, std::vector<trajectory::Axis> axes)
    : settings_(settings),
      axes_(std::move(axes)),
      q_scale_(axes_.size(), 1.0),
      q_offset_(axes_.size(), 0.0),
      tau_scale_(axes_.size(), 1.0),
      tau_e_scale_(axes_.size(), 1.0),
      scratch_(axes_.size()) {}

void RecordingLink::declare(Variables& v, JointVariables& joints) {
  v.parameter("file", file_, "recording: CSV with named columns, one row per sample, or a ROS bag").essential();
  v.parameter("topic", topic_, "topic of a ROS bag; empty: the only one with joints");
  v.parameter("separator", separator_, "column separator: comma, semicolon or tab; empty: detected");
  v.parameter("t_column", t_column_, "time column; empty: t, time or timestamp");
  v.parameter("t_unit", t_unit_, "unit of the time column: s, ms, us or ns");
  v.parameter("rate", rate_, "Hz", "sampling rate of a recording without a time column; 0: the recording has one")
      .range(0, 1e6);
  v.parameter("q_columns", q_columns_,
              "columns of q: a list, a pattern as q{} (from 1), q{0} (from 0) or {name} (joints of the URDF); empty: detected");
  v.parameter("dq_columns", dq_columns_, "columns of dq, as q_columns; none: not read");
  v.parameter("tau_columns", tau_columns_, "columns of tau, as q_columns; none: not read");
  v.parameter("tau_e_columns", tau_e_columns_, "columns of tau_e, as q_columns; none: not read");
  v.parameter("angle", angle_, "unit of positions and velocities of revolute joints in the file: rad or deg");
  v.parameter("q_scale", q_scale_, "1", "sign or gear ratio: q = q_scale * column + q_offset, dq = q_scale * column");
  joints.parameter("q_offset", q_offset_, "rad", "offset added to the positions");
  v.parameter("tau_scale", tau_scale_, "1", "sign, gear ratio or torque constant: tau = tau_scale * column");
  v.parameter("tau_e_scale", tau_e_scale_, "1", "sign or scale factor of tau_e, as tau_scale");
  v.parameter("max_gap", max_gap_, "1", "largest gap between samples, in median sampling steps; a longer one is an error")
      .range(1, 1e9);
  joints
      .parameter("max_speed", max_speed_, "rad/s",
                 "largest speed between samples; a higher one is an error; 0: four times the joint's limit, or 30 rad/s")
      .range(0, 1e9);
  v.parameter("q_cutoff", q_cutoff_, "Hz",
              "-3 dB frequency of the zero-phase low-pass of q and dq, both passes together; 0: no filter")
      .range(0, 1e6);
  v.parameter("tau_cutoff", tau_cutoff_, "Hz", "-3 dB frequency of the low-pass of tau and tau_e, as q_cutoff").range(0, 1e6);
  v.parameter("filter_order", filter_order_, "Butterworth order of each of the two passes").range(1, 8);
  v.parameter("derivative", derivative_, "source of dq: position (the derivative of q) or columns (measured)");
  v.parameter("start", start_, "s", "time in the recording, from its first sample, that is played at time 0").range(0, 1e9);
  v.parameter("end", end_, "s", "time in the recording at which playback ends; 0: last sample").range(0, 1e9);
  v.parameter("limits", limits_, "if the recording violates the robot's joint limits: warn, error or ignore");
}

RecordingLink::Source RecordingLink::source() const {
  if (file_.empty()) throw Error("io: file", "is empty, expected the CSV with the recording");
  constexpr double kDegree = std::numbers::pi / 180;
  Source source;
  source.file = settings_.file(file_);
  source.written = std::filesystem::last_write_time(source.file);
  trajectory::RecordingFormat& f = source.format;
  f.separator =
      text::choose<char>("io: separator", separator_, {{"", '\0'}, {"comma", ','}, {"semicolon", ';'}, {"tab", '\t'}});
  f.t_column = t_column_;
  f.t_unit = text::choose<double>("io: t_unit", t_unit_, {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}});
  f.rate = rate_;
  f.topic = topic_;
  f.q_columns = q_columns_;
  f.dq_columns = dq_columns_;
  f.tau_columns = tau_columns_;
  f.tau_e_columns = tau_e_columns_;
  f.angle_unit = text::choose<double>("io: angle", angle_, {{"rad", 1}, {"deg", kDegree}});
  f.q_scale = q_scale_;
  f.q_offset = q_offset_;
  f.tau_scale = tau_scale_;
  f.tau_e_scale = tau_e_scale_;
  f.max_gap = max_gap_;
  f.max_speed = max_speed_;
  source.q_cutoff = q_cutoff_;
  source.tau_cutoff = tau_cutoff_;
  source.filter_order = filter_order_;
  source.velocity_columns = text::choose<bool>("io: derivative", derivative_, {{"position", false}, {"columns", true}});
  return source;
}

void RecordingLink::load(const Source& source) {
  loaded_.reset();
  trajectory::Recording recording = trajectory::load_recording(source.file, axes_, source.format);
  const auto smoothed = [&](trajectory::Series& series, double cutoff) {
    return cutoff > 0 && series.size() > 0 ? trajectory::smooth(series, cutoff, source.filter_order) : std::move(series);
  };
  instants_ = recording.q.t;
  constexpr double kIrregular = 1.5;
  gap_ = kIrregular * (instants_.size() < 2 ? 0 : trajectory::median_step(instants_));
  q_ = trajectory::interpolate(smoothed(recording.q, source.q_cutoff));
  dq_ = {};
  if (source.velocity_columns) {
    if (recording.dq.size() == 0)
      throw Error(recording.file, "has no columns of joint velocities, expected them for derivative = columns");
    dq_ = trajectory::interpolate(smoothed(recording.dq, source.q_cutoff));
  }
  tau_ = smoothed(recording.tau, source.tau_cutoff);
  tau_e_ = smoothed(recording.tau_e, source.tau_cutoff);
  time_warning_ = trajectory::time_unit_warning(instants_);
  for (const std::string& note : recording.notes) text::append(time_warning_, note, "; ");
  loaded_ = source;
}

void RecordingLink::choose_part(std::string& warning) {
  last_ = end_ > 0 ? end_ : q_.end();
  if (!(start_ < last_ && last_ <= q_.end())) {
    throw Error("io: start, end", "from " + text::to_text(start_) + " s to " + text::to_text(last_) +
                                      " s, expected a part of the " + text::to_text(q_.end(), 12) + " s of " +
                                      loaded_->file.string());
  }
  const Limits limits = text::choose<Limits>("io: limits", limits_,
                                             {{"warn", Limits::kWarn}, {"error", Limits::kError}, {"ignore", Limits::kIgnore}});
  if (limits == Limits::kIgnore) return;
  const trajectory::Path part = trajectory::cut(q_, start_, last_);
  const std::string violation = limit_violation(part, trajectory::Phase(last_ - start_), axes_);
  if (violation.empty()) return;
  if (limits == Limits::kError) throw Error(loaded_->file.string(), violation);
  warning = loaded_->file.string() + ": " + violation;
}

void RecordingLink::initialise(Time start, Measured& measured) {
  const Source wanted = source();
  if (loaded_ != wanted) load(wanted);
  choose_part(measured.warning);
  measured.has_tau = tau_.size() > 0;
  if (!measured.has_tau && tau_columns_ != "none") {
    measured.warning += (measured.warning.empty() ? loaded_->file.string() + ": " : "; ") +
                        "no columns of joint torques found, tau is 0; set tau_columns to their names or to none";
  }
  if (!time_warning_.empty())
    measured.warning += (measured.warning.empty() ? loaded_->file.string() + ": " : "; ") + time_warning_;
  // Composed here because a step must not allocate.
  ended_ = (measured.warning.empty() ? loaded_->file.string() + ": " : "; ") + "the recording ended at " +
           text::to_text(last_ - start_, 9) + " s; after that the robot is assumed to be at rest";
  measured.warning.reserve(measured.warning.size() + ended_.size());
  measured.has_tau_e = tau_e_.size() > 0;
  std::fill(measured.tau.begin(), measured.tau.end(), 0.0);
  std::fill(measured.tau_e.begin(), measured.tau_e.end(), 0.0);
  measure(start.seconds(), start.seconds(), measured);
  measured.fresh = std::binary_search(instants_.begin(), instants_.end(), start_ + start.seconds());
}

StepResult RecordingLink::step(Time now, Duration h, const Command&, Measured& measured) {
  measure(now.seconds(), (now + h).seconds(), measured);
  const bool over = now >= Time::from_seconds(last_ - start_);
  if (over && !measured.warning.ends_with(ended_)) measured.warning += ended_;
  return StepResult::kDone;
}

// Sets all measurements at the scenario's time `to`; fresh if there is a sample after `from`. Between samples on both sides of a gap
// the values are of no use to one who learns from them.
void RecordingLink::measure(double from, double to, Measured& measured) {
  const double t = std::min(start_ + to, last_);
  q_.at(t, measured.q, measured.dq, measured.ddq);
  if (dq_.joints() > 0) dq_.at(t, measured.dq, measured.ddq, scratch_);
  if (start_ + to > last_) {
    std::fill(measured.dq.begin(), measured.dq.end(), 0.0);
    std::fill(measured.ddq.begin(), measured.ddq.end(), 0.0);
  }
  if (measured.has_tau) trajectory::linear(tau_, t, measured.tau);
  if (measured.has_tau_e) trajectory::linear(tau_e_, t, measured.tau_e);
  const auto until = [&](double instant) {
    return std::upper_bound(instants_.begin(), instants_.end(), std::min(start_ + instant, last_)) - instants_.begin();
  };
  measured.fresh = until(to) > until(from);
  const auto next = std::lower_bound(instants_.begin(), instants_.end(), start_ + to);
  const bool at_sample = next != instants_.end() && *next == start_ + to;
  measured.between = start_ + to <= last_ && next != instants_.end() &&
                     (at_sample || (next != instants_.begin() && *next - *(next - 1) < gap_));
  measured.done = start_ + to >= last_;
}

}  // namespace cotwin::io
