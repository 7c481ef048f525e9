#include "components/contact_world/engine/soft_contact.h"

#include <algorithm>
#include <cmath>

namespace cotwin::contact_world {
namespace {

/// Newton's method converges from one side, because the impulse is convex in u.
constexpr int kNewtonSteps = 60;

/// The same with a limit, where half of the steps may halve an interval.
constexpr int kBoundedSteps = 160;

/// Work of the force min(k e, limit) from the depth 0 to e, J.
double work(double e, double k, double limit) {
  if (e <= 0) return 0;
  const double most = limit / k;
  return e <= most ? k * e * e / 2 : limit * (e - most / 2);
}

}  // namespace

double SoftContact::spring(double u) const {
  if (!conserves) return gap > 0 ? 0 : std::min(-h / 2 * stiffness * (gap + theta * h * u), h / 2 * limit);
  const double end = gap + h * u;
  if (-std::min(gap, end) * stiffness > limit) return h / 2 * yielding_force(u);
  if (gap <= 0 && end <= 0) return -h / 4 * stiffness * (gap + end);
  if (gap > 0 && end >= 0) return 0;
  return gap > 0 ? h / 4 * stiffness * end * end / (gap - end) : h / 4 * stiffness * gap * gap / (end - gap);
}

/// Mean force over a step in which the contact yields. It starts at the limit at most.
double SoftContact::yielding_force(double u) const {
  const double start = std::min(-gap, limit / stiffness), way = -h * u;
  if (!(std::abs(way) > 1e-12 * start)) return std::min(stiffness * std::max(start, 0.0), limit);
  return (work(start + way, stiffness, limit) - work(start, stiffness, limit)) / way;
}

double SoftContact::share(double u) const {
  const double end = gap + h * u;
  if (gap <= 0 && (end <= 0 || !conserves)) return 1;
  if (gap > 0 && (end >= 0 || !conserves)) return 0;
  return gap > 0 ? end / (end - gap) : gap / (gap - end);
}

double SoftContact::slope(double u) const {
  const double end = gap + h * u;
  if (limit < std::numeric_limits<double>::infinity() && spring(u) - h / 2 * damping * share(u) * u >= h / 2 * limit) return 0;
  if (!conserves) return gap > 0 ? 0 : -h / 2 * (theta * h * stiffness + damping);
  if (-std::min(gap, end) * stiffness > limit) {
    const double start = std::min(-gap, limit / stiffness), way = -h * u;
    if (start + way <= limit / stiffness) return -h / 2 * (h * stiffness / 2 + damping * share(u));  // it unloads
    const double falls = way > 0 ? (limit - yielding_force(u)) / way : 0;
    return -h / 2 * (h * falls + damping * share(u));
  }
  if (gap <= 0 && end <= 0) return -h / 2 * (h * stiffness / 2 + damping);
  if (gap > 0 && end >= 0) return 0;
  const double depth = gap > 0 ? -end : -gap, way = std::abs(end - gap), part = depth / way;
  // The damper's impulse is −h/2 d (depth / way) u. Entering, that is d/2 end; leaving, it is constant.
  if (gap > 0) return -h / 2 * (h * stiffness / 2 * part * (2 - part) + damping);
  return -h / 2 * (h * stiffness / 2 * part * part);
}

double SoftContact::solve(double w, double A) const {
  double u = w;
  // With a limit the impulse is not convex: Newton's steps are kept within bounds of u, which is between w and the velocity under
  // the limit, and where they do not halve the step before, the bounds are halved.
  const bool bounded = limit < std::numeric_limits<double>::infinity();
  double low = w, high = w + A * h / 2 * std::min(limit, 1e300), last = std::numeric_limits<double>::infinity();
  for (int k = 0; k < (bounded ? kBoundedSteps : kNewtonSteps); ++k) {
    const double x = impulse(u);
    double step = (u - w - A * std::max(x, 0.0)) / (1 - (x > 0 ? A * slope(u) : 0));
    if (bounded) {
      (step > 0 ? high : low) = u;
      const bool newton = u - step > low && u - step < high && std::abs(step) <= last / 2;
      if (!newton && step != 0) step = u - (low + high) / 2;
      last = std::abs(step);
    }
    u -= step;
    if (!(std::abs(step) > 1e-12 * std::abs(w))) break;
  }
  return u;
}

}  // namespace cotwin::contact_world
