#include "master/engine/coupling/initialisation.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "components/unit/staged_initialisation.h"
#include "master/engine/coupling/algebraic_loop.h"
#include "master/engine/wiring/strong_components.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

constexpr double kSameInput = 1e-6;  // relative to 1 + |value|
constexpr double kGrowth = 1e100;    // of outputs that diverge in sweeps

using Graph = std::vector<std::vector<std::size_t>>;

class Initialiser {
 public:
  Initialiser(std::span<Member> members, const Schedule& schedule, const std::vector<ResolvedConnection>& links, Wiring& wiring,
              Time start)
      : members_(members),
        schedule_(schedule),
        links_(links),
        wiring_(wiring),
        start_(start),
        edges_(schedule.slots.size()),
        into_(schedule.slots.size()),
        stages_(schedule.slots.size()) {
    for (const ResolvedConnection& link : links) {
      const std::size_t to = schedule.slot_of[link.to.member];
      edges_[schedule.slot_of[link.from.member]].push_back(to);
      into_[to].push_back(&link);
    }
    for (auto& targets : edges_) {
      std::sort(targets.begin(), targets.end());
      targets.erase(std::unique(targets.begin(), targets.end()), targets.end());
    }
  }

  Initialisation run() {
    for (const auto& component : strong_components(edges_)) {
      if (is_cycle(component)) {
        initialise_cycle(component);
      } else {
        wiring_.update(component.front());
        initialise(component.front());
      }
    }
    return result_;
  }

 private:
  const std::string& name(std::size_t slot) const { return members_[schedule_.slots[slot].member].name(); }

  template <class Call>
  void at_component(std::size_t slot, Call call) {
    try {
      call();
    } catch (const Error& error) {
      const ComponentSpec& spec = members_[schedule_.slots[slot].member].spec;
      fail(spec.place, "component '" + spec.name + "': " + without_component(spec.name, error.what()));
    }
  }

  /// Initialises with the present inputs; in a cycle repeatedly.
  void initialise(std::size_t slot) {
    at_component(slot, [&] {
      if (stages_[slot] != nullptr) {
        stages_[slot]->update_initialisation();
      } else {
        schedule_.slots[slot].unit->initialise(start_);
      }
    });
  }

  /// Units that support StagedInitialisation stay in their initialisation until the cycle has converged. If leaving it changes
  /// an output of a connection within the cycle, the cycle is iterated once more, with complete initialisations.
  void initialise_cycle(const std::vector<std::size_t>& slots) {
    bool staged = false;
    for (const std::size_t slot : slots) {
      wiring_.update(slot);
      set_given_inputs(slot, slots);
      auto* stages = dynamic_cast<StagedInitialisation*>(schedule_.slots[slot].unit);
      if (stages == nullptr) {
        initialise(slot);
      } else {
        at_component(slot, [&] { stages->enter_initialisation(start_); });
        stages_[slot] = stages;
        staged = true;
      }
    }
    converge(slots);
    if (!staged) return;
    const auto sources = sources_within(slots);
    const auto before = values_of(sources);
    for (const std::size_t slot : slots) {
      if (stages_[slot] == nullptr) continue;
      at_component(slot, [&] { stages_[slot]->exit_initialisation(); });
      stages_[slot] = nullptr;
    }
    if (values_of(sources) != before) converge(slots);
  }

  /// The source variables of connections between `slots`, each once.
  std::vector<const Variable*> sources_within(const std::vector<std::size_t>& slots) const {
    const auto within = [&](const Signal& signal) {
      return std::binary_search(slots.begin(), slots.end(), schedule_.slot_of[signal.member]);
    };
    std::vector<const Variable*> sources;
    for (const ResolvedConnection& link : links_) {
      if (within(link.from) && within(link.to)) sources.push_back(link.from.variable);
    }
    std::sort(sources.begin(), sources.end());
    sources.erase(std::unique(sources.begin(), sources.end()), sources.end());
    return sources;
  }

  /// The elements of real sources_within().
  std::vector<const double*> real_sources(const std::vector<std::size_t>& slots) const {
    std::vector<const double*> elements;
    for (const Variable* variable : sources_within(slots)) {
      if (variable->kind() != Kind::kReal) continue;
      for (const double& value : variable->reals()) elements.push_back(&value);
    }
    return elements;
  }

