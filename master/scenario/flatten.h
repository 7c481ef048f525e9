#pragma once
#include "master/scenario/scenario.h"
#include "master/scenario/system.h"

/// Turns the tree of a system structure into a flat list of components.
namespace cotwin::master::ssp {

/// Writes to the scenario the components in the order of the file, their start values in order of application (inner bindings
/// first, so that outer ones take precedence) and the connections between components. Connections through connectors of systems
/// or through signal dictionaries are composed. Throws Error for connections to unknown ends, of the wrong direction, in loops,
/// or with two sources for one sink. Calls `complain` for parameters that no element has.
void flatten(const Element& root, const UnitTable& units, const xml::Complaint& complain, Scenario& scenario);

}  // namespace cotwin::master::ssp
