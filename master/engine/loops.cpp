// The loops of a scenario: which are solved, their gains, their report.
#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <tuple>
#include <utility>

#include "master/engine/engine.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kMostWatched = 64;  // unknowns of a loop that may be solved from some time on
constexpr double kDoubtfulGain = 0.5;     // of a loop that steps explicitly
constexpr int kFirstTrial = 128;          // steps, in which the growth of a deviation is looked for at the start of a run …
constexpr int kLaterTrial = 512;          // … and where values grow

struct Border {
  double step = 0;      // s, from which on explicit steps let a deviation grow, to 1 %; as LoopReport::border
  double examined = 0;  // s, the longest step that was looked at
};

/// Looks for clear growth in few steps first, then around it in many. Loops whose steps take long are given up after some processor time: longer
/// steps are not looked at, and the border is known to 5 %.
Border stability_border(ExplicitSteps& steps, Time now, Duration tick) {
  constexpr double kPatience = 5;  // s of processor time
  constexpr double kHurriedPrecision = 1.05;
  constexpr int kDoublings = 10, kPerDoubling = 4;
  constexpr double kPrecision = 1.01;
  constexpr double kBudget = 131072;              // ticks in all steps of a measurement
  constexpr double kLeast = 2048, kMost = 16384;  // steps of one
  constexpr int kFew = 512;
  constexpr double kLongestStep = 1e15;  // ns: all steps of a measurement fit into a Time
  const std::clock_t begun = std::clock();
  const auto late = [&] { return static_cast<double>(std::clock() - begun) > kPatience * CLOCKS_PER_SEC; };
  const auto seconds = [](std::int64_t ns) { return static_cast<double>(ns) / 1e9; };
  std::int64_t stable = tick.ns, unstable = tick.ns;
  bool made = true;  // units may discard longer steps
  const auto grows = [&](std::int64_t ns, int most) {
    const StepGrowth growth = measure_growth(steps, now, Duration{ns}, most);
    made = growth.grows || growth.steps > 0;
    if (growth.grows || !growth.ended || growth.steps == 0 || stable >= ns) return growth.grows;
    // It came to an end, as diverging steps do, but perhaps not because of them.
    return can_step(steps, now, Duration{stable}, static_cast<int>(2 * growth.steps * (ns / stable + 1)));
  };
  const auto grows_in = [&](std::int64_t ns) {
    return grows(ns,
                 static_cast<int>(std::clamp(kBudget * static_cast<double>(tick.ns) / static_cast<double>(ns), kLeast, kMost)));
  };
  const auto longer = [&](int i) {
    return std::llround(static_cast<double>(tick.ns) * std::exp2(static_cast<double>(i) / kPerDoubling));
  };
  if (grows_in(tick.ns)) {
    for (int i = 0;; ++i) {
      if (i == kDoublings || stable == 1) return {0, seconds(tick.ns)};
      unstable = std::exchange(stable, stable / 2);
      if (!grows_in(stable)) break;
    }
  } else {
    const auto first = [&](const auto& grow) {  // in small steps, so that no band of unstable steps is left out
      for (int i = 1; i <= kPerDoubling * kDoublings && made && !late() && static_cast<double>(longer(i)) <= kLongestStep;
           ++i) {
        if (grow(longer(i))) return i;
        if (made) stable = longer(i);
      }
      return 0;
    };
    int found = first([&](std::int64_t ns) { return grows(ns, kFew) && grows_in(ns); });
    const bool ended = !made || late();
    made = true;
    if (found == 0 && !ended) found = first(grows_in);
    if (found == 0) return {std::numeric_limits<double>::infinity(), seconds(stable)};
    while (found > 1 && grows_in(longer(found - 1))) --found;
    stable = longer(found - 1);
    unstable = longer(found);
  }
  const auto precision = [&] { return late() ? kHurriedPrecision : kPrecision; };
  while (static_cast<double>(unstable) > precision() * static_cast<double>(stable) && unstable - stable > 1) {
    const std::int64_t middle = stable + (unstable - stable) / 2;
    (grows_in(middle) ? unstable : stable) = middle;
  }
  return {seconds(unstable), seconds(unstable)};
}

}  // namespace

