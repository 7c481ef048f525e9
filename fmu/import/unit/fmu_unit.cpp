#include "fmu/import/unit/fmu_unit.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "fmu/import/watched_calls.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr Exchange kSent[] = {Exchange::kContinuousInput, Exchange::kDiscreteInput, Exchange::kTunable};
constexpr int kMaxReturns = 100'000;  // of doStep in one communication step
constexpr double kTimeSlack = 1e-9;   // s: tolerance of the time that an FMU reports to have reached
constexpr int kMaxIdleReturns = 100;  // of doStep in succession without progress in time
constexpr int kMaxTicksAtOnce = 1'000;

/// Returns whether t has reached `end`, within the rounding of sums of steps (some 10 ulps).
bool reaches(double t, double end) { return t >= end - 1e-14 * std::max(1.0, std::abs(end)); }

}  // namespace

bool can_ramp_inputs(const ModelDescription& d, InterfaceKind kind) {
  const Interface& interface = interface_of(d, kind);
  if (kind == InterfaceKind::kModelExchange) return true;
  if (d.version == Version::k2) return interface.can_interpolate_inputs;
  if (!rate_inputs(d).empty()) return true;
  // FMI 3: one call in an intermediate update sets all continuous inputs, so all of them must allow it.
  bool any = false, all = true;
  for (const ModelVariable& v : d.variables) {
    if (v.causality != Causality::kInput || v.type != Type::kFloat64 || v.variability != Variability::kContinuous) continue;
    any = true;
    all = all && v.intermediate_update;
  }
  return interface.provides_intermediate_update && any && all;
}

ForeignVariablesOptions variables_options(const ModelDescription& d, InterfaceKind kind, const UnitOptions& options) {
  const bool clocks = kind == InterfaceKind::kCoSimulation && interface_of(d, kind).has_event_mode;
  if (options.slopes && (kind != InterfaceKind::kCoSimulation || interface_of(d, kind).max_output_derivative_order == 0))
    throw Error("slopes=true",
                "the FMU gives no derivatives of outputs, expected Co-Simulation with maxOutputDerivativeOrder > 0");
  return {options.locals, options.structural, can_ramp_inputs(d, kind), options.si, clocks, options.slopes};
}

bool can_restore(const Interface& interface, const UnitOptions& options) {
  return interface.can_get_and_set_state && (interface.can_serialise_state || options.rollback);
}

ForeignUnit::ForeignUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options, InterfaceKind kind)
    : fmu_(std::move(fmu)),
      options_(std::move(options)),
      place_{fmu_->name.c_str(), options_.instance_name.c_str()},
      interface_(interface_of(fmu_->description, kind)),
      variables_(fmu_->description, variables_options(fmu_->description, kind, options_)),
      states_(interface_) {
  if (watched_calls != nullptr) watched_calls->add(place_);
  set_call_place(place_, 0);
}

ForeignUnit::~ForeignUnit() {
  set_call_place(place_, under_way().ns);
  if (instance_) states_.clear(*instance_);
  instance_.reset();  // before its files are removed
}

void ForeignUnit::replace() {
  if (instance_) states_.leave(*instance_);
  instance_.reset();  // first, for the FMU may allow only one instance per process
  instance_ = make();
  committed_ = -kForever;
}

/// Destroys the instance. After an error its state is unspecified.
void ForeignUnit::drop() {
  healthy_ = fresh_ = in_mode_ = false;
  choose_path();
  if (!instance_) return;
  states_.leave(*instance_);
  instance_.reset();
}

void ForeignUnit::note(const EventOutcome& events) {
  next_event_ = events.next_event;
  finished_ = finished_ || events.terminate;
}

/// Runs `call` and destroys the instance if it throws.
template <class Call>
void ForeignUnit::attempt(Call call) {
  try {
    call();
  } catch (...) {
    drop();
    throw;
  }
}

/// Provides an unused instance and collects the start values to set.
void ForeignUnit::renew_instance() {
  // After an error the variables may hold values of the FMU; the start values given before remain.
  if (healthy_ || !initialised_) variables_.collect_written_starts(healthy_ ? instance_.get() : nullptr);
  healthy_ = in_mode_ = false;
  initialised_ = true;
  if (!std::exchange(fresh_, false)) replace();
}

void ForeignUnit::initialise(Time time) {
  set_call_place(place_, time.ns);
  renew_instance();
  attempt([&] {
    enter(time);
    leave();
  });
}

void ForeignUnit::enter_initialisation(Time time) {
  if (!reads_in_mode_) return initialise(time);
  set_call_place(place_, time.ns);
  renew_instance();
  attempt([&] { enter(time); });
  read_outputs();
}

