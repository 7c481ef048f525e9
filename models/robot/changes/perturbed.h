#pragma once
#include <cstdint>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Varies the mass distribution of each body by a random affine map, which keeps it physical.
/// With u, U uniform in [−1, 1], its pseudo-inertia P = [Σ h; hᵀ m] becomes A P Aᵀ,
///   A = [U_3 + bound/2 U,  bound ℓ u;  0, √(1 + bound u)],      ℓ the body's radius of gyration about its centre of mass
/// so that masses differ by at most `bound`, principal moments by up to about 1.8 `bound`, centres of mass by up to
/// √3 ℓ bound / √(1 − bound). Equal seeds give equal robots. Throws Error unless 0 ≤ bound ≤ 0.5, or if a body has no
/// physical inertia.
RobotModel perturbed(const RobotModel& robot, double bound, std::uint64_t seed);

}  // namespace cotwin::robot