/// Decides which loops are solved: all (implicit), none (explicit), or those that explicit steps would not follow (auto).
void Engine::choose_groups(const Initialisation& initialised) {
  loops_.clear();
  groups_ = coupled_groups(links, members_);
  const auto is_algebraic = [&](std::size_t m) { return std::ranges::count(initialised.loop, members_[m].name()) > 0; };
  const auto has_cheap_rollback = [&](std::size_t m) { return members_[m].instance.unit->has_cheap_rollback(); };
  const auto report = [&](const std::vector<std::size_t>& group) -> LoopReport& {
    LoopReport& loop = loops_.emplace_back();
    for (const std::size_t m : group) text::append(loop.members, members_[m].name());
    // One member alone may be in a loop with others.
    loop.algebraic = std::ranges::count_if(group, is_algebraic) >= std::min<std::ptrdiff_t>(2, std::ssize(group));
    loop.unmeasurable = !std::ranges::all_of(group, has_cheap_rollback);
    if (loop.unmeasurable && !loop.algebraic) loop.algebraic = is_declared_algebraic(links, members_, group);
    loop.unknowns = count_unknowns(links, group);
    return loop;
  };
  for (const std::vector<std::size_t>& group : groups_) report(group).solved = scenario_.coupling == CouplingChoice::kImplicit;
  probes_.clear();
  if (scenario_.coupling == CouplingChoice::kAuto) {
    const Time start = schedule.time(0);
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      LoopReport& loop = loops_[g];
      if (loop.unmeasurable || loop.unknowns > kMostMeasured) continue;
      probes_.push_back(make_probe(g));
      measure_gain(probes_.back(), start, first_tick());
      if (!loop.needs_solving()) loop.grows = measure_growth(*probes_.back().steps, start, first_tick(), kFirstTrial).grows;
      loop.solved = loop.needs_solving();
    }
    std::erase_if(probes_, [&](const LoopProbe& probe) {
      const LoopReport& loop = loops_[probe.loop];
      return loop.solved || loop.unknowns > kMostWatched || !is_free();
    });
  }
  arrange_solved();
  for (const std::vector<std::size_t>& group : unsolvable_groups(links, members_)) {
    const auto stays = std::ranges::find_if(group, [&](std::size_t m) { return !members_[m].instance.unit->restorable(); });
    report(group).not_restorable = members_[*stays].name();
  }
}

void Engine::arrange_solved() {
  std::vector<std::vector<std::size_t>> solved;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (loops_[g].solved) solved.push_back(groups_[g]);
  }
  const bool by_flow = !solved.empty() || scenario_.tolerance > 0;
  arrange(by_flow ? arrange_by_flow(links, members_, solved, scenario_.tolerance > 0) : arrange_as_given(members_));
  solver_of_loop_.clear();
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const auto is_of_group = [&](const Stage& stage) {
      return stage.group != kNoGroup && schedule.slots[stage.first].member == groups_[g].front();
    };
    std::size_t solver = 0;
    solver_of_loop_.push_back(kNoGroup);
    for (const Stage& stage : schedule.stages) {
      if (is_of_group(stage)) solver_of_loop_.back() = solver;
      if (stage.group != kNoGroup) ++solver;
    }
  }
}

Engine::LoopProbe Engine::make_probe(std::size_t loop) {
  LoopProbe probe;
  probe.loop = loop;
  for (const std::size_t m : groups_[loop]) {
    ScheduledUnit& slot = probe.slots.emplace_back();
    slot.unit = members_[m].instance.unit.get();
    slot.member = m;
  }
  probe.solver = std::make_unique<GroupSolver>(probe.slots, members_, links, bonds, scenario_.tolerance);
  probe.steps = std::make_unique<ExplicitSteps>(scenario_, members_, links, groups_[loop]);
  return probe;
}

/// Keeps the largest gain of the run.
void Engine::measure_gain(const LoopProbe& probe, Time now, Duration tick) {
  LoopReport& loop = loops_[probe.loop];
  const double gain = probe.solver->loop_gain(now, tick);
  if (!(gain > loop.gain || std::isnan(loop.gain))) return;
  loop.gain = gain;
  loop.gain_time = now.seconds();
}

GroupSolver* Engine::solver_of(std::size_t loop) const {
  return loop < solver_of_loop_.size() && solver_of_loop_[loop] != kNoGroup ? solvers_[solver_of_loop_[loop]].get() : nullptr;
}

