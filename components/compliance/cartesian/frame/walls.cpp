#include "components/compliance/cartesian/frame/walls.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace cotwin::compliance {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// The largest share s ≤ 1 of `change` with |base + s change| ≤ most; 0 if |base| is above that.
double share_within(const Vector3d& base, const Vector3d& change, double most) {
  if ((base + change).squaredNorm() <= most * most) return 1;
  const double a = change.squaredNorm(), b = base.dot(change), c = base.squaredNorm() - most * most;
  if (a == 0 || c >= 0) return 0;
  return std::clamp((-b + std::sqrt(b * b - a * c)) / a, 0.0, 1.0);
}

/// Reduces the speed v of inertia M by the energy `excess`, as far as the tank does not have it.
void take(double excess, const Matrix3d& M, Vector3d& v, Tank& tank) {
  if (!(excess > 0)) return;
  const double paid = std::min(excess, tank.energy);
  tank.energy -= paid;
  const double kinetic = v.dot(M * v) / 2, left = kinetic - (excess - paid);
  v *= kinetic > 0 ? std::sqrt(std::max(left, 0.0) / kinetic) : 0.0;
}

}  // namespace

Limit confine(const FrameLimits& limits, const DesiredFrame& desired, const Impedance& impedance, const FrameDeviation& start,
              const Vector3d& f, double h, FrameDeviation& end, Tank& tank) {
  Limit met = Limit::kNone;
  const auto energy = [&](const FrameDeviation& at) {
    return (at.dx.dot(impedance.M * at.dx) + at.x.dot(impedance.S * at.x)) / 2;
  };
  if (limits.v_max > 0) {
    const double share = share_within(desired.v, end.dx, limits.v_max);
    if (share < 1) {
      end.dx *= share;
      end.x = start.x + h / 2 * (start.dx + end.dx);
      met = Limit::kSpeed;
    }
  }
  const Matrix3d inverse = impedance.M.inverse();
  constexpr int kSweeps = 2;  // an impulse changes the speeds along the other axes if M is not diagonal
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (int i = 0; i < 3; ++i) {
      const Limits side{.q_min = limits.p_min[i], .q_max = limits.p_max[i], .braking = limits.braking};
      const Desired d{desired.p[i], desired.v[i]};
      if (clear_of(side, d, {end.x[i], end.dx[i]}, h)) continue;
      const Allowed may = allowed(side, d, {start.x[i], start.dx[i]}, h);
      const double v = std::max(std::min(end.dx[i], may.dx_high), may.dx_low);
      const bool held = v != end.dx[i] || end.x[i] > may.x_high || end.x[i] < may.x_low;
      if (!held) continue;
      end.dx += inverse.col(i) * ((v - end.dx[i]) / inverse(i, i));
      end.x[i] = std::max(std::min(start.x[i] + h / 2 * (start.dx[i] + v), may.x_high), may.x_low);
      met = Limit::kPosition;
    }
  }
  if (met != Limit::kNone) take(energy(end) - energy(start) - f.dot(end.x - start.x), impedance.M, end.dx, tank);
  return met;
}

Limit confine(const FrameLimits& limits, const Vector3d& w_d, Potential potential, const Impedance& impedance,
              const Turn& start, const Vector3d& m, double h, Turn& end, Tank& tank) {
  if (limits.w_max <= 0) return Limit::kNone;
  const double share = share_within(w_d, end.w, limits.w_max);
  if (share == 1) return Limit::kNone;
  end.w *= share;
  const Vector3d way = h / 2 * (start.w + end.w);
  end.Q = quaternion_of(way) * start.Q;
  if (end.Q.w() < 0) end.Q.coeffs() *= -1;
  const auto energy = [&](const Turn& at) {
    return at.w.dot(impedance.M * at.w) / 2 + potential_energy(potential, impedance.S, at.Q);
  };
  take(energy(end) - energy(start) - m.dot(way), impedance.M, end.w, tank);
  return Limit::kSpeed;
}

}  // namespace cotwin::compliance