void ForeignUnit::update_initialisation() {
  if (!in_mode_) return initialise(start_);
  set_call_place(place_, start_.ns);
  const bool parameters = variables_.changed(Exchange::kFixed) || variables_.changed(Exchange::kTunable);
  if (parameters) return enter_initialisation(start_);
  attempt([&] {
    variables_.send(*instance_, Exchange::kContinuousInput);
    variables_.send(*instance_, Exchange::kDiscreteInput);
  });
  read_outputs();
}

void ForeignUnit::exit_initialisation() {
  set_call_place(place_, start_.ns);
  if (in_mode_) attempt([&] { leave(); });
}

/// Reads outputs in Initialization Mode. If that fails, it is not tried again.
void ForeignUnit::read_outputs() {
  try {
    variables_.receive_outputs(*instance_);
    return;
  } catch (const Error&) {
    reads_in_mode_ = false;
  }
  drop();
  initialise(start_);
}

/// Brings a new instance to Initialization Mode.
void ForeignUnit::enter(Time time) {
  start_ = time;
  finished_ = false;
  next_event_.reset();
  variables_.forget();
  variables_.note_step(time, {});
  variables_.set_starts(*instance_);
  variables_.mark_sent(Exchange::kFixed);
  variables_.mark_sent(Exchange::kTunable);
  const std::optional<DefaultExperiment>& experiment = description().default_experiment;
  const std::optional<double> tolerance = options_.tolerance ? options_.tolerance
                                          : experiment       ? experiment->tolerance
                                                             : std::nullopt;
  instance_->enter_initialisation(time.seconds(), options_.stop, tolerance);
  in_mode_ = true;
  variables_.send(*instance_, Exchange::kContinuousInput);
  variables_.send(*instance_, Exchange::kDiscreteInput);
  prepare(time);
}

/// Leaves Initialization Mode; afterwards the first step can be made.
void ForeignUnit::leave() {
  const auto complete = [&] {
    instance_->exit_initialisation();
    in_mode_ = false;
    begin(start_);
  };
  complete();
  while (variables_.find_unavailable_slope(*instance_)) {  // after that error the instance's state is unspecified
    replace();
    enter(start_);
    complete();
  }
  if (!options_.structural.empty()) {  // the description has no start values for parameters of other sizes
    variables_.receive(*instance_, Exchange::kFixed);
    variables_.receive(*instance_, Exchange::kTunable);
  }
  variables_.receive(*instance_, Exchange::kConstant);
  variables_.receive(*instance_, Exchange::kResult);
  variables_.clear_slopes();                 // an FMU gives them only after a step
  variables_.mark_sent(Exchange::kTunable);  // they were set as start values
  healthy_ = true;
  choose_path();
}

/// Returns whether `time` is before the last communication point that excludes earlier states (see commit()).
bool ForeignUnit::is_before_commit(Time time) const {
  if (options_.rollback) return false;
  const double committed = std::max(committed_, variables_.stepped_from().seconds());
  return time.seconds() < committed;
}

StepResult ForeignUnit::step(Time now, Duration h) {
  set_call_place(place_, now.ns);
  if (!healthy_) throw Error("the FMU has failed or was not initialised");
  if (finished_) throw Error("the FMU has ended the simulation; no further step is possible");
  try {
    if (!advance(now, h)) {
      variables_.note_step(now, {});
      choose_path();
      return StepResult::kDiscard;
    }
    variables_.note_step(now, h);
    variables_.receive(*instance_, Exchange::kResult);
    variables_.receive_slopes(*instance_, h.seconds());
  } catch (...) {
    drop();
    throw;
  }
  choose_path();
  return finished_ ? StepResult::kFinished : StepResult::kDone;
}

/// What belongs to the FMU's state beside it, to extra_.
void ForeignUnit::write_extra() {
  ByteWriter extra(std::move(extra_));
  extra.value(static_cast<std::uint8_t>(next_event_.has_value()));
  extra.value(next_event_.value_or(0));
  extra.value(static_cast<std::uint8_t>(finished_));
  for (const Exchange e : kSent) extra.value(static_cast<std::uint8_t>(variables_.changed(e)));
  for (const bool nonzero : variables_.nonzero_rates()) extra.value(static_cast<std::uint8_t>(nonzero));
  write_memory(extra);
  extra_ = extra.take();
}

void ForeignUnit::save_memory(std::string& bytes) {
  if (!restorable() || !healthy_) return bytes.clear();
  set_call_place(place_, under_way().ns);
  write_extra();
  states_.save(*instance_, variables_.stepped_from() + variables_.stepped_by(), extra_, bytes);
}