/// Watches the loops whose values may diverge, also those that cannot be solved.
void Engine::watch_all() {
  growth_.clear();
  std::vector<std::vector<std::size_t>> groups = groups_;
  for (std::vector<std::size_t>& group : unsolvable_groups(links, members_)) groups.push_back(std::move(group));
  for (std::size_t g = 0; g < groups.size(); ++g) {
    std::vector<const double*> values;
    std::vector<double> magnitudes;
    const auto in_group = [&](std::size_t member) { return std::ranges::binary_search(groups[g], member); };
    for (const ResolvedConnection& link : links) {
      if (!is_continuous(link) || !in_group(link.from.member) || !in_group(link.to.member)) continue;
      for (const double& value : link.from.reals()) {
        if (std::ranges::find(values, &value) != values.end()) continue;
        values.push_back(&value);
        magnitudes.push_back(std::max(magnitude_of(*link.from.variable), std::abs(value)));
      }
    }
    growth_.emplace_back(std::move(values), std::move(magnitudes));
    growth_.back().watch(may_diverge(g));
  }
}

/// Values that are solved for follow a step of their units, unless these hold their inputs.
bool Engine::may_diverge(std::size_t loop) const {
  const GroupSolver* const solver = solver_of(loop);
  return solver == nullptr || (solver->holds() && !loops_[loop].unmeasurable && loops_[loop].unknowns <= kMostWatched);
}

bool Engine::may_change() const {
  bool holds = false;
  for (std::size_t g = 0; g < groups_.size(); ++g) holds = holds || (solver_of(g) != nullptr && may_diverge(g));
  return !probes_.empty() || (holds && is_free());
}

Engine::CouplingChange Engine::present() const {
  CouplingChange change;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const GroupSolver* const solver = solver_of(g);
    change.solved.push_back(solver != nullptr);
    change.rules.push_back(solver != nullptr ? solver->rule() : GroupSolver::Rule());
  }
  return change;
}

std::optional<Engine::CouplingChange> Engine::find_coupling_change(Time now, Duration tick) {
  bool helps = false;  // something may
  for (std::size_t g = 0; g < growth_.size(); ++g) {
    GrowthWatch& watch = growth_[g];
    if (!watch.is_suspicious()) continue;
    const bool measured = solver_of(g) == nullptr && std::ranges::find(probes_, g, &LoopProbe::loop) != probes_.end();
    if (measured || (solver_of(g) != nullptr && is_free() && watch.diverges())) {
      helps = true;
    } else if (watch.diverges()) {
      fail_diverging(g, watch.factor(), now);
    } else {
      watch.dismiss();
    }
  }
  if (!helps) return std::nullopt;
  const CouplingChange before = present();
  CouplingChange change = before;
  for (std::size_t g = 0; g < growth_.size(); ++g) {
    GrowthWatch& watch = growth_[g];
    if (!watch.is_suspicious()) continue;
    const auto probe = std::ranges::find(probes_, g, &LoopProbe::loop);
    if (GroupSolver* const solver = solver_of(g)) {
      solver->choose_rule(now, tick);
      change.rules[g] = solver->rule();
      solver->set_rule(before.rules[g]);
      if (change.rules[g] == before.rules[g]) fail_diverging(g, watch.factor(), now);
    } else {
      measure_gain(*probe, now, tick);
      LoopReport& loop = loops_[g];
      loop.grows = measure_growth(*probe->steps, now, tick, kLaterTrial).grows;
      change.solved[g] = loop.needs_solving() || watch.diverges();
      if (change.solved[g]) change.rules[g] = rule_for(*probe, now, tick);
      watch.dismiss();
    }
  }
  return change == before ? std::nullopt : std::optional(change);
}

GroupSolver::Rule Engine::rule_for(const LoopProbe& probe, Time now, Duration tick) {
  probe.solver->choose_rule(now, tick);
  return probe.solver->rule();
}

