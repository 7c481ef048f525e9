#include "components/io/links/synchronisation.h"

#include <algorithm>
#include <cmath>

#include "models/trajectory/approach.h"

namespace cotwin::io {

Synchronisation::Synchronisation(std::size_t joints)
    : e_(joints), correction_(joints), q_(joints), dq_(joints), target_(joints) {}

void Synchronisation::start(std::span<const double> q) {
  std::ranges::copy(q, q_.begin());
  std::ranges::fill(e_, 0);
  std::ranges::fill(correction_, 0);
  std::ranges::fill(dq_, 0);
  measured_ = has_target_ = false;
  since_start_ = 0;
}

void Synchronisation::measure(std::span<const double> q_v, std::span<const double> q_r, const Gains& gains, double elapsed) {
  if (measured_ && elapsed <= 0) return;
  for (std::size_t i = 0; i < e_.size(); ++i) {
    const double e = q_v[i] - q_r[i];
    const double de = measured_ ? (e - e_[i]) / elapsed : 0;
    const double correction = gains.K_P[i] * e + gains.K_D[i] * de;
    if (!std::isfinite(e) || !std::isfinite(correction)) continue;
    correction_[i] = correction;
    e_[i] = e;
  }
  measured_ = true;
}

std::span<const double> Synchronisation::command(std::span<const double> q_v, const Gains& gains, double h) {
  since_start_ += h;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const double target = q_v[i] + correction_[i], most = gains.dq_max[i] * share(), change = gains.ddq_max * h;
    if (!std::isfinite(target) || !(most >= 0) || !(h > 0)) {
      rest(i, gains, h);
      if (!has_target_) target_[i] = q_[i];
      continue;
    }
    const double before = has_target_ ? target_[i] : target, distance = before - q_[i];
    const double approach = trajectory::approach_speed(std::abs(distance), gains.ddq_max, h);
    const double speed = (target - before) / h + std::copysign(approach, distance);
    dq_[i] = std::clamp(std::clamp(speed, dq_[i] - change, dq_[i] + change), -most, most);
    const bool arrives = dq_[i] == speed && approach == std::abs(distance) / h;
    q_[i] = arrives ? target : q_[i] + dq_[i] * h;
    target_[i] = target;
  }
  has_target_ = true;
  return q_;
}

void Synchronisation::go_on(double time) {
  for (std::size_t i = 0; i < q_.size(); ++i) q_[i] += dq_[i] * time;
}

void Synchronisation::rest(std::size_t i, const Gains& gains, double h) {
  if (!(h > 0)) return;
  const double change = gains.ddq_max * h;
  dq_[i] = std::clamp(0.0, dq_[i] - change, dq_[i] + change);
  q_[i] += dq_[i] * h;
}

std::span<const double> Synchronisation::pause(const Gains& gains, double h) {
  for (std::size_t i = 0; i < q_.size(); ++i) rest(i, gains, h);
  return q_;
}

std::span<const double> Synchronisation::rest(const Gains& gains, double h) {
  pause(gains, h);
  has_target_ = false;
  since_start_ = 0;
  return q_;
}

}  // namespace cotwin::io
