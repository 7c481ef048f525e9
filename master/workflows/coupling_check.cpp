#include "master/workflows/coupling_check.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "master/engine/engine.h"
#include "master/engine/wiring/arrangement.h"
#include "master/results/summary.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using fmu::Finding;

constexpr std::size_t kMostUnknowns = 200;  // of a loop that is measured
constexpr std::size_t kMostNames = 6;       // members or connections that are listed

std::string listed(const std::vector<std::string>& names) {
  std::string list;
  for (std::size_t i = 0; i < std::min(names.size(), kMostNames); ++i) list += (i == 0 ? "" : ", ") + names[i];
  if (names.size() > kMostNames) list += " and " + std::to_string(names.size() - kMostNames) + " more";
  return list;
}

/// "loop a, b (a.y -> b.u, b.y -> a.u): ". Several connections between elements of two vectors are listed as one.
std::string place_of(std::span<const std::size_t> group, const std::vector<ResolvedConnection>& links,
                     std::span<const Member> members) {
  const auto in_group = [&](std::size_t m) { return std::ranges::binary_search(group, m); };
  const auto whole = [&](const Signal& s) { return members[s.member].name() + "." + s.variable->name; };
  std::vector<std::string> names, connections;
  std::map<std::string, std::size_t> listed_at;  // by the names of the vectors
  for (const std::size_t m : group) names.push_back(members[m].name());
  for (const ResolvedConnection& link : links) {
    if (!is_continuous(link) || !in_group(link.from.member) || !in_group(link.to.member)) continue;
    const std::string vectors = whole(link.from) + " -> " + whole(link.to);
    if (const auto [at, is_new] = listed_at.emplace(vectors, connections.size()); is_new) {
      connections.push_back(link.from.name + " -> " + link.to.name);
    } else {
      connections[at->second] = vectors;
    }
  }
  return "loop " + listed(names) + " (" + listed(connections) + "): ";
}

const Member* without_way_back(std::span<const std::size_t> group, std::span<const Member> members) {
  for (const std::size_t m : group) {
    if (!members[m].instance.unit->has_cheap_rollback()) return &members[m];
  }
  return nullptr;
}

/// What the run does with a loop that was not measured because an FMU has no cheap way back.
std::string advice_without_rollback(const std::string& name, CouplingChoice coupling) {
  const std::string fact = "its gain is not measured, because '" + name + "' restores earlier states only in a new instance; ";
  switch (coupling) {
    case CouplingChoice::kAuto:
      return fact + "coupling=auto steps it explicitly, expected rollback=true in the source of '" + name +
             "' or coupling=implicit if explicit steps diverge";
    case CouplingChoice::kImplicit:
      return fact + "coupling=implicit makes such an instance in every iteration, expected rollback=true in its source";
    case CouplingChoice::kExplicit:
      break;
  }
  return fact + "expected rollback=true in its source, and coupling=auto or implicit if explicit steps diverge";
}

std::string facts_of(const LoopReport& loop, double tick) {
  std::string facts = "gain " + text::to_text(loop.gain, 3) + " in a tick of " + duration(tick);
  if (loop.algebraic) facts += ", its values depend on one another without delay";
  if (loop.border == 0) return facts + ", explicit steps diverge (also in 1/1024 tick)";
  if (std::isfinite(loop.border)) return facts + ", explicit steps diverge above " + duration(loop.border);
  return facts + ", explicit steps are stable (also in " + text::to_text(std::round(loop.examined / tick)) + " ticks)";
}

