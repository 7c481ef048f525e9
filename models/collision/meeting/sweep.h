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
  bool first = false;       // ends where they meet first
};

/// `meets`: up to t they do not meet, and there they are nearer than the limit that `enough` stands for, or above it by at most SweepLimits::finest.
struct Least {
  double t = 0, d = 0;
  bool meets = false;
};

/// The least distance of two parts in an interval, from its beginning on. Between two instants it changes by at most the sum of the longest paths of their
/// points, `travel`, so it is at least (d_from + d_to − travel) / 2; the interval is divided where that bound is the lowest until it is enough
/// (Piyavskii 1972). Nothing is passed, however thin it is.
/// measure(t, most): the distance, or a lower bound that is at least `most`. travel(from, to): m. enough(d): where d is known, a distance of this changes
/// nothing. Allocates nothing if `stack` has room for one interval more than are measured.
template <class Measure, class Travel, class Enough>
Least least_distance(const Interval& whole, const SweepLimits& limits, std::vector<Interval>& stack, const Measure& measure,
                     const Travel& travel, const Enough& enough) {
  Least least = whole.d_from <= whole.d_to ? Least{whole.from, whole.d_from} : Least{whole.to, whole.d_to};
  int measured = 0;
  stack.assign(1, whole);
  while (!stack.empty()) {
    const Interval interval = stack.back();
    stack.pop_back();
    const double moved = travel(interval.from, interval.to), lowest = (interval.d_from + interval.d_to - moved) / 2;
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
