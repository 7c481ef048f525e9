#include "components/services/reaction_service.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "components/services/extremes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/floating_base.h"

namespace cotwin::services {

namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kTolerance = 1e-10;    // rad
constexpr double kEnough = 1e-6;        // rad, of noisy recordings, where the tolerance takes more than kMost steps
constexpr double kFewest = 512;         // steps of a motion
constexpr std::size_t kMost = 250'000;  // or four times those at first

/// The base along a motion.
class Course {
 public:
  Course(const robot::RobotModel& robot, const trajectory::Path& path, const ReactionOptions& o)
      : path_(path),
        options_(o),
        mechanism_(robot),
        data_(mechanism_),
        inertia_(robot.n()),
        q_(robot.n()),
        dq_(q_),
        ddq_(q_),
        dddq_(q_),
        tau_(q_) {
    move_to(path.begin());
    centre_ = inertia_.p_C;
    integrate();
  }

  const std::vector<BaseAt>& grid() const { return grid_; }
  double mass() const { return inertia_.mass; }
  BaseAt at(double t) {
    const auto next = std::ranges::upper_bound(grid_, t, {}, &BaseAt::t);
    const BaseAt& before = *(next == grid_.begin() ? next : next - 1);
    return described(t, t > before.t ? step(before.attitude, rate_at(before.t), before.t, t).Q : before.attitude);
  }

  /// The largest torques of the motors, and the integrals.
  void torques(Reaction& r) {
    std::vector<trajectory::Peak>& peaks = r.torques;
    peaks.resize(static_cast<std::size_t>(tau_.size()));
    for (std::size_t k = 0; k < grid_.size(); ++k) {
      const BaseAt& b = grid_[k];
      const double dt = 0.5 * (grid_[std::min(k + 1, grid_.size() - 1)].t - grid_[k > 0 ? k - 1 : 0].t);  // trapezoids
      move_to(b.t);
      r.jerk += dt * dddq_.squaredNorm();
      robot::reduced_inverse_dynamics(mechanism_, data_, inertia_, q_, dq_, ddq_, b.attitude.conjugate() * options_.spin,
                                      Wrench::Zero(), tau_);
      for (std::size_t joint = 0; joint < peaks.size(); ++joint) {
        const auto j = static_cast<Eigen::Index>(joint);
        const double tau = tau_[j] + optimisation::drive_torque(options_.drives, joint, dq_[j], ddq_[j]);
        if (std::abs(tau) > std::abs(peaks[joint].value)) peaks[joint] = {tau, b.t};
        r.torque += dt * tau * tau;
        r.work += dt * std::max(tau * dq_[j], 0.0);
      }
    }
  }

 private:
  /// ω = w + I⁻¹ Rᵀ L.
  struct Rate {
    Vector3d w;
    Eigen::Matrix3d I_inverse;
  };
  struct Step {
    Quaterniond Q;
    Rate rate;
  };

  void move_to(double t) {
    const auto span = [](Eigen::VectorXd& x) { return std::span(x.data(), static_cast<std::size_t>(x.size())); };
    path_.at(std::min(t, path_.end()), span(q_), span(dq_), span(ddq_), span(dddq_));
    robot::floating_inertia(mechanism_, data_, q_, inertia_);
  }
  Rate rate_at(double t) {
    move_to(t);
    return {inertia_.Z() * dq_, inertia_.I_C_inverse};
  }
  Vector3d omega(const Quaterniond& Q, const Rate& r) const { return r.w + r.I_inverse * (Q.conjugate() * options_.spin); }
  static Quaterniond rotation(const Vector3d& v) { return Quaterniond(Eigen::AngleAxisd(v.norm(), v.stableNormalized())); }
  Step step(const Quaterniond& Q, const Rate& first, double from, double to) {
    const double h = to - from;
    const Rate middle = rate_at(from + 0.5 * h), last = rate_at(to);
    const Vector3d a = h * omega(Q, first), b = h * omega(Q * rotation(0.5 * a), middle),
                   c = h * omega(Q * rotation(0.5 * b + 0.125 * a.cross(b)), middle), d = h * omega(Q * rotation(c), last);
    return {(Q * rotation((a + 2 * b + 2 * c + d) / 6 + a.cross(d) / 12)).normalized(), last};
  }

