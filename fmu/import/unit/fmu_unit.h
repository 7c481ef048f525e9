#pragma once
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/declared_dependencies.h"
#include "components/unit/local_memory.h"
#include "components/unit/staged_initialisation.h"
#include "components/unit/unit.h"
#include "fmu/description/dependencies.h"
#include "fmu/import/foreign.h"
#include "fmu/import/under_way.h"
#include "fmu/import/unit/clocks.h"
#include "fmu/import/unit/state_keeper.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/bytes.h"

namespace cotwin::fmu {

/// Settings of a foreign FMU in a scenario, apart from start values.
struct UnitOptions {
  std::string instance_name;
  bool locals = true;
  std::map<std::string, std::uint64_t> structural;
  std::optional<double> stop;       // s; passed to the FMU if given
  std::optional<double> tolerance;  // relative; no value: that of the FMU's default experiment
  bool si = true;                   // see ForeignVariablesOptions
  bool slopes = false;              // see ForeignVariablesOptions
  bool rollback = false;            // earlier states may be restored; see ForeignUnit
};

struct LoadOptions;
/// Returns the unit options in the options of load.h. Without a choice, `rollback` is true for FMUs of this program: their units go
/// back to earlier states at no cost, as they do without an FMU.
UnitOptions unit_options(const ModelDescription& description, const LoadOptions& options);

/// Returns whether the FMU can be set back to an earlier state.
bool can_restore(const Interface& interface, const UnitOptions& options);

/// Returns whether continuous inputs of the FMU can change linearly during a step.
bool can_ramp_inputs(const ModelDescription& description, InterfaceKind kind);

/// Returns the options of the FMU's variables. Throws Error if slopes are requested and the FMU gives no output derivatives.
ForeignVariablesOptions variables_options(const ModelDescription& description, InterfaceKind kind, const UnitOptions& options);

/// The common part of Co-Simulation and Model Exchange: the FMU's variables as those of the unit, and its life cycle
///   instantiate · start values · enter initialisation · inputs · exit initialisation · … · terminate · free
/// A repeated initialise() makes a new instance. FMUs are never reset, because many fail then.
///
/// Restoring: with `rollback`, every step passes noSetFMUStatePriorToCurrentPoint = false, and earlier states are restored in
/// the same instance. Otherwise every step passes true; restore_memory() of a state before the last communication point then
/// makes a new instance and gives it the serialised state. Hence an FMU that cannot serialise its states is restorable() only
/// with `rollback`.
class ForeignUnit : public Unit, public StagedInitialisation, public DeclaredDependencies, public LocalMemory {
 public:
  ~ForeignUnit() override;
  void declare(Variables& variables) final { variables_.declare(variables); }
  void initialise(Time start) final;
  /// In Initialization Mode inputs are set and outputs are read. An FMU whose outputs cannot be read there completes its
  /// initialisation at once. An update then repeats the whole initialisation, as it does after a change of parameters.
  void enter_initialisation(Time start) final;
  void update_initialisation() final;
  void exit_initialisation() final;
  StepResult step(Time now, Duration h) override;
  bool restorable() const final { return can_restore(interface_, options_); }
  bool has_cheap_rollback() const final { return restorable() && options_.rollback; }
  void save_memory(std::string& bytes) final;
  void save_local_memory(std::string& bytes) final;
  void restore_memory(const std::string& bytes) final;
  const std::vector<std::string>& warnings() const { return variables_.warnings(); }
  bool follows(const Variable& output, std::size_t row, const Variable& input, std::size_t column) const final {
    return declares_dependency(description(), output, row, input, column);
  }

 protected:
  /// The next step: the full one, the fast one of FmuUnit, or, kByInputs, the fast one unless the inputs require the full one.
  enum class StepPath : std::uint8_t { kFull, kByInputs, kFast };
  static constexpr double kForever = std::numeric_limits<double>::infinity();

  ForeignUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options, InterfaceKind kind);

  virtual std::unique_ptr<ForeignInstance> make() = 0;
  /// Called at the end of Initialization Mode, before leaving it.
  virtual void prepare(Time) {}
  /// Called after Initialization Mode: brings the FMU to the mode in which steps can be made.
  virtual void begin(Time start) = 0;
  /// Makes a step. Returns false if the FMU discarded it.
  virtual bool advance(Time now, Duration h) = 0;
  /// Write and read the unit's own memory, which is saved and restored together with the FMU's state.
  virtual void write_memory(ByteWriter&) {}
  virtual void read_memory(ByteReader&) {}
  void note(const EventOutcome& events);
  /// Notes that a call at `t`, s, excluded earlier states (noSetFMUStatePriorToCurrentPoint = true).
  void commit(double t) { committed_ = std::max(committed_, t); }
  /// The path of the next step if there was no error, the simulation has not finished and no event is announced.
  virtual StepPath step_path() const { return StepPath::kFull; }

