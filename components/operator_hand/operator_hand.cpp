#include "components/operator_hand/operator_hand.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"
#include "models/trajectory/waypoints.h"

namespace cotwin::operator_hand {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using numerics::Deviation;

Eigen::Map<const Vector3d> map(const std::array<double, 3>& x) { return Eigen::Map<const Vector3d>(x.data()); }
Eigen::Map<Vector3d> map(std::array<double, 3>& x) { return Eigen::Map<Vector3d>(x.data()); }

Quaterniond exponential(const Vector3d& turn) {
  const double angle = turn.norm();
  return angle < 1e-12 ? Quaterniond(1, turn.x() / 2, turn.y() / 2, turn.z() / 2).normalized()
                       : Quaterniond(Eigen::AngleAxisd(angle, turn / angle));
}

/// Axis times angle, at most π.
Vector3d logarithm(const Quaterniond& Q) {
  const double sign = Q.w() < 0 ? -1 : 1, s = Q.vec().norm();
  return s < 1e-12 ? Vector3d(2 * sign * Q.vec()) : Vector3d(2 * std::atan2(s, sign * Q.w()) / s * sign * Q.vec());
}

Quaterniond unit_quaternion(const std::array<double, 4>& q, const char* name) {
  const Quaterniond Q(q[0], q[1], q[2], q[3]);
  if (std::isfinite(Q.norm()) && Q.norm() > 1e-6) return Q.normalized();
  throw Error(std::string("unit:operator_hand.") + name,
              "the quaternion (w, x, y, z) has length " + text::to_text(Q.norm()) + ", expected 1");
}

/// 0 before, 1 after; in between with minimum jerk.
double rise(double since, double duration) {
  if (since <= 0) return 0;
  if (since >= duration) return 1;
  const double s = since / duration;
  return s * s * s * (10 + s * (6 * s - 15));
}

}  // namespace

struct OperatorHand::Gripped {
  explicit Gripped(const robot::RobotModel& robot, const std::string& name)
      : mechanism(robot),
        data(mechanism),
        frame(robot::on_body(name.empty() ? robot.end_effector() : robot.frame(name))),
        J(6, robot.n()),
        q(robot.n()),
        dq(robot.n()) {}

  robot::Mechanism mechanism;
  robot::Data data;
  robot::FrameOnBody frame;
  Eigen::MatrixXd J;
  Eigen::VectorXd q, dq;
};

void OperatorHand::declare_settings(SettingList& s) {
  s.set_first_variables({"p", "v", "tau_e", "f", "grip", "waypoint_t", "waypoint_p", "K_h", "D_h", "m_h"});
  s.robot("the robot whose frame is gripped, a name in models/robots or a path to a URDF file; none: p and v are inputs");
  s.text("frame", "", "with a robot: the frame that is gripped; none: the end of the longest chain");
  s.integer("points", 2, 2, 1000, "number of waypoints of the intention");
  s.integer("history", 1000, 2, 1'000'000, "samples kept for reaction_delay, more than reaction_delay/step");
  s.boolean("moment", false, "the hand also exerts a moment on what it grips");
  s.integer("grips", 1, 1, 1000, "number of times that the hand grips and releases");
}

OperatorHand::OperatorHand(Settings& settings)
    : OperatorHand(settings,
                   settings.text("robot").empty()
                       ? nullptr
                       : std::make_unique<Gripped>(settings.robot(Settings::Masses::kUnused), settings.text("frame"))) {}

OperatorHand::OperatorHand(Settings& settings, std::unique_ptr<Gripped> robot)
    : robot_(std::move(robot)),
      measures_(settings.robot_used().get()),
      seen_(3, static_cast<std::size_t>(settings.integer("history"))),
      moment_(settings.boolean("moment")) {
  const auto N = static_cast<std::size_t>(settings.integer("points"));
  waypoint_t_.resize(N);
  for (std::size_t k = 0; k < N; ++k) waypoint_t_[k] = static_cast<double>(k);
  waypoint_p_.resize(3 * N);
  waypoint_dwell_.resize(N);
  waypoint_turn_.resize(3 * N);
  grip_t_.assign(static_cast<std::size_t>(settings.integer("grips")), kNever);
  grip_t_[0] = 0;
  release_t_.assign(grip_t_.size(), kNever);
  if (!robot_) return;
  for (auto* joints : {&q_, &dq_, &q_rate_, &dq_rate_, &tau_e_}) joints->resize(static_cast<std::size_t>(robot_->q.size()));
}

