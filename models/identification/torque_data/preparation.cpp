#include "models/identification/torque_data/preparation.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::identification {

namespace {

/// y'' + 2 ω y' + ω² y = ω² u over a time h in which u goes linearly from u_0 to u_1, exactly. With e = y − (u − 2 u'/ω), the
/// particular solution of a ramp, e'' + 2 ω e' + ω² e = 0: e(t) = (e_0 + (e_0' + ω e_0) t) e^{−ω t}.
void follow(double omega, double h, double u_0, double u_1, double& y, double& dy) {
  const double slope = (u_1 - u_0) / h;
  const double e = y - (u_0 - 2 * slope / omega);
  const double rise = (dy - slope) + omega * e;
  const double decay = std::exp(-omega * h);
  y = (u_1 - 2 * slope / omega) + (e + rise * h) * decay;
  dy = slope + (rise - omega * (e + rise * h)) * decay;
}

}  // namespace

CausalFilter::CausalFilter(std::size_t joints, double cutoff)
    : joints_(joints), omega_(0), state_(9 * joints, 0.0), output_(4 * joints, 0.0) {
  set_cutoff(cutoff);
}

void CausalFilter::set_cutoff(double cutoff) {
  if (!(cutoff > 0) || !std::isfinite(cutoff)) throw Error("cutoff", text::to_text(cutoff) + " Hz, expected above 0");
  omega_ = 2 * std::numbers::pi * cutoff;
}

void CausalFilter::reset(std::span<const double> q, std::span<const double> dq, std::span<const double> tau) {
  const std::span<const double> inputs[3] = {q, dq, tau};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < joints_; ++j) {
      double* s = &state_[3 * (k * joints_ + j)];
      s[0] = s[1] = inputs[k][j];
      s[2] = 0;
    }
  write_output();
}

void CausalFilter::step(double h, std::span<const double> q, std::span<const double> dq, std::span<const double> tau) {
  const std::span<const double> inputs[3] = {q, dq, tau};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < joints_; ++j) {
      double* s = &state_[3 * (k * joints_ + j)];
      follow(omega_, h, s[0], inputs[k][j], s[1], s[2]);
      s[0] = inputs[k][j];
    }
  write_output();
}

void CausalFilter::write_output() {
  for (std::size_t j = 0; j < joints_; ++j) {
    output_[j] = state_[3 * j + 1];
    output_[joints_ + j] = state_[3 * (joints_ + j) + 1];
    output_[2 * joints_ + j] = state_[3 * (joints_ + j) + 2];
    output_[3 * joints_ + j] = state_[3 * (2 * joints_ + j) + 1];
  }
}

double CausalFilter::delay() const { return 2 / omega_; }

}  // namespace cotwin::identification
