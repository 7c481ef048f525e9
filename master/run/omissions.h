#pragma once
#include <span>
#include <string>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"

namespace cotwin::master {

/// Probable omissions of a scenario, one warning each, "place: …":
///   - an essential variable (Variable::essential) without connection, start value and event
///   - an input dx without a value, where x is connected to a source with a declared derivative
///   - a force or torque that one of two connected units returns and the other does not receive
///   - an event or start value of an external force or torque that acts on two connected units and is given to one of them
///   - events after the end of the run
/// A required variable (Variable::required) without any of them is an Error, because the unit would act on its default.
/// A start value, also 0, means that a variable was not forgotten. The members must have their start values, because parameters
/// may decide what is essential.
std::vector<std::string> find_omissions(const Scenario& scenario, std::span<const Member> members,
                                        std::span<const ResolvedConnection> links);

}  // namespace cotwin::master