  const ModelDescription& description() const { return fmu_->description; }

  void drop();

  std::unique_ptr<ForeignInstance> instance_;
  bool healthy_ = false;              // initialised, and no error since
  bool finished_ = false;             // the FMU requested the end of the simulation
  StepPath path_ = StepPath::kFull;   // of the next step
  std::optional<double> next_event_;  // s
  std::shared_ptr<const ForeignFmu> fmu_;
  UnitOptions options_;
  CallPlace place_;  // of every call into the FMU
  const Interface& interface_;
  ForeignVariables variables_;
  StateKeeper states_;

 private:
  void replace();
  void renew_instance();
  void enter(Time time);
  void leave();
  void read_outputs();
  template <class Call>
  void attempt(Call call);
  void write_extra();
  bool is_before_commit(Time time) const;
  void choose_path() { path_ = healthy_ && !finished_ && !next_event_ ? step_path() : StepPath::kFull; }

  std::string extra_;             // what save_memory() adds to the FMU's state
  bool fresh_ = true;             // no function of the instance was called yet
  bool initialised_ = false;      // at least once
  bool in_mode_ = false;          // Initialization Mode
  bool reads_in_mode_ = true;     // false: reading outputs there has failed
  Time start_;                    // of the initialisation
  double committed_ = -kForever;  // s; see commit()
};

/// A foreign FMU for Co-Simulation as a unit. Most steps only set the changed continuous inputs, call doStep and read the
/// results; ForeignInstance::step() makes them. Any other step
///   1. sets what changed: continuous inputs directly; the others in event mode if the FMU has it, else directly
///   2. calls doStep until the communication point is reached: the FMU may return early or need event handling, and a step is
///      interrupted at the time of its next event
///   3. reads outputs and locals
/// A step that the FMU discards returns StepResult::kDiscard. If the FMU requires equal step sizes, another size is an Error.
/// Input derivatives are passed if FMI 2's canInterpolateInputs, our inputs der(u) in FMI 3 (rate.h) or FMI 3's intermediate
/// update allow it. Time-based clocks tick when a step reaches their time; if the FMU allows variable steps, the step is
/// interrupted there. The inputs are those of the whole step.
class FmuUnit final : public ForeignUnit {
 public:
  FmuUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options);
  StepResult step(Time now, Duration h) override;
  void append_notes(std::vector<std::string>& notes) const override;

 private:
  /// Statistics since the initialisation.
  struct Counts {
    std::uint64_t early_returns = 0, events = 0, discards = 0;
    double discarded_at = 0, discarded_reached = 0;  // s, of the last discarded step
  };
  std::unique_ptr<ForeignInstance> make() override;
  StepPath step_path() const override;
  void prepare(Time start) override;
  void begin(Time start) override;
  bool advance(Time now, Duration h) override;
  void write_memory(ByteWriter& out) override;
  void read_memory(ByteReader& in) override;
  StepResult step_fast(Time now, Duration h);
  StepResult step_checked(Time now, Duration h);
  StepResult complete_step();
  void send_inputs();
  void handle_events(double t);
  /// Completes event mode and enters step mode. `triggered`: requested ticks of triggered input clocks are made.
  void finish_events(double t, bool triggered);
  /// Returns the time at which the FMU or one of its clocks needs event mode, s.
  std::optional<double> next_stop() const;

  bool event_mode_ = false;
  bool ramps_by_updates_ = false;  // inputs are ramped in intermediate updates; else slopes are passed, if the FMU accepts them
  bool begun_ = false;             // the fast step did not complete; the full one continues it
  ForeignClocks clocks_;
  std::function<void()> observe_clocks_;  // empty without clocks
  Counts counts_;
  double step_begin_ = 0;  // s
  Duration equal_step_{};  // the step size, if the FMU requires equal steps
};

inline StepResult FmuUnit::step(Time now, Duration h) {
  if (path_ != StepPath::kFast) [[unlikely]]
    return step_checked(now, h);
  return step_fast(now, h);
}

[[gnu::always_inline]] inline StepResult FmuUnit::step_fast(Time now, Duration h) {
  set_call_place(place_, now.ns);
  try {
    if (variables_.step(*instance_, now, h)) [[likely]]
      return StepResult::kDone;
  } catch (...) {
    drop();
    throw;
  }
  return complete_step();
}

}  // namespace cotwin::fmu
