#pragma once
#include <span>
#include <string>
#include <vector>

#include "master/run/schedule.h"
#include "master/run/wiring.h"

/// Makes inputs and outputs of all units agree before the first step.
namespace cotwin::master {

struct Initialisation {
  int rounds = 0;                 // sweeps until nothing changed, of the circle of units that took most; 1: there is none
  std::vector<std::string> loop;  // members of the algebraic loops that had to be solved; empty if there was none
  int iterations = 0;             // evaluations of the loops
};

/// Exchanges and initialises in the order of the signal flow, a unit that does not lead back to itself once. A circle of units
/// is swept until no input changes. What still changes after every unit of it could have heard of every other is an algebraic
/// loop: it is solved with Anderson's acceleration of the fixed-point iteration
/// (depth 8; a linear loop of that many unknowns is solved exactly, contracting or not) to 1e-12 relative to 1 + |value|.
/// Throws Error that names the members of a loop that cannot be solved, and the unit whose initialise throws.
Initialisation initialise_units(std::span<Member> members, const Schedule& schedule, const std::vector<Link>& links,
                                Wiring& wiring, Time start);

/// Strongly connected components of the graph whose edges are `edges[node]`, the components in topological order (sources
/// first), nodes within a component ascending.
std::vector<std::vector<std::size_t>> strong_components(const std::vector<std::vector<std::size_t>>& edges);

}  // namespace cotwin::master