  /// Values as bytes: a NaN equals itself.
  static std::vector<std::string> values_of(const std::vector<const Variable*>& variables) {
    std::vector<std::string> values;
    for (const Variable* variable : variables) {
      std::visit(
          [&](auto span) {
            if constexpr (std::is_same_v<typename decltype(span)::value_type, std::string>) {
              values.insert(values.end(), span.begin(), span.end());
            } else {
              values.emplace_back(reinterpret_cast<const char*>(span.data()), span.size_bytes());
            }
          },
          variable->storage);
    }
    return values;
  }

  /// Real inputs that units of the cycle feed get the start values of the scenario, so that these choose the solution.
  void set_given_inputs(std::size_t slot, const std::vector<std::size_t>& slots) const {
    for (const ResolvedConnection* link : into_[slot]) {
      const Member &source = members_[link->from.member], &target = members_[link->to.member];
      const bool given = !source.given.empty() || !target.given.empty();
      if (!given || link->from.variable->kind() != Kind::kReal || !is_from(*link, slots)) continue;
      for (std::size_t e = 0; e < link->to.count; ++e) {
        double& input = link->to.reals()[e];
        if (const auto output = source.start_of(*link->from.variable, link->from.first + e)) {
          input = link->factor * *output + link->offset;
        } else {
          input = target.start_of(*link->to.variable, link->to.first + e).value_or(input);
        }
      }
    }
  }

  void converge(const std::vector<std::size_t>& slots) {
    // Each sweep passes a change along at least one connection.
    const std::vector<std::size_t> changing = sweep(slots, slots.size() + 1, true);
    if (changing.empty()) return;
    std::vector<std::size_t> rest = slots;
    for (const std::vector<std::size_t>& component : components_among(changing)) {
      if (is_loop(component)) {
        solve(component);
        std::erase_if(rest, [&](std::size_t slot) { return std::ranges::binary_search(component, slot); });
      } else {
        wiring_.update(component.front());
        initialise(component.front());
      }
    }
    if (sweep(rest, rest.size() + 1, false).empty() && inputs_agree(slots)) return;
    // The solved units depend on units that seemed to have settled.
    for (auto& [source, values] : swept_.of) {
      if (std::isfinite(*source)) values.fill(*source);
    }
    solve(slots);
  }

  void solve(const std::vector<std::size_t>& loop) {
    for (const std::size_t slot : loop) {
      const bool known = std::ranges::find(result_.loop, name(slot)) != result_.loop.end();
      if (!known) result_.loop.push_back(name(slot));
    }
    AlgebraicLoop algebraic({members_, schedule_, links_, wiring_, [this](std::size_t slot) { initialise(slot); }}, loop);
    result_.iterations += algebraic.solve(swept_);
  }

  bool is_from(const ResolvedConnection& link, const std::vector<std::size_t>& slots) const {
    return std::ranges::binary_search(slots, schedule_.slot_of[link.from.member]);
  }

  /// Whether the inputs that units of the cycle feed are the present outputs.
  bool inputs_agree(const std::vector<std::size_t>& slots) const {
    return std::ranges::all_of(slots, [&](std::size_t slot) {
      return std::ranges::all_of(into_[slot],
                                 [&](const ResolvedConnection* link) { return !is_from(*link, slots) || agrees(*link); });
    });
  }

  static bool agrees(const ResolvedConnection& link) {
    return std::visit(
        [&link](auto from, auto to) {
          for (std::size_t e = 0; e < link.to.count; ++e) {
            const auto& a = from[link.from.first + e];
            const auto& b = to[link.to.first + e];
            if constexpr (std::is_same_v<decltype(to), std::span<double>> &&
                          !std::is_same_v<decltype(from), std::span<std::string>>) {
              const double wanted = link.factor * static_cast<double>(a) + link.offset;
              const bool same = std::isnan(wanted) ? std::isnan(b) : std::abs(wanted - b) <= kSameInput * (1 + std::abs(b));
              if (!same && wanted != b) return false;
            } else if constexpr (std::is_same_v<decltype(from), decltype(to)>) {
              if (a != b) return false;
            }
          }
          return true;
        },
        link.from.variable->storage, link.to.variable->storage);
  }

