#pragma once
#include <span>
#include <string>
#include <vector>

#include "master/run/members.h"
#include "master/run/wiring.h"

namespace cotwin::master {

/// What a scenario most likely forgot, a warning each, "place: …":
///   - an essential variable (Variable::essential) that nothing is connected to, and that has no start value and no event
///   - an input dx next to an input x that follows a source whose derivative is known
///   - a force or torque that one of two connected units returns and the other does not take
///   - a push, an event or a start value of a force or torque, that two connected units share and only one of them gets
///   - events that come after the end of the run
/// A start value, also 0, says that a variable was not forgotten. `links` are those of the scenario. The values of the members
/// are the start values, because what is essential may depend on parameters.
std::vector<std::string> find_omissions(const Scenario& scenario, std::span<const Member> members, std::span<const Link> links);

}  // namespace cotwin::master