  BaseAt described(double t, const Quaterniond& Q) {
    BaseAt b;
    b.t = t;
    b.attitude = Q.w() < 0 ? Quaterniond(-Q.coeffs()) : Q;
    b.turn = 2 * std::atan2(Q.vec().norm(), std::abs(Q.w()));
    const Rate r = rate_at(t);
    b.rate = Q * omega(Q, r);
    b.displacement = centre_ + (t - path_.begin()) / inertia_.mass * options_.momentum - Q * inertia_.p_C;
    return b;
  }

  /// The attitudes at these times.
  std::vector<Quaterniond> integrate(const std::vector<double>& times) {
    std::vector<Quaterniond> all{Quaterniond::Identity()};
    Rate rate = rate_at(times.front());
    for (std::size_t k = 1; k < times.size(); ++k) {
      const Step next = step(all.back(), rate, times[k - 1], times[k]);
      all.push_back(next.Q);
      rate = next.rate;
    }
    return all;
  }
  void integrate() {
    const std::span<const double> knots = path_.times();
    const double longest = (path_.end() - path_.begin()) / kFewest;
    std::vector<double> times{knots.front()};
    for (std::size_t k = 1; k < knots.size(); ++k) {
      const double parts = std::ceil((knots[k] - knots[k - 1]) / longest);
      for (double i = 1; i < parts; ++i) times.push_back(knots[k - 1] + i / parts * (knots[k] - knots[k - 1]));
      times.push_back(knots[k]);
    }
    const std::size_t most = std::max(kMost, 4 * times.size());
    std::vector<Quaterniond> coarse = integrate(times), fine;
    for (double error = 1; !(error < kTolerance); coarse = fine) {
      if (times.size() > most) {
        if (error < kEnough) break;
        throw Error("base", "turns too fast to be followed over " + text::to_text(path_.end() - path_.begin()) +
                                " s, expected less momentum, or a shorter or smoother motion");
      }
      std::vector<double> finer{times.front()};
      for (std::size_t k = 1; k < times.size(); ++k) {
        finer.push_back(0.5 * (times[k - 1] + times[k]));
        finer.push_back(times[k]);
      }
      fine = integrate(finer);
      error = 0;
      for (std::size_t k = 0; k < times.size(); ++k) error = std::max(error, coarse[k].angularDistance(fine[2 * k]));
      times = std::move(finer);
    }
    for (std::size_t k = 0; k < times.size(); ++k) grid_.push_back(described(times[k], coarse[k]));
  }

  const trajectory::Path& path_;
  const ReactionOptions& options_;
  robot::FloatingMechanism mechanism_;
  robot::FloatingData data_;
  robot::FloatingInertia inertia_;
  Eigen::VectorXd q_, dq_, ddq_, dddq_, tau_;
  Vector3d centre_;  // of mass at the beginning
  std::vector<BaseAt> grid_;
};

}  // namespace

Reaction reaction(const robot::RobotModel& robot, const trajectory::Path& path, const ReactionOptions& o) {
  Course course(robot, path, o);
  Reaction r;
  r.mass = course.mass();
  r.end = course.grid().back();
  const auto at = [&](double t) { return course.at(t); };
  r.most_turned = largest(course.grid(), at, [](const BaseAt& b) { return b.turn; });
  r.fastest = largest(course.grid(), at, [](const BaseAt& b) { return b.rate.norm(); });
  r.farthest = largest(course.grid(), at, [](const BaseAt& b) { return b.displacement.norm(); });
  course.torques(r);
  const double T = path.end() - path.begin();
  for (std::size_t i = 0; i < o.samples; ++i)
    r.series.push_back(course.at(path.begin() + T * static_cast<double>(i) / static_cast<double>(o.samples - 1)));
  if (o.spin.isZero(0) && o.momentum.isZero(0)) return r;
  const std::size_t n = robot.joints.size();
  std::vector<double> q(n), dq(n), ddq(n);
  path.at(path.begin(), q, dq, ddq);
  q.insert(q.end(), q.begin(), q.end());
  const std::vector<double> rest(2 * n);
  const trajectory::Path still(n, {path.begin(), path.end()}, q, rest, rest);
  r.drift = Course(robot, still, o).grid().back();
  return r;
}

}  // namespace cotwin::services
