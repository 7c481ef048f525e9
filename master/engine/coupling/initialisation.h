#pragma once
#include <span>
#include <string>
#include <vector>

#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"

/// Initialises all units so that inputs and outputs are consistent before the first step.
namespace cotwin::master {

struct Initialisation {
  int rounds = 0;                 // largest number of sweeps over a cycle until nothing changed; 1 without a cycle
  std::vector<std::string> loop;  // members of the algebraic loops that had to be solved
  int iterations = 0;             // of Newton's method, in all loops together
};

/// Exchanges and initialises in the order of the signal flow. A unit outside of cycles is initialised once. A cycle of units is
/// swept until no input changes, first with the start values that the scenario gives to inputs and outputs of the cycle. Units
/// that still change after as many sweeps as the cycle has units form an algebraic loop, which AlgebraicLoop solves to 1e-12
/// relative to 1 + |value|. Throws Error naming the members of a loop that has no solution, no unique one, or several and no
/// start value, or the unit whose initialise throws. A cycle that settles in the sweeps is not searched for other solutions.
Initialisation initialise_units(std::span<Member> members, const Schedule& schedule,
                                const std::vector<ResolvedConnection>& links, Wiring& wiring, Time start);

}  // namespace cotwin::master
