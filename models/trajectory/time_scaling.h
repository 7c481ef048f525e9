#pragma once
#include <array>
#include <limits>
#include <span>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// The phase s(t) of a motion q(s): rate ds/dt = 1/stretch between a soft start and a soft stop, in which ds/dt rises from and
/// falls to zero as x³(10 − 15x + 6x²). q̈ is continuous, and a path with a velocity at its ends is entered and left at rest.
class Phase {
 public:
  Phase() = default;
  /// `length` of s in seconds; the ramps are durations before stretching. Throws Error for stretch <= 0, negative ramps, or
  /// ramps that need more than the length (each needs half its duration).
  Phase(double length, double stretch = 1, double ramp_up = 0, double ramp_down = 0);

  struct Value {
    double s = 0, ds = 0, dds = 0, ddds = 0;  // and derivatives with respect to t
  };
  /// At rest at 0 before t = 0 and at the length after the duration.
  Value at(double t) const;
  double duration() const;
  /// Time at which s is reached.
  double time_of(double s) const;
  double length() const { return length_; }
  /// Largest ds/dt, |d²s/dt²|, |d³s/dt³|.
  Value largest() const;

 private:
  double length_ = 0, stretch_ = 1, up_ = 0, down_ = 0;
};

/// Chain rule for q(s(t)): converts derivatives with respect to s to those with respect to t, in place.
void apply_chain_rule(const Phase::Value& phase, std::span<double> dq, std::span<double> ddq, std::span<double> dddq = {});

/// Limits of a joint; infinite: none.
struct Limits {
  double dq = std::numeric_limits<double>::infinity();    // rad/s
  double ddq = std::numeric_limits<double>::infinity();   // rad/s²
  double dddq = std::numeric_limits<double>::infinity();  // rad/s³
};

/// An upper bound of |q̇| (derivative 1), |q̈| (2) or the |jerk| (3) of a joint on `path` with `phase`: the maximum itself
/// without ramps; with ramps a safe bound, |q″| ṡ² + |q′| |s̈| and so on from the maximum of each factor.
double bound(const Path& path, const Phase& phase, std::size_t joint, int derivative);
/// The same bound from the greatest magnitudes of the first three derivatives with respect to s.
double bound(const std::array<double, 3>& largest, const Phase& phase, int derivative);

/// The least factor for all durations with which every joint meets its limits: q̇ falls with it, q̈ with its square, jerk with
/// its cube. Less than one if the limits allow a faster motion. Throws Error for a limit that is not positive.
double stretch_to(const Path& path, const Phase& phase, std::span<const Limits> limits);

}  // namespace cotwin::trajectory