  /// Sweeps over `slots` until no input changes, at most `rounds` times. Returns the slots that changed in the last sweep; all,
  /// if values have grown so much that they will overflow, or that a unit refuses them. `record`: notes the values of outputs in swept_.
  std::vector<std::size_t> sweep(const std::vector<std::size_t>& slots, std::size_t rounds, bool record) {
    std::vector<std::pair<const double*, std::array<double, 4>*>> sources;  // each with its place in swept_
    const auto note = [&](std::size_t at) {
      for (const auto& [source, values] : sources) (*values)[at] = *source;
    };
    const auto has_grown = [](const auto& source) {
      const double at_first = (*source.second)[0];
      return std::isfinite(at_first) && !(std::abs(*source.first) <= kGrowth * (1 + std::abs(at_first)));
    };
    if (record) {
      swept_ = {};
      for (const double* source : real_sources(slots)) sources.emplace_back(source, &swept_.of[source]);
      note(0);
    }
    std::vector<std::size_t> changing;
    int made = 1;  // the first initialisation
    for (std::size_t round = 0; round < rounds; ++round) {
      changing.clear();
      note(2);
      try {
        for (const std::size_t slot : slots) {
          if (!wiring_.update(slot)) continue;
          changing.push_back(slot);
          initialise(slot);
        }
      } catch (const Error&) {
        if (!record || round == 0) throw;
        note(1);
        return slots;
      }
      if (round == 0) note(1);
      ++made;
      if (changing.empty()) break;
      if (std::ranges::any_of(sources, has_grown)) return slots;
    }
    note(3);
    swept_.complete = true;
    result_.rounds = std::max(result_.rounds, made);
    return changing;
  }

  /// The strong components of `changing`, sources first. Its edges are the connections whose values still change.
  std::vector<std::vector<std::size_t>> components_among(const std::vector<std::size_t>& changing) const {
    const auto is_changing = [&](std::size_t slot) { return std::ranges::binary_search(changing, slot); };
    Graph among(edges_.size());
    for (const std::size_t to : changing) {
      for (const ResolvedConnection* link : into_[to]) {
        const std::size_t from = schedule_.slot_of[link->from.member];
        if (is_changing(from) && has_changed(*link)) among[from].push_back(to);
      }
    }
    std::vector<std::vector<std::size_t>> components = strong_components(among);
    std::erase_if(components, [&](const auto& component) { return !is_changing(component.front()); });
    return components;
  }

  /// Whether the source may have changed in the last sweep.
  bool has_changed(const ResolvedConnection& link) const {
    if (link.from.variable->kind() != Kind::kReal || !swept_.complete) return true;
    return std::ranges::any_of(link.from.reals(), [&](const double& value) {
      const auto& values = swept_.of.at(&value);
      return values[2] != values[3];
    });
  }

  bool is_loop(const std::vector<std::size_t>& component) const {
    return component.size() > 1 || std::ranges::any_of(into_[component.front()], [&](const ResolvedConnection* link) {
             return is_from(*link, component) && has_changed(*link);
           });
  }

  bool is_cycle(const std::vector<std::size_t>& component) const {
    const std::size_t first = component.front();
    return component.size() > 1 || std::ranges::binary_search(edges_[first], first);
  }

  std::span<Member> members_;
  const Schedule& schedule_;
  const std::vector<ResolvedConnection>& links_;
  Wiring& wiring_;
  Time start_;
  Graph edges_;
  std::vector<std::vector<const ResolvedConnection*>> into_;  // per slot
  std::vector<StagedInitialisation*> stages_;                 // per slot; nullptr: not in a staged initialisation
  SweptValues swept_;
  Initialisation result_{.rounds = 1, .loop = {}, .iterations = 0};
};

}  // namespace

Initialisation initialise_units(std::span<Member> members, const Schedule& schedule,
                                const std::vector<ResolvedConnection>& links, Wiring& wiring, Time start) {
  return Initialiser(members, schedule, links, wiring, start).run();
}

}  // namespace cotwin::master
