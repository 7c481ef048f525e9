// FMI 2.0.4; the section numbers in parentheses are those of the standard.
#include <sched.h>

#include <cstdarg>
#include <cstdio>
#include <cstdlib>

#include "fmu/archive/uri.h"
#include "fmu/fmi2.h"
#include "fmu/import/callbacks.h"
#include "fmu/import/foreign.h"
#include "fmu/import/library.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

struct Functions2 {
  // Called in every step; adjacent in memory
  Function<decltype(fmi2SetReal)> set_real;
  Function<decltype(fmi2DoStep)> do_step;
  Function<decltype(fmi2GetReal)> get_real;

  Function<decltype(fmi2SetDebugLogging)> set_debug_logging;
  Function<decltype(fmi2Instantiate)> instantiate;
  Function<decltype(fmi2FreeInstance)> free_instance;
  Function<decltype(fmi2SetupExperiment)> setup_experiment;
  Function<decltype(fmi2EnterInitializationMode)> enter_initialisation;
  Function<decltype(fmi2ExitInitializationMode)> exit_initialisation;
  Function<decltype(fmi2Terminate)> terminate;
  Function<decltype(fmi2GetInteger)> get_integer;
  Function<decltype(fmi2GetBoolean)> get_boolean;
  Function<decltype(fmi2GetString)> get_string;
  Function<decltype(fmi2SetInteger)> set_integer;
  Function<decltype(fmi2SetBoolean)> set_boolean;
  Function<decltype(fmi2SetString)> set_string;
  Function<decltype(fmi2GetFMUstate)> get_state;
  Function<decltype(fmi2SetFMUstate)> set_state;
  Function<decltype(fmi2FreeFMUstate)> free_state;
  Function<decltype(fmi2SerializedFMUstateSize)> serialised_size;
  Function<decltype(fmi2SerializeFMUstate)> serialise;
  Function<decltype(fmi2DeSerializeFMUstate)> deserialise;
  // Co-Simulation
  Function<decltype(fmi2SetRealInputDerivatives)> set_input_derivatives;
  Function<decltype(fmi2GetRealOutputDerivatives)> get_output_derivatives;
  Function<decltype(fmi2GetStatus)> get_status;
  Function<decltype(fmi2GetRealStatus)> get_real_status;
  Function<decltype(fmi2GetBooleanStatus)> get_boolean_status;
  // Model Exchange
  Function<decltype(fmi2EnterEventMode)> enter_event_mode;
  Function<decltype(fmi2NewDiscreteStates)> new_discrete_states;
  Function<decltype(fmi2EnterContinuousTimeMode)> enter_continuous_time_mode;
  Function<decltype(fmi2CompletedIntegratorStep)> completed_integrator_step;
  Function<decltype(fmi2SetTime)> set_time;
  Function<decltype(fmi2SetContinuousStates)> set_continuous_states;
  Function<decltype(fmi2GetDerivatives)> get_derivatives;
  Function<decltype(fmi2GetEventIndicators)> get_event_indicators;
  Function<decltype(fmi2GetContinuousStates)> get_continuous_states;
  Function<decltype(fmi2GetNominalsOfContinuousStates)> get_nominals;
};