void ForeignUnit::save_local_memory(std::string& bytes) {
  if (!restorable() || !healthy_) return bytes.clear();
  set_call_place(place_, under_way().ns);
  write_extra();
  states_.save_here(*instance_, variables_.stepped_from() + variables_.stepped_by(), extra_, bytes);
}

void ForeignUnit::restore_memory(const std::string& bytes) {
  set_call_place(place_, under_way().ns);
  const Time time = StateKeeper::time_of(bytes);
  if (!instance_ || is_before_commit(time)) replace();
  ByteReader in(as_bytes(states_.restore(*instance_, bytes)), StateKeeper::kPlace);
  const bool has_next = in.value<std::uint8_t>() != 0;
  const auto next = in.value<double>();
  next_event_ = has_next ? std::optional(next) : std::nullopt;
  finished_ = in.value<std::uint8_t>() != 0;
  variables_.forget();
  for (const Exchange e : kSent) {
    if (in.value<std::uint8_t>() == 0) variables_.mark_sent(e);  // contained in the FMU's state
  }
  for (std::size_t i = 0; i < variables_.nonzero_rates().size(); ++i)
    variables_.nonzero_rates()[i] = in.value<std::uint8_t>() != 0;
  read_memory(in);
  variables_.restart_slopes();
  variables_.note_step(time, {});
  healthy_ = initialised_ = true;
  fresh_ = in_mode_ = false;
  choose_path();
}

FmuUnit::FmuUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options)
    : ForeignUnit(std::move(fmu), std::move(options), InterfaceKind::kCoSimulation),
      event_mode_(interface_.has_event_mode),
      clocks_(description(), variables_) {
  ramps_by_updates_ = description().version == Version::k3 && can_ramp_inputs(description(), InterfaceKind::kCoSimulation) &&
                      rate_inputs(description()).empty();
  if (!clocks_.empty()) observe_clocks_ = [this] { clocks_.observe(*instance_); };
  instance_ = make();
}

ForeignUnit::StepPath FmuUnit::step_path() const {
  if (!interface_.variable_step || !clocks_.empty() || !variables_.inputs_sent()) return StepPath::kFull;
  return variables_.may_need_full_step() ? StepPath::kByInputs : StepPath::kFast;
}

std::unique_ptr<ForeignInstance> FmuUnit::make() {
  ForeignOptions options;
  options.kind = InterfaceKind::kCoSimulation;
  options.instance_name = options_.instance_name;
  options.event_mode = event_mode_;
  options.output_derivatives = variables_.reads_slopes();
  options.may_restore = options_.rollback;
  if (ramps_by_updates_) {
    options.intermediate_inputs = variables_.continuous_inputs();
    options.set_intermediate_inputs = [this](double t) { variables_.send_ramped(*instance_, t - step_begin_); };
  }
  if (!event_mode_) return make_foreign(*fmu_, std::move(options));
  std::string refusal;
  try {
    return make_foreign(*fmu_, options);
  } catch (const Error& error) {
    if (!clocks_.empty()) throw;  // clocks tick only in event mode
    refusal = error.what();
  }
  options.event_mode = false;
  std::unique_ptr<ForeignInstance> instance;
  try {
    instance = make_foreign(*fmu_, std::move(options));
  } catch (const Error&) {
    throw Error(refusal);
  }
  event_mode_ = false;
  variables_.warn("the FMU declares an event mode, but cannot be instantiated with it; it is used without (" + refusal + ")");
  return instance;
}

void FmuUnit::prepare(Time start) {
  if (event_mode_) clocks_.begin(*instance_, start.seconds());
}

void FmuUnit::begin(Time start) {
  equal_step_ = {};
  counts_ = {};
  if (event_mode_) finish_events(start.seconds(), true);  // an FMU with event mode begins in it (4.2.1)
}

StepResult FmuUnit::step_checked(Time now, Duration h) {
  return path_ == StepPath::kByInputs && !variables_.needs_full_step() ? step_fast(now, h) : ForeignUnit::step(now, h);
}

/// Continues a fast step that did not complete as a full step.
StepResult FmuUnit::complete_step() {
  begun_ = true;
  return ForeignUnit::step(variables_.stepped_from(), variables_.stepped_by());
}

/// Sends the changed inputs. If the FMU has an event mode, only continuous inputs may change outside it.
void FmuUnit::send_inputs() {
  const bool discrete = variables_.changed(Exchange::kDiscreteInput) || variables_.changed(Exchange::kTunable);
  const bool in_event_mode = event_mode_ && (discrete || clocks_.triggered());
  if (in_event_mode) instance_->enter_event_mode();
  variables_.send(*instance_, Exchange::kContinuousInput);
  if (discrete) {
    variables_.send(*instance_, Exchange::kDiscreteInput);
    variables_.send(*instance_, Exchange::kTunable);
  }
  if (in_event_mode) finish_events(step_begin_, true);
  if (!ramps_by_updates_) variables_.send_rates(*instance_);
}

