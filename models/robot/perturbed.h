#pragma once
#include <cstdint>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Another specimen of the same robot: each body's mass distribution is deformed by a random affine map, which keeps it a
/// physical one. With u, U uniform in [−1, 1], its pseudo-inertia P = [Σ h; hᵀ m] becomes A P Aᵀ,
///   A = [U_3 + bound/2 U,  bound ℓ u;  0, √(1 + bound u)],      ℓ the body's radius of gyration about its centre of mass
/// so that masses differ by `bound` at most, principal moments by up to about 1.8 `bound`, centres of mass by up to
/// √3 ℓ bound / √(1 − bound). The same seed makes the same robot. Throws Error unless 0 ≤ bound ≤ 0.5, or if a body has no
/// physical inertia.
RobotModel perturbed(const RobotModel& robot, double bound, std::uint64_t seed);

}  // namespace cotwin::robot