Functions2 bind(Library& library, const ForeignOptions& options, const Interface& interface) {
  Functions2 f{};
  library.bind(f.set_debug_logging, "fmi2SetDebugLogging", false);
  library.bind(f.instantiate, "fmi2Instantiate");
  library.bind(f.free_instance, "fmi2FreeInstance");
  library.bind(f.setup_experiment, "fmi2SetupExperiment");
  library.bind(f.enter_initialisation, "fmi2EnterInitializationMode");
  library.bind(f.exit_initialisation, "fmi2ExitInitializationMode");
  library.bind(f.terminate, "fmi2Terminate");
  library.bind(f.get_real, "fmi2GetReal");
  library.bind(f.get_integer, "fmi2GetInteger");
  library.bind(f.get_boolean, "fmi2GetBoolean");
  library.bind(f.get_string, "fmi2GetString");
  library.bind(f.set_real, "fmi2SetReal");
  library.bind(f.set_integer, "fmi2SetInteger");
  library.bind(f.set_boolean, "fmi2SetBoolean");
  library.bind(f.set_string, "fmi2SetString");
  library.bind(f.get_state, "fmi2GetFMUstate", interface.can_get_and_set_state);
  library.bind(f.set_state, "fmi2SetFMUstate", interface.can_get_and_set_state);
  library.bind(f.free_state, "fmi2FreeFMUstate", interface.can_get_and_set_state);
  library.bind(f.serialised_size, "fmi2SerializedFMUstateSize", interface.can_serialise_state);
  library.bind(f.serialise, "fmi2SerializeFMUstate", interface.can_serialise_state);
  library.bind(f.deserialise, "fmi2DeSerializeFMUstate", interface.can_serialise_state);
  const bool co = options.kind == InterfaceKind::kCoSimulation, me = !co;
  library.bind(f.set_input_derivatives, "fmi2SetRealInputDerivatives", co && interface.can_interpolate_inputs);
  library.bind(f.do_step, "fmi2DoStep", co);
  library.bind(f.get_output_derivatives, "fmi2GetRealOutputDerivatives", options.output_derivatives);
  library.bind(f.get_status, "fmi2GetStatus", false);
  library.bind(f.get_real_status, "fmi2GetRealStatus", false);
  library.bind(f.get_boolean_status, "fmi2GetBooleanStatus", false);
  library.bind(f.enter_event_mode, "fmi2EnterEventMode", me);
  library.bind(f.new_discrete_states, "fmi2NewDiscreteStates", me);
  library.bind(f.enter_continuous_time_mode, "fmi2EnterContinuousTimeMode", me);
  library.bind(f.completed_integrator_step, "fmi2CompletedIntegratorStep", me);
  library.bind(f.set_time, "fmi2SetTime", me);
  library.bind(f.set_continuous_states, "fmi2SetContinuousStates", me);
  library.bind(f.get_derivatives, "fmi2GetDerivatives", me);
  library.bind(f.get_event_indicators, "fmi2GetEventIndicators", me);
  library.bind(f.get_continuous_states, "fmi2GetContinuousStates", me);
  library.bind(f.get_nominals, "fmi2GetNominalsOfContinuousStates", me);
  library.check();
  return f;
}

const char* word_of(fmi2Status status) {
  static constexpr const char* kWords[] = {"ok", "warning", "discard", "error", "fatal", "pending"};
  return static_cast<unsigned>(status) < 6 ? kWords[status] : "an unknown status";
}

void log(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String format,
         ...) {
  char text[1000] = "";
  va_list arguments;
  va_start(arguments, format);
  if (format != nullptr) std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  CallbackData::log(environment, instance, word_of(status), category, text);
}

class Foreign2 final : public ForeignInstance {
 public:
  Foreign2(const ForeignFmu& fmu, const ForeignOptions& options)
      : interface_(interface_of(fmu.description, options.kind)),
        co_(options.kind == InterfaceKind::kCoSimulation),
        event_indicators_(fmu.description.event_indicators),
        states_(fmu.description.structure.derivatives.size()),
        data_(std::make_unique<CallbackData>(options.instance_name)),
        library_(library_file(fmu.folder, Version::k2, interface_.model_identifier)) {
    f_ = bind(library_, options, interface_);
    no_set_back_ = options.may_restore ? fmi2False : fmi2True;
    const std::string resources = uri_from_path(std::filesystem::absolute(fmu.folder / "resources"));
    component_ = f_.instantiate(options.instance_name.c_str(), co_ ? fmi2CoSimulation : fmi2ModelExchange,
                                fmu.description.token.c_str(), resources.c_str(), callbacks_.get(), fmi2False, fmi2True);
    if (component_ == nullptr) throw Error("fmi2Instantiate returned no instance" + data_->messages.take());
    if (f_.set_debug_logging != nullptr) {
      // Only errors and warnings are logged, because logging costs time. FMUs without such categories log nothing.
      const std::vector<const char*> categories = error_categories(fmu.description);
      f_.set_debug_logging(component_, fmi2False, 0, nullptr);
      if (!categories.empty()) f_.set_debug_logging(component_, fmi2True, categories.size(), categories.data());
    }
  }
  ~Foreign2() override {
    if (fatal_) {  // threads of the FMU may still call back, so the callback data must stay valid
      library_.abandon();
      static_cast<void>(data_.release());
      static_cast<void>(callbacks_.release());
      return;
    }
    if (running_) f_.terminate.call_quietly(component_);
    if (component_ != nullptr) f_.free_instance.call_quietly(component_);
  }

  void enter_initialisation(double start, std::optional<double> stop, std::optional<double> tolerance) override {
    check(f_.setup_experiment(component_, tolerance.has_value(), tolerance.value_or(0), start, stop.has_value(),
                              stop.value_or(0)),
          "fmi2SetupExperiment");
    check(f_.enter_initialisation(component_), "fmi2EnterInitializationMode");
  }
  void exit_initialisation() override {
    check(f_.exit_initialisation(component_), "fmi2ExitInitializationMode");
    running_ = true;
  }

