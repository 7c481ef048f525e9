#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace cotwin::collision {

/// A share of a motion with the distances at its ends, or lower bounds of them.
struct Interval {
  double from = 0, to = 0, d_from = 0, d_to = 0;
};

struct SweepLimits {
  double finest = 0;        // m: an interval in which the distance changes by no more is not divided
  int most_measured = 500;  // distances; then a lower bound counts
  bool first = false;       // ends at the first time at which they meet
};

/// The least distance of a motion and its time. Meets: a time before which they do not meet; they do by 1 finest later or sooner, or that is not known.
struct Least {
  double t = 0, d = 0;
  bool meets = false;
};

/// Looks for the least distance in an interval from its beginning on. Between two instants a distance changes by at most the way of the points of the pair,
/// so it is at least (d_from + d_to − way) / 2, and the interval is divided where that bound is the lowest until it says enough (Piyavskii 1972): nothing is passed,
/// however thin it is. measure(t, most): the distance, or a lower bound that is at least `most`. way(from, to): m. enough(d): a least distance of at
/// least this changes nothing where d is known. `stack` has room; allocates nothing if it has room for as many intervals as are measured.
template <class Measure, class Way, class Enough>
Least least_distance(const Interval& whole, const SweepLimits& limits, std::vector<Interval>& stack, const Measure& measure,
                     const Way& way, const Enough& enough) {
  Least least = whole.d_from <= whole.d_to ? Least{whole.from, whole.d_from} : Least{whole.to, whole.d_to};
  int measured = 0;
  stack.assign(1, whole);
  while (!stack.empty()) {
    const Interval interval = stack.back();
    stack.pop_back();
    const double moved = way(interval.from, interval.to), lowest = (interval.d_from + interval.d_to - moved) / 2;
    const double most = enough(least.d), width = interval.to - interval.from;
    if (lowest >= most) continue;
    if (moved <= limits.finest || measured == limits.most_measured || !(width > 1e-12 * (1 + std::abs(interval.to)))) {
      if (limits.first) return {interval.from, interval.d_from, true};
      if (lowest < least.d) least = {interval.from, lowest};
      continue;
    }
    const double middle = interval.from + width * std::clamp(0.5 + (interval.d_from - interval.d_to) / (2 * moved), 0.1, 0.9);
    const double d = measure(middle, most + moved);
    ++measured;
    if (d < least.d) least = {middle, d};
    stack.push_back({middle, interval.to, d, interval.d_to});
    stack.push_back({interval.from, middle, interval.d_from, d});
  }
  return least;
}

}  // namespace cotwin::collision
