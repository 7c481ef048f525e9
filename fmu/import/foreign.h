#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "fmu/description/model_description.h"

/// FMUs that others made, and one set of verbs for the C interfaces of FMI 2 and FMI 3, Co-Simulation and Model Exchange.
namespace cotwin::fmu {

/// An unpacked FMU.
struct ForeignFmu {
  std::string name;  // of the file, for messages
  std::filesystem::path folder;
  std::shared_ptr<const void> unpacked;  // keeps the folder, if it is a temporary one
  ModelDescription description;
};

enum class InterfaceKind : std::uint8_t { kCoSimulation, kModelExchange };

/// The largest state that an FMU may have.
inline constexpr std::size_t kMaxStateBytes = std::size_t{1} << 30;

/// The last messages of an FMU, few and short whatever it says. May be written by any thread.
class Messages {
 public:
  void add(std::string_view level, std::string_view category, std::string_view text);
  /// "; the FMU says: [error] …", "" if it said nothing; forgets them.
  std::string take();
  std::uint64_t count() const;

 private:
  static constexpr std::size_t kKept = 8, kLength = 400;
  mutable std::mutex mutex_;
  std::deque<std::string> kept_;
  std::uint64_t count_ = 0, untold_ = 0;
};

/// How an instance is made.
struct ForeignOptions {
  InterfaceKind kind = InterfaceKind::kCoSimulation;
  std::string instance_name;
  bool event_mode = false;                              // FMI 3 Co-Simulation
  std::vector<std::uint32_t> intermediate_inputs;       // FMI 3 Co-Simulation: to be set in intermediate updates
  std::function<void(double)> set_intermediate_inputs;  // at that time
  bool output_derivatives = false;                      // will be asked for: the function must be there
  bool goes_back = false;  // states of earlier instants may be restored: noSetFMUStatePriorToCurrentPoint is false
};

struct StepOutcome {
  bool discarded = false;
  bool terminate = false;  // the FMU wants the simulation to end at `reached`
  bool event = false;      // FMI 3: event mode is needed at `reached`
  double reached = 0;      // s
};

/// What a time-based clock knows of its next activation.
enum class IntervalState : std::uint8_t { kNotYetKnown, kUnchanged, kChanged };

/// A step with the reals that go through one call before it and one after it; no references to get: no call.
struct PlainStep {
  std::span<const std::uint32_t> set_references, get_references;
  std::span<const double> set_values;
  std::span<double> get_values;
  double now = 0, h = 0;  // s
  StepOutcome outcome;    // of a step that did not simply come to its end
};

struct EventOutcome {
  bool terminate = false;
  bool nominals_changed = false;
  bool states_changed = false;
  std::optional<double> next_event;  // s
};

/// One instance of an FMU. Every function throws Error, with the function's name and what the FMU logged, where the FMU returns
/// an error; after a fatal one nothing is called any more, not even to free the instance.
class ForeignInstance {
 public:
  virtual ~ForeignInstance() = default;

  virtual void enter_initialisation(double start, std::optional<double> stop, std::optional<double> tolerance) = 0;
  virtual void exit_initialisation() = 0;

  /// Values of variables of one type, as the C interface has them (double*, const char**, …; booleans are int in FMI 2 and bool
  /// in FMI 3). `n`: number of elements together; `sizes`: of binaries, else nullptr.
  virtual void get(Type type, std::span<const std::uint32_t> references, void* values, std::size_t n, std::size_t* sizes) = 0;
  virtual void set(Type type, std::span<const std::uint32_t> references, const void* values, std::size_t n,
                   const std::size_t* sizes) = 0;
  /// Calls `set` in the configuration mode, in which structural parameters are set, before initialisation (FMI 3).
  virtual void configure(const std::function<void()>& set) = 0;
  /// First derivatives of inputs (FMI 2).
  virtual void set_input_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                                     std::span<const double> values) = 0;
  /// First derivatives of outputs, of Float64: element by element, at the end of the last step. Only where the options say
  /// that they are asked for.
  virtual void get_output_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                                      std::span<double> values) = 0;

  /// The FMU's state; `state` is nullptr or an earlier one, the memory of which is used again.
  virtual void save(void*& state) = 0;
  virtual void restore(void* state) = 0;
  virtual void free(void*& state) noexcept = 0;
  virtual void serialise(void* state, std::string& bytes) = 0;
  virtual void* deserialise(std::string_view bytes) = 0;

  // Co-Simulation
  virtual StepOutcome do_step(double now, double h) = 0;
  /// set() where `sets`, do_step() and get() in one call, which is all that most FMUs need in most steps. False if the step did
  /// not simply come to its end: then nothing was got, and its outcome says what happened.
  virtual bool step(PlainStep& step, bool sets);
  virtual void enter_step_mode() = 0;  // FMI 3 with event mode

  // Events: FMI 3 Co-Simulation with event mode, and Model Exchange
  virtual void enter_event_mode() = 0;
  /// Repeats fmi2NewDiscreteStates or fmi3UpdateDiscreteStates until nothing changes; `before_each`, if any, is called before.
  EventOutcome update_discrete_states(const std::function<void()>& before_each = nullptr);

  // Clocks in the event mode of FMI 3; intervals and shifts in the initialisation mode, too. s.
  virtual void activate_clocks(std::span<const std::uint32_t>) {}
  virtual void get_clocks(std::span<const std::uint32_t>, std::span<bool>) {}
  virtual void get_intervals(std::span<const std::uint32_t>, std::span<double>, std::span<IntervalState>) {}
  virtual void set_intervals(std::span<const std::uint32_t>, std::span<const double>) {}
  virtual void get_shifts(std::span<const std::uint32_t>, std::span<double>) {}

  // Model Exchange
  virtual void enter_continuous_time_mode() = 0;
  virtual void set_time(double t) = 0;
  virtual void set_states(std::span<const double> x) = 0;
  virtual void get_states(std::span<double> x) = 0;
  virtual void get_nominals(std::span<double> nominals) = 0;
  virtual void get_derivatives(std::span<double> dx) = 0;
  virtual void get_event_indicators(std::span<double> z) = 0;
  virtual std::size_t states() = 0;
  virtual std::size_t event_indicators() = 0;
  struct Completed {
    bool event = false, terminate = false;
  };
  virtual Completed completed_step() = 0;
  /// False if the FMU could not evaluate here (fmi2Discard): the solver tries a smaller step.
  virtual bool try_derivatives(double t, std::span<const double> x, std::span<double> dx) = 0;
  virtual bool try_event_indicators(double t, std::span<const double> x, std::span<double> z) = 0;

 private:
  /// One update; whether another is needed.
  virtual bool update_once(EventOutcome& out) = 0;
};

/// Throws Error for a library that is missing, cannot be loaded or lacks functions, and where the FMU refuses to be
/// instantiated.
std::unique_ptr<ForeignInstance> make_foreign(const ForeignFmu& fmu, ForeignOptions options);
std::unique_ptr<ForeignInstance> make_foreign_fmi2(const ForeignFmu& fmu, ForeignOptions options);
std::unique_ptr<ForeignInstance> make_foreign_fmi3(const ForeignFmu& fmu, ForeignOptions options);

/// What the FMU offers of that kind. Throws Error if it does not.
const Interface& interface_of(const ModelDescription& description, InterfaceKind kind);

/// The log categories that tell of errors and warnings alone.
std::vector<const char*> error_categories(const ModelDescription& description);

}  // namespace cotwin::fmu