  void get(Type type, std::span<const std::uint32_t> references, void* values, std::size_t, std::size_t*) override {
    const std::size_t n = references.size();
    switch (type) {
      case Type::kFloat64:
        return check(f_.get_real(component_, references.data(), n, static_cast<fmi2Real*>(values)), "fmi2GetReal");
      case Type::kBoolean:
        return check(f_.get_boolean(component_, references.data(), n, static_cast<fmi2Boolean*>(values)), "fmi2GetBoolean");
      case Type::kString:
        return check(f_.get_string(component_, references.data(), n, static_cast<fmi2String*>(values)), "fmi2GetString");
      default:
        return check(f_.get_integer(component_, references.data(), n, static_cast<fmi2Integer*>(values)), "fmi2GetInteger");
    }
  }
  void set(Type type, std::span<const std::uint32_t> references, const void* values, std::size_t, const std::size_t*) override {
    const std::size_t n = references.size();
    switch (type) {
      case Type::kFloat64:
        return check(f_.set_real(component_, references.data(), n, static_cast<const fmi2Real*>(values)), "fmi2SetReal");
      case Type::kBoolean:
        return check(f_.set_boolean(component_, references.data(), n, static_cast<const fmi2Boolean*>(values)),
                     "fmi2SetBoolean");
      case Type::kString:
        return check(f_.set_string(component_, references.data(), n, static_cast<const fmi2String*>(values)), "fmi2SetString");
      default:
        return check(f_.set_integer(component_, references.data(), n, static_cast<const fmi2Integer*>(values)),
                     "fmi2SetInteger");
    }
  }
  void configure(const std::function<void()>&) override {}
  void set_input_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                             std::span<const double> values) override {
    check(f_.set_input_derivatives(component_, references.data(), references.size(), orders.data(), values.data()),
          "fmi2SetRealInputDerivatives");
  }
  void get_output_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                              std::span<double> values) override {
    check(f_.get_output_derivatives(component_, references.data(), references.size(), orders.data(), values.data()),
          "fmi2GetRealOutputDerivatives");
  }

  void save(void*& state) override { check(f_.get_state(component_, &state), "fmi2GetFMUstate"); }
  void restore(void* state) override {
    check(f_.set_state(component_, state), "fmi2SetFMUstate");
    running_ = true;
  }
  void free(void*& state) noexcept override {
    if (!fatal_ && state != nullptr) f_.free_state.call_quietly(component_, &state);
    state = nullptr;
  }
  void serialise(void* state, std::string& bytes) override {
    if (fatal_) fail("the FMU's state is lost in a fatal error");
    std::size_t size = 0;
    check(f_.serialised_size(component_, state, &size), "fmi2SerializedFMUstateSize");
    if (size > kMaxStateBytes)
      fail("the FMU's state has " + std::to_string(size) + " bytes, expected at most " + std::to_string(kMaxStateBytes));
    bytes.resize(size);
    check(f_.serialise(component_, state, bytes.data(), size), "fmi2SerializeFMUstate");
  }
  void* deserialise(std::string_view bytes) override {
    void* state = nullptr;
    check(f_.deserialise(component_, bytes.data(), bytes.size(), &state), "fmi2DeSerializeFMUstate");
    return state;
  }

  StepOutcome do_step(double now, double h) override {
    return outcome_of(f_.do_step(component_, now, h, no_set_back_), now, h);
  }
  bool step(PlainStep& step, bool sets) override {
    if (sets) [[likely]] {
      check(f_.set_real(component_, step.set_references.data(), step.set_references.size(), step.set_values.data()),
            "fmi2SetReal");
    }
    const fmi2Status status = f_.do_step(component_, step.now, step.h, no_set_back_);
    if (status != fmi2OK) [[unlikely]] {
      step.outcome = outcome_of(status, step.now, step.h);
      if (step.outcome.discarded || step.outcome.terminate) return false;
    }
    if (!step.get_references.empty()) [[likely]] {
      check(f_.get_real(component_, step.get_references.data(), step.get_references.size(), step.get_values.data()),
            "fmi2GetReal");
    }
    return true;
  }
  [[gnu::cold]] StepOutcome outcome_of(fmi2Status status, double now, double h) {
    // Only asynchronous FMUs return pending. stepFinished is NULL, so their status is polled (4.2.2).
    while (status == fmi2Pending) {
      if (f_.get_status == nullptr) fail("fmi2DoStep returned pending, but there is no fmi2GetStatus");
      sched_yield();
      const fmi2Status polled = f_.get_status(component_, fmi2DoStepStatus, &status);
      if (polled != fmi2OK && polled != fmi2Warning) status = polled;
    }
    StepOutcome out;
    out.reached = now + h;
    if (status != fmi2Discard) {
      check(status, "fmi2DoStep");
      return out;
    }
    fmi2Boolean terminated = fmi2False;
    if (f_.get_boolean_status != nullptr && f_.get_boolean_status(component_, fmi2Terminated, &terminated) == fmi2OK)
      out.terminate = terminated != fmi2False;
    out.discarded = !out.terminate;
    fmi2Real reached = now;
    const bool known =
        f_.get_real_status != nullptr && f_.get_real_status(component_, fmi2LastSuccessfulTime, &reached) == fmi2OK;
    out.reached = known ? reached : now;
    return out;
  }
  void enter_step_mode() override {}

  void enter_event_mode() override { check(f_.enter_event_mode(component_), "fmi2EnterEventMode"); }
  void enter_continuous_time_mode() override {
    check(f_.enter_continuous_time_mode(component_), "fmi2EnterContinuousTimeMode");
  }
  void set_time(double t) override { check(f_.set_time(component_, t), "fmi2SetTime"); }
  void set_states(std::span<const double> x) override {
    if (!x.empty()) check(f_.set_continuous_states(component_, x.data(), x.size()), "fmi2SetContinuousStates");
  }
  void get_states(std::span<double> x) override {
    if (!x.empty()) check(f_.get_continuous_states(component_, x.data(), x.size()), "fmi2GetContinuousStates");
  }
  void get_nominals(std::span<double> nominals) override {
    if (!nominals.empty())
      check(f_.get_nominals(component_, nominals.data(), nominals.size()), "fmi2GetNominalsOfContinuousStates");
  }
  void get_derivatives(std::span<double> dx) override {
    if (!dx.empty()) check(f_.get_derivatives(component_, dx.data(), dx.size()), "fmi2GetDerivatives");
  }
  void get_event_indicators(std::span<double> z) override {
    if (!z.empty()) check(f_.get_event_indicators(component_, z.data(), z.size()), "fmi2GetEventIndicators");
  }
  std::size_t states() override { return states_; }
  std::size_t event_indicators() override { return event_indicators_; }
  Completed completed_step() override {
    if (!interface_.needs_completed_integrator_step) return {};
    fmi2Boolean event = fmi2False, terminate = fmi2False;
    check(f_.completed_integrator_step(component_, no_set_back_, &event, &terminate), "fmi2CompletedIntegratorStep");
    return {event != fmi2False, terminate != fmi2False};
  }
  bool try_derivatives(double t, std::span<const double> x, std::span<double> dx) override {
    set_time(t);
    set_states(x);
    if (dx.empty()) return true;
    const fmi2Status status = f_.get_derivatives(component_, dx.data(), dx.size());
    if (status == fmi2Discard) return false;
    check(status, "fmi2GetDerivatives");
    return true;
  }
  bool try_event_indicators(double t, std::span<const double> x, std::span<double> z) override {
    set_time(t);
    set_states(x);
    const fmi2Status status = f_.get_event_indicators(component_, z.data(), z.size());
    if (status == fmi2Discard) return false;
    check(status, "fmi2GetEventIndicators");
    return true;
  }

 private:
  bool update_once(EventOutcome& out) override {
    fmi2EventInfo info{};
    check(f_.new_discrete_states(component_, &info), "fmi2NewDiscreteStates");
    out.terminate = out.terminate || info.terminateSimulation != fmi2False;
    out.nominals_changed = out.nominals_changed || info.nominalsOfContinuousStatesChanged != fmi2False;
    out.states_changed = out.states_changed || info.valuesOfContinuousStatesChanged != fmi2False;
    out.next_event = info.nextEventTimeDefined != fmi2False ? std::optional(info.nextEventTime) : std::nullopt;
    return info.newDiscreteStatesNeeded != fmi2False;
  }
  void check(fmi2Status status, const char* function) {
    if (status != fmi2OK && status != fmi2Warning) [[unlikely]]
      fail_with(status, function);
  }
  [[noreturn]] void fail_with(fmi2Status status, const char* function) {
    if (status == fmi2Error || status == fmi2Fatal) running_ = false;
    if (status == fmi2Fatal) fatal_ = true;
    fail(std::string(function) + " returned " + word_of(status));
  }
  [[noreturn]] void fail(const std::string& what) { throw Error(what + data_->messages.take()); }

  fmi2Component component_ = nullptr;
  Functions2 f_{};
  fmi2Boolean no_set_back_ = fmi2True;
  bool running_ = false, fatal_ = false;
  Interface interface_;
  bool co_;
  std::size_t event_indicators_, states_;
  std::unique_ptr<CallbackData> data_;
  // The FMU holds a pointer to them.
  std::unique_ptr<fmi2CallbackFunctions> callbacks_{
      new fmi2CallbackFunctions{log, std::calloc, std::free, nullptr, data_.get()}};
  Library library_;
};

}  // namespace

std::unique_ptr<ForeignInstance> make_foreign_fmi2(const ForeignFmu& fmu, ForeignOptions options) {
  return std::make_unique<Foreign2>(fmu, options);
}

}  // namespace cotwin::fmu