OperatorHand::~OperatorHand() = default;

void OperatorHand::update_axes() { R_ = unit_quaternion(axes_, "axes").toRotationMatrix(); }

void OperatorHand::update_path() {
  using trajectory::Passing;
  const Passing passing =
      text::choose<Passing>("unit:operator_hand.passing", passing_, {{"rest", Passing::kRest}, {"through", Passing::kThrough}});
  path_ = trajectory::make_path({3, waypoint_t_, waypoint_p_, waypoint_dwell_, {}}, passing);
  turns_ = trajectory::make_path({3, waypoint_t_, waypoint_turn_, waypoint_dwell_, {}}, passing);
}

double OperatorHand::grip_at(double t) const {
  double grip = 0;
  for (std::size_t k = 0; k < grip_t_.size(); ++k)
    grip += rise(t - grip_t_[k], grip_duration_) * (1 - rise(t - release_t_[k], grip_duration_));
  return grip;
}

OperatorHand::Point OperatorHand::planned(double t) const {
  Point x{};
  Vector3d ddx;
  path_.at(t, {x.p.data(), 3}, {x.v.data(), 3}, {ddx.data(), 3});
  x.p += map(origin_);
  return x;
}

/// `since`: time since the beginning of the step, to which the correction refers.
OperatorHand::Point OperatorHand::intended(double t, double since) const {
  const Point x = planned(t);
  return {x.p + map(e_) + since * map(de_), x.v + map(de_)};
}

/// The gripped point `h` after the instant to which the inputs refer.
OperatorHand::Point OperatorHand::point(double h) {
  if (!robot_) {
    const Quaterniond Q = unit_quaternion(quat_, "quat");
    const Vector3d w = map(w_) + h * map(w_rate_);
    return {map(p_) + h * map(p_rate_), map(v_) + h * map(v_rate_), exponential(h / 2 * (map(w_) + w)) * Q, w};
  }
  Gripped& r = *robot_;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    r.q[static_cast<Eigen::Index>(i)] = q_[i] + h * q_rate_[i];
    r.dq[static_cast<Eigen::Index>(i)] = dq_[i] + h * dq_rate_[i];
  }
  robot::FrameOnBody frame = r.frame;
  frame.X_BF.p = frame.X_BF * Vector3d(map(offset_));
  const Pose X_BE = robot::jacobian(r.mechanism, r.data, r.q, frame, r.J);
  return {X_BE.p, r.J.topRows<3>().lazyProduct(r.dq), Quaterniond(X_BE.R), r.J.bottomRows<3>().lazyProduct(r.dq)};
}

void OperatorHand::initialise(Time start) {
  check();
  update_axes();
  update_path();
  origin_ = e_ = de_ = {};
  work_ = {};
  const Point p = point(0);
  if (relative_) map(origin_) = p.p - planned(start.seconds()).p;
  const Point x_i = planned(start.seconds());
  map(x_) = R_.transpose() * x_i.p;
  map(dx_) = R_.transpose() * x_i.v;
  K_before_ = K_h_;
  grip_before_ = grip_at(start.seconds());
  quat_start_ = {1, 0, 0, 0};
  if (relative_) quat_start_ = {p.Q.w(), p.Q.x(), p.Q.y(), p.Q.z()};
  work_turn_ = 0;
  const auto after = std::ranges::upper_bound(grip_t_, start.seconds());
  taken_ = static_cast<std::int32_t>(after - grip_t_.begin());
  const Vector3 here = {p.p.x(), p.p.y(), p.p.z()};
  seen_.start(start, here);
  see(start);
  write_outputs(start, p);
  figures_.start({map(f_), planned(start.seconds()).p - p.p, p.v});
}

/// Energy of the hand and its springs, with arms of stiffness K.
double OperatorHand::stored(const Vector3& K, const Point& x_i, const Point& p) const {
  const Vector3d xi = R_.transpose() * x_i.p, vi = R_.transpose() * x_i.v, pp = R_.transpose() * p.p, pv = R_.transpose() * p.v;
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    Hand one = hand(i);
    one.K = K[i];
    sum += energy(one, grip_before_, {x_[i], dx_[i]}, {xi[axis], vi[axis]}, {pp[axis], pv[axis]});
  }
  return sum;
}

