#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "models/anomaly/attribution.h"

namespace cotwin::anomaly {

/// A change that was found. What a cause's size counts: kg, shares of the tuned friction, N.m, rad (TorqueModel).
struct Event {
  double since = 0, found = 0;  // s, of the session's clock
  Cause cause = Cause::kLoad;   // that explains the change best,
  Cause other = Cause::kLoad;   // and another kind that explains it at least four fifths as well; else the same
  int which = -1;               // of the causes of TorqueModel; −1 for `spread` and `brief`
  int joint = 0;                // that shows it most, from 0
  double size = 0,
         deviation = 0;  // and its standard deviation. `brief`: largest residual, N.m; `spread`: factor of the residuals' RMS
  double torque = 0;     // N.m at `joint`, with the sign of the residual: RMS; `brief`: the largest
  bool spread = false, brief = false;  // residuals scatter more, without a change that a cause explains; a blow
  std::uint64_t joints = 0;            // bit per joint that bears at least a twentieth of what `joint` does
  bool concerns(std::size_t j) const { return (joints >> j & 1) != 0; }
};

/// Calls visit for each of its numbers.
template <class Self, class Visit>
void visit_event(Self& e, Visit&& visit) {
  visit(e.since), visit(e.found), visit(e.cause), visit(e.other), visit(e.which), visit(e.joint), visit(e.size),
      visit(e.deviation);
  visit(e.torque), visit(e.spread), visit(e.brief), visit(e.joints);
}

/// "load +1.0 ± 0.1 kg, 7.4 N.m at joint 2". `joints`: of the robot.
std::string describe(const Event& event, const TorqueModel& model, const std::vector<robot::Joint>& joints);

}  // namespace cotwin::anomaly
