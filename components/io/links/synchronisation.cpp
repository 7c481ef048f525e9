#include "components/io/links/synchronisation.h"

#include <algorithm>
#include <cmath>

#include "models/numerics/jury.h"

namespace cotwin::io {

Synchronisation::Synchronisation(std::size_t joints) : e_(joints), correction_(joints), q_(joints) {}

void Synchronisation::start(std::span<const double> q) {
  std::ranges::copy(q, q_.begin());
  std::ranges::fill(e_, 0);
  std::ranges::fill(correction_, 0);
  measured_ = false;
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
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const double q = q_v[i] + correction_[i];
    const double most = gains.dq_max[i] * h;
    if (!std::isfinite(q) || !(most >= 0)) continue;
    q_[i] = std::clamp(q, q_[i] - most, q_[i] + most);
  }
  return q_;
}

bool is_synchronisation_stable(double a, double K_P, double K_D_over_h, std::size_t delay) {
  std::vector<double> c(4 + delay);
  c[0] = 1;
  c[1] = a - 1;
  c[2 + delay] += a * (K_P + K_D_over_h);
  c[3 + delay] = -a * K_D_over_h;
  return numerics::is_stable_polynomial(c);
}

}  // namespace cotwin::io
