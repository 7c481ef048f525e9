#pragma once
#include <Eigen/Core>
#include <cstdint>

#include "components/compliance/cartesian/frame/rotation.h"
#include "components/compliance/cartesian/frame/translation.h"
#include "components/compliance/joints/admittance.h"
#include "components/compliance/joints/limits.h"

namespace cotwin::compliance {

/// Limits of the compliant frame in the axes of W: a box for its origin and bounds of its speeds.
struct FrameLimits {
  Eigen::Vector3d p_min = Eigen::Vector3d::Zero(), p_max = Eigen::Vector3d::Zero();  // m; p_min >= p_max: none
  double v_max = 0, w_max = 0;                                                       // m/s, rad/s; 0: none
  double braking = 2;  // m/s²; deceleration before a side of the box, > 0

  bool any() const { return v_max > 0 || w_max > 0 || (p_min.array() < p_max.array()).any(); }
};

/// The desired motion of the frame at the end of a step, in W.
struct DesiredFrame {
  const Eigen::Vector3d &p, &v, &w;
};

struct FrameDeviation {
  Eigen::Vector3d x = Eigen::Vector3d::Zero(), dx = Eigen::Vector3d::Zero();
};

/// Applies the box and v_max as one-sided walls (limits.h) to a step of h seconds from `start` to `end` under the mean force f,
/// everything in W. The momentum along a side is taken by an impulse, that of the other directions stays. A wall gives no energy:
/// ½ ẋᵀ M ẋ + ½ xᵀ S x rises by at most the work of f; what constant acceleration adds is taken from the tank or from the
/// speed. Returns the limit that acted.
Limit confine(const FrameLimits& limits, const DesiredFrame& desired, const Impedance& impedance, const FrameDeviation& start,
              const Eigen::Vector3d& f, double h, FrameDeviation& end, Tank& tank);

/// Applies w_max to a turn from `start` to `end` under the mean moment m, in the axes of D, where `w_d` is the desired speed.
Limit confine(const FrameLimits& limits, const Eigen::Vector3d& w_d, Potential potential, const Impedance& impedance,
              const Turn& start, const Eigen::Vector3d& m, double h, Turn& end, Tank& tank);

}  // namespace cotwin::compliance
