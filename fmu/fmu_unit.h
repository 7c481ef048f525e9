#pragma once
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/unit.h"
#include "fmu/bytes.h"
#include "fmu/foreign.h"
#include "fmu/foreign_variables.h"

namespace cotwin::fmu {

/// What a scenario may say about a foreign FMU, beside its start values.
struct UnitOptions {
  std::string instance_name;
  bool locals = true;
  std::map<std::string, std::uint64_t> structural;
  std::optional<double> stop;       // s; told to the FMU where it is known
  std::optional<double> tolerance;  // relative; none: that of the FMU's default experiment
  bool si = true;                   // see ForeignVariablesOptions
};

/// Whether continuous inputs of that FMU may be ramped.
bool ramps_of(const ModelDescription& description, InterfaceKind kind);

/// States of a foreign FMU, as bytes that a snapshot can carry: serialised where the FMU can, so that a fresh instance takes
/// them; else the number of one of the last kKept states that stay in the FMU.
class StateKeeper {
 public:
  static constexpr std::size_t kKept = 16;
  explicit StateKeeper(const Interface& interface) : serialises_(interface.can_serialise_state) {}

  /// Writes `extra` and the state.
  void save(ForeignInstance& instance, std::string_view extra, std::string& bytes);
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

/// What Co-Simulation and Model Exchange have in common: the FMU's variables as the unit's, and its life,
///   instantiate · start values · enter initialisation · inputs · exit initialisation · … · terminate · free
/// initialise() that repeats resets the FMU, or makes a new instance where it cannot.
class ForeignUnit : public cotwin::Unit {
 public:
  ~ForeignUnit() override;
  void declare(Variables& variables) final { variables_.declare(variables); }
  void initialise(Time start) final;
  StepResult step(Time now, Duration h) final;
  bool restorable() const final { return interface_.can_get_and_set_state; }
  void save_memory(std::string& bytes) final;
  void restore_memory(const std::string& bytes) final;
  const std::vector<std::string>& warnings() const { return variables_.warnings(); }

 protected:
  ForeignUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options, InterfaceKind kind, bool ramps);

  virtual std::unique_ptr<ForeignInstance> make() = 0;
  /// From the end of the initialisation mode to where steps can be made.
  virtual void begin(Time start) = 0;
  /// False: discarded.
  virtual bool advance(Time now, Duration h) = 0;
  /// What is remembered beside the FMU's state: written when that is saved, read when it was restored.
  virtual void write_memory(ByteWriter&) {}
  virtual void read_memory(ByteReader&) {}
  void note(const EventOutcome& events);

  const ModelDescription& description() const { return fmu_->description; }

  std::shared_ptr<const ForeignFmu> fmu_;
  UnitOptions options_;
  const Interface& interface_;
  ForeignVariables variables_;
  StateKeeper states_;
  std::unique_ptr<ForeignInstance> instance_;
  bool finished_ = false;             // the FMU wants the simulation to end
  std::optional<double> next_event_;  // s

 private:
  void start_afresh();
  void drop();

  bool fresh_ = true;         // the instance was made or reset and not touched since
  bool initialised_ = false;  // once, at least
  bool healthy_ = false;      // initialised, and no error since
};

/// A foreign FMU for Co-Simulation as a unit: here the words of FMI end. A step
///   1. sends what changed: continuous inputs at once; the rest too or, where the FMU has an event mode, in it
///   2. calls doStep until the communication point is reached: an FMU may return early, may need events handled on the way, and
///   is
///      stopped at the time of its next event
///   3. reads outputs and locals
/// A step that the FMU discards is StepResult::kDiscard. An FMU that has to be stepped equally gets equal steps or an Error.
/// Input derivatives are passed on where FMI 2's canInterpolateInputs or FMI 3's intermediate update allow it.
class FmuUnit final : public ForeignUnit {
 public:
  FmuUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options);

 private:
  std::unique_ptr<ForeignInstance> make() override;
  void begin(Time start) override;
  bool advance(Time now, Duration h) override;
  void write_memory(ByteWriter& out) override { out.value(equal_step_.ns); }
  void read_memory(ByteReader& in) override { equal_step_ = {in.value<std::int64_t>()}; }
  void send_inputs();
  void handle_events();

  bool event_mode_ = false;
  double step_begin_ = 0;  // s
  Duration equal_step_{};  // of an FMU that demands equal steps
};

}  // namespace cotwin::fmu
