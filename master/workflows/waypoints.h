#pragma once
#include <span>
#include <string>

#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// Applies `--waypoints [MOTION=]FILE.csv` or `--waypoints '[MOTION=]POINT; POINT; …'` to a scenario: replaces the waypoints of the
/// component MOTION, or of the only unit:motion. A point has one number per joint, with blanks or commas between them, and may
/// begin with its time of arrival, "2.5: 0 0.3 0"; without times the legs last trajectory::calm_duration().
///
/// The drive trains that the motion reaches by connections begin at the first waypoint, unless a connection or `--set` gives their
/// q0. With `extend`, a run that would stop before the motion ends is extended to its end. Throws Error for malformed points, and
/// for a unit that has no waypoints of joints.
void set_waypoints(Scenario& scenario, const std::string& given, bool extend, std::span<const UnitType> types);

}  // namespace cotwin::master
