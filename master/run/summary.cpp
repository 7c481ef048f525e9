// The figures and warnings of a run.
#include <cmath>
#include <set>
#include <type_traits>
#include <utility>
#include <variant>

#include "master/run/loop.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

/// Warnings from building the unit, and those in an output called `warning`.
std::vector<std::string> warnings_of(const Member& member) {
  std::vector<std::string> all = member.instance.warnings;
  const Variable* output = member.variables().find("warning");
  if (output == nullptr || output->role != Role::kOutput || output->kind() != Kind::kString) return all;
  for (const std::string& text : output->strings()) {
    if (!text.empty()) all.push_back(text);
  }
  return all;
}

/// The values of a variable that is no text.
std::vector<double> values_of(const Variable& variable) {
  std::vector<double> values;
  std::visit(
      [&](auto all) {
        if constexpr (!std::is_same_v<typename decltype(all)::value_type, std::string>) {
          for (const auto value : all) values.push_back(static_cast<double>(value));
        }
      },
      variable.storage);
  return values;
}

}  // namespace

/// Each once: a unit may repeat a warning of its construction after its initialisation.
std::vector<std::string> Master::Loop::warnings() const {
  std::vector<std::string> all;
  std::set<std::string> reported;
  const auto add = [&](const std::string& warning) {
    if (reported.insert(warning).second) all.push_back(warning);
  };
  for (const std::string& warning : scenario_.warnings) add(warning);
  for (const std::string& warning : omissions_) add(warning);
  for (const std::string& warning : separation_.warnings) add(warning);
  if (engine_.finished_by() != Engine::kNoSlot) {
    add("'" + engine_.name(engine_.finished_by()) + "' asked for the end of the run at t = " + text::to_text(now().seconds()) +
        " s");
  }
  if (live_ && live_->stopped())
    add("the end of the run was asked for from outside at t = " + text::to_text(now().seconds()) + " s");
  for (const Member& member : members_) {
    for (const std::string& warning : warnings_of(member)) add(member.name() + ": " + warning);
  }
  for (const std::string& warning : engine_.tools.warnings()) add(warning);
  for (const std::string& warning : pace_.refused()) add(warning);
  return all;
}

Summary Master::Loop::summary() const {
  Summary s;
  s.scenario = scenario_.name;
  s.start = scenario_.start.seconds();
  s.reached = now().seconds();
  s.stop = engine_.schedule.stop().seconds();
  s.tick = scenario_.tick.seconds();
  s.ticks = tick_;
  s.wall_seconds = wall_seconds();
  s.real_time_factor = s.wall_seconds > 0 ? (s.reached - s.start) / s.wall_seconds : 0;
  s.threads = engine_.threads_used();
  s.initialisation = initialisation_;
  const double exchange = times_.stepping(tick_, engine_), check = times_.checking(tick_), observe = times_.observing(tick_);
  double all = exchange + check + observe;
  const auto cost_of = [&](std::size_t m) { return engine_.cost(m, tick_, control_.mean_tries(tick_)); };
  for (std::size_t m = 0; m < members_.size(); ++m) all += cost_of(m).seconds();
  s.exchange_share = all > 0 ? exchange / all : 0;
  s.check_share = all > 0 ? check / all : 0;
  s.observe_share = all > 0 ? observe / all : 0;
  s.warnings = warnings();
  s.notes = separation_.notes;
  for (std::size_t m = 0; m < members_.size(); ++m) {
    const Engine::Cost cost = cost_of(m);
    s.units.push_back({members_[m].name(), cost.seconds_per_step, all > 0 ? cost.seconds() / all : 0, cost.samples});
    std::vector<std::string> notes;
    members_[m].instance.unit->append_notes(notes);
    for (const std::string& note : notes) s.notes.push_back(members_[m].name() + ": " + note);
    for (const Variable& variable : members_[m].variables()) {
      if (variable.role != Role::kOutput || variable.kind() == Kind::kString || variable.size() > kMostElementsOfEnds) continue;
      s.ends.push_back({members_[m].name() + "." + variable.name, variable.si, values_of(variable),
                        variable.elements != nullptr ? *variable.elements : Elements{}});
    }
    if (const std::int64_t count = control_.discarded_by()[m]; count > 0)
      s.discarded_by.emplace_back(members_[m].name(), count);
  }
  for (std::string& note : engine_.tools.notes()) s.notes.push_back(std::move(note));
  s.discarded = control_.discarded();
  s.most_parts = control_.most_parts();
  s.mean_parts = control_.mean_parts(tick_);
  s.tallies = statistics_.tallies();
  s.works = statistics_.works();
  s.comparisons = statistics_.comparisons();
  s.bonds = engine_.bonds.results();
  s.loops = engine_.loops();
  s.rejected = control_.rejected();
  for (const Bonded& bond : s.bonds) {
    if (bond.tolerance > 0 && std::abs(bond.leak) > bond.tolerance) {
      s.warnings.push_back("power bond '" + bond.name + "' leaks " + text::to_text(bond.leak, 4) + " J, more than " +
                           text::to_text(bond.tolerance, 4) +
                           " J: couple its two sides in smaller ticks or with coupling=implicit");
    }
  }
  if (const std::int64_t missed = control_.tolerance_missed(); missed > 0) {
    s.notes.push_back(text::counted(missed, "step") + " of the smallest length missed the tolerance: values jump there");
  }
  for (const std::string& name : control_.noisy())
    s.notes.push_back(name + " jumps in every step, however short: the tolerance does not control it any more");
  for (std::string& warning : engine_.loop_warnings()) s.warnings.push_back(std::move(warning));
  if (const Member* member = control_.not_restorable(); member != nullptr && scenario_.tolerance > 0) {
    s.notes.push_back("'" + member->name() + "' cannot be restored: it makes one step in each tick, whatever the tolerance");
  }
  if (signals_.recorder) {
    s.recording = signals_.recorder->file();
    s.rows = signals_.recorder->rows();
    s.dropped_rows = signals_.recorder->dropped();
    if (s.dropped_rows > 0) {
      s.warnings.push_back("the disk could not keep up: " + text::counted(static_cast<std::int64_t>(s.dropped_rows), "row") +
                           " of the recording dropped");
    }
  }
  if (live_) s.influence = live_->influence();
  if (const std::int64_t changes = s.influence.count(); changes > 0)
    s.notes.push_back(text::counted(changes, "value") + " set from outside during the run (listed in run.json)");
  if (s.influence.pauses > 0)
    s.notes.push_back("the run was paused " + text::counted(s.influence.pauses, "time") + " from outside, for " +
                      text::to_text(s.influence.paused_seconds, 3) + " s in total");
  s.clock = pace_.report();
  s.overruns = s.clock.state.overruns;
  s.worst_delay = Duration{s.clock.start_delays.max()}.seconds();
  return s;
}

}  // namespace cotwin::master
