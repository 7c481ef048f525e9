#include "components/contact_world/engine/soft_contact.h"

#include <algorithm>
#include <cmath>

namespace cotwin::contact_world {
namespace {

/// Newton's method converges from one side, because the impulse is convex in u.
constexpr int kNewtonSteps = 60;

}  // namespace

double SoftContact::spring(double u) const {
  if (!conserves) return gap > 0 ? 0 : -h / 2 * stiffness * (gap + theta * h * u);
  const double end = gap + h * u;
  if (gap <= 0 && end <= 0) return -h / 4 * stiffness * (gap + end);
  if (gap > 0 && end >= 0) return 0;
  return gap > 0 ? h / 4 * stiffness * end * end / (gap - end) : h / 4 * stiffness * gap * gap / (end - gap);
}

double SoftContact::share(double u) const {
  const double end = gap + h * u;
  if (gap <= 0 && (end <= 0 || !conserves)) return 1;
  if (gap > 0 && (end >= 0 || !conserves)) return 0;
  return gap > 0 ? end / (end - gap) : gap / (gap - end);
}

double SoftContact::slope(double u) const {
  const double end = gap + h * u;
  if (!conserves) return gap > 0 ? 0 : -h / 2 * (theta * h * stiffness + damping);
  if (gap <= 0 && end <= 0) return -h / 2 * (h * stiffness / 2 + damping);
  if (gap > 0 && end >= 0) return 0;
  const double depth = gap > 0 ? -end : -gap, way = std::abs(end - gap), part = depth / way;
  // The damper's impulse is −h/2 d (depth / way) u. Entering, that is d/2 end; leaving, it is constant.
  if (gap > 0) return -h / 2 * (h * stiffness / 2 * part * (2 - part) + damping);
  return -h / 2 * (h * stiffness / 2 * part * part);
}

double SoftContact::solve(double w, double A) const {
  double u = w;
  for (int k = 0; k < kNewtonSteps; ++k) {
    const double x = impulse(u);
    const double step = (u - w - A * std::max(x, 0.0)) / (1 - (x > 0 ? A * slope(u) : 0));
    u -= step;
    if (!(std::abs(step) > 1e-12 * std::abs(w))) break;
  }
  return u;
}

}  // namespace cotwin::contact_world
