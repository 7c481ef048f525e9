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

#include "components/unit/staged_initialisation.h"
#include "components/unit/unit.h"
#include "fmu/import/clocks.h"
#include "fmu/import/foreign.h"
#include "fmu/import/under_way.h"
#include "fmu/import/variables.h"
#include "models/support/bytes.h"

namespace cotwin::fmu {

/// What a scenario may say about a foreign FMU, beside its start values.
struct UnitOptions {
  std::string instance_name;
  bool locals = true;
  std::map<std::string, std::uint64_t> structural;
  std::optional<double> stop;       // s; told to the FMU where it is known
  std::optional<double> tolerance;  // relative; none: that of the FMU's default experiment
  bool si = true;                   // see ForeignVariablesOptions
  bool slopes = false;              // likewise
  bool rollback = false;            // the FMU is told that its run may go back; see ForeignUnit
};

struct LoadOptions;
/// Those of load.h.
UnitOptions unit_options(const LoadOptions& options);

/// Whether that FMU can be taken back to an earlier instant.
bool can_go_back(const Interface& interface, const UnitOptions& options);

/// Whether continuous inputs of that FMU may be ramped.
bool ramps_of(const ModelDescription& description, InterfaceKind kind);

/// How the variables of that FMU are shown. Throws Error where slopes are wanted that the FMU does not tell.
ForeignVariablesOptions variables_options(const ModelDescription& description, InterfaceKind kind, const UnitOptions& options);

/// States of a foreign FMU, as bytes that a snapshot can carry: serialised where the FMU can, so that a fresh instance takes
/// them; else the number of one of the last kKept states that stay in the FMU.
class StateKeeper {
 public:
  static constexpr std::size_t kKept = 16;
  explicit StateKeeper(const Interface& interface) : serialises_(interface.can_serialise_state) {}

  /// Writes `extra` and the state, which is that at `time`.
  void save(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes);
  /// Of the state. Throws Error for no bytes.
  static Time time_of(const std::string& bytes);
  /// Gives `extra` back. Throws Error for bytes of another FMU's kind and for a state that is no longer kept.
  std::string restore(ForeignInstance& instance, const std::string& bytes);
  /// Before the instance goes.
  void clear(ForeignInstance& instance) noexcept;

 private:
  struct Kept {
    std::uint64_t number = 0;
    void* state = nullptr;
  };
  bool serialises_;
  std::uint64_t next_ = 1;
  std::array<Kept, kKept> kept_{};
  std::string scratch_;
};

/// Whether bytes of StateKeeper hold the FMU's state itself, so that an instance in another process can take it.
bool holds_state(std::string_view saved);

/// What Co-Simulation and Model Exchange have in common: the FMU's variables as the unit's, and its life,
///   instantiate · start values · enter initialisation · inputs · exit initialisation · … · terminate · free
/// initialise() that repeats makes a new instance: FMUs are never reset, which many cannot bear.
///
/// Going back: with `rollback` the FMU is told in every step that earlier states may be restored
/// (noSetFMUStatePriorToCurrentPoint = false), and they are. Else it is told that they are not (true), and restore_memory() of
/// a state before the last communication point does not break that promise: a new instance takes the serialised state. An FMU
/// that cannot serialise its states is restorable() with `rollback` alone.
class ForeignUnit : public Unit, public StagedInitialisation {
 public:
  ~ForeignUnit() override;
  void declare(Variables& variables) final { variables_.declare(variables); }
  void initialise(Time start) final;
  /// In Initialization Mode inputs are set and outputs are got. An FMU whose outputs cannot be read there completes its
  /// initialisation at once; it, and one whose parameters change, begins anew in an update.
  void enter_initialisation(Time start) final;
  void update_initialisation() final;
  void exit_initialisation() final;
  StepResult step(Time now, Duration h) override;
  bool restorable() const final { return can_go_back(interface_, options_); }
  void save_memory(std::string& bytes) final;
  void restore_memory(const std::string& bytes) final;
  const std::vector<std::string>& warnings() const { return variables_.warnings(); }

 protected:
  /// How a step may be made: whether FmuUnit's simple one will do, or will if the inputs do not ask for more.
  enum class Pace : std::uint8_t { kCareful, kByInputs, kSimple };
  static constexpr double kForever = std::numeric_limits<double>::infinity();

  ForeignUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options, InterfaceKind kind);

