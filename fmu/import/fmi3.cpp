// FMI 3.0.2; the section numbers in parentheses are those of the standard.
#include "fmu/fmi3.h"

#include "fmu/import/callbacks.h"
#include "fmu/import/foreign.h"
#include "fmu/import/library.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

struct Functions3 {
  Function<decltype(fmi3SetDebugLogging)> set_debug_logging;
  Function<decltype(fmi3InstantiateCoSimulation)> instantiate_co_simulation;
  Function<decltype(fmi3InstantiateModelExchange)> instantiate_model_exchange;
  Function<decltype(fmi3FreeInstance)> free_instance;
  Function<decltype(fmi3EnterInitializationMode)> enter_initialisation;
  Function<decltype(fmi3ExitInitializationMode)> exit_initialisation;
  Function<decltype(fmi3EnterEventMode)> enter_event_mode;
  Function<decltype(fmi3Terminate)> terminate;
  Function<decltype(fmi3GetFloat32)> get_float32;
  Function<decltype(fmi3GetFloat64)> get_float64;
  Function<decltype(fmi3GetInt8)> get_int8;
  Function<decltype(fmi3GetUInt8)> get_uint8;
  Function<decltype(fmi3GetInt16)> get_int16;
  Function<decltype(fmi3GetUInt16)> get_uint16;
  Function<decltype(fmi3GetInt32)> get_int32;
  Function<decltype(fmi3GetUInt32)> get_uint32;
  Function<decltype(fmi3GetInt64)> get_int64;
  Function<decltype(fmi3GetUInt64)> get_uint64;
  Function<decltype(fmi3GetBoolean)> get_boolean;
  Function<decltype(fmi3GetString)> get_string;
  Function<decltype(fmi3GetBinary)> get_binary;
  Function<decltype(fmi3SetFloat32)> set_float32;
  Function<decltype(fmi3SetFloat64)> set_float64;
  Function<decltype(fmi3SetInt8)> set_int8;
  Function<decltype(fmi3SetUInt8)> set_uint8;
  Function<decltype(fmi3SetInt16)> set_int16;
  Function<decltype(fmi3SetUInt16)> set_uint16;
  Function<decltype(fmi3SetInt32)> set_int32;
  Function<decltype(fmi3SetUInt32)> set_uint32;
  Function<decltype(fmi3SetInt64)> set_int64;
  Function<decltype(fmi3SetUInt64)> set_uint64;
  Function<decltype(fmi3SetBoolean)> set_boolean;
  Function<decltype(fmi3SetString)> set_string;
  Function<decltype(fmi3SetBinary)> set_binary;
  Function<decltype(fmi3GetFMUState)> get_state;
  Function<decltype(fmi3SetFMUState)> set_state;
  Function<decltype(fmi3FreeFMUState)> free_state;
  Function<decltype(fmi3SerializedFMUStateSize)> serialised_size;
  Function<decltype(fmi3SerializeFMUState)> serialise;
  Function<decltype(fmi3DeserializeFMUState)> deserialise;
  Function<decltype(fmi3EnterConfigurationMode)> enter_configuration_mode;
  Function<decltype(fmi3ExitConfigurationMode)> exit_configuration_mode;
  Function<decltype(fmi3UpdateDiscreteStates)> update_discrete_states;
  // Co-Simulation
  Function<decltype(fmi3EnterStepMode)> enter_step_mode;
  Function<decltype(fmi3DoStep)> do_step;
  Function<decltype(fmi3GetOutputDerivatives)> get_output_derivatives;
  Function<decltype(fmi3SetClock)> set_clock;
  Function<decltype(fmi3GetClock)> get_clock;
  Function<decltype(fmi3GetIntervalDecimal)> get_interval;
  Function<decltype(fmi3SetIntervalDecimal)> set_interval;
  Function<decltype(fmi3GetShiftDecimal)> get_shift;
  // Model Exchange
  Function<decltype(fmi3EnterContinuousTimeMode)> enter_continuous_time_mode;
  Function<decltype(fmi3CompletedIntegratorStep)> completed_integrator_step;
  Function<decltype(fmi3SetTime)> set_time;
  Function<decltype(fmi3SetContinuousStates)> set_continuous_states;
  Function<decltype(fmi3GetContinuousStateDerivatives)> get_derivatives;
  Function<decltype(fmi3GetEventIndicators)> get_event_indicators;
  Function<decltype(fmi3GetContinuousStates)> get_continuous_states;
  Function<decltype(fmi3GetNominalsOfContinuousStates)> get_nominals;
  Function<decltype(fmi3GetNumberOfEventIndicators)> number_of_event_indicators;
  Function<decltype(fmi3GetNumberOfContinuousStates)> number_of_continuous_states;
};

