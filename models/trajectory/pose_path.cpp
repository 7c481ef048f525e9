#include "models/trajectory/pose_path.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/text.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::trajectory {

namespace {

Taylor4 constant(const Eigen::Vector4d& Q) {
  const Eigen::Vector4d zero = Eigen::Vector4d::Zero();
  return {{Q, zero, zero, zero}};
}

PoseMotion motion_of(const Taylor3& p, const Taylor4& Q) {
  const Taylor3 w = angular_velocity(Q);
  return {p.c[0], p.c[1], 2 * p.c[2], 6 * p.c[3], Q.c[0].normalized(), w.c[0], w.c[1], 2 * w.c[2]};
}

PoseMotion at_rest(const Eigen::Vector3d& p, const Eigen::Vector4d& Q) {
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  return {p, zero, zero, zero, Q, zero, zero, zero};
}

}  // namespace

Taylor1 PosePath::progress(const Leg& leg, double t) const {
  const double T = leg.end - leg.begin;
  if (passing_ == PosePassing::kRest) {
    constexpr std::array<double, 6> kQuintic{0, 0, 0, 1, 1, 1};
    const auto f = bernstein::evaluate(kQuintic, std::clamp((t - leg.begin) / T, 0.0, 1.0));
    return from_derivatives(f[0], f[1] / T, f[2] / (T * T), f[3] / (T * T * T));
  }
  const double length = T - leg.blend;  // two ramps cost half their durations each
  const Phase::Value s = Phase(length, 1, leg.blend, leg.blend).at(std::clamp(t - leg.begin, 0.0, T));
  return from_derivatives(s.s / length, s.ds / length, s.dds / length, s.ddds / length);
}

void PosePath::add(const Leg& leg, double t, Taylor3& p, Taylor4& Q) const {
  const Taylor1 s = progress(leg, t);
  p = p + s * leg.line;
  if (leg.angle != 0) {
    const Taylor1 angle = leg.angle * s;
    Taylor1 versine = cos(angle);  // cos − 1
    versine.c[0] = -2 * std::pow(std::sin(angle.c[0] / 2), 2);
    p = p + versine * leg.radius + sin(angle) * leg.normal_times_radius;
  }
  Q = Q * exponential(s * leg.psi);
}

PoseMotion PosePath::at(double t) const {
  if (t <= begin()) return at_rest(p_.front(), Q_.front());
  if (t >= end()) return at_rest(p_.back(), Q_.back());
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  if (passing_ == PosePassing::kThrough) {
    std::array<double, 6> q, dq, ddq, dddq;
    positions_.at(t, q, dq, ddq, dddq);
    const std::size_t k = interval(knots_, t);
    const double T = knots_[k + 1] - knots_[k], rate = 1 / T;
    Taylor3 p{{zero, zero, zero, zero}}, psi = p;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto set = [i](Taylor3& x, const Taylor1& s) {
        for (std::size_t order = 0; order < 4; ++order) x.c[order][static_cast<Eigen::Index>(i)] = s.c[order];
      };
      set(p, from_derivatives(q[i], dq[i], ddq[i], dddq[i]));
      const auto f = bernstein::evaluate(rotation_[k][i], std::clamp((t - knots_[k]) * rate, 0.0, 1.0));
      set(psi, from_derivatives(f[0], f[1] * rate, f[2] * rate * rate, f[3] * rate * rate * rate));
    }
    return motion_of(p, constant(Q_at_knot_[k]) * exponential(psi));
  }
  const auto first = std::upper_bound(legs_.begin(), legs_.end(), t, [](double x, const Leg& leg) { return x < leg.end; });
  const std::size_t k = static_cast<std::size_t>(first - legs_.begin());
  if (first == legs_.end() || t <= first->begin) return at_rest(p_[k], Q_[k]);
  Taylor3 p{{p_[k], zero, zero, zero}};
  Taylor4 Q = constant(Q_[k]);
  for (auto leg = first; leg != legs_.end() && leg->begin < t; ++leg) add(*leg, t, p, Q);
  return motion_of(p, Q);
}

