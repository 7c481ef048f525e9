#include "fmu/import/fmu_unit.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr Exchange kSent[] = {Exchange::kContinuousInput, Exchange::kDiscreteInput, Exchange::kTunable};
constexpr int kMaxReturns = 100'000;  // of doStep in one communication step
constexpr double kTimeSlack = 1e-9;   // s: of what an FMU says to have reached
constexpr int kMaxIdleReturns = 100;  // of them without progress in time
constexpr int kMaxTicksAtOnce = 1'000;

/// An instant that doStep is asked for is reached within rounding of the sums behind it: some 10 ulps.
bool reaches(double t, double end) { return t >= end - 1e-14 * std::max(1.0, std::abs(end)); }

}  // namespace

bool ramps_of(const ModelDescription& d, InterfaceKind kind) {
  const Interface& interface = interface_of(d, kind);
  if (kind == InterfaceKind::kModelExchange) return true;
  if (d.version == Version::k2) return interface.can_interpolate_inputs;
  if (!rate_inputs(d).empty()) return true;
  // FMI 3: all continuous inputs go through one call in an intermediate update, so all of them must be allowed there.
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
                "the FMU tells no derivatives of outputs, expected Co-Simulation with maxOutputDerivativeOrder > 0");
  return {options.locals, options.structural, ramps_of(d, kind), options.si, clocks, options.slopes};
}

bool can_go_back(const Interface& interface, const UnitOptions& options) {
  return interface.can_get_and_set_state && (interface.can_serialise_state || options.rollback);
}

Time StateKeeper::time_of(const std::string& bytes) {
  if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
  return {ByteReader(as_bytes(bytes), "state of the FMU").value<std::int64_t>()};
}

void StateKeeper::save(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes) {
  std::string state;
  if (serialises_) {
    Kept& kept = kept_.front();
    instance.save(kept.state);
    instance.serialise(kept.state, scratch_);
  } else {
    Kept& kept = kept_[next_ % kKept];
    kept.number = 0;
    instance.save(kept.state);
    kept.number = next_++;
  }
  ByteWriter out;
  out.value(time.ns);
  out.value(static_cast<std::uint8_t>(serialises_));
  out.text(std::string(extra));
  if (serialises_) {
    out.text(scratch_);
  } else {
    out.value(kept_[(next_ - 1) % kKept].number);
  }
  bytes = out.bytes();
}

std::string StateKeeper::restore(ForeignInstance& instance, const std::string& bytes) {
  if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
  ByteReader in(as_bytes(bytes), "state of the FMU");
  static_cast<void>(in.value<std::int64_t>());  // time_of()
  if (in.value<std::uint8_t>() != static_cast<std::uint8_t>(serialises_)) in.fail("is that of another FMU");
  const std::string extra = in.text();
  if (serialises_) {
    const std::string serialised = in.text();
    in.expect_end();
    void* state = instance.deserialise(serialised);
    try {
      instance.restore(state);
    } catch (...) {
      instance.free(state);
      throw;
    }
    instance.free(state);
  } else {
    const auto number = in.value<std::uint64_t>();
    in.expect_end();
    const Kept& kept = kept_[number % kKept];
    if (number == 0 || kept.number != number) {
      in.fail("is no longer kept: this FMU cannot serialise its states, and only its last " + std::to_string(kKept) +
              " are kept");
    }
    instance.restore(kept.state);
  }
  return extra;
}

bool holds_state(std::string_view saved) {
  constexpr std::size_t kFlag = sizeof(std::int64_t);  // behind the time
  return saved.size() > kFlag && saved[kFlag] == 1;
}

void StateKeeper::clear(ForeignInstance& instance) noexcept {
  for (Kept& kept : kept_) {
    instance.free(kept.state);
    kept.number = 0;
  }
}

