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

/// Foreign FMUs (made by other tools): one C++ interface for FMI 2 and FMI 3, Co-Simulation and Model Exchange.
namespace cotwin::fmu {

/// An unpacked FMU.
struct ForeignFmu {
  std::string name;  // of the file, for messages
  std::filesystem::path folder;
  std::shared_ptr<const void> unpacked;  // owns the folder if it is temporary
  ModelDescription description;
};

enum class InterfaceKind : std::uint8_t { kCoSimulation, kModelExchange };

/// The largest serialised state of an FMU that is accepted.
inline constexpr std::size_t kMaxStateBytes = std::size_t{1} << 30;

/// The last few log messages of an FMU, shortened. Any thread may add messages.
class Messages {
 public:
  void add(std::string_view level, std::string_view category, std::string_view text);
  /// Returns "; messages of the FMU: [error] …" or "", and removes the messages.
  std::string take();
  std::uint64_t count() const;

 private:
  static constexpr std::size_t kKept = 8, kLength = 400;
  mutable std::mutex mutex_;
  std::deque<std::string> kept_;
  std::uint64_t count_ = 0, new_ = 0;  // all; since take()
};

/// Options of an instance.
struct ForeignOptions {
  InterfaceKind kind = InterfaceKind::kCoSimulation;
  std::string instance_name;
  bool event_mode = false;                              // FMI 3 Co-Simulation
  std::vector<std::uint32_t> intermediate_inputs;       // FMI 3 Co-Simulation: set in intermediate updates
  std::function<void(double)> set_intermediate_inputs;  // sets them; argument: time, s
  bool output_derivatives = false;                      // are read, so the function is required
  bool may_restore = false;  // earlier states may be restored: noSetFMUStatePriorToCurrentPoint is false
};

struct StepOutcome {
  bool discarded = false;
  bool terminate = false;  // the FMU requests the end of the simulation at `reached`
  bool event = false;      // FMI 3: event mode is needed at `reached`
  double reached = 0;      // s
};

/// State of a time-based clock's interval (fmi3IntervalQualifier).
enum class IntervalState : std::uint8_t { kNotYetKnown, kUnchanged, kChanged };

/// A step with one call before it to set reals and one after it to read reals. Without references to get, nothing is read.
struct PlainStep {
  std::span<const std::uint32_t> set_references, get_references;
  std::span<const double> set_values;
  std::span<double> get_values;
  double now = 0, h = 0;  // s
  StepOutcome outcome;    // if the step was not simply completed
};

struct EventOutcome {
  bool terminate = false;
  bool nominals_changed = false;
  bool states_changed = false;
  std::optional<double> next_event;  // s
};

/// One instance of an FMU. Every function throws Error, with the name of the C function and the FMU's log messages, if the FMU
/// returns an error. After a fatal error no function is called any more, not even to free the instance.
class ForeignInstance {
 public:
  virtual ~ForeignInstance() = default;

  virtual void enter_initialisation(double start, std::optional<double> stop, std::optional<double> tolerance) = 0;
  virtual void exit_initialisation() = 0;

  /// Read and set variables of one type. `values` has the type of the C interface (double*, const char**, …; booleans are int
  /// in FMI 2 and bool in FMI 3). `n`: total number of elements; `sizes`: of binaries, else nullptr.
  virtual void get(Type type, std::span<const std::uint32_t> references, void* values, std::size_t n, std::size_t* sizes) = 0;
  virtual void set(Type type, std::span<const std::uint32_t> references, const void* values, std::size_t n,
                   const std::size_t* sizes) = 0;
  /// Calls `set` in Configuration Mode, where structural parameters are set (FMI 3, before initialisation).
  virtual void configure(const std::function<void()>& set) = 0;
  /// Sets first derivatives of inputs (FMI 2).
  virtual void set_input_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                                     std::span<const double> values) = 0;
  /// Reads first derivatives of Float64 outputs, element by element, at the end of the last step. Requires
  /// ForeignOptions::output_derivatives.
  virtual void get_output_derivatives(std::span<const std::uint32_t> references, std::span<const std::int32_t> orders,
                                      std::span<double> values) = 0;

  /// Saves the FMU's state. `state` is nullptr or an earlier state, whose memory is reused.
  virtual void save(void*& state) = 0;
  virtual void restore(void* state) = 0;
  virtual void free(void*& state) noexcept = 0;
  virtual void serialise(void* state, std::string& bytes) = 0;
  virtual void* deserialise(std::string_view bytes) = 0;

  // Co-Simulation
  virtual StepOutcome do_step(double now, double h) = 0;
  /// Calls set() if `sets`, then do_step() and get(); sufficient for most steps of most FMUs. Returns false if the step was
  /// discarded, ended early or needs event handling; then nothing was read, and step.outcome has the result.
  virtual bool step(PlainStep& step, bool sets);
  virtual void enter_step_mode() = 0;  // FMI 3 with event mode

  // Events: FMI 3 Co-Simulation with event mode, and Model Exchange
  virtual void enter_event_mode() = 0;
  /// Repeats fmi2NewDiscreteStates or fmi3UpdateDiscreteStates until the FMU needs no further update. Calls `before_each`, if
  /// given, before each of them.
  EventOutcome update_discrete_states(const std::function<void()>& before_each = nullptr);

  // Clocks of FMI 3, in event mode; intervals and shifts also in Initialization Mode. s.
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
  /// Return false if the FMU cannot evaluate at this point (fmi2Discard); the solver then tries a smaller step.
  virtual bool try_derivatives(double t, std::span<const double> x, std::span<double> dx) = 0;
  virtual bool try_event_indicators(double t, std::span<const double> x, std::span<double> z) = 0;

 private:
  /// Makes one update. Returns whether another is needed.
  virtual bool update_once(EventOutcome& out) = 0;
};

/// Loads the library and instantiates the FMU. Throws Error if the library is missing, cannot be loaded or lacks functions, or
/// if instantiation fails.
std::unique_ptr<ForeignInstance> make_foreign(const ForeignFmu& fmu, ForeignOptions options);
std::unique_ptr<ForeignInstance> make_foreign_fmi2(const ForeignFmu& fmu, ForeignOptions options);
std::unique_ptr<ForeignInstance> make_foreign_fmi3(const ForeignFmu& fmu, ForeignOptions options);

/// Returns the FMU's interface of this kind. Throws Error if the FMU lacks it.
const Interface& interface_of(const ModelDescription& description, InterfaceKind kind);

/// Returns the log categories of errors and warnings.
std::vector<const char*> error_categories(const ModelDescription& description);

}  // namespace cotwin::fmu