/// Binds getters and setters only for the types that the FMU has.
Functions3 bind(Library& library, const ForeignOptions& options, const ModelDescription& d, const Interface& interface) {
  const auto has = [&](Type type) {
    for (const ModelVariable& v : d.variables) {
      if (v.type == type) return true;
    }
    return false;
  };
  Functions3 f{};
  const bool co = options.kind == InterfaceKind::kCoSimulation, me = !co;
  library.bind(f.set_debug_logging, "fmi3SetDebugLogging", false);
  library.bind(f.instantiate_co_simulation, "fmi3InstantiateCoSimulation", co);
  library.bind(f.instantiate_model_exchange, "fmi3InstantiateModelExchange", me);
  library.bind(f.free_instance, "fmi3FreeInstance");
  library.bind(f.enter_initialisation, "fmi3EnterInitializationMode");
  library.bind(f.exit_initialisation, "fmi3ExitInitializationMode");
  library.bind(f.enter_event_mode, "fmi3EnterEventMode", me || options.event_mode);
  library.bind(f.terminate, "fmi3Terminate");
  library.bind(f.get_float32, "fmi3GetFloat32", has(Type::kFloat32));
  library.bind(f.get_float64, "fmi3GetFloat64", has(Type::kFloat64));
  library.bind(f.get_int8, "fmi3GetInt8", has(Type::kInt8));
  library.bind(f.get_uint8, "fmi3GetUInt8", has(Type::kUInt8));
  library.bind(f.get_int16, "fmi3GetInt16", has(Type::kInt16));
  library.bind(f.get_uint16, "fmi3GetUInt16", has(Type::kUInt16));
  library.bind(f.get_int32, "fmi3GetInt32", has(Type::kInt32));
  library.bind(f.get_uint32, "fmi3GetUInt32", has(Type::kUInt32));
  library.bind(f.get_int64, "fmi3GetInt64", has(Type::kInt64) || has(Type::kEnumeration));
  library.bind(f.get_uint64, "fmi3GetUInt64", has(Type::kUInt64));
  library.bind(f.get_boolean, "fmi3GetBoolean", has(Type::kBoolean));
  library.bind(f.get_string, "fmi3GetString", has(Type::kString));
  library.bind(f.get_binary, "fmi3GetBinary", has(Type::kBinary));
  library.bind(f.set_float32, "fmi3SetFloat32", has(Type::kFloat32));
  library.bind(f.set_float64, "fmi3SetFloat64", has(Type::kFloat64));
  library.bind(f.set_int8, "fmi3SetInt8", has(Type::kInt8));
  library.bind(f.set_uint8, "fmi3SetUInt8", has(Type::kUInt8));
  library.bind(f.set_int16, "fmi3SetInt16", has(Type::kInt16));
  library.bind(f.set_uint16, "fmi3SetUInt16", has(Type::kUInt16));
  library.bind(f.set_int32, "fmi3SetInt32", has(Type::kInt32));
  library.bind(f.set_uint32, "fmi3SetUInt32", has(Type::kUInt32));
  library.bind(f.set_int64, "fmi3SetInt64", has(Type::kInt64) || has(Type::kEnumeration));
  library.bind(f.set_uint64, "fmi3SetUInt64", has(Type::kUInt64));
  library.bind(f.set_boolean, "fmi3SetBoolean", has(Type::kBoolean));
  library.bind(f.set_string, "fmi3SetString", has(Type::kString));
  library.bind(f.set_binary, "fmi3SetBinary", has(Type::kBinary));
  library.bind(f.get_state, "fmi3GetFMUState", interface.can_get_and_set_state);
  library.bind(f.set_state, "fmi3SetFMUState", interface.can_get_and_set_state);
  library.bind(f.free_state, "fmi3FreeFMUState", interface.can_get_and_set_state);
  library.bind(f.serialised_size, "fmi3SerializedFMUStateSize", interface.can_serialise_state);
  library.bind(f.serialise, "fmi3SerializeFMUState", interface.can_serialise_state);
  library.bind(f.deserialise, "fmi3DeserializeFMUState", interface.can_serialise_state);
  library.bind(f.enter_configuration_mode, "fmi3EnterConfigurationMode", false);
  library.bind(f.exit_configuration_mode, "fmi3ExitConfigurationMode", false);
  library.bind(f.update_discrete_states, "fmi3UpdateDiscreteStates", me || options.event_mode);
  library.bind(f.enter_step_mode, "fmi3EnterStepMode", options.event_mode);
  library.bind(f.do_step, "fmi3DoStep", co);
  library.bind(f.get_output_derivatives, "fmi3GetOutputDerivatives", options.output_derivatives);
  const bool clocks = options.event_mode && has(Type::kClock);
  library.bind(f.set_clock, "fmi3SetClock", clocks);
  library.bind(f.get_clock, "fmi3GetClock", clocks);
  library.bind(f.get_interval, "fmi3GetIntervalDecimal", clocks);
  library.bind(f.set_interval, "fmi3SetIntervalDecimal", clocks);
  library.bind(f.get_shift, "fmi3GetShiftDecimal", clocks);
  library.bind(f.enter_continuous_time_mode, "fmi3EnterContinuousTimeMode", me);
  library.bind(f.completed_integrator_step, "fmi3CompletedIntegratorStep", me && interface.needs_completed_integrator_step);
  library.bind(f.set_time, "fmi3SetTime", me);
  library.bind(f.set_continuous_states, "fmi3SetContinuousStates", me);
  library.bind(f.get_derivatives, "fmi3GetContinuousStateDerivatives", me);
  library.bind(f.get_event_indicators, "fmi3GetEventIndicators", me);
  library.bind(f.get_continuous_states, "fmi3GetContinuousStates", me);
  library.bind(f.get_nominals, "fmi3GetNominalsOfContinuousStates", me);
  library.bind(f.number_of_event_indicators, "fmi3GetNumberOfEventIndicators", me);
  library.bind(f.number_of_continuous_states, "fmi3GetNumberOfContinuousStates", me);
  library.check();
  return f;
}

