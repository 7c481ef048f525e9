#pragma once
#include <cstddef>

namespace cotwin::robot {

/// J̇ from J (6 x n each, linear first, column-major with leading dimensions `ld`, `ld_rate`) and the velocities dq of n joints, each
/// after the joints that carry it. A joint i is turned by the joints up to it and its lever arm is changed by those beyond it:
///   ∂J_i/∂q_j = [ω_j × v_i; ω_j × ω_i] for j ≤ i,   [ω_i × v_j; 0] for j > i,   J_i = [v_i; ω_i]
/// (for example Bruyninckx and De Schutter, IEEE T-RA 12(2), 1996). Prismatic joints have ω = 0; columns of joints that do not move
/// the frame are 0 and stay so.
void jacobian_rate(int n, const double* J, std::ptrdiff_t ld, const double* dq, double* dJ, std::ptrdiff_t ld_rate);

}  // namespace cotwin::robot
