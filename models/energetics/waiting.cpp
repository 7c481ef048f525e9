#include "models/energetics/waiting.h"

#include <algorithm>
#include <limits>

namespace cotwin::energetics {

Waiting wait(const Standby& s, double P_hold, double t) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double on = s.P_0 + s.P_brake + P_hold, busy = s.t_close + s.t_release, saved = on - s.P_off;
  Waiting w;
  w.held = on * t;
  w.closed = t >= busy ? on * busy + s.P_off * (t - busy) + s.E_release : kNever;
  w.break_even = saved > 0 ? busy + s.E_release / saved : kNever;
  w.closes = w.closed < w.held;
  w.energy = std::min(w.held, w.closed);
  return w;
}

}  // namespace cotwin::energetics
