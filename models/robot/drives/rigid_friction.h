#pragma once
#include <algorithm>

/// Friction of a rigid joint in planned motions, as in (2b) without Stribeck effect and presliding: τ_f = τ_C s + σ q̇ + τ_0.
namespace cotwin::robot {

/// v_0, rad/s or m/s: a joint that is slower rests or turns around, where friction holds what it must, up to τ_C.
inline constexpr double kRestSpeed = 1e-3;
/// s of one instant of a motion: sat(q̇/v_0).
inline double coulomb_share(double dq) { return std::min(std::max(dq / kRestSpeed, -1.0), 1.0); }
/// s where the duration is not known yet, so that the speed is one only up to a factor: sgn q̇, 0 at rest.
inline double coulomb_sign(double dq) { return (dq > 0) - (dq < 0); }

/// τ_f, N m or N, with one of these s. τ_C, τ_0 in N m or N, σ in N m s/rad or N s/m.
inline double rigid_friction(double tau_C, double sigma, double tau_0, double s, double dq) {
  return tau_C * s + sigma * dq + tau_0;
}

}  // namespace cotwin::robot
