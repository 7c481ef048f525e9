#include "components/motion/sources.h"

#include <algorithm>
#include <numbers>
#include <span>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/trajectory/bernstein.h"
#include "models/trajectory/polynomial.h"
#include "models/trajectory/series/series.h"

namespace cotwin::motion {

namespace {

double angle_unit(const std::string& angle) {
  return text::choose<double>("motion: angle", angle, {{"rad", 1}, {"deg", std::numbers::pi / 180}});
}

constexpr const char* kColumns =
    "columns of q: a list, a pattern as q{} (from 1), q{0} (from 0) or {name} (joints of the URDF); empty: detected";
constexpr const char* kAngle = "unit of the positions of revolute joints in the file: rad or deg";

}  // namespace

void declare_source_settings(SettingList& s) {
  s.integer("points", 2, 2, 100000, "kind=waypoints: number of waypoints in the parameters");
  s.boolean("jerk", false, "kind=polynomial: the jerks at both ends are also prescribed");
  s.integer("degree", 5, 5, trajectory::bernstein::kMaxDegree,
            "kind=waypoints or polynomial: degree of the polynomials; above the minimum there are redundant coefficients c_r")
      .fallback_rule("5, with jerk=true 7");
}

WaypointSource::WaypointSource(Settings& settings, std::vector<trajectory::Axis> axes)
    : settings_(settings), axes_(std::move(axes)), degree_(static_cast<int>(settings.integer("degree"))) {
  const std::size_t N = static_cast<std::size_t>(settings.integer("points"));
  t_.resize(N);
  for (std::size_t k = 0; k < N; ++k) t_[k] = static_cast<double>(k);
  q_.resize(N * axes_.size());
  dwell_.resize(N);
  c_r_.resize((N - 1) * axes_.size() * static_cast<std::size_t>(degree_ - 5));
}

void WaypointSource::declare(Variables& v, JointVariables& joints) {
  v.parameter("file", file_,
              "CSV with waypoints: columns t, joint positions and optionally dwell; empty: waypoints from the parameters");
  v.parameter("q_columns", q_columns_, kColumns);
  v.parameter("angle", angle_, kAngle);
  v.parameter("passing", passing_,
              "rest: the joints stop at every waypoint; through: they pass waypoints without dwell with minimum jerk");
  v.parameter("waypoint_t", t_, "s", "arrival times at the waypoints");
  auto q = joints.parameter("waypoint_q", q_, "rad", "joint positions, all joints of the first waypoint, then of the next");
  if (file_.empty()) q.essential();
  v.parameter("waypoint_dwell", dwell_, "s", "duration of the rest at each waypoint").range(0, 1e9);
  if (!c_r_.empty()) {
    joints.parameter(
        "c_r", c_r_, "rad",
        "redundant coefficients (V-B): legs x joints x (degree - 5); each is the maximum displacement of its term");
  }
}

trajectory::Waypoints WaypointSource::points() const {
  if (file_.empty()) return {axes_.size(), t_, q_, dwell_, {}};
  return trajectory::load_waypoints(settings_.file(file_), axes_, q_columns_, angle_unit(angle_));
}

trajectory::Path WaypointSource::path() {
  using trajectory::Passing;
  const Passing passing =
      text::choose<Passing>("motion: passing", passing_, {{"rest", Passing::kRest}, {"through", Passing::kThrough}});
  const bool plain =
      std::all_of(c_r_.begin(), c_r_.end(), [](double c) { return c == 0; });  // then the number of points is free
  return trajectory::make_path(points(), passing, degree_, plain ? std::span<const double>() : std::span<const double>(c_r_));
}

PolynomialSource::PolynomialSource(Settings& settings, std::vector<trajectory::Axis> axes)
    : n_(axes.size()), jerk_(settings.boolean("jerk")), degree_(static_cast<int>(settings.integer("degree", jerk_ ? 7 : 5))) {
  if (jerk_ && degree_ < 7) {
    throw Error("unit:motion", "degree=" + std::to_string(degree_) + " with jerk=true, expected 7 to " +
                                   std::to_string(trajectory::bernstein::kMaxDegree));
  }
  for (End* end : {&start_, &end_}) {
    for (std::vector<double>* x : {&end->q, &end->dq, &end->ddq, &end->dddq}) x->resize(n_);
  }
  c_r_.resize(n_ * static_cast<std::size_t>(degree_ - (jerk_ ? 7 : 5)));
}

void PolynomialSource::declare(Variables& v, JointVariables& joints) {
  v.parameter("T", T_, "s", "duration before stretching").range(1e-6, 1e9);
  joints.parameter("q_start", start_.q, "rad", "joint position at the start");
  joints.parameter("dq_start", start_.dq, "rad/s", "joint velocity at the start");
  joints.parameter("ddq_start", start_.ddq, "rad/s2", "joint acceleration at the start");
  joints.parameter("q_end", end_.q, "rad", "joint position at the end").essential();
  joints.parameter("dq_end", end_.dq, "rad/s", "joint velocity at the end");
  joints.parameter("ddq_end", end_.ddq, "rad/s2", "joint acceleration at the end");
  if (jerk_) {
    joints.parameter("dddq_start", start_.dddq, "rad/s3", "joint jerk at the start");
    joints.parameter("dddq_end", end_.dddq, "rad/s3", "joint jerk at the end");
  }
  if (!c_r_.empty()) {
    joints.parameter("c_r", c_r_, "rad",
                     "redundant coefficients (V-B), joint by joint; each is the maximum displacement of its term");
  }
}

trajectory::Path PolynomialSource::path() {
  const trajectory::RedundantTerms terms(degree_, jerk_, jerk_);
  const auto boundary = [&](const End& end, std::size_t j) {
    return trajectory::Boundary{end.q[j], end.dq[j], end.ddq[j], jerk_ ? std::optional(end.dddq[j]) : std::nullopt};
  };
  std::vector<double> control;
  for (std::size_t j = 0; j < n_; ++j) {
    const auto c_r = std::span(c_r_).subspan(j * terms.size(), terms.size());
    const auto points = trajectory::make_polynomial(boundary(start_, j), boundary(end_, j), T_, terms, c_r);
    control.insert(control.end(), points.begin(), points.end());
  }
  return trajectory::Path(n_, {0, T_}, degree_, std::move(control));
}

RecordingSource::RecordingSource(Settings& settings, std::vector<trajectory::Axis> axes)
    : settings_(settings), axes_(std::move(axes)) {}

void RecordingSource::declare(Variables& v, JointVariables& joints) {
  v.parameter("file", file_, "CSV with the motion: named columns, one row per sample").essential();
  v.parameter("topic", topic_, "topic of a ROS bag; empty: the only one with joints");
  v.parameter("t_column", t_column_, "time column; empty: t, time or timestamp");
  v.parameter("t_unit", t_unit_, "unit of the time column: s, ms, us or ns");
  v.parameter("rate", rate_, "Hz", "sampling rate of a file without a time column; 0: the file has one").range(0, 1e6);
  v.parameter("q_columns", q_columns_, kColumns);
  v.parameter("angle", angle_, kAngle);
  v.parameter("max_gap", max_gap_, "1", "largest gap between samples, in median sampling steps; a longer one is an error")
      .range(1, 1e9);
  joints
      .parameter("max_speed", max_speed_, "rad/s",
                 "largest speed between samples; a higher one is an error; 0: four times the joint's limit, or 30 rad/s")
      .range(0, 1e9);
  v.parameter("cutoff", cutoff_, "Hz", "-3 dB frequency of the zero-phase low-pass, both passes together; 0: no filter")
      .range(0, 1e6);
  v.parameter("filter_order", filter_order_, "Butterworth order of each of the two passes").range(1, 8);
  v.parameter("start", begin_, "s", "time in the file, from its first sample, at which the motion begins").range(0, 1e9);
  v.parameter("end", end_, "s", "time in the file at which the motion ends; 0: last sample").range(0, 1e9);
}

RecordingSource::Source RecordingSource::source() const {
  if (file_.empty()) throw Error("motion: file", "is empty, expected the CSV with the motion");
  Source source;
  source.file = settings_.file(file_);
  source.written = std::filesystem::last_write_time(source.file);
  source.format.t_column = t_column_;
  source.format.t_unit = text::choose<double>("motion: t_unit", t_unit_, {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}});
  source.format.rate = rate_;
  source.format.topic = topic_;
  source.format.q_columns = q_columns_;
  source.format.dq_columns = source.format.tau_columns = source.format.tau_e_columns = "none";
  source.format.angle_unit = angle_unit(angle_);
  source.format.max_gap = max_gap_;
  source.format.max_speed = max_speed_;
  source.cutoff = cutoff_;
  source.filter_order = filter_order_;
  return source;
}

trajectory::Path RecordingSource::path() {
  const Source wanted = source();
  if (loaded_ != wanted) {
    loaded_.reset();
    const trajectory::Recording recording = trajectory::load_recording(wanted.file, axes_, wanted.format);
    const trajectory::Series& q = recording.q;
    warning_ = trajectory::time_unit_warning(q.t);
    for (const std::string& note : recording.notes) text::append(warning_, note, "; ");
    if (!warning_.empty()) warning_ = wanted.file.string() + ": " + warning_;
    whole_ = trajectory::interpolate(wanted.cutoff > 0 ? trajectory::smooth(q, wanted.cutoff, wanted.filter_order) : q);
    loaded_ = wanted;
  }
  const double end = end_ > 0 ? end_ : whole_.end();
  if (!(begin_ < end && end <= whole_.end())) {
    throw Error("motion: start, end", "from " + text::to_text(begin_) + " s to " + text::to_text(end) +
                                          " s, expected a part of the " + text::to_text(whole_.end(), 12) + " s of " +
                                          wanted.file.string());
  }
  return trajectory::cut(whole_, begin_, end);
}

}  // namespace cotwin::motion
