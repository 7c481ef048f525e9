#pragma once
#include <limits>
#include <span>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// The phase s(t) at which a motion q(s) is run through: at full rate 1/stretch, after a soft start and before a soft stop in
/// which ds/dt rises from and falls to zero as x³(10 − 15x + 6x²), so that q̈ stays continuous and a motion that begins or ends
/// with a velocity is entered and left from rest.
class Phase {
 public:
  Phase() = default;
  /// `length` of s in seconds; the ramps are durations before stretching. Throws Error for stretch <= 0, negative ramps, or
  /// ramps that need more than the length (each takes half its duration of it).
  Phase(double length, double stretch = 1, double ramp_up = 0, double ramp_down = 0);

  struct Value {
    double s = 0, ds = 0, dds = 0, ddds = 0;  // and derivatives with respect to t
  };
  /// Rests at 0 before t = 0, at the length after the duration.
  Value at(double t) const;
  double duration() const;
  /// When s is reached.
  double time_of(double s) const;
  double length() const { return length_; }
  /// The greatest ds/dt, |d²s/dt²|, |d³s/dt³|.
  Value largest() const;

 private:
  double length_ = 0, stretch_ = 1, up_ = 0, down_ = 0;
};

/// q(s(t)): turns derivatives with respect to s into those with respect to t, in place.
void chain(const Phase::Value& phase, std::span<double> dq, std::span<double> ddq, std::span<double> dddq = {});

/// What a joint may do. Infinite: anything.
struct Limits {
  double dq = std::numeric_limits<double>::infinity();    // rad/s
  double ddq = std::numeric_limits<double>::infinity();   // rad/s²
  double dddq = std::numeric_limits<double>::infinity();  // rad/s³
};

/// A bound of the magnitude of a joint's q̇ (derivative 1), q̈ (2) or jerk (3) on `path` run through by `phase`: the largest
/// value itself where the phase has no ramps; with ramps a safe bound, |q″| ṡ² + |q′| |s̈| and so on with the greatest of each.
double bound(const Path& path, const Phase& phase, std::size_t joint, int derivative);

/// The least factor by which to multiply all durations so that every joint keeps its limits: q̇ falls with it, q̈ with its
/// square, jerk with its cube. Less than one where there is room. Throws Error for a limit that is not positive.
double stretch_to(const Path& path, const Phase& phase, std::span<const Limits> limits);

}  // namespace cotwin::trajectory
