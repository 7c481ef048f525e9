#pragma once
#include "master/ssp/scenario.h"
#include "master/ssp/system.h"

/// From the tree of a system structure to components side by side.
namespace cotwin::master::ssp {

/// Components in the order of the file, with their start values in order of application (inner bindings first, so that outer
/// ones win), and the connections between them: those that pass through connectors of systems or signal dictionaries are
/// composed. Throws Error for connections to what is not there, of the wrong direction, in circles, with two sources for one
/// sink. `complain` hears of parameters that no element has.
void flatten(const Element& root, const UnitTable& units, const xml::Complaint& complain, Scenario& scenario);

}  // namespace cotwin::master::ssp