void Engine::fail_diverging(std::size_t loop, double factor, Time now) const {
  std::string expected = "coupling=implicit or a shorter tick";
  if (solver_of(loop) != nullptr) {
    expected = "a shorter tick, or a system that is stable in itself";
  } else if (const std::string& name = loops_[loop].not_restorable; !name.empty()) {
    expected = "a shorter tick, because '" + name +
               "' cannot be restored, as coupling=implicit needs; an FMU that can get and set its state can with rollback=true "
               "in its source";
  } else if (loops_[loop].unmeasurable && scenario_.coupling == CouplingChoice::kAuto) {
    expected = "rollback=true in the sources of its FMUs, coupling=implicit, or a shorter tick";
  }
  throw Error("the values that " + loops_[loop].members + " exchange diverge: at t = " + text::to_text(now.seconds()) +
              " s their changes grow by a factor of " + text::to_text(factor, 3) + " per tick; expected " + expected);
}

std::optional<Engine::CouplingChange> Engine::watch_loops(Time now, Duration tick) {
  const CouplingChange before = present();
  CouplingChange change = before;
  for (const LoopProbe& probe : probes_) {
    if (solver_of(probe.loop) != nullptr) continue;
    measure_gain(probe, now, tick);
    if (!(loops_[probe.loop].gain > kDoubtfulGain)) continue;
    change.solved[probe.loop] = true;
    change.rules[probe.loop] = rule_for(probe, now, tick);
  }
  return change == before ? std::nullopt : std::optional(change);
}

void Engine::apply(const CouplingChange& change) {
  std::vector<std::pair<Time, Duration>> progress;  // per member
  for (const std::size_t slot : schedule.slot_of)
    progress.emplace_back(schedule.slots[slot].time, schedule.slots[slot].last_step);
  const std::vector<LoopReport> reports = loops();
  const CouplingChange before = present();
  const bool other_order = change.solved != before.solved;
  for (std::size_t g = 0; g < groups_.size(); ++g) loops_[g].solved = change.solved[g];
  if (other_order) {
    arrange_solved();
    for (std::size_t m = 0; m < progress.size(); ++m) {
      ScheduledUnit& slot = schedule.slots[schedule.slot_of[m]];
      std::tie(slot.time, slot.last_step) = progress[m];
    }
    for (const auto& solver : solvers_) solver->prepare();
  }
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (change.solved[g] != before.solved[g]) {
      loops_[g].solved_from =
          change.solved[g] ? progress[groups_[g].front()].first.seconds() : std::numeric_limits<double>::quiet_NaN();
    }
    if (change.solved[g] != before.solved[g] || change.rules[g] != before.rules[g]) growth_[g].watch(may_diverge(g));
    GroupSolver* const solver = solver_of(g);
    if (solver == nullptr) continue;
    solver->set_counts(reports[g].counts);
    if (other_order || solver->rule() != change.rules[g]) solver->set_rule(change.rules[g]);
  }
  if (other_order) start_workers(threads_, always_threads_);
}

/// The numbers: which loops are solved, the state of each solver and each watch, the energies of the bonds.
void Engine::save_coupling(std::vector<double>& numbers) const {
  const std::size_t loops = groups_.size();
  std::size_t size = loops + bonds.state().size();
  for (const auto& solver : solvers_) size += solver->state_size();
  for (const GrowthWatch& watch : growth_) size += watch.state_size();
  numbers.resize(size);
  std::span<double> rest = numbers;
  for (std::size_t g = 0; g < loops; ++g) rest[g] = solver_of(g) != nullptr ? 1 : 0;
  rest = rest.subspan(loops);
  for (const auto& solver : solvers_) {
    solver->save(rest);
    rest = rest.subspan(solver->state_size());
  }
  for (const GrowthWatch& watch : growth_) {
    watch.save(rest);
    rest = rest.subspan(watch.state_size());
  }
  std::ranges::copy(bonds.state(), rest.begin());
}

void Engine::restore_coupling(std::span<const double> numbers) {
  const auto is_solved = [&](std::size_t g) { return numbers[g] == 1; };
  bool same = true;  // without allocations
  for (std::size_t g = 0; g < groups_.size(); ++g) same = same && is_solved(g) == (solver_of(g) != nullptr);
  if (!same) {
    CouplingChange change = present();
    for (std::size_t g = 0; g < groups_.size(); ++g) change.solved[g] = is_solved(g);
    apply(change);
  }
  numbers = numbers.subspan(groups_.size());
  for (const auto& solver : solvers_) {
    solver->restore(numbers);
    numbers = numbers.subspan(solver->state_size());
  }
  for (GrowthWatch& watch : growth_) {
    watch.restore(numbers);
    numbers = numbers.subspan(watch.state_size());
  }
  bonds.restore(numbers);
}

