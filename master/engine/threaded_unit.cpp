#include "master/engine/threaded_unit.h"

#ifndef _WIN32
#include <pthread.h>
#include <signal.h>
#endif

#include <algorithm>
#include <type_traits>
#include <utility>
#include <variant>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

template <class Storage>
Variables::Declared declare_as(const Variable& v, Variables& variables, Storage storage) {
  switch (v.role) {
    case Role::kInput:
      return variables.input(v.name, storage, v.si_of(0), v.description);
    case Role::kOutput:
      return variables.output(v.name, storage, v.si_of(0), v.description);
    case Role::kParameter:
      return variables.parameter(v.name, storage, v.si_of(0), v.description);
    case Role::kTunable:
      return variables.tunable(v.name, storage, v.si_of(0), v.description);
    case Role::kState:
      break;
  }
  return variables.state(v.name, storage, v.si_of(0), v.description);
}

// Signals are for the threads of the loop, whose wait they end.
void block_signals() {
#ifndef _WIN32
  sigset_t all;
  sigfillset(&all);
  for (const int fault : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) sigdelset(&all, fault);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
#endif
}

}  // namespace

ThreadedUnit::ThreadedUnit(Instance instance, ThreadMode mode, std::string name)
    : inner_(std::move(instance)), mode_(mode), name_(std::move(name)) {
  std::size_t reals = 0, integers = 0, booleans = 0, strings = 0;
  for (const Variable& v : inner_.variables)
    (v.kind() == Kind::kReal      ? reals
     : v.kind() == Kind::kInteger ? integers
     : v.kind() == Kind::kBoolean ? booleans
                                  : strings) += v.size();
  outer_ = {std::vector<double>(reals), std::vector<std::int32_t>(integers), std::make_unique<bool[]>(booleans),
            std::vector<std::string>(strings)};
  take(false);
}

ThreadedUnit::~ThreadedUnit() {
  if (!thread_.joinable()) return;
  quit_.store(true, std::memory_order_release);
  order_.release();
  thread_.join();
}

/// Calls action(variable, the unit's values, their copies).
template <class Action>
void ThreadedUnit::for_each(const Action& action) {
  std::size_t reals = 0, integers = 0, booleans = 0, strings = 0;
  const auto part = [](auto* data, std::size_t& begin, std::size_t size) {
    const std::span span(data + begin, size);
    begin += size;
    return span;
  };
  for (const Variable& v : inner_.variables) {
    switch (v.kind()) {
      case Kind::kReal:
        action(v, v.reals(), part(outer_.reals.data(), reals, v.size()));
        break;
      case Kind::kInteger:
        action(v, v.integers(), part(outer_.integers.data(), integers, v.size()));
        break;
      case Kind::kBoolean:
        action(v, v.booleans(), part(outer_.booleans.get(), booleans, v.size()));
        break;
      case Kind::kString:
        action(v, v.strings(), part(outer_.strings.data(), strings, v.size()));
        break;
    }
  }
}

/// Copies to the unit: everything, or inputs and tunables.
void ThreadedUnit::give(bool only_changeable) {
  for_each([&](const Variable& v, auto inner, auto outer) {
    if (!only_changeable || v.role == Role::kInput || v.role == Role::kTunable)
      std::copy(outer.begin(), outer.end(), inner.begin());
  });
}

/// Copies from the unit: everything, or outputs and states.
void ThreadedUnit::take(bool only_results) {
  for_each([&](const Variable& v, auto inner, auto outer) {
    if (!only_results || v.role == Role::kOutput || v.role == Role::kState)
      std::copy(inner.begin(), inner.end(), outer.begin());
  });
}

// Outputs are discrete: they are those of a step that has ended before, so that no loop is solved through them. Nothing is said
// of rates: an input is held. The unit declares itself again with the present parameters, because they may decide what is required.
void ThreadedUnit::declare(Variables& v) {
  wait();
  v.foreign();
  for_each([](const Variable& variable, auto inner, auto outer) {
    if (variable.role == Role::kParameter || variable.role == Role::kTunable)
      std::copy(outer.begin(), outer.end(), inner.begin());
  });
  Variables present;
  inner_.unit->declare(present);
  for_each([&](const Variable& variable, auto, auto outer) {
    const Variable& now = present.at(variable.name);
    auto declared = declare_as(variable, v, outer);
    declared.elements(variable.elements).range(variable.min, variable.max);
    if (variable.nominal > 0) declared.nominal(variable.nominal);
    if (variable.relative) declared.relative();
    if (now.essential) declared.essential();
    if (now.required) declared.required();
    if (!variable.derivative_of.empty()) declared.derivative_of(variable.derivative_of);
    if (variable.role != Role::kOutput) return;
    if (variable.has_start) declared.start();
    if (variable.kind() == Kind::kReal) declared.discrete();
  });
}

void ThreadedUnit::initialise(Time start) {
  wait();
  failure_ = nullptr;
  pending_ = false;
  steps_ = late_ = 0;
  longest_ = {};
  time_ = start;
  give(false);
  inner_.unit->initialise(start);
  take(false);
  if (mode_ != ThreadMode::kInStep && !thread_.joinable()) thread_ = std::thread([this] { run(); });
}

void ThreadedUnit::run() {
  block_signals();
  for (;;) {
    order_.acquire();
    if (quit_.load(std::memory_order_acquire)) return;
    make_step();
    ready_.store(true, std::memory_order_release);
    ready_.notify_one();
  }
}