const char* word_of(fmi3Status status) {
  static constexpr const char* kWords[] = {"ok", "warning", "discard", "error", "fatal"};
  return static_cast<unsigned>(status) < 5 ? kWords[status] : "an unknown status";
}

class Foreign3 final : public ForeignInstance {
 public:
  Foreign3(const ForeignFmu& fmu, ForeignOptions options)
      : interface_(interface_of(fmu.description, options.kind)),
        options_(std::move(options)),
        data_(std::make_unique<CallbackData>(options_.instance_name)),
        library_(library_file(fmu.folder, Version::k3, interface_.model_identifier)),
        f_(bind(library_, options_, fmu.description, interface_)) {
    data_->set_inputs = options_.set_intermediate_inputs;
    data_->may_ask_for_return = interface_.can_return_early_after_intermediate_update;
    const std::string resources = std::filesystem::absolute(fmu.folder / "resources").string() + "/";
    const char* name = options_.instance_name.c_str();
    const char* token = fmu.description.token.c_str();
    const bool co = options_.kind == InterfaceKind::kCoSimulation;
    // The callback is passed whenever the FMU declares intermediate updates, for some FMUs call it without a check for NULL.
    const auto update = !interface_.provides_intermediate_update ? nullptr
                        : data_->set_inputs                      ? intermediate_update
                                                                 : ignored_update;
    const std::vector<std::uint32_t>& inputs = options_.intermediate_inputs;
    instance_ =
        co ? f_.instantiate_co_simulation(name, token, resources.c_str(), false, true, options_.event_mode, true,
                                          inputs.empty() ? nullptr : inputs.data(), inputs.size(), data_.get(), log, update)
           : f_.instantiate_model_exchange(name, token, resources.c_str(), false, true, data_.get(), log);
    if (instance_ == nullptr) {
      throw Error(std::string(co ? "fmi3InstantiateCoSimulation" : "fmi3InstantiateModelExchange") + " returned no instance" +
                  data_->messages.take());
    }
    if (f_.set_debug_logging != nullptr) {
      // Only errors and warnings are logged, because logging costs time. FMUs without such categories log nothing.
      const std::vector<const char*> categories = error_categories(fmu.description);
      f_.set_debug_logging(instance_, false, 0, nullptr);
      if (!categories.empty()) f_.set_debug_logging(instance_, true, categories.size(), categories.data());
    }
  }
  ~Foreign3() override {
    if (fatal_) {  // threads of the FMU may still call back, so the callback data must stay valid
      library_.abandon();
      data_->set_inputs = nullptr;
      static_cast<void>(data_.release());
      return;
    }
    if (running_) f_.terminate.call_quietly(instance_);
    if (instance_ != nullptr) f_.free_instance.call_quietly(instance_);
  }