Finding judge(const LoopReport& loop, const Scenario& scenario, const std::string& place) {
  const std::string facts = place + facts_of(loop, scenario.tick.seconds()) + "; ";
  const bool diverges = loop.border <= scenario.tick.seconds();
  switch (scenario.coupling) {
    case CouplingChoice::kAuto: {
      const char* steps = diverges ? "coupling=auto steps it so until its values grow" : "coupling=auto steps it so";
      return {Finding::Level::kNote, facts + (loop.needs_solving() ? "coupling=auto solves it" : steps)};
    }
    case CouplingChoice::kImplicit:
      return {Finding::Level::kNote,
              facts + "coupling=implicit solves it" + (loop.needs_solving() ? "" : ", which it does not need")};
    case CouplingChoice::kExplicit:
      break;
  }
  if (loop.algebraic || diverges || !(loop.gain < 1)) {
    const bool smaller_tick = !loop.algebraic && loop.border > 0;
    return {Finding::Level::kWarning,
            facts + "expected coupling=auto or implicit" + (smaller_tick ? ", or a tick well below that" : "")};
  }
  return {Finding::Level::kNote,
          facts + (loop.needs_solving() ? "coupling=auto would solve it for less error" : "coupling=explicit is good for it")};
}

}  // namespace

std::vector<Finding> check_coupling(const Scenario& scenario, std::span<Member> members) {
  std::vector<Finding> findings;
  const std::vector<ResolvedConnection> links = resolve_connections(scenario, members);
  const auto groups = coupled_groups(links, members);
  const auto may_measure = [&](const std::vector<std::size_t>& group) {
    return count_unknowns(links, group) <= kMostUnknowns && without_way_back(group, members) == nullptr;
  };
  const auto hinders =
      std::ranges::find_if(members, [](const Member& member) { return !member.instance.unit->has_cheap_rollback(); });
  std::vector<LoopReport> loops(groups.size());
  if (hinders == members.end() && std::ranges::any_of(groups, may_measure)) {
    Scenario unsolved = scenario;
    unsolved.coupling = CouplingChoice::kExplicit;  // then initialise() measures nothing
    Engine engine(unsolved, members, 1, false);
    engine.initialise(scenario.start);
    loops = engine.measure_loops(scenario.start, kMostUnknowns);
  }
  for (std::size_t g = 0; g < groups.size(); ++g) {
    const std::string place = place_of(groups[g], links, members);
    const auto note = [&](const std::string& what) { findings.push_back({Finding::Level::kNote, place + what}); };
    if (const std::size_t unknowns = count_unknowns(links, groups[g]); unknowns > kMostUnknowns) {
      note(
          "its gain is not measured here, because it has " + std::to_string(unknowns) + " unknowns, more than " +
          std::to_string(kMostUnknowns) +
          (unknowns > kMostMeasured ? "; coupling=auto does not measure it either" : "; coupling=auto measures it in the run"));
    } else if (const Member* member = without_way_back(groups[g], members)) {
      const bool wrong = scenario.coupling != CouplingChoice::kImplicit && is_declared_algebraic(links, members, groups[g]);
      const std::string fact =
          wrong ? "its values depend on one another without delay, and each step uses those of the last one; " : "";
      findings.push_back({wrong ? Finding::Level::kWarning : Finding::Level::kNote,
                          place + fact + advice_without_rollback(member->name(), scenario.coupling)});
    } else if (hinders != members.end()) {
      note("its gain is not measured here, because '" + hinders->name() +
           "' has no cheap way back and check does not run it; coupling=auto measures it in the run");
    } else if (std::isnan(loops[g].gain)) {
      note("its gain is not known, because a unit cannot step over a whole tick from the start; coupling=auto solves it");
    } else {
      findings.push_back(judge(loops[g], scenario, place));
    }
  }
  for (const std::vector<std::size_t>& group : unsolvable_groups(links, members)) {
    const auto stays = std::ranges::find_if(group, [&](std::size_t m) { return !members[m].instance.unit->restorable(); });
    const std::string fact =
        "'" + members[*stays].name() + "' cannot be restored, so that the loop is neither measured nor solved";
    if (is_declared_algebraic(links, members, group)) {
      findings.push_back(
          {Finding::Level::kWarning,
           place_of(group, links, members) +
               "its values depend on one another without delay, and each step uses those of the last one, because " + fact +
               "; expected rollback=true in the source of an FMU that can get and set its state"});
    } else {
      findings.push_back({Finding::Level::kNote, place_of(group, links, members) + fact});
    }
  }
  return findings;
}

}  // namespace cotwin::master
