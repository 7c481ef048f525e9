#include "master/twin.h"

#include <algorithm>
#include <limits>

#include "fmu/bytes.h"

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

Twin::Twin(Scenario scenario, std::vector<Member> members, const std::set<std::string>& outputs)
    : scenario_(std::move(scenario)), members_(std::move(members)), outputs_(outputs) {
  engine_.emplace(scenario_, members_, 1, false);
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
  for (const Member& member : members_) {
    for (const Variable& v : member.variables()) {
      const std::string name = member.name() + "." + v.name;
      const Role role = role_of(name, v);
      std::visit(
          [&](auto storage) {
            auto declared = declare_as(role, variables, identifier(name), storage, v);
            declared.range(v.min, v.max);
            if (role == Role::kOutput && v.has_start) declared.start();
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
}

StepResult Twin::step(Time now, Duration h) {
  const std::int64_t ticks = (h.ns + scenario_.tick.ns - 1) / scenario_.tick.ns;
  const Duration tick{h.ns / ticks};
  for (std::int64_t i = 0; i < ticks; ++i, ++tick_) {
    const Time end = i + 1 == ticks ? now + h : now + (i + 1) * tick;
    if (engine_->advance(tick_, now + i * tick, end, 1, false) != Engine::kNobody) return StepResult::kDiscard;
    if (engine_->finished_by() != Engine::kNobody) return StepResult::kFinished;
  }
  return StepResult::kDone;
}

void Twin::restored() {
  for (const Member& member : members_) member.instance.unit->restored();
}

void Twin::save_memory(std::string& bytes) {
  fmu::ByteWriter out;
  out.value(tick_);
  for (const Slot& slot : engine_->schedule.slots) {
    out.value(slot.time.ns);
    out.value(slot.last_step.ns);
  }
  Events::Bookmark events;
  engine_->events.mark(events);
  out.value(static_cast<std::uint64_t>(events.next));
  for (const double begin : events.begins) out.value(begin);
  for (const std::uint8_t active : events.active) out.value(active);
  for (const Member& member : members_) {
    std::string memory;
    member.instance.unit->save_memory(memory);
    out.text(memory);
  }
  bytes = out.bytes();
}

void Twin::restore_memory(const std::string& bytes) {
  fmu::ByteReader in(fmu::as_bytes(bytes), "state of the scenario");
  tick_ = in.value<std::int64_t>();
  for (Slot& slot : engine_->schedule.slots) {
    slot.time.ns = in.value<std::int64_t>();
    slot.last_step.ns = in.value<std::int64_t>();
  }
  Events::Bookmark events;
  engine_->events.mark(events);  // as long as they must be
  const auto next = in.value<std::uint64_t>();
  if (next > events.begins.size()) in.fail("is damaged: it has more events than the scenario");
  events.next = static_cast<std::size_t>(next);
  for (double& begin : events.begins) begin = in.value<double>();
  for (std::uint8_t& active : events.active) active = in.value<std::uint8_t>();
  for (const Member& member : members_) member.instance.unit->restore_memory(in.text());
  in.expect_end();
  engine_->events.back_to(events);
}

bool Twin::restorable() const {
  return std::all_of(members_.begin(), members_.end(), [](const Member& m) { return m.instance.unit->restorable(); });
}

}  // namespace cotwin::master
