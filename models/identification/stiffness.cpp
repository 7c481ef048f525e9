#include "models/identification/stiffness.h"

#include <algorithm>
#include <cmath>

namespace cotwin::identification {

void TorsionFit::add(double tau_J, double dq, double torsion) {
  Eigen::Vector3d z(tau_J, dq, torsion);
  if (count_ == 0) origin_ = z;
  z -= origin_;
  count_ += 1;
  sum_ += z;
  products_ += z * z.transpose();
}

Torsion TorsionFit::solve(double independent) const {
  Torsion result;
  if (count_ < 4) return result;
  const Eigen::Vector3d mean = sum_ / count_;
  const Eigen::Matrix3d S = products_ / count_ - mean * mean.transpose();  // covariances of τ_J, q̇ and θ − q
  // What the speed explains is taken out of torque and torsion first (Frisch, Waugh 1933).
  const bool moves = S(1, 1) > 0;
  const double torque_by_speed = moves ? S(0, 1) / S(1, 1) : 0, torsion_by_speed = moves ? S(2, 1) / S(1, 1) : 0;
  const double torque = S(0, 0) - torque_by_speed * S(0, 1), torsion = S(2, 2) - torsion_by_speed * S(2, 1),
               both = S(0, 2) - torque_by_speed * S(1, 2);
  constexpr double kRounding = 1e-12;  // of the variances, that is left of what the speed explains wholly
  if (!(torque > kRounding * S(0, 0) && torsion > kRounding * S(2, 2))) return result;
  const double compliance = both / torque;
  result.correlation = both / std::sqrt(torque * torsion);
  result.lag = torsion_by_speed - compliance * torque_by_speed;
  const Eigen::Vector3d centre = mean + origin_;
  result.offset = centre[2] - compliance * centre[0] - result.lag * centre[1];
  const double rest = std::max(0.0, torsion - compliance * both);
  const double deviation = std::sqrt(rest / torque / std::max(1.0, independent - 3));
  constexpr double kKnown = 0.3, kExplained = 0.5;
  if (!(compliance > 0) || deviation > kKnown * compliance || result.correlation * result.correlation < kExplained)
    return result;
  result.K = 1 / compliance;
  result.deviation = deviation / (compliance * compliance);
  return result;
}

}  // namespace cotwin::identification
