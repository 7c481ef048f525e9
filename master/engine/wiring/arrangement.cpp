#include "master/engine/wiring/arrangement.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "components/unit/declared_dependencies.h"
#include "master/engine/wiring/strong_components.h"

namespace cotwin::master {

namespace {

using Graph = std::vector<std::vector<std::size_t>>;

template <class Keep>
Graph graph_of(const std::vector<ResolvedConnection>& links, std::size_t nodes, Keep keep) {
  Graph edges(nodes);
  for (const ResolvedConnection& link : links) {
    if (keep(link)) edges[link.from.member].push_back(link.to.member);
  }
  for (std::vector<std::size_t>& targets : edges) {
    std::sort(targets.begin(), targets.end());
    targets.erase(std::unique(targets.begin(), targets.end()), targets.end());
  }
  return edges;
}

/// The strong components of the continuous connections between members that `takes_part`.
template <class TakesPart>
std::vector<std::vector<std::size_t>> loops_of(const std::vector<ResolvedConnection>& links, std::size_t members,
                                               TakesPart takes_part) {
  const Graph edges = graph_of(links, members, [&](const ResolvedConnection& link) {
    return is_continuous(link) && takes_part(link.from.member) && takes_part(link.to.member);
  });
  std::vector<std::vector<std::size_t>> loops;
  for (std::vector<std::size_t>& component : strong_components(edges)) {
    const std::size_t first = component.front();
    if (component.size() > 1 || std::ranges::binary_search(edges[first], first)) loops.push_back(std::move(component));
  }
  return loops;
}

}  // namespace

bool is_continuous(const ResolvedConnection& link) {
  return !link.initial && link.to.variable->role == Role::kInput && link.from.variable->kind() == Kind::kReal &&
         link.to.variable->kind() == Kind::kReal && !link.from.variable->discrete;
}

std::vector<std::vector<std::size_t>> coupled_groups(const std::vector<ResolvedConnection>& links,
                                                     std::span<const Member> members) {
  return loops_of(links, members.size(),
                  [&](std::size_t m) { return members[m].spec.period == 1 && members[m].instance.unit->restorable(); });
}

std::vector<std::vector<std::size_t>> unsolvable_groups(const std::vector<ResolvedConnection>& links,
                                                        std::span<const Member> members) {
  std::vector<std::vector<std::size_t>> groups =
      loops_of(links, members.size(), [&](std::size_t m) { return members[m].spec.period == 1; });
  std::erase_if(groups, [&](const std::vector<std::size_t>& group) {
    return std::ranges::all_of(group, [&](std::size_t m) { return members[m].instance.unit->restorable(); });
  });
  return groups;
}

std::size_t count_unknowns(const std::vector<ResolvedConnection>& links, std::span<const std::size_t> group) {
  const auto in_group = [&](std::size_t member) { return std::ranges::find(group, member) != group.end(); };
  std::set<const double*> seen;
  for (const ResolvedConnection& link : links) {
    if (!is_continuous(link) || !in_group(link.from.member) || !in_group(link.to.member)) continue;
    for (const double& value : link.from.reals()) seen.insert(&value);
  }
  return seen.size();
}

bool is_declared_algebraic(const std::vector<ResolvedConnection>& links, std::span<const Member> members,
                           std::span<const std::size_t> group) {
  /// Nodes of the graph: the connections between single elements.
  struct Wire {
    const ResolvedConnection* link;
    std::size_t element;
  };
  const auto in_group = [&](std::size_t member) { return std::ranges::find(group, member) != group.end(); };
  std::vector<Wire> wires;
  for (const ResolvedConnection& link : links) {
    if (!is_continuous(link) || !in_group(link.from.member) || !in_group(link.to.member)) continue;
    for (std::size_t e = 0; e < link.to.count; ++e) wires.push_back({&link, e});
  }
  constexpr std::size_t kMostWires = 400;  // the search takes the square of their number
  if (wires.size() > kMostWires) return false;
  Graph edges(wires.size());
  for (std::size_t a = 0; a < wires.size(); ++a) {
    const Signal& input = wires[a].link->to;
    const auto* const declared = dynamic_cast<const DeclaredDependencies*>(members[input.member].instance.unit.get());
    if (declared == nullptr) continue;
    for (std::size_t b = 0; b < wires.size(); ++b) {
      const Signal& output = wires[b].link->from;
      if (output.member == input.member &&
          declared->follows(*output.variable, output.first + wires[b].element, *input.variable, input.first + wires[a].element))
        edges[a].push_back(b);
    }
  }
  return std::ranges::any_of(strong_components(edges), [&](const std::vector<std::size_t>& component) {
    return component.size() > 1 || std::ranges::binary_search(edges[component.front()], component.front());
  });
}

Arrangement arrange_as_given(std::span<const Member> members) {
  Arrangement result;
  for (const Member& member : members) result.stage.push_back(member.spec.stage);
  result.group_of.assign(members.size(), kNoGroup);
  return result;
}

Arrangement arrange_by_flow(const std::vector<ResolvedConnection>& links, std::span<const Member> members,
                            std::span<const std::vector<std::size_t>> solved, bool once_first) {
  Arrangement result = arrange_as_given(members);
  for (std::size_t g = 0; g < solved.size(); ++g) {
    int first = std::numeric_limits<int>::max();
    for (const std::size_t m : solved[g]) first = std::min(first, members[m].spec.stage);
    for (const std::size_t m : solved[g]) {
      result.group_of[m] = g;
      result.stage[m] = first;
    }
  }
  const Graph edges = graph_of(links, members.size(), [](const ResolvedConnection& link) { return !link.initial; });
  std::map<std::pair<std::size_t, int>, int> number;  // place in the flow and stage → new stage, in this order
  std::vector<std::size_t> place(members.size());
  std::size_t next = 1;  // 0: members that step before all others
  for (const std::vector<std::size_t>& component : strong_components(edges)) {
    for (const std::size_t m : component) {
      place[m] = once_first && !members[m].instance.unit->restorable() ? 0 : next;
      number.emplace(std::pair(place[m], result.stage[m]), 0);
    }
    ++next;
  }
  int stage = 0;
  for (auto& [key, value] : number) value = stage++;
  for (std::size_t m = 0; m < members.size(); ++m) result.stage[m] = number.at({place[m], result.stage[m]});
  return result;
}

}  // namespace cotwin::master
