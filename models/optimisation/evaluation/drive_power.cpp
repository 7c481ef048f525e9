#include "models/optimisation/evaluation/drive_power.h"

#include <algorithm>
#include <cmath>

namespace cotwin::optimisation {

using energetics::Bus;

DrivePower::DrivePower(const Electrical& e, std::size_t joints)
    : c_{{},
         e.bus,
         e.standby.P_0 + e.standby.P_brake,
         e.standby.controller,
         1 / e.supply.efficiency,
         e.supply.eta_r,
         e.link.stored(e.link.V_min),
         e.link.stored(e.link.V_max),
         e.link.stored(e.V > 0 ? e.V : e.link.V_min)} {
  const double m = energetics::copper_factor(e.current);
  for (std::size_t j = 0; j < joints; ++j) {
    const double k_t = e.losses.k_t[j];
    c_.joints.push_back({m * e.losses.R[j] / (k_t * k_t), e.losses.V_0[j] / k_t, e.losses.k_h[j], e.losses.k_e[j]});
  }
}

void DrivePower::power(std::size_t states, const double* tau, const double* dq, double* power) const {
  std::fill_n(power, states, c_.idle);
  const double least = c_.bus == Bus::kSeparate ? 0 : -std::numeric_limits<double>::infinity();
  for (const Joint& joint : c_.joints) {
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
  double supplied = 0, returned = 0, stored = c_.start;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double taken = power[i] * weights[i];
    if (c_.bus != Bus::kShared) {
      (taken > 0 ? supplied : returned) += std::abs(taken);
      continue;
    }
    stored -= taken * T;
    if (stored < c_.least) {
      supplied += (c_.least - stored) / T;
      stored = c_.least;
    }
    stored = std::min(stored, c_.most);  // the chopper
  }
  return T * (c_.per_supplied * supplied - c_.per_returned * returned + c_.controller);
}

}  // namespace cotwin::optimisation
