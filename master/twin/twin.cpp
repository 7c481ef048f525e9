#include "master/twin/twin.h"

#include <algorithm>
#include <limits>
#include <map>

#include "master/engine/threaded_unit.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

template <class Storage>
Variables::Declared declare_as(Role role, Variables& variables, const std::string& name, Storage storage, const Variable& v) {
  switch (role) {
    case Role::kInput:
      return variables.input(name, storage, v.si_of(0), v.description);
    case Role::kOutput:
      return variables.output(name, storage, v.si_of(0), v.description);
    case Role::kParameter:
      return variables.parameter(name, storage, v.si_of(0), v.description);
    case Role::kTunable:
      return variables.tunable(name, storage, v.si_of(0), v.description);
    case Role::kState:
      break;
  }
  return variables.state(name, storage, v.si_of(0), v.description);
}

/// A variable of the twin.
struct Declared {
  std::string name;
  Role role;
};
using AllDeclared = std::map<const Variable*, Declared>;

/// Follows the connections backwards from an output as it is after the initialisation.
class InitialInputs {
 public:
  InitialInputs(std::span<const Member> members, const std::vector<ResolvedConnection>& links, const AllDeclared& declared)
      : declared_(declared) {
    for (const ResolvedConnection& link : links)
      sources_[link.to.variable].insert({&members[link.from.member], link.from.variable});
    for (const Member& member : members) {
      for (const Variable& v : member.variables()) {
        if (v.role == Role::kInput || sources_.contains(&v)) knowns_[&member].push_back(&v);
      }
    }
  }

  /// The names of the twin's inputs that the output depends on.
  std::vector<std::string> of(const Member& member, const Variable& output) const {
    std::set<std::string> inputs;
    std::set<Output> seen = {{&member, &output}};
    for (std::vector<Output> open(seen.begin(), seen.end()); !open.empty();) {
      const auto [of, unknown] = open.back();
      open.pop_back();
      const auto knowns = knowns_.find(of);
      if (knowns == knowns_.end()) continue;
      for (const Variable* known : knowns->second) {
        if (!depends(*unknown, *known)) continue;
        const Declared& declared = declared_.at(known);
        if (declared.role == Role::kInput) inputs.insert(declared.name);
        const auto found = sources_.find(known);
        if (found == sources_.end()) continue;
        for (const Output& source : found->second) {
          if (seen.insert(source).second) open.push_back(source);
        }
      }
    }
    return {inputs.begin(), inputs.end()};
  }

 private:
  using Output = std::pair<const Member*, const Variable*>;

  static bool depends(const Variable& unknown, const Variable& known) {
    if (known.role != Role::kInput) return true;  // a parameter that is connected
    return !unknown.initial_inputs || std::ranges::find(*unknown.initial_inputs, known.name) != unknown.initial_inputs->end();
  }

  const AllDeclared& declared_;
  std::map<const Variable*, std::set<Output>> sources_;
  std::map<const Member*, std::vector<const Variable*>> knowns_;  // inputs, and what is connected
};

}  // namespace

Twin::Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs, bool states_leave)
    : scenario_(std::move(scenario)), members_(std::move(members)), outputs_(outputs), states_leave_(states_leave) {
  scenario_.bonds.clear();
  put_on_threads(scenario_, members_, ThreadMode::kInStep);
  build_engine();
}

void Twin::build_engine() {
  control_.reset();
  engine_.emplace(scenario_, members_, 1, false);
  control_.emplace(
      *engine_, members_, 0,
      [this](std::int64_t tick) {
        const Past& p = past(tick);
        p.outside.write(outside_);
        return Tick{tick, p.begin, p.end};
      },
      true);
}

Role Twin::role_of(const std::string& name, const Variable& variable) const {
  std::size_t fed = 0;  // elements; each is fed at most once
  for (const ResolvedConnection& link : engine_->links) {
    if (link.to.variable == &variable) fed += link.to.count;
  }
  const bool connected = fed == variable.size() && fed > 0;
  switch (variable.role) {
    case Role::kInput:
    case Role::kParameter:
      return connected ? Role::kState : variable.role;
    case Role::kOutput:
      return outputs_.count(name) != 0 ? Role::kOutput : Role::kState;
    case Role::kTunable:
    case Role::kState:
      break;
  }
  return variable.role;
}