/// Grips that begin within the step: the hand takes the point where it is, and the intention goes on from there.
void OperatorHand::take(Time now, Duration h, const Point& here) {
  const double t = now.seconds();
  for (; static_cast<std::size_t>(taken_) < grip_t_.size(); ++taken_) {
    const double begin = grip_t_[static_cast<std::size_t>(taken_)], until = begin - t;
    if (until >= h.seconds()) return;
    if (!relative_) continue;
    const double before = stored(K_before_, intended(t, 0), here);
    e_ = de_ = {};
    map(origin_) += here.p + until * here.v - planned(begin).p;
    map(x_) = R_.transpose() * here.p;
    map(dx_) = R_.transpose() * here.v;
    work_.muscles += stored(K_before_, intended(t, 0), here) - before;  // the person brings the hand there
    if (!moment_) continue;
    Vector3d rate;
    const Quaterniond Q_start =
        (exponential(turned(begin, rate)).conjugate() * exponential(until * here.w) * here.Q).normalized();
    quat_start_ = {Q_start.w(), Q_start.x(), Q_start.y(), Q_start.z()};
  }
}

// A step:
//   1. a hand that begins to grip takes the point where it is
//   2. the person sees the gripped point, and corrects the intention by what was seen T_r ago
//   3. stiffness and grip follow their changes
//   4. the hand moves
//   5. force and figures at the end
StepResult OperatorHand::step(Time now, Duration h) {
  check();
  const double seconds = h.seconds(), t = now.seconds();
  const Point begin = point(0), end = point(seconds);
  const Vector3 here = {begin.p.x(), begin.p.y(), begin.p.z()};
  seen_.push(now, here);
  take(now, h, begin);
  correct(now, h);

  // Parts that are short against the fastest motion of the hand, so that Simpson's rule is accurate.
  double rate = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    rate = std::max(rate, std::sqrt((K_h_[i] + K_g_[i]) / m_h_[i]) + (D_h_[i] + D_g_[i]) / m_h_[i]);
  }
  constexpr double kShort = 0.2, kMostParts = 20;
  const double parts = std::clamp(std::ceil(seconds * rate / kShort), 1.0, kMostParts), part = seconds / parts;
  for (double k = 0; k < parts; ++k) {
    std::array<Course, 3> x_i, p;  // per axis
    for (std::size_t node = 0; node < 3; ++node) {
      const double since = (k + 0.5 * static_cast<double>(node)) * part, share = since / seconds;
      const Point intention = intended(t + since, since);
      const Vector3d xi = R_.transpose() * intention.p, vi = R_.transpose() * intention.v;
      const Vector3d pp = R_.transpose() * (begin.p + share * (end.p - begin.p));
      const Vector3d pv = R_.transpose() * (begin.v + share * (end.v - begin.v));
      for (std::size_t i = 0; i < 3; ++i) {
        const auto axis = static_cast<Eigen::Index>(i);
        x_i[i][node] = {xi[axis], vi[axis]};
        p[i][node] = {pp[axis], pv[axis]};
      }
    }
    const double grip = grip_at(t + (k + 0.5) * part);
    for (std::size_t i = 0; i < 3; ++i) {
      // A rise of stiffness or grip costs energy, which the muscles provide.
      const double arm = x_i[i][0].x - x_[i], palm = x_[i] - p[i][0].x;
      work_.muscles += 0.5 * ((K_h_[i] - K_before_[i]) * arm * arm + (grip - grip_before_) * K_g_[i] * palm * palm);
      const Deviation x = advance(hand(i), grip, {x_[i], dx_[i]}, x_i[i], p[i], part, work_);
      x_[i] = x.x;
      dx_[i] = x.dx;
    }
    K_before_ = K_h_;
    grip_before_ = grip;
  }
  map(e_) += seconds * map(de_);
  see(now + h);
  const double power = map(m_).dot(begin.w);
  write_outputs(now + h, end);
  work_turn_ += seconds / 2 * (power + map(m_).dot(end.w));

  const double from = path_.begin() + waypoint_dwell_[0], to = path_.end() - waypoint_dwell_.back() + settling_;
  const double middle = t + seconds / 2;
  figures_.add({map(f_), planned((now + h).seconds()).p - end.p, end.v}, seconds, middle > from && middle < to);
  return StepResult::kDone;
}