void FmuUnit::handle_events(double t) {
  ++counts_.events;
  instance_->enter_event_mode();
  finish_events(t, false);
}

void FmuUnit::finish_events(double t, bool triggered) {
  int rounds = 0;
  do {  // aperiodic clocks may tick again at once
    if (++rounds > kMaxTicksAtOnce)
      throw Error("the FMU's clocks tick more than " + std::to_string(kMaxTicksAtOnce) + " times at " + text::to_text(t) +
                  " s");
    clocks_.activate(*instance_, t, triggered && rounds == 1);
    note(instance_->update_discrete_states(observe_clocks_));
    clocks_.schedule(*instance_, t);
  } while (!finished_ && clocks_.due(t));
  instance_->enter_step_mode();
}

std::optional<double> FmuUnit::next_stop() const {
  const std::optional<double> tick = clocks_.next();
  if (!next_event_) return tick;
  return tick ? std::min(*tick, *next_event_) : *next_event_;
}

void FmuUnit::write_memory(ByteWriter& out) {
  out.value(equal_step_.ns);
  clocks_.write(out);
}

void FmuUnit::read_memory(ByteReader& in) {
  equal_step_ = {in.value<std::int64_t>()};
  clocks_.read(in);
}

void FmuUnit::append_notes(std::vector<std::string>& notes) const {
  notes.insert(notes.end(), variables_.slope_notes().begin(), variables_.slope_notes().end());
  const auto add = [&](std::uint64_t n, const char* one, const char* many, const std::string& rest) {
    if (n > 0) notes.push_back(std::to_string(n) + " " + (n == 1 ? one : many) + rest);
  };
  add(counts_.early_returns, "early return", "early returns", " from a step; the step was continued from there");
  add(counts_.events, "event", "events", " handled in event mode");
  add(clocks_.ticks(), "tick", "ticks", " of its input clocks");
  add(counts_.discards, "step", "steps",
      " discarded, the last one at " + text::to_text(counts_.discarded_at) + " s" +
          (counts_.discarded_reached > counts_.discarded_at
               ? ", of which the FMU completed " + text::to_text(counts_.discarded_reached - counts_.discarded_at) + " s"
               : ""));
}

bool FmuUnit::advance(Time now, Duration h) {
  if (!interface_.variable_step) {
    if (equal_step_.ns == 0) equal_step_ = h;
    if (equal_step_ != h) {
      throw Error("the FMU requires equal communication steps, got " + text::to_text(h.seconds()) + " s after " +
                  text::to_text(equal_step_.seconds()) + " s");
    }
  }
  const double begin = now.seconds(), end = (now + h).seconds();
  step_begin_ = begin;
  clocks_.begin_step();
  bool begun = std::exchange(begun_, false);
  if (!begun) send_inputs();
  double t = begin;
  int idle = 0;
  for (int returns = 0; !finished_ && !reaches(t, end); ++returns) {
    // If the FMU allows variable steps, the step is interrupted at an announced event.
    double target = end;
    const std::optional<double> stop = event_mode_ && interface_.variable_step ? next_stop() : std::nullopt;
    if (stop && *stop > t && *stop < end) target = *stop;
    const bool whole = t == begin && target == end;
    commit(t);
    const StepOutcome out =
        std::exchange(begun, false) ? variables_.outcome() : instance_->do_step(t, whole ? h.seconds() : target - t);
    if (out.discarded) {
      ++counts_.discards;
      counts_.discarded_at = t;
      counts_.discarded_reached = out.reached;
      return false;
    }
    idle = out.reached > t ? 0 : idle + 1;
    if (idle > kMaxIdleReturns || returns > kMaxReturns) {
      throw Error("the FMU returns from doStep too often without completing the step: at " + text::to_text(out.reached) +
                  " s, expected " + text::to_text(end) + " s");
    }
    if (!(out.reached >= t - kTimeSlack) || !(out.reached <= target + kTimeSlack)) {
      throw Error("the FMU reports to have reached " + text::to_text(out.reached) + " s in a step from " + text::to_text(t) +
                  " s to " + text::to_text(target) + " s");
    }
    t = reaches(out.reached, target) ? target : out.reached;
    if (out.terminate) {
      finished_ = true;
      break;
    }
    if (t != target) ++counts_.early_returns;
    const bool announced = next_event_ && reaches(t, *next_event_);
    if (event_mode_ && (out.event || announced || clocks_.due(t))) handle_events(t);
  }
  return true;
}

}  // namespace cotwin::fmu