void Twin::declare(Variables& variables) {
  outside_ = {};
  variables.foreign();  // FMUs among the components may lack units of measure
  outside_.foreign();
  std::set<std::string> taken;
  AllDeclared all;
  for (const Member& member : members_) {
    for (const Variable& v : member.variables()) {
      const std::string full = member.name() + "." + v.name;
      std::string name = text::identifier(full);
      while (!taken.insert(name).second) name += '_';
      all[&v] = {name, role_of(full, v)};
    }
  }
  const InitialInputs initial(members_, engine_->links, all);
  for (const Member& member : members_) {
    for (const Variable& v : member.variables()) {
      const std::string& name = all.at(&v).name;
      const Role role = all.at(&v).role;
      std::visit(
          [&](auto storage) {
            auto declared = declare_as(role, variables, name, storage, v);
            declared.elements(v.elements).range(v.min, v.max);
            if (v.nominal > 0) declared.nominal(v.nominal);
            if (v.relative) declared.relative();
            if (role == Role::kOutput && v.has_start) declared.start();
            if (role == Role::kOutput && v.discrete) declared.discrete();
            if (role == Role::kOutput) declared.initially_from(initial.of(member, v));
            if (role == Role::kInput || role == Role::kTunable)
              declare_as(role, outside_, name, storage, v).elements(v.elements);
          },
          v.storage);
    }
  }
}

void Twin::initialise(Time start) {
  const std::int64_t longest =
      std::numeric_limits<std::int64_t>::max() - std::max<std::int64_t>(start.ns, 0) - scenario_.tick.ns;
  scenario_.start = start;
  scenario_.stop = start + Duration{longest};
  build_engine();
  engine_->initialise(start);
  tick_ = 0;
  if (control_->not_restorable() == nullptr) past_.resize(static_cast<std::size_t>(kCheckpointEvery + kMostWaiting));
  for (Past& p : past_) p.outside.take(outside_);  // so that steps allocate nothing
  control_->initialise();
  control_->forget();
}

bool Twin::step_tick(Time begin, Time end) {
  if (tick_ >= control_->next_checkpoint()) control_->save_checkpoint(tick_);
  if (!past_.empty()) {
    Past& now = past(tick_);
    now.outside.take(outside_);
    now.begin = begin;
    now.end = end;
  }
  return control_->step({tick_, begin, end}) == Engine::kNoSlot;
}

void Twin::append_notes(std::vector<std::string>& notes) const {
  for (std::size_t m = 0; m < members_.size(); ++m) {
    const std::int64_t discarded = control_->discarded_by()[m];
    if (discarded == 0 || control_->not_restorable() != nullptr) continue;
    notes.push_back(members_[m].name() + " discarded " + text::counted(discarded, "tick") + ", made in up to " +
                    std::to_string(control_->most_parts()) + " parts");
  }
  for (std::string& warning : engine_->tools.warnings()) notes.push_back(std::move(warning));
  for (std::string& warning : engine_->loop_warnings()) notes.push_back(std::move(warning));
  for (const Member& member : members_) {
    std::vector<std::string> of_member;
    member.instance.unit->append_notes(of_member);
    for (const std::string& note : of_member) notes.push_back(member.name() + ": " + note);
  }
}

void Twin::end() noexcept {
  for (const Member& member : members_) member.instance.unit->end();
}

StepResult Twin::step(Time now, Duration h) {
  const std::int64_t ticks = (h.ns - 1) / scenario_.tick.ns + 1;
  Time begin = now;
  for (std::int64_t i = 0; i < ticks; ++i, ++tick_) {
    const Time end = cut(now, now + h, i, ticks);
    if (!step_tick(begin, end)) return StepResult::kDiscard;
    begin = end;
    if (engine_->finished_by() != Engine::kNoSlot) return StepResult::kFinished;
  }
  return StepResult::kDone;
}

void Twin::restored() {
  control_->forget();
  for (const Member& member : members_) member.instance.unit->restored();
}

void Twin::save_memory(std::string& bytes) {
  ByteWriter out;
  Putter(out).put(tick_);
  for (const std::size_t slot : engine_->schedule.slot_of)
    Putter(out).put(engine_->schedule.slots[slot].time, engine_->schedule.slots[slot].last_step);
  Events::State events;
  engine_->events.save(events);
  std::vector<double> coupling;
  engine_->save_coupling(coupling);
  Putter(out).put(events, coupling);
  for (const Member& member : members_) {
    std::string memory;
    member.instance.unit->save_memory(memory);
    out.text(memory);
  }
  bytes = out.bytes();
}

void Twin::restore_memory(const std::string& bytes) {
  ByteReader in(as_bytes(bytes), "state of the scenario");
  Getter(in).get(tick_);
  for (const std::size_t slot : engine_->schedule.slot_of)
    Getter(in).get(engine_->schedule.slots[slot].time, engine_->schedule.slots[slot].last_step);
  Events::State events;
  std::vector<double> coupling;
  Getter(in).get(events, coupling);
  if (!engine_->events.is_valid(events)) in.fail("is damaged: its events are not those of the scenario");
  if (!engine_->is_coupling(coupling)) in.fail("is damaged: its loops are not those of the scenario");
  for (const Member& member : members_) member.instance.unit->restore_memory(in.text());
  in.expect_end();
  engine_->restore_coupling(coupling);
  engine_->events.restore(events);
}

}  // namespace cotwin::master