/// The rate of the correction over the step, from the lag that was there a reaction delay before its middle.
void OperatorHand::correct(Time now, Duration h) {
  de_ = {};
  if (correction_ == 0) return;
  const Time then = now + Duration{h.ns / 2 - Duration::from_seconds(reaction_delay_).ns};
  const bool seen_before = taken_ > 0 && then.seconds() < grip_t_[static_cast<std::size_t>(taken_ - 1)];
  if (relative_ && seen_before) return;  // the lag of then was not this motion's
  Vector3d p;
  if (!seen_.at(then, {p.data(), 3})) {
    throw Error("unit:operator_hand.reaction_delay",
                "is " + text::to_text(reaction_delay_) +
                    " s, longer than the samples that are kept, expected a larger setting history");
  }
  const Vector3d e = map(e_) + h.seconds() * correction_ * (planned(then.seconds()).p - p);
  const double length = e.norm();
  map(de_) = ((length > correction_max_ ? correction_max_ / length : 1.0) * e - map(e_)) / h.seconds();
}

void OperatorHand::see(Time now) {
  if (!seen_.at(now + Duration{-Duration::from_seconds(reaction_delay_).ns}, p_seen_)) {
    throw Error("unit:operator_hand.reaction_delay",
                "is " + text::to_text(reaction_delay_) +
                    " s, longer than the samples that are kept, expected a larger setting history");
  }
}

void OperatorHand::write_outputs(Time now, const Point& p) {
  const double t = now.seconds();
  const Point x_i = intended(t, 0);
  const Vector3d pp = R_.transpose() * p.p, pv = R_.transpose() * p.v;
  grip_ = grip_at(t);
  Vector3d f;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    f[axis] = force(hand(i), grip_, {x_[i], dx_[i]}, {pp[axis], pv[axis]});
  }
  energy_ = stored(K_h_, x_i, p);
  map(f_) = R_ * f;
  map(p_h_) = R_ * map(x_);
  map(v_h_) = R_ * map(dx_);
  map(p_i_) = x_i.p;
  map(v_i_) = x_i.v;
  lag_ = (planned(t).p - p.p).norm();
  if (moment_) turn_robot(t, p);
  if (!robot_) return;
  map(p_) = p.p;
  map(v_) = p.v;
  Eigen::Map<Eigen::VectorXd>(tau_e_.data(), static_cast<Eigen::Index>(tau_e_.size())) =
      robot_->J.topRows<3>().transpose().lazyProduct(map(f_)) + robot_->J.bottomRows<3>().transpose().lazyProduct(map(m_));
}

/// The planned turn, axis times angle, and its rate.
Eigen::Vector3d OperatorHand::turned(double t, Eigen::Vector3d& rate) const {
  Vector3d turn, unused;
  turns_.at(t, {turn.data(), 3}, {rate.data(), 3}, {unused.data(), 3});
  return turn;
}

void OperatorHand::turn_robot(double t, const Point& p) {
  Vector3d rate;
  const Vector3d turn = turned(t, rate);
  const Quaterniond Q_start(quat_start_[0], quat_start_[1], quat_start_[2], quat_start_[3]), further = exponential(turn);
  const Quaterniond Q_i = (further * Q_start).normalized();
  // ω_i of exp(turn(t)): the left Jacobian times the rate.
  const double angle = turn.norm(), a2 = angle * angle;
  const double c1 = angle > 1e-4 ? (1 - std::cos(angle)) / a2 : 0.5 - a2 / 24;
  const double c2 = angle > 1e-4 ? (angle - std::sin(angle)) / (a2 * angle) : 1.0 / 6 - a2 / 120;
  const Vector3d across = turn.cross(rate), w_i = rate + c1 * across + c2 * turn.cross(across);
  const Vector3d phi = R_.transpose() * logarithm(Q_i * p.Q.conjugate()), slip = R_.transpose() * (w_i - p.w);
  map(m_) = R_ * (grip_ * (map(K_r_).cwiseProduct(phi) + map(D_r_).cwiseProduct(slip)));
  quat_i_ = {Q_i.w(), Q_i.x(), Q_i.y(), Q_i.z()};
}

}  // namespace cotwin::operator_hand