bool Engine::is_coupling(std::span<const double> numbers) const {
  const std::size_t loops = groups_.size();
  if (numbers.size() < loops) return false;
  std::size_t size = loops + bonds.state().size();
  for (const GrowthWatch& watch : growth_) size += watch.state_size();
  for (std::size_t g = 0; g < loops; ++g) {
    const GroupSolver* const solver = solver_of(g);
    const auto probe = std::ranges::find(probes_, g, &LoopProbe::loop);
    const bool is_solved = numbers[g] == 1;
    if (!is_solved && numbers[g] != 0) return false;
    if (is_solved) size += solver != nullptr ? solver->state_size() : probe != probes_.end() ? probe->solver->state_size() : 0;
    if (is_solved != (solver != nullptr) && probe == probes_.end()) return false;  // this loop never changes
  }
  return size == numbers.size();
}

std::vector<LoopReport> Engine::measure_loops(Time start, std::size_t most_unknowns) {
  std::vector<LoopReport> result = loops_;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    LoopReport& loop = result[g];
    if (loop.unmeasurable || loop.unknowns > most_unknowns) continue;
    const LoopProbe measured = make_probe(g);
    loop.gain = measured.solver->loop_gain(start, first_tick());
    if (std::isnan(loop.gain)) continue;
    loop.grows = measure_growth(*measured.steps, start, first_tick(), kFirstTrial).grows;
    const Border border = stability_border(*measured.steps, start, first_tick());
    loop.border = border.step;
    loop.examined = border.examined;
  }
  return result;
}

std::vector<LoopReport> Engine::loops() const {
  std::vector<LoopReport> result = loops_;
  for (std::size_t g = 0; g < solver_of_loop_.size(); ++g) {
    if (solver_of_loop_[g] != kNoGroup) result[g].counts = solvers_[solver_of_loop_[g]]->counts();
  }
  return result;
}

std::vector<std::string> Engine::loop_warnings() const {
  std::vector<std::string> warnings;
  for (const LoopReport& loop : loops_) {
    if (!loop.solved && loop.gain > kDoubtfulGain) {
      warnings.push_back("the loop of " + loop.members + " has a gain of " + text::to_text(loop.gain, 3) +
                         " in a tick at t = " + text::to_text(loop.gain_time) +
                         " s: with explicit steps its values are wrong, or diverge from 1 on; expected coupling=implicit or a "
                         "shorter tick");
    }
    if (scenario_.coupling == CouplingChoice::kAuto && !loop.solved && loop.unknowns > kMostMeasured) {
      warnings.push_back("the loop of " + loop.members + " exchanges " + std::to_string(loop.unknowns) + " values, more than " +
                         std::to_string(kMostMeasured) + ": coupling=auto does not measure its gain, and it steps explicitly");
    }
    if (!loop.not_restorable.empty()) {
      if (!loop.algebraic && scenario_.coupling != CouplingChoice::kImplicit) continue;
      warnings.push_back("the loop of " + loop.members + " is coupled by explicit steps: '" + loop.not_restorable +
                         "' cannot be restored, as coupling=implicit needs");
    } else if (loop.algebraic && !loop.solved) {
      warnings.push_back("the values of " + loop.members +
                         " depend on one another without delay, and each step uses those of the last one: expected "
                         "coupling=implicit");
    }
  }
  return warnings;
}

bool Engine::solves(const ResolvedConnection& link) const {
  const std::size_t group = arrangement_.group_of[link.from.member];
  return group != kNoGroup && group == arrangement_.group_of[link.to.member] && is_continuous(link);
}

void Engine::write_counts(ByteWriter& out) const {
  for (const LoopReport& loop : loops_) Putter(out).put(loop.gain, loop.gain_time, loop.solved_from);
  for (const auto& solver : solvers_) Putter(out).put(solver->counts());
}

void Engine::read_counts(ByteReader& in) {
  for (LoopReport& loop : loops_) Getter(in).get(loop.gain, loop.gain_time, loop.solved_from);
  for (const auto& solver : solvers_) {
    LoopCounts counts;
    Getter(in).get(counts);
    solver->set_counts(counts);
  }
}

}  // namespace cotwin::master