namespace {

const Eigen::Vector3d& derivative(const PoseMotion& m, bool angular, std::size_t order) {
  if (angular) return order == 0 ? m.w : order == 1 ? m.dw : m.ddw;
  return order == 0 ? m.v : order == 1 ? m.dv : m.ddv;
}

/// The largest magnitude in [a, b] around the largest sample, by golden sections.
Peak refine(const PosePath& path, bool angular, std::size_t order, double a, double b, Peak best) {
  constexpr double kGolden = 0.6180339887498949;
  const auto value = [&](double t) { return derivative(path.at(t), angular, order).norm(); };
  for (int i = 0; i < 40; ++i) {
    const double left = b - kGolden * (b - a), right = a + kGolden * (b - a);
    const double f = value(left), g = value(right);
    if (f > best.value) best = {f, left};
    if (g > best.value) best = {g, right};
    (f > g ? b : a) = f > g ? right : left;
  }
  return best;
}

constexpr const char* kVerbs[2][3] = {{"moves with ", "accelerates with ", "has a jerk of "},
                                      {"turns with ", "has an angular acceleration of ", "has an angular jerk of "}};
constexpr const char* kUnits[2][3] = {{" m/s", " m/s2", " m/s3"}, {" rad/s", " rad/s2", " rad/s3"}};

}  // namespace

PosePeaks find_peaks(const PosePath& path) {
  constexpr int kSamples = 200;
  PosePeaks peaks;
  for (std::size_t k = 0; k + 1 < path.knots().size(); ++k) {
    const double a = path.knots()[k], b = path.knots()[k + 1];
    const auto time = [&](int i) {  // inside the interval: third derivatives jump at its ends
      const double x = std::clamp(static_cast<double>(i) / kSamples, 1e-9, 1 - 1e-9);
      return a + x * (b - a);
    };
    std::array<std::array<Peak, 3>, 2> best{};
    for (int i = 0; i <= kSamples; ++i) {
      const PoseMotion m = path.at(time(i));
      for (const bool angular : {false, true}) {
        for (std::size_t order = 0; order < 3; ++order) {
          Peak& peak = best[angular][order];
          if (const double value = derivative(m, angular, order).norm(); value > peak.value) peak = {value, time(i)};
        }
      }
    }
    for (const bool angular : {false, true}) {
      for (std::size_t order = 0; order < 3; ++order) {
        Peak& peak = (angular ? peaks.angular : peaks.linear)[order];
        Peak& found = best[angular][order];
        if (found.value <= 0.98 * peak.value) continue;  // samples are closer to the maximum
        const double step = (b - a) / kSamples;
        found =
            refine(path, angular, order, std::max(found.t - step, time(0)), std::min(found.t + step, time(kSamples)), found);
        if (found.value > peak.value) peak = found;
      }
    }
  }
  return peaks;
}

double stretch_to(const PosePeaks& peaks, const Phase& phase, const PoseLimits& limits) {
  double factor = 0;
  for (const bool angular : {false, true}) {
    const auto& found = angular ? peaks.angular : peaks.linear;
    const auto& limit = angular ? limits.angular : limits.linear;
    const std::array<double, 3> largest{found[0].value, found[1].value, found[2].value};
    for (int order = 1; order <= 3; ++order) {
      const double most = limit[static_cast<std::size_t>(order - 1)];
      if (std::isinf(most)) continue;
      factor = std::max(factor, std::pow(bound(largest, phase, order) / most, 1.0 / order));
    }
  }
  return factor;
}

std::string limit_violation(const PosePeaks& peaks, const PosePath& path, const Phase& phase, const PoseLimits& limits,
                            double tolerance) {
  for (const bool angular : {false, true}) {
    const auto& found = angular ? peaks.angular : peaks.linear;
    const auto& limit = angular ? limits.angular : limits.linear;
    const std::array<double, 3> largest{found[0].value, found[1].value, found[2].value};
    for (std::size_t i = 0; i < 3; ++i) {
      const double value = bound(largest, phase, static_cast<int>(i) + 1);
      if (value <= limit[i] * (1 + tolerance)) continue;
      const auto number = [](double x) { return text::to_text(x, 6); };
      return std::string("the frame ") + kVerbs[angular][i] + number(value) + kUnits[angular][i] + " at " +
             number(phase.time_of(found[i].t - path.begin())) + " s, expected at most " + number(limit[i]) + kUnits[angular][i];
    }
  }
  return {};
}

}  // namespace cotwin::trajectory
