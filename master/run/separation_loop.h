#pragma once
#include <span>
#include <string>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"

namespace cotwin::master {

/// What a scenario makes of the robots that a unit:monitor with `separation` is to stop: robot ← motion ← speed.
struct SeparationLoop {
  std::vector<std::string> warnings;  // what does not stop a robot in time, and which connection is right; "place: …"
  std::vector<std::string> notes;     // one for each robot, with its path, also of what is not known
};

/// The members must have their start values. Events count at their times.
SeparationLoop trace_separation(const Scenario& scenario, std::span<const Member> members,
                                std::span<const ResolvedConnection> links);

}  // namespace cotwin::master
