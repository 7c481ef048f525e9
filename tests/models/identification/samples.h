#pragma once
#include <cmath>
#include <numbers>

#include "models/identification/torque_data/torque_data.h"
#include "models/identification/torque_data/torque_model.h"
#include "models/numerics/random.h"

/// Samples of known robots.
namespace cotwin::identification::testing {

/// The samples [first, last).
inline Samples part(const Samples& samples, std::size_t first, std::size_t last) {
  Samples result;
  result.joints = samples.joints;
  for (const auto values :
       {&Samples::t, &Samples::q, &Samples::dq, &Samples::ddq, &Samples::tau, &Samples::dtheta, &Samples::ddtheta}) {
    const std::vector<double>& from = samples.*values;
    const auto width = static_cast<std::ptrdiff_t>(values == &Samples::t ? 1 : samples.joints);
    if (!from.empty())
      (result.*values)
          .assign(from.begin() + width * static_cast<std::ptrdiff_t>(first),
                  from.begin() + width * static_cast<std::ptrdiff_t>(last));
  }
  return result;
}

inline void add(TorqueData& data, const Samples& s) {
  for (std::size_t k = 0; k < s.count(); ++k) {
    const std::size_t i = k * s.joints;
    data.add(&s.q[i], &s.dq[i], &s.ddq[i], &s.tau[i], s.dtheta.empty() ? nullptr : &s.dtheta[i],
             s.ddtheta.empty() ? nullptr : &s.ddtheta[i]);
  }
}

/// Per joint: root of the mean square of measured minus given torques, and its maximum, N.m.
struct Discrepancy {
  Eigen::VectorXd rms, maximum;
};
inline Discrepancy discrepancy(const Samples& samples, const std::vector<double>& tau) {
  const auto n = static_cast<Eigen::Index>(samples.joints), count = static_cast<Eigen::Index>(samples.count());
  const Eigen::ArrayXXd e =
      Eigen::Map<const Eigen::ArrayXXd>(samples.tau.data(), n, count) - Eigen::Map<const Eigen::ArrayXXd>(tau.data(), n, count);
  return {e.square().rowwise().mean().sqrt(), e.abs().rowwise().maxCoeff()};
}

/// A multi-sine motion of `count` samples at 100 Hz with the torques of `truth`, and normal noise on them.
inline Samples simulate(const robot::RobotModel& robot, const Estimate& truth, std::size_t count, double noise,
                        std::uint32_t stream = 0) {
  const auto n = static_cast<std::size_t>(robot.n());
  Samples s;
  s.joints = n;
  const auto draw = [&](std::size_t j, std::uint32_t k) {
    return numerics::uniform({11, stream, 0, static_cast<std::uint32_t>(j), k});
  };
  for (std::size_t i = 0; i < count; ++i) {
    const double t = 0.01 * static_cast<double>(i);
    s.t.push_back(t);
    for (std::size_t j = 0; j < n; ++j) {
      double q = 0, dq = 0, ddq = 0;
      for (std::uint32_t k = 0; k < 5; ++k) {
        const double w = 2 * std::numbers::pi * (0.1 + 0.9 * draw(j, 3 * k)), phase = 6.3 * draw(j, 3 * k + 1);
        const double a = 0.8 * (0.2 + draw(j, 3 * k + 2)) / (0.5 + w);
        q += a * std::sin(w * t + phase);
        dq += a * w * std::cos(w * t + phase);
        ddq -= a * w * w * std::sin(w * t + phase);
      }
      s.q.push_back(q);
      s.dq.push_back(dq);
      s.ddq.push_back(ddq);
    }
  }
  s.tau = torques(robot, truth, s);
  for (std::size_t i = 0; i < s.tau.size(); ++i)
    s.tau[i] += noise * numerics::normal({12, stream, 0, 0, static_cast<std::uint32_t>(i)});
  return s;
}

/// The robot's own bodies with drives that differ from joint to joint.
inline Estimate truth_of(const robot::RobotModel& robot, bool motor_inertia = true) {
  Estimate truth = estimate_of(robot);
  for (std::size_t j = 0; j < truth.drive.size(); ++j) {
    const auto k = static_cast<double>(j);
    JointDrive& d = truth.drive[j];
    d.tau_C = d.tau_S = 2 - 0.2 * k;
    d.sigma2 = 1 + 0.3 * k;
    d.tau_0 = 0.4 - 0.15 * k;
    d.B = motor_inertia ? 0.5 + 0.05 * k : 0.0;
  }
  return truth;
}

/// The robot with masses, inertias and centres of mass changed by `share`, each randomly up or down.
inline robot::RobotModel perturbed(const robot::RobotModel& robot, double share, std::uint32_t stream = 0) {
  robot::RobotModel result = robot;
  for (std::size_t i = 0; i < result.bodies.size(); ++i) {
    const auto factor = [&](std::uint32_t k) {
      return numerics::uniform({13, stream, 0, static_cast<std::uint32_t>(i), k}) < 0.5 ? 1 - share : 1 + share;
    };
    Inertia& body = result.bodies[i].inertia;
    body.mass *= factor(0);
    body.I_CC *= factor(1);
    for (int k = 0; k < 3; ++k) body.p_LC[k] *= factor(static_cast<std::uint32_t>(2 + k));
  }
  return result;
}

}  // namespace cotwin::identification::testing