ForeignUnit::ForeignUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options, InterfaceKind kind)
    : fmu_(std::move(fmu)),
      options_(std::move(options)),
      place_{fmu_->name.c_str(), options_.instance_name.c_str()},
      interface_(interface_of(fmu_->description, kind)),
      variables_(fmu_->description, variables_options(fmu_->description, kind, options_)),
      states_(interface_) {
  set_call_place(place_, 0);
}

ForeignUnit::~ForeignUnit() {
  set_call_place(place_, under_way.ns);
  if (instance_) states_.clear(*instance_);
  instance_.reset();  // before its files go
}

void ForeignUnit::replace() {
  if (instance_) states_.clear(*instance_);
  instance_.reset();  // first: it may be one of those that a process can have only once
  instance_ = make();
  promised_ = -kForever;
}

/// After an error the instance's state is unspecified: the next attempt begins with a new one.
void ForeignUnit::drop() {
  healthy_ = fresh_ = in_mode_ = false;
  choose_pace();
  if (!instance_) return;
  states_.clear(*instance_);
  instance_.reset();
}

void ForeignUnit::note(const EventOutcome& events) {
  next_event_ = events.next_event;
  finished_ = finished_ || events.terminate;
}

/// After an error in `call` there is no instance.
template <class Call>
void ForeignUnit::attempt(Call call) {
  try {
    call();
  } catch (...) {
    drop();
    throw;
  }
}

/// An instance that was not touched yet, and the start values that are to be given to it.
void ForeignUnit::begin_anew() {
  // After an error it is not known who wrote the variables: the start values given before stay.
  if (healthy_ || !initialised_) variables_.adopt_starts(healthy_ ? instance_.get() : nullptr);
  healthy_ = in_mode_ = false;
  initialised_ = true;
  if (!std::exchange(fresh_, false)) replace();
}

void ForeignUnit::initialise(Time time) {
  set_call_place(place_, time.ns);
  begin_anew();
  attempt([&] {
    enter(time);
    leave();
  });
}