void ThreadedUnit::make_step() {
  try {
    result_ = inner_.unit->step(begin_, length_);
  } catch (...) {
    failure_ = std::current_exception();
  }
}

void ThreadedUnit::wait() const { ready_.wait(false, std::memory_order_acquire); }

/// Throws the error of the step that has ended, once.
void ThreadedUnit::check_step() {
  if (!pending_) return;
  if (failure_) {
    pending_ = false;
    std::rethrow_exception(std::exchange(failure_, nullptr));
  }
  if (result_ == StepResult::kDiscard) {
    pending_ = false;
    throw Error("discarded its step of " + text::to_text(length_.seconds()) + " s from t = " + text::to_text(begin_.seconds()) +
                " s, which is not repeated beside the loop; expected a shorter period, or beside=\"false\"");
  }
}

void ThreadedUnit::check_last_step() {
  wait();
  try {
    check_step();
  } catch (const std::exception& error) {
    throw Error(name_ + " at t = " + text::to_text(time_.seconds()) + " s", error.what());
  }
}

/// The outputs of the step that was started. False: the unit requests the end of the run.
bool ThreadedUnit::pop_results() {
  check_step();
  pending_ = false;
  take(true);
  return result_ != StepResult::kFinished;
}

StepResult ThreadedUnit::step(Time now, Duration h) {
  if (mode_ == ThreadMode::kHold && !ready_.load(std::memory_order_acquire)) {
    ++late_;
    return StepResult::kDone;
  }
  wait();
  if (pending_ && !pop_results()) return StepResult::kFinished;
  give(true);
  begin_ = time_;
  time_ = now + h;
  length_ = time_ - begin_;
  longest_ = std::max(longest_, length_);
  ++steps_;
  pending_ = true;
  if (mode_ == ThreadMode::kInStep) {
    make_step();
    check_step();
  } else {
    ready_.store(false, std::memory_order_relaxed);
    order_.release();
  }
  return StepResult::kDone;
}

void ThreadedUnit::save_memory(std::string& bytes) {
  check_last_step();
  snapshot_.take(inner_.variables, *inner_.unit);
  ByteWriter out;
  out.value(time_.ns);
  out.value(static_cast<std::uint8_t>(pending_));
  out.value(static_cast<std::uint8_t>(result_));
  out.value(steps_);
  out.value(longest_.ns);
  out.text(snapshot_.serialise());
  bytes = out.bytes();
}

void ThreadedUnit::restore_memory(const std::string& bytes) {
  wait();
  failure_ = nullptr;
  ByteReader in(as_bytes(bytes), "a component beside the loop");
  time_.ns = in.value<std::int64_t>();
  pending_ = in.value<std::uint8_t>() != 0;
  const auto result = in.value<std::uint8_t>();
  if (result > static_cast<std::uint8_t>(StepResult::kFinished)) in.fail("has no result of a step");
  result_ = static_cast<StepResult>(result);
  steps_ = in.value<std::int64_t>();
  longest_.ns = in.value<std::int64_t>();
  snapshot_ = Snapshot::deserialise(in.text());
  in.expect_end();
  snapshot_.restore(inner_.variables, *inner_.unit);
}

void ThreadedUnit::end() noexcept {
  wait();
  inner_.unit->end();
}

void ThreadedUnit::append_notes(std::vector<std::string>& sentences) const {
  wait();
  inner_.unit->append_notes(sentences);
  if (late_ > 0) {
    sentences.push_back("beside the loop: " + text::counted(steps_, "step") + "; " + text::counted(late_, "time") +
                        " the last one had not ended when the next was due; longest step " + text::to_text(longest_.seconds()) +
                        " s of the scenario");
  }
}

namespace {

/// Whether the ticks follow the clock of the component: it is named, or none is and no component in the loop has a clock.
bool is_clock(const ClockSpec& clock, const std::string& component, std::span<const Member> members) {
  if (!clock.component.empty()) return clock.component == component;
  if (clock.kind != ClockKind::kArrivals && clock.kind != ClockKind::kLocked) return false;
  return std::ranges::none_of(members,
                              [](const Member& m) { return !m.spec.beside && m.instance.unit->tick_source() != nullptr; });
}

}  // namespace

void put_on_threads(const Scenario& scenario, std::span<Member> members, ThreadMode mode) {
  for (Member& member : members) {
    if (!member.spec.beside) continue;
    const std::string component = "component '" + member.name() + "' with beside=\"true\"";
    if (scenario.tolerance > 0)
      fail(member.spec.place, component + " in a scenario with a tolerance, expected steps of whole ticks: tolerance 0");
    if (member.instance.unit->tick_source() != nullptr && is_clock(scenario.clock, member.name(), members))
      fail(member.spec.place, component + " is the source of the clock, expected another component, or beside=\"false\"");
    Instance instance;
    instance.warnings = std::exchange(member.instance.warnings, {});
    instance.given = member.instance.given;
    instance.robots = member.instance.robots;
    instance.unit = std::make_unique<ThreadedUnit>(std::move(member.instance), mode, member.name());
    instance.unit->declare(instance.variables);
    member.instance = std::move(instance);
  }
}

ThreadedUnit* beside_of(const Member& member) { return dynamic_cast<ThreadedUnit*>(member.instance.unit.get()); }

}  // namespace cotwin::master
