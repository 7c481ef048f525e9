#include "models/optimisation/drive_power.h"

#include <algorithm>
#include <cmath>

namespace cotwin::optimisation {

using energetics::Bus;

DrivePower::DrivePower(const Electrical& e, std::size_t joints)
    : bus_(e.bus),
      idle_(e.standby.P_0 + e.standby.P_brake),
      controller_(e.standby.controller),
      per_supplied_(1 / e.supply.efficiency),
      per_returned_(e.supply.eta_r),
      least_(e.link.stored(e.link.V_min)),
      most_(e.link.stored(e.link.V_max)),
      start_(e.link.stored(e.V > 0 ? e.V : e.link.V_min)) {
  const double m = energetics::copper_factor(e.current);
  for (std::size_t j = 0; j < joints; ++j) {
    const double k_t = e.losses.k_t[j];
    joints_.push_back({m * e.losses.R[j] / (k_t * k_t), e.losses.V_0[j] / k_t, e.losses.k_h[j], e.losses.k_e[j]});
  }
}

void DrivePower::power(std::size_t states, const double* tau, const double* dq, double* power) const {
  std::fill_n(power, states, idle_);
  const double least = bus_ == Bus::kSeparate ? 0 : -std::numeric_limits<double>::infinity();
  for (const Joint& joint : joints_) {
    for (std::size_t i = 0; i < states; ++i) {
      const double t = tau[i], v = dq[i];
      const double own =
          t * v + joint.copper * t * t + joint.converter * std::abs(t) + joint.iron * std::abs(v) + joint.eddy * v * v;
      power[i] += std::max(own, least);
    }
    tau += states;
    dq += states;
  }
}

double DrivePower::drawn(std::span<const double> power, std::span<const double> weights, double T) const {
  double supplied = 0, returned = 0, stored = start_;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double taken = power[i] * weights[i];
    if (bus_ != Bus::kShared) {
      (taken > 0 ? supplied : returned) += std::abs(taken);
      continue;
    }
    stored -= taken * T;
    if (stored < least_) {
      supplied += (least_ - stored) / T;
      stored = least_;
    }
    stored = std::min(stored, most_);  // the chopper
  }
  return T * (per_supplied_ * supplied - per_returned_ * returned + controller_);
}

}  // namespace cotwin::optimisation
