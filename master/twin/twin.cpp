#include "master/twin/twin.h"

#include <algorithm>
#include <limits>

#include "models/support/bytes.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

/// The name with nothing in it but what the name of a variable may have.
std::string identifier(std::string name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  for (char& c : name) {
    if (!letter(c) && !(c >= '0' && c <= '9') && c != '.') c = '_';
  }
  return letter(name.front()) ? name : "_" + name;
}

template <class Storage>
Variables::Declared declare_as(Role role, Variables& variables, const std::string& name, Storage storage, const Variable& v) {
  switch (role) {
    case Role::kInput:
      return variables.input(name, storage, v.si, v.description);
    case Role::kOutput:
      return variables.output(name, storage, v.si, v.description);
    case Role::kParameter:
      return variables.parameter(name, storage, v.si, v.description);
    case Role::kTunable:
      return variables.tunable(name, storage, v.si, v.description);
    case Role::kState:
      break;
  }
  return variables.state(name, storage, v.si, v.description);
}

}  // namespace

Twin::Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs, bool states_leave)
    : scenario_(std::move(scenario)),
      members_(std::move(members)),
      outputs_(outputs),
      can_go_back_(
          std::all_of(members_.begin(), members_.end(), [](const Member& m) { return m.instance.unit->restorable(); })),
      states_leave_(states_leave) {
  engine_.emplace(scenario_, members_, 1, false);
  discarded_by_.resize(members_.size());
}

Role Twin::role_of(const std::string& name, const Variable& variable) const {
  std::size_t fed = 0;  // elements; none is fed twice
  for (const Link& link : engine_->links) {
    if (link.to.variable == &variable) fed += link.to.count;
  }
  const bool given = fed == variable.size() && fed > 0;
  switch (variable.role) {
    case Role::kInput:
    case Role::kParameter:
      return given ? Role::kState : variable.role;
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
  variables.foreign();  // FMUs among the components need not tell their units of measure
  outside_.foreign();
  std::set<std::string> taken;
  for (const Member& member : members_) {
    for (const Variable& v : member.variables()) {
      const std::string full = member.name() + "." + v.name;
      const Role role = role_of(full, v);
      std::string name = identifier(full);
      while (!taken.insert(name).second) name += '_';
      std::visit(
          [&](auto storage) {
            auto declared = declare_as(role, variables, name, storage, v);
            declared.range(v.min, v.max);
            if (role == Role::kOutput && v.has_start) declared.start();
            if (role == Role::kOutput && v.discrete) declared.discrete();
            if (role == Role::kInput || role == Role::kTunable) declare_as(role, outside_, name, storage, v);
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
  engine_.emplace(scenario_, members_, 1, false);
  engine_->initialise(start);
  tick_ = 0;
  std::fill(discarded_by_.begin(), discarded_by_.end(), 0);
  most_parts_ = 1;
  if (can_go_back_) {  // makes the room that steps need
    past_.resize(kCheckpointEvery);
    for (Past& past : past_) past.outside.take(outside_);
    checkpoint_.take(tick_, members_, engine_->schedule, engine_->events);
  }
  forget_the_past();
}

void Twin::forget_the_past() {
  checkpointed_ = false;
  past_ticks_ = 0;
}

bool Twin::tick(Time begin, Time end) {
  if (past_.empty()) return engine_->advance(tick_, begin, end, 1, false) == Engine::kNobody;
  if (!checkpointed_ || tick_ % kCheckpointEvery == 0) {
    checkpoint_.take(tick_, members_, engine_->schedule, engine_->events);
    checkpointed_ = true;
    past_ticks_ = 0;
  }
  Past& now = past_[past_ticks_++];
  now.outside.take(outside_);
  now.begin = begin;
  now.end = end;
  const std::size_t who = engine_->advance(tick_, begin, end, 1, false);
  if (who == Engine::kNobody) return true;
  ++discarded_by_[engine_->schedule.slots[who].member];
  return tick_in_parts(begin, end);
}

/// The ticks since the checkpoint are made once more, to the same bits, with what the host had written before each.
bool Twin::tick_in_parts(Time begin, Time end) {
  checkpoint_.restore(members_, engine_->schedule, engine_->events);
  for (std::size_t i = 0; i < past_ticks_; ++i) {
    const Past& past = past_[i];
    past.outside.write(outside_);
    if (i + 1 == past_ticks_) break;
    const std::size_t again =
        engine_->advance(checkpoint_.tick() + static_cast<std::int64_t>(i), past.begin, past.end, 1, false);
    if (again == Engine::kNobody) continue;
    throw Error("'" + engine_->name(again) + "' discards at t = " + text::to_text(past.begin.seconds()) +
                " s a step that it has made before: its variables do not hold all that it remembers");
  }
  checkpoint_.take(tick_, members_, engine_->schedule, engine_->events);
  forget_the_past();
  for (int parts = 2; parts <= kMostParts; parts *= 2) {
    const std::size_t who = engine_->advance(tick_, begin, end, parts, false);
    if (who == Engine::kNobody) {
      most_parts_ = std::max(most_parts_, parts);
      return true;
    }
    checkpoint_.restore(members_, engine_->schedule, engine_->events);
  }
  return false;
}

void Twin::tell(std::vector<std::string>& notes) const {
  for (std::size_t m = 0; m < members_.size(); ++m) {
    if (discarded_by_[m] == 0) continue;
    notes.push_back(members_[m].name() + " discarded " + std::to_string(discarded_by_[m]) +
                    " ticks, which were made in up to " + std::to_string(most_parts_) + " parts");
  }
  for (const Member& member : members_) {
    std::vector<std::string> of_member;
    member.instance.unit->tell(of_member);
    for (const std::string& note : of_member) notes.push_back(member.name() + ": " + note);
  }
}

StepResult Twin::step(Time now, Duration h) {
  const std::int64_t ticks = (h.ns + scenario_.tick.ns - 1) / scenario_.tick.ns;
  const Duration part{h.ns / ticks};
  for (std::int64_t i = 0; i < ticks; ++i, ++tick_) {
    const Time end = i + 1 == ticks ? now + h : now + (i + 1) * part;
    if (!tick(now + i * part, end)) return StepResult::kDiscard;
    if (engine_->finished_by() != Engine::kNobody) return StepResult::kFinished;
  }
  return StepResult::kDone;
}

void Twin::restored() {
  forget_the_past();
  for (const Member& member : members_) member.instance.unit->restored();
}

void Twin::save_memory(std::string& bytes) {
  ByteWriter out;
  out.value(tick_);
  for (const Slot& slot : engine_->schedule.slots) {
    out.value(slot.time.ns);
    out.value(slot.last_step.ns);
  }
  Events::Bookmark events;
  engine_->events.mark(events);
  events.write(out);
  for (const Member& member : members_) {
    std::string memory;
    member.instance.unit->save_memory(memory);
    out.text(memory);
  }
  bytes = out.bytes();
}

void Twin::restore_memory(const std::string& bytes) {
  ByteReader in(as_bytes(bytes), "state of the scenario");
  tick_ = in.value<std::int64_t>();
  for (Slot& slot : engine_->schedule.slots) {
    slot.time.ns = in.value<std::int64_t>();
    slot.last_step.ns = in.value<std::int64_t>();
  }
  Events::Bookmark events;
  events.read(in);
  if (!engine_->events.fits(events)) in.fail("is damaged: its events are not those of the scenario");
  for (const Member& member : members_) member.instance.unit->restore_memory(in.text());
  in.expect_end();
  engine_->events.back_to(events);
}

}  // namespace cotwin::master
