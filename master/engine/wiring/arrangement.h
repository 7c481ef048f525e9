#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"

/// Loops of connections, and the order in which units are stepped where loops are solved.
namespace cotwin::master {

/// A connection that can be solved for: from a continuous real output to a real input.
bool is_continuous(const ResolvedConnection& link);

/// Groups of members that feed one another by continuous connections (strongly connected components), members ascending. A
/// member with a period, or one that cannot be restored, is in no group: it uses what the others had sent before its step.
std::vector<std::vector<std::size_t>> coupled_groups(const std::vector<ResolvedConnection>& links,
                                                     std::span<const Member> members);
/// Likewise the groups that would be larger if all of their members could be restored.
std::vector<std::vector<std::size_t>> unsolvable_groups(const std::vector<ResolvedConnection>& links,
                                                        std::span<const Member> members);

/// Number of the elements of outputs in a group that feed inputs in it.
std::size_t count_unknowns(const std::vector<ResolvedConnection>& links, std::span<const std::size_t> group);

/// Whether values in a group depend on one another without delay by the declared dependencies of its units, whatever the values are.
bool is_declared_algebraic(const std::vector<ResolvedConnection>& links, std::span<const Member> members,
                           std::span<const std::size_t> group);

/// The stages of the scenario.
Arrangement arrange_as_given(std::span<const Member> members);

/// The order of the signal flow: a member steps after all that it depends on. Members of a loop keep the order of their stages
/// among themselves. A solved group steps as one, in the first stage of its members. `once_first`: members that cannot be
/// restored step before all others, with values that are not taken back.
Arrangement arrange_by_flow(const std::vector<ResolvedConnection>& links, std::span<const Member> members,
                            std::span<const std::vector<std::size_t>> solved, bool once_first);

}  // namespace cotwin::master
