// The loops of a scenario: which are solved, their gains, their report.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "master/engine/engine.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::size_t kMostWatched = 64;  // unknowns of a loop whose gain is measured again during the run

/// Returns the length of a step (s) at which the gain of the loop is 1, to 0.1 %. See LoopReport::border. `gain`: in a step of
/// `tick`, not NaN.
double stability_border(GroupSolver& solver, Time now, Duration tick, double gain) {
  constexpr int kDoublings = 10;
  constexpr double kPrecision = 1.001;
  const auto gain_in = [&](std::int64_t ns) { return solver.loop_gain(now, Duration{ns}); };
  std::int64_t stable = tick.ns, unstable = tick.ns;
  if (gain < 1) {
    for (int i = 0; gain < 1; ++i) {
      if (i == kDoublings || unstable > std::numeric_limits<std::int64_t>::max() / 8)
        return std::numeric_limits<double>::infinity();
      stable = std::exchange(unstable, 2 * unstable);
      gain = gain_in(unstable);
    }
    if (std::isnan(gain)) return std::numeric_limits<double>::infinity();  // a unit discards longer steps
  } else {
    for (int i = 0; !(gain < 1); ++i) {
      if (i == kDoublings || stable == 1) return 0;
      unstable = std::exchange(stable, stable / 2);
      gain = gain_in(stable);
    }
  }
  while (static_cast<double>(unstable) > kPrecision * static_cast<double>(stable) && unstable - stable > 1) {
    const std::int64_t middle = stable + (unstable - stable) / 2;
    (gain_in(middle) < 1 ? stable : unstable) = middle;
  }
  return static_cast<double>(unstable) / 1e9;
}

}  // namespace

/// Decides which loops are solved: all (implicit), none (explicit), or those that explicit steps would not follow (auto).
void Engine::choose_groups(const Initialisation& initialised) {
  loops_.clear();
  groups_ = coupled_groups(links, members_);
  const auto is_algebraic = [&](std::size_t m) { return std::ranges::count(initialised.loop, members_[m].name()) > 0; };
  const auto goes_back = [&](std::size_t m) { return members_[m].instance.unit->goes_back(); };
  const auto report = [&](const std::vector<std::size_t>& group) -> LoopReport& {
    LoopReport& loop = loops_.emplace_back();
    for (const std::size_t m : group) text::append(loop.members, members_[m].name());
    // One member alone may be in a loop with others.
    loop.algebraic = std::ranges::count_if(group, is_algebraic) >= std::min<std::ptrdiff_t>(2, std::ssize(group));
    loop.unmeasurable = !std::ranges::all_of(group, goes_back);
    loop.unknowns = count_unknowns(links, group);
    return loop;
  };
  for (const std::vector<std::size_t>& group : groups_) report(group).solved = scenario_.coupling == CouplingChoice::kImplicit;
  watches_.clear();
  if (scenario_.coupling == CouplingChoice::kAuto) {
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      if (!loops_[g].unmeasurable && loops_[g].unknowns <= kMostMeasured) watches_.push_back(watch(g));
    }
    watch_loops(first_tick());
    for (const Watch& watch : watches_) loops_[watch.loop].solved = loops_[watch.loop].needs_solving();
    std::erase_if(watches_, [&](const Watch& watch) {
      const LoopReport& loop = loops_[watch.loop];
      return loop.solved || loop.unknowns > kMostWatched || scenario_.clock.kind != ClockKind::kFree;
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

Engine::Watch Engine::watch(std::size_t loop) {
  Watch watch;
  watch.loop = loop;
  for (const std::size_t m : groups_[loop]) {
    Slot& slot = watch.slots.emplace_back();
    slot.unit = members_[m].instance.unit.get();
    slot.member = m;
  }
  watch.solver = std::make_unique<GroupSolver>(watch.slots, members_, links, bonds, scenario_.tolerance);
  return watch;
}

void Engine::watch_loops(Duration tick) {
  for (const Watch& watch : watches_) {
    const Time now = schedule.slots[schedule.slot_of[watch.slots.front().member]].time;
    LoopReport& loop = loops_[watch.loop];
    const double gain = watch.solver->loop_gain(now, tick);
    if (!(gain > loop.gain || std::isnan(loop.gain))) continue;
    loop.gain = gain;
    loop.gain_time = now.seconds();
  }
}

std::vector<LoopReport> Engine::measure_loops(Time start, std::size_t most_unknowns) {
  std::vector<LoopReport> result = loops_;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    LoopReport& loop = result[g];
    if (loop.unmeasurable || loop.unknowns > most_unknowns) continue;
    const Watch watched = watch(g);
    loop.gain = watched.solver->loop_gain(start, first_tick());
    if (!std::isnan(loop.gain)) loop.border = stability_border(*watched.solver, start, first_tick(), loop.gain);
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
  constexpr double kDoubtfulGain = 0.5;  // of a loop that steps explicitly
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

bool Engine::solves(const Link& link) const {
  const std::size_t group = arrangement_.group_of[link.from.member];
  return group != kNoGroup && group == arrangement_.group_of[link.to.member] && is_continuous(link);
}

void Engine::write_counts(ByteWriter& out) const {
  for (const LoopReport& loop : loops_) {
    out.value(loop.gain);
    out.value(loop.gain_time);
  }
  for (const auto& solver : solvers_) {
    const LoopCounts& c = solver->counts();
    for (const std::int64_t count : {c.steps, c.iterations, c.linearisations, c.evaluations, c.divided}) out.value(count);
  }
}

void Engine::read_counts(ByteReader& in) {
  for (LoopReport& loop : loops_) {
    loop.gain = in.value<double>();
    loop.gain_time = in.value<double>();
  }
  for (const auto& solver : solvers_) {
    LoopCounts c;
    for (std::int64_t* count : {&c.steps, &c.iterations, &c.linearisations, &c.evaluations, &c.divided})
      *count = in.value<std::int64_t>();
    solver->set_counts(c);
  }
}

}  // namespace cotwin::master