void ForeignUnit::enter_initialisation(Time time) {
  if (!reads_in_mode_) return initialise(time);
  set_call_place(place_, time.ns);
  begin_anew();
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

/// In Initialization Mode. An FMU that refuses is not asked again.
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

/// From a new instance to Initialization Mode.
void ForeignUnit::enter(Time time) {
  start_ = time;
  finished_ = false;
  next_event_.reset();
  variables_.forget();
  variables_.note_step(time, {});
  variables_.set_starts(*instance_);
  variables_.settle(Exchange::kFixed);
  variables_.settle(Exchange::kTunable);
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

/// From Initialization Mode to where the first step can be made.
void ForeignUnit::leave() {
  const auto complete = [&] {
    instance_->exit_initialisation();
    in_mode_ = false;
    begin(start_);
  };
  complete();
  while (variables_.refuses_a_slope(*instance_)) {  // an error, after which the instance's state is unspecified
    replace();
    enter(start_);
    complete();
  }
  if (!options_.structural.empty()) {  // parameters of other sizes than the description has start values for
    variables_.receive(*instance_, Exchange::kFixed);
    variables_.receive(*instance_, Exchange::kTunable);
  }
  variables_.receive(*instance_, Exchange::kConstant);
  variables_.receive(*instance_, Exchange::kResult);
  variables_.clear_slopes();              // an FMU tells them after a step
  variables_.settle(Exchange::kTunable);  // the FMU has them as start values
  healthy_ = true;
  choose_pace();
}

/// Whether that time is before one that the FMU was told not to be taken behind.
bool ForeignUnit::breaks_a_promise(Time time) const {
  if (options_.rollback) return false;
  const double promised = std::max(promised_, variables_.stepped_from().seconds());
  return time.seconds() < promised;
}

StepResult ForeignUnit::step(Time now, Duration h) {
  set_call_place(place_, now.ns);
  if (!healthy_) throw Error("the FMU has failed, or was not initialised");
  if (finished_) throw Error("the FMU has ended its simulation and makes no further step");
  try {
    if (!advance(now, h)) {
      variables_.note_step(now, {});
      choose_pace();
      return StepResult::kDiscard;
    }
    variables_.note_step(now, h);
    variables_.receive(*instance_, Exchange::kResult);
    variables_.receive_slopes(*instance_, h.seconds());
  } catch (...) {
    drop();
    throw;
  }
  choose_pace();
  return finished_ ? StepResult::kFinished : StepResult::kDone;
}

void ForeignUnit::save_memory(std::string& bytes) {
  bytes.clear();
  if (!restorable() || !healthy_) return;
  set_call_place(place_, under_way.ns);
  ByteWriter extra;
  extra.value(static_cast<std::uint8_t>(next_event_.has_value()));
  extra.value(next_event_.value_or(0));
  extra.value(static_cast<std::uint8_t>(finished_));
  for (const Exchange e : kSent) extra.value(static_cast<std::uint8_t>(variables_.changed(e)));
  for (const bool known : variables_.rates_known()) extra.value(static_cast<std::uint8_t>(known));
  write_memory(extra);
  const Time time = variables_.stepped_from() + variables_.stepped_by();
  states_.save(*instance_, time, extra.bytes(), bytes);
}

void ForeignUnit::restore_memory(const std::string& bytes) {
  set_call_place(place_, under_way.ns);
  const Time time = StateKeeper::time_of(bytes);
  if (!instance_ || breaks_a_promise(time)) replace();
  const std::string extra = states_.restore(*instance_, bytes);
  ByteReader in(as_bytes(extra), "state of the FMU");
  const bool has_next = in.value<std::uint8_t>() != 0;
  const auto next = in.value<double>();
  next_event_ = has_next ? std::optional(next) : std::nullopt;
  finished_ = in.value<std::uint8_t>() != 0;
  variables_.forget();
  for (const Exchange e : kSent) {
    if (in.value<std::uint8_t>() == 0) variables_.settle(e);  // the FMU's state has them, too
  }
  for (std::size_t i = 0; i < variables_.rates_known().size(); ++i) variables_.rates_known()[i] = in.value<std::uint8_t>() != 0;
  read_memory(in);
  variables_.restart_slopes();
  variables_.note_step(time, {});
  healthy_ = initialised_ = true;
  fresh_ = in_mode_ = false;
  choose_pace();
}

FmuUnit::FmuUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options)
    : ForeignUnit(std::move(fmu), std::move(options), InterfaceKind::kCoSimulation),
      event_mode_(interface_.has_event_mode),
      clocks_(description(), variables_) {
  ramps_by_updates_ = description().version == Version::k3 && ramps_of(description(), InterfaceKind::kCoSimulation) &&
                      rate_inputs(description()).empty();
  if (!clocks_.empty()) observe_clocks_ = [this] { clocks_.observe(*instance_); };
  instance_ = make();
}

ForeignUnit::Pace FmuUnit::pace() const {
  if (!interface_.variable_step || !clocks_.empty() || !variables_.knows_inputs()) return Pace::kCareful;
  return variables_.may_need_care() ? Pace::kByInputs : Pace::kSimple;
}

std::unique_ptr<ForeignInstance> FmuUnit::make() {
  ForeignOptions options;
  options.kind = InterfaceKind::kCoSimulation;
  options.instance_name = options_.instance_name;
  options.event_mode = event_mode_;
  options.output_derivatives = variables_.asks_for_slopes();
  options.goes_back = options_.rollback;
  if (ramps_by_updates_) {
    options.intermediate_inputs = variables_.continuous_inputs();
    options.set_intermediate_inputs = [this](double t) { variables_.send_ramped(*instance_, t - step_begin_); };
  }
  if (!event_mode_) return make_foreign(*fmu_, std::move(options));
  std::string refusal;
  try {
    return make_foreign(*fmu_, options);
  } catch (const Error& error) {
    if (!clocks_.empty()) throw;  // they tick in event mode alone
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
  variables_.warn("the FMU declares an event mode and refuses it: it is used without (" + refusal + ")");
  return instance;
}

void FmuUnit::prepare(Time start) {
  if (event_mode_) clocks_.begin(*instance_, start.seconds());
}

void FmuUnit::begin(Time start) {
  equal_step_ = {};
  asked_ = {};
  if (event_mode_) finish_events(start.seconds(), true);  // an FMU with event mode begins in it (4.2.1)
}

StepResult FmuUnit::step_with_care(Time now, Duration h) {
  return pace_ == Pace::kByInputs && !variables_.needs_care() ? step_simply(now, h) : ForeignUnit::step(now, h);
}

/// Of a step that was thought to be a simple one.
StepResult FmuUnit::complete_step() {
  begun_ = true;
  return ForeignUnit::step(variables_.stepped_from(), variables_.stepped_by());
}

/// Sends what changed. Where there is an event mode, all but continuous inputs may change only in it.
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
  ++asked_.events;
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

void FmuUnit::tell(std::vector<std::string>& notes) const {
  notes.insert(notes.end(), variables_.refused_slopes().begin(), variables_.refused_slopes().end());
  const auto add = [&](std::uint64_t n, const char* one, const char* many, const std::string& rest) {
    if (n > 0) notes.push_back(std::to_string(n) + " " + (n == 1 ? one : many) + rest);
  };
  add(asked_.early_returns, "early return", "early returns", " from a step, which was completed from there");
  add(asked_.events, "event", "events", " handled in event mode");
  add(clocks_.ticks(), "tick", "ticks", " of its input clocks");
  add(asked_.discards, "step", "steps",
      " discarded, the last one at " + text::to_text(asked_.discarded_at) + " s" +
          (asked_.discarded_reached > asked_.discarded_at
               ? ", of which the FMU made " + text::to_text(asked_.discarded_reached - asked_.discarded_at) + " s"
               : ""));
}

bool FmuUnit::advance(Time now, Duration h) {
  if (!interface_.variable_step) {
    if (equal_step_.ns == 0) equal_step_ = h;
    if (equal_step_ != h) {
      throw Error("the FMU demands equal communication steps, got " + text::to_text(h.seconds()) + " s after " +
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
    // An event that the FMU has announced is where the step pauses, if the FMU lets us choose.
    double target = end;
    const std::optional<double> stop = event_mode_ && interface_.variable_step ? next_stop() : std::nullopt;
    if (stop && *stop > t && *stop < end) target = *stop;
    const bool whole = t == begin && target == end;
    promise(t);
    const StepOutcome out =
        std::exchange(begun, false) ? variables_.outcome() : instance_->do_step(t, whole ? h.seconds() : target - t);
    if (out.discarded) {
      ++asked_.discards;
      asked_.discarded_at = t;
      asked_.discarded_reached = out.reached;
      return false;
    }
    idle = out.reached > t ? 0 : idle + 1;
    if (idle > kMaxIdleReturns || returns > kMaxReturns) {
      throw Error("the FMU returns from doStep again and again, at " + text::to_text(out.reached) + " s, before " +
                  text::to_text(end) + " s");
    }
    if (!(out.reached >= t - kTimeSlack) || !(out.reached <= target + kTimeSlack)) {
      throw Error("the FMU says to have reached " + text::to_text(out.reached) + " s in a step from " + text::to_text(t) +
                  " s to " + text::to_text(target) + " s");
    }
    t = reaches(out.reached, target) ? target : out.reached;
    if (out.terminate) {
      finished_ = true;
      break;
    }
    if (t != target) ++asked_.early_returns;
    const bool announced = next_event_ && reaches(t, *next_event_);
    if (event_mode_ && (out.event || announced || clocks_.due(t))) handle_events(t);
  }
  return true;
}

}  // namespace cotwin::fmu
