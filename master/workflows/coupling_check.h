#pragma once
#include <span>
#include <vector>

#include "fmu/check/check.h"
#include "master/engine/wiring/members.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// How the loops of continuous connections couple within a tick, and which coupling and tick they need: a finding per loop, none
/// without loops. For loops of at most 200 unknowns the units are initialised and stepped from the start time, if all of the
/// scenario have a cheap way back (Unit::has_cheap_rollback). `members`: of a scenario without errors, not initialised. Throws Error as
/// Engine::initialise.
std::vector<fmu::Finding> check_coupling(const Scenario& scenario, std::span<Member> members);

}  // namespace cotwin::master