  void enter_initialisation(double start, std::optional<double> stop, std::optional<double> tolerance) override {
    check(f_.enter_initialisation(instance_, tolerance.has_value(), tolerance.value_or(0), start, stop.has_value(),
                                  stop.value_or(0)),
          "fmi3EnterInitializationMode");
  }
  void exit_initialisation() override {
    check(f_.exit_initialisation(instance_), "fmi3ExitInitializationMode");
    running_ = true;
  }

  void get(Type type, std::span<const std::uint32_t> references, void* values, std::size_t n, std::size_t* sizes) override {
    const std::uint32_t* r = references.data();
    const std::size_t nr = references.size();
    switch (type) {
      case Type::kFloat32:
        return check(f_.get_float32(instance_, r, nr, static_cast<float*>(values), n), "fmi3GetFloat32");
      case Type::kFloat64:
        return check(f_.get_float64(instance_, r, nr, static_cast<double*>(values), n), "fmi3GetFloat64");
      case Type::kInt8:
        return check(f_.get_int8(instance_, r, nr, static_cast<std::int8_t*>(values), n), "fmi3GetInt8");
      case Type::kUInt8:
        return check(f_.get_uint8(instance_, r, nr, static_cast<std::uint8_t*>(values), n), "fmi3GetUInt8");
      case Type::kInt16:
        return check(f_.get_int16(instance_, r, nr, static_cast<std::int16_t*>(values), n), "fmi3GetInt16");
      case Type::kUInt16:
        return check(f_.get_uint16(instance_, r, nr, static_cast<std::uint16_t*>(values), n), "fmi3GetUInt16");
      case Type::kInt32:
        return check(f_.get_int32(instance_, r, nr, static_cast<std::int32_t*>(values), n), "fmi3GetInt32");
      case Type::kUInt32:
        return check(f_.get_uint32(instance_, r, nr, static_cast<std::uint32_t*>(values), n), "fmi3GetUInt32");
      case Type::kInt64:
      case Type::kEnumeration:
        return check(f_.get_int64(instance_, r, nr, static_cast<std::int64_t*>(values), n), "fmi3GetInt64");
      case Type::kUInt64:
        return check(f_.get_uint64(instance_, r, nr, static_cast<std::uint64_t*>(values), n), "fmi3GetUInt64");
      case Type::kBoolean:
        return check(f_.get_boolean(instance_, r, nr, static_cast<bool*>(values), n), "fmi3GetBoolean");
      case Type::kString:
        return check(f_.get_string(instance_, r, nr, static_cast<const char**>(values), n), "fmi3GetString");
      case Type::kBinary:
        return check(f_.get_binary(instance_, r, nr, sizes, static_cast<const std::uint8_t**>(values), n), "fmi3GetBinary");
      case Type::kClock:
        return;
    }
  }
  void set(Type type, std::span<const std::uint32_t> references, const void* values, std::size_t n,
           const std::size_t* sizes) override {
    const std::uint32_t* r = references.data();
    const std::size_t nr = references.size();
    switch (type) {
      case Type::kFloat32:
        return check(f_.set_float32(instance_, r, nr, static_cast<const float*>(values), n), "fmi3SetFloat32");
      case Type::kFloat64:
        return check(f_.set_float64(instance_, r, nr, static_cast<const double*>(values), n), "fmi3SetFloat64");
      case Type::kInt8:
        return check(f_.set_int8(instance_, r, nr, static_cast<const std::int8_t*>(values), n), "fmi3SetInt8");
      case Type::kUInt8:
        return check(f_.set_uint8(instance_, r, nr, static_cast<const std::uint8_t*>(values), n), "fmi3SetUInt8");
      case Type::kInt16:
        return check(f_.set_int16(instance_, r, nr, static_cast<const std::int16_t*>(values), n), "fmi3SetInt16");
      case Type::kUInt16:
        return check(f_.set_uint16(instance_, r, nr, static_cast<const std::uint16_t*>(values), n), "fmi3SetUInt16");
      case Type::kInt32:
        return check(f_.set_int32(instance_, r, nr, static_cast<const std::int32_t*>(values), n), "fmi3SetInt32");
      case Type::kUInt32:
        return check(f_.set_uint32(instance_, r, nr, static_cast<const std::uint32_t*>(values), n), "fmi3SetUInt32");
      case Type::kInt64:
      case Type::kEnumeration:
        return check(f_.set_int64(instance_, r, nr, static_cast<const std::int64_t*>(values), n), "fmi3SetInt64");
      case Type::kUInt64:
        return check(f_.set_uint64(instance_, r, nr, static_cast<const std::uint64_t*>(values), n), "fmi3SetUInt64");
      case Type::kBoolean:
        return check(f_.set_boolean(instance_, r, nr, static_cast<const bool*>(values), n), "fmi3SetBoolean");
      case Type::kString:
        return check(f_.set_string(instance_, r, nr, static_cast<const char* const*>(values), n), "fmi3SetString");
      case Type::kBinary:
        return check(f_.set_binary(instance_, r, nr, sizes, static_cast<const std::uint8_t* const*>(values), n),
                     "fmi3SetBinary");
      case Type::kClock:
        return;
    }
  }
  void configure(const std::function<void()>& set) override {
    if (f_.enter_configuration_mode == nullptr || f_.exit_configuration_mode == nullptr) {
      fail("structural parameters cannot be set: the FMU has no configuration mode");
    }
    check(f_.enter_configuration_mode(instance_), "fmi3EnterConfigurationMode");
    set();
    check(f_.exit_configuration_mode(instance_), "fmi3ExitConfigurationMode");
  }
  void set_input_derivatives(std::span<const std::uint32_t>, std::span<const std::int32_t>, std::span<const double>) override {}
  void get_output_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                              std::span<double> values) override {
    check(
        f_.get_output_derivatives(instance_, references.data(), references.size(), orders.data(), values.data(), values.size()),
        "fmi3GetOutputDerivatives");
  }

  void save(void*& state) override { check(f_.get_state(instance_, &state), "fmi3GetFMUState"); }
  void restore(void* state) override {
    check(f_.set_state(instance_, state), "fmi3SetFMUState");
    running_ = true;
  }
  void free(void*& state) noexcept override {
    if (!fatal_ && state != nullptr) f_.free_state.call_quietly(instance_, &state);
    state = nullptr;
  }
  void serialise(void* state, std::string& bytes) override {
    if (fatal_) fail("the FMU's state is lost in a fatal error");
    std::size_t size = 0;
    check(f_.serialised_size(instance_, state, &size), "fmi3SerializedFMUStateSize");
    if (size > kMaxStateBytes)
      fail("the FMU's state has " + std::to_string(size) + " bytes, expected at most " + std::to_string(kMaxStateBytes));
    bytes.resize(size);
    check(f_.serialise(instance_, state, reinterpret_cast<fmi3Byte*>(bytes.data()), size), "fmi3SerializeFMUState");
  }
  void* deserialise(std::string_view bytes) override {
    void* state = nullptr;
    check(f_.deserialise(instance_, reinterpret_cast<const fmi3Byte*>(bytes.data()), bytes.size(), &state),
          "fmi3DeserializeFMUState");
    return state;
  }

  StepOutcome do_step(double now, double h) override {
    bool event = false, terminate = false, early = false;
    double reached = now + h;
    StepOutcome out;
    const fmi3Status status = f_.do_step(instance_, now, h, !options_.may_restore, &event, &terminate, &early, &reached);
    if (data_->update_failed) {
      data_->update_failed = false;
      if (status == fmi3Fatal) check(status, "fmi3DoStep");
      fail("an intermediate update of the step from " + text::to_text(now) + " s failed");
    }
    if (status == fmi3Discard) {
      out.discarded = true;
      out.reached = now;
      return out;
    }
    check(status, "fmi3DoStep");
    out.reached = early || terminate ? reached : now + h;
    out.event = event;
    out.terminate = terminate;
    return out;
  }
  void enter_step_mode() override { check(f_.enter_step_mode(instance_), "fmi3EnterStepMode"); }

  void enter_event_mode() override { check(f_.enter_event_mode(instance_), "fmi3EnterEventMode"); }

  void activate_clocks(std::span<const std::uint32_t> references) override {
    for (const std::uint32_t reference : references) {
      constexpr bool kActive = true;
      check(f_.set_clock(instance_, &reference, 1, &kActive), "fmi3SetClock");
    }
  }
  void get_clocks(std::span<const std::uint32_t> references, std::span<bool> active) override {
    check(f_.get_clock(instance_, references.data(), references.size(), active.data()), "fmi3GetClock");
  }
  void get_intervals(std::span<const std::uint32_t> references, std::span<double> intervals,
                     std::span<IntervalState> states) override {
    for (std::size_t i = 0; i < references.size(); ++i) {
      fmi3IntervalQualifier qualifier = fmi3IntervalNotYetKnown;
      check(f_.get_interval(instance_, &references[i], 1, &intervals[i], &qualifier), "fmi3GetIntervalDecimal");
      states[i] = qualifier == fmi3IntervalChanged     ? IntervalState::kChanged
                  : qualifier == fmi3IntervalUnchanged ? IntervalState::kUnchanged
                                                       : IntervalState::kNotYetKnown;
    }
  }
  void set_intervals(std::span<const std::uint32_t> references, std::span<const double> intervals) override {
    check(f_.set_interval(instance_, references.data(), references.size(), intervals.data()), "fmi3SetIntervalDecimal");
  }
  void get_shifts(std::span<const std::uint32_t> references, std::span<double> shifts) override {
    check(f_.get_shift(instance_, references.data(), references.size(), shifts.data()), "fmi3GetShiftDecimal");
  }

  void enter_continuous_time_mode() override { check(f_.enter_continuous_time_mode(instance_), "fmi3EnterContinuousTimeMode"); }
  void set_time(double t) override { check(f_.set_time(instance_, t), "fmi3SetTime"); }
  void set_states(std::span<const double> x) override {
    if (!x.empty()) check(f_.set_continuous_states(instance_, x.data(), x.size()), "fmi3SetContinuousStates");
  }
  void get_states(std::span<double> x) override {
    if (!x.empty()) check(f_.get_continuous_states(instance_, x.data(), x.size()), "fmi3GetContinuousStates");
  }
  void get_nominals(std::span<double> nominals) override {
    if (!nominals.empty())
      check(f_.get_nominals(instance_, nominals.data(), nominals.size()), "fmi3GetNominalsOfContinuousStates");
  }
  void get_derivatives(std::span<double> dx) override {
    if (!dx.empty()) check(f_.get_derivatives(instance_, dx.data(), dx.size()), "fmi3GetContinuousStateDerivatives");
  }
  void get_event_indicators(std::span<double> z) override {
    if (!z.empty()) check(f_.get_event_indicators(instance_, z.data(), z.size()), "fmi3GetEventIndicators");
  }
  std::size_t states() override {
    std::size_t n = 0;
    check(f_.number_of_continuous_states(instance_, &n), "fmi3GetNumberOfContinuousStates");
    return n;
  }
  std::size_t event_indicators() override {
    std::size_t n = 0;
    check(f_.number_of_event_indicators(instance_, &n), "fmi3GetNumberOfEventIndicators");
    return n;
  }
  Completed completed_step() override {
    if (!interface_.needs_completed_integrator_step) return {};
    Completed out;
    check(f_.completed_integrator_step(instance_, !options_.may_restore, &out.event, &out.terminate),
          "fmi3CompletedIntegratorStep");
    return out;
  }
  bool try_derivatives(double t, std::span<const double> x, std::span<double> dx) override {
    set_time(t);
    set_states(x);
    if (dx.empty()) return true;
    const fmi3Status status = f_.get_derivatives(instance_, dx.data(), dx.size());
    if (status == fmi3Discard) return false;
    check(status, "fmi3GetContinuousStateDerivatives");
    return true;
  }
  bool try_event_indicators(double t, std::span<const double> x, std::span<double> z) override {
    set_time(t);
    set_states(x);
    const fmi3Status status = f_.get_event_indicators(instance_, z.data(), z.size());
    if (status == fmi3Discard) return false;
    check(status, "fmi3GetEventIndicators");
    return true;
  }

 private:
  bool update_once(EventOutcome& out) override {
    bool again = false, terminate = false, nominals = false, states = false, defined = false;
    double next = 0;
    check(f_.update_discrete_states(instance_, &again, &terminate, &nominals, &states, &defined, &next),
          "fmi3UpdateDiscreteStates");
    out.terminate = out.terminate || terminate;
    out.nominals_changed = out.nominals_changed || nominals;
    out.states_changed = out.states_changed || states;
    out.next_event = defined ? std::optional(next) : std::nullopt;
    return again;
  }
  void check(fmi3Status status, const char* function) {
    if (status == fmi3OK || status == fmi3Warning) return;
    if (status == fmi3Error || status == fmi3Fatal) running_ = false;
    if (status == fmi3Fatal) fatal_ = true;
    fail(std::string(function) + " returned " + word_of(status));
  }
  [[noreturn]] void fail(const std::string& what) { throw Error(what + data_->messages.take()); }

  static void log(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
    CallbackData::log(environment, nullptr, word_of(status), category, message);
  }
  /// Where no inputs are set; FMUs may call it in each of their internal steps.
  static void ignored_update(fmi3InstanceEnvironment, double t, bool, bool, bool, bool, bool* early_return_requested,
                             double* early_return_time) {
    if (early_return_requested != nullptr) *early_return_requested = false;
    if (early_return_time != nullptr) *early_return_time = t;
  }
  static void intermediate_update(fmi3InstanceEnvironment environment, double t, bool set_requested, bool, bool, bool,
                                  bool* early_return_requested, double* early_return_time) {
    ignored_update(environment, t, set_requested, false, false, false, early_return_requested, early_return_time);
    CallbackData* const data = CallbackData::find(environment, nullptr);
    if (data == nullptr || !data->set_inputs || !set_requested) return;
    try {
      data->set_inputs(t);
    } catch (const std::exception& error) {  // the step is invalid: request an early return
      data->messages.add("error", "intermediate update", error.what());
      data->update_failed = true;
      if (early_return_requested != nullptr) *early_return_requested = data->may_ask_for_return;
    }
  }

  Interface interface_;
  ForeignOptions options_;
  std::unique_ptr<CallbackData> data_;
  Library library_;
  Functions3 f_;
  fmi3Instance instance_ = nullptr;
  bool running_ = false, fatal_ = false;
};

}  // namespace

std::unique_ptr<ForeignInstance> make_foreign_fmi3(const ForeignFmu& fmu, ForeignOptions options) {
  return std::make_unique<Foreign3>(fmu, std::move(options));
}

}  // namespace cotwin::fmu