  virtual std::unique_ptr<ForeignInstance> make() = 0;
  /// At the end of the initialisation mode, still in it.
  virtual void prepare(Time) {}
  /// From the end of the initialisation mode to where steps can be made.
  virtual void begin(Time start) = 0;
  /// False: discarded.
  virtual bool advance(Time now, Duration h) = 0;
  /// What is remembered beside the FMU's state: written when that is saved, read when it was restored.
  virtual void write_memory(ByteWriter&) {}
  virtual void read_memory(ByteReader&) {}
  void note(const EventOutcome& events);
  /// The FMU was told at `t` that nothing before will be restored.
  void promise(double t) { promised_ = std::max(promised_, t); }
  /// The pace of a unit that is healthy, has not finished and awaits no event.
  virtual Pace pace() const { return Pace::kCareful; }

  const ModelDescription& description() const { return fmu_->description; }

  void drop();

  std::unique_ptr<ForeignInstance> instance_;
  bool healthy_ = false;              // initialised, and no error since
  bool finished_ = false;             // the FMU wants the simulation to end
  Pace pace_ = Pace::kCareful;        // of the next step
  std::optional<double> next_event_;  // s
  std::shared_ptr<const ForeignFmu> fmu_;
  UnitOptions options_;
  CallPlace place_;  // of every call into the FMU
  const Interface& interface_;
  ForeignVariables variables_;
  StateKeeper states_;

 private:
  void replace();
  void begin_anew();
  void enter(Time time);
  void leave();
  void read_outputs();
  template <class Call>
  void attempt(Call call);
  bool breaks_a_promise(Time time) const;
  void choose_pace() { pace_ = healthy_ && !finished_ && !next_event_ ? pace() : Pace::kCareful; }

  bool fresh_ = true;            // the instance was made and not touched since
  bool initialised_ = false;     // once, at least
  bool in_mode_ = false;         // Initialization Mode
  bool reads_in_mode_ = true;    // its outputs can be read there, as far as is known
  Time start_;                   // of the initialisation
  double promised_ = -kForever;  // s; see promise()
};

/// A foreign FMU for Co-Simulation as a unit: here the words of FMI end. Most steps need nothing but the continuous inputs that
/// changed, doStep and the results, and go through ForeignInstance::step(). Any other
///   1. sends what changed: continuous inputs at once; the rest too or, where the FMU has an event mode, in it
///   2. calls doStep until the communication point is reached: an FMU may return early, may need events handled on the way, and
///      is stopped at the time of its next event
///   3. reads outputs and locals
/// A step that the FMU discards is StepResult::kDiscard. An FMU that has to be stepped equally gets equal steps or an Error.
/// Input derivatives are passed on where FMI 2's canInterpolateInputs, inputs der(u) of ours in FMI 3 (rate.h) or FMI 3's
/// intermediate update allow it. Time-based clocks tick where a step, pausing there if the FMU lets us, reaches their time,
/// with the inputs as that step has them.
class FmuUnit final : public ForeignUnit {
 public:
  FmuUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options);
  StepResult step(Time now, Duration h) override;
  void tell(std::vector<std::string>& notes) const override;

 private:
  /// What an FMU asked for since the initialisation.
  struct Asked {
    std::uint64_t early_returns = 0, events = 0, discards = 0;
    double discarded_at = 0, discarded_reached = 0;  // s, of the last one
  };
  std::unique_ptr<ForeignInstance> make() override;
  Pace pace() const override;
  void prepare(Time start) override;
  void begin(Time start) override;
  bool advance(Time now, Duration h) override;
  void write_memory(ByteWriter& out) override;
  void read_memory(ByteReader& in) override;
  StepResult step_simply(Time now, Duration h);
  StepResult step_with_care(Time now, Duration h);
  StepResult complete_step();
  void send_inputs();
  void handle_events(double t);
  /// From event mode, in which the FMU is, to step mode. `triggered`: the triggered input clocks that are asked for tick.
  void finish_events(double t, bool triggered);
  /// s; where the FMU or one of its clocks wants event mode.
  std::optional<double> next_stop() const;

  bool event_mode_ = false;
  bool ramps_by_updates_ = false;  // inputs move in intermediate updates; else the FMU is given their slopes, if it wants them
  bool begun_ = false;             // a step that was thought to be a simple one is to be completed
  ForeignClocks clocks_;
  std::function<void()> observe_clocks_;  // empty without clocks
  Asked asked_;
  double step_begin_ = 0;  // s
  Duration equal_step_{};  // of an FMU that demands equal steps
};

inline StepResult FmuUnit::step(Time now, Duration h) {
  if (pace_ != Pace::kSimple) [[unlikely]]
    return step_with_care(now, h);
  return step_simply(now, h);
}

inline StepResult FmuUnit::step_simply(Time now, Duration h) {
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
