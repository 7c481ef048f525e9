#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "fmu/export/package.h"

/// An exported unit behind the C interfaces of FMI: the common part of FMI 2 and FMI 3 and all data of an instance. fmi2.cpp
/// and fmi3.cpp translate calls, types and status.
namespace cotwin::fmu {

/// The type of the unit that this library exports. Defined in the source that CMake writes for each unit (fmu.cmake).
const UnitType& exported_unit();

/// Has the numeric values of fmi2Status and fmi3Status.
enum class Status { kOk, kWarning, kDiscard, kError };

/// State of an instance in the state machine of FMI. The values are bits, so that a function's allowed states form a set.
enum State : unsigned {
  kInstantiated = 1,
  kInitialising = 2,   // Initialization Mode
  kStepping = 4,       // FMI 2: stepComplete, FMI 3: Step Mode
  kStepDiscarded = 8,  // FMI 2: stepFailed
  kTerminated = 16,
  kFailed = 32  // the unit threw
};
constexpr State last(State) { return kFailed; }
inline constexpr unsigned kAnyState = 63;
const char* name_of(State state);

/// Numbering of value references: 0 is time. Then FMI 2 numbers every element of every variable, FMI 3 every variable and then
/// the slopes of inputs (rate.h), in the order of declaration.
enum class References { kElements, kVariables };

class Exported {
 public:
  /// Receives log messages. `category` is one of kLogCategoryTexts.
  using Log = std::function<void(Status, const char* category, const std::string& message)>;

  /// Builds the unit from the package in `resources` or, if that has none, in the folder resources/ of the archive that
  /// contains this library. Throws Error if the package is missing or has another token, and the errors of the unit.
  Exported(References references, const std::string& token, const std::optional<std::filesystem::path>& resources);

  State state() const { return memory_.state; }
  bool restorable() const { return unit_ != nullptr && unit_->restorable(); }
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// For an invalid call, the following functions throw Error and leave the instance unchanged. If the unit throws, the state
  /// becomes kFailed.
  void setup(double start, std::optional<double> stop);
  void enter_initialisation();
  void exit_initialisation();
  /// Returns kOk or kDiscard. Times are those of the host, s, and may be sums of step sizes. After a step in which the unit
  /// requested the end of the run, finished() is true and no further step is possible.
  Status step(double now, double h);
  void terminate();
  void reset();
  double time() const { return memory_.host_time; }
  bool finished() const { return memory_.finished; }

  /// Read and write variables of one kind. Host is the type of an Element in the C interface. `values` has as many elements as
  /// the variables have in total. set() writes all values or, if it throws, none.
  template <class Element, class Host>
  void get(std::span<const unsigned> references, std::span<Host> values);
  template <class Element, class Host>
  void set(std::span<const unsigned> references, std::span<const Host> values);
  /// Sets time derivatives of inputs for the next step. Orders above 1, and derivatives of inputs that the unit holds constant,
  /// are ignored with kWarning and, the first time, a message. Throws Error for a variable that is not a real input.
  Status set_rates(std::span<const unsigned> references, std::span<const int> orders, std::span<const double> values);

  /// Reads first time derivatives of real variables. Throws Error for a variable without a declared derivative.
  void output_derivatives(std::span<const unsigned> references, std::span<const int> orders, std::span<double> values);
  /// Computes J · seed or, if `adjoint`, Jᵀ · seed, where J is the present Jacobian ∂unknowns/∂knowns.
  void directional(std::span<const unsigned> unknowns, std::span<const unsigned> knowns, std::span<const double> seed,
                   std::span<double> sensitivity, bool adjoint);
  bool has_partials() const { return !blocks_.empty(); }

  /// Saved states are identified by their addresses. Those that remain are freed with the instance.
  void* save(void* reuse);
  void restore(const void* saved);
  void free(void** saved);
  std::string serialise(const void* saved) const;
  void* deserialise(std::span<const std::byte> bytes);

  // Logging
  Log log;
  bool logging = false;
  unsigned logged_categories = ~0u;  // bits, in the order of kLogCategoryTexts
  void report(Status status, const std::string& message) const;
  /// Throws Error for a category that is not declared. An empty list means all categories.
  void choose_categories(bool on, std::span<const char* const> categories);

 private:
  /// The variable, or the element of one, with a value reference.
  struct ReferencedValue {
    const Variable* variable = nullptr;  // nullptr: time
    std::size_t first = 0, count = 1;
  };
  /// The state of this layer, apart from the unit's variables.
  struct Memory {
    State state = kInstantiated;
    bool initialised = false;  // the unit is initialised with the present values of its variables
    std::int64_t start_ns = 0, time_ns = 0;
    bool has_stop = false;
    std::int64_t stop_ns = 0;
    std::uint64_t steps = 0;  // since the start; bounds the rounding error of a host that adds up its steps
    double host_time = 0;     // s
    bool finished = false;    // the unit requested the end of the run

    static auto fields(auto& m, auto each) {
      return each(m.state, m.initialised, m.start_ns, m.time_ns, m.has_stop, m.stop_ns, m.steps, m.host_time, m.finished);
    }
  };
  struct Saved {
    Memory memory;
    Snapshot snapshot;
    /// Number of the initialisation that set the unit's fixed parameters and hidden memory; 0: in another instance.
    std::uint64_t initialisation = 0;

    static auto fields(auto& s, auto each) { return each(s.memory, s.snapshot); }
    static auto left_out(auto& s, auto each) { return each(s.initialisation); }
  };

  void build();
  void drop();
  Unit& unit() const;
  template <class Call>
  void in_unit(Call call);
  void initialise();
  void check_finite() const;
  const ReferencedValue& slot(unsigned reference) const;
  template <class Element>
  std::span<Element> elements(unsigned reference, const ReferencedValue& slot) const;
  std::string name_of(const ReferencedValue& slot) const;
  void check_writable(const ReferencedValue& slot) const;
  const Saved& find(const void* saved) const;
  void add_slots(const Variable& variable);
  void find_partials();
  std::size_t check_reals(std::span<const unsigned> references) const;

  References references_;
  Package package_;
  std::filesystem::path resources_;
  std::unique_ptr<Unit> unit_;  // nullptr after a reset that failed
  Variables variables_;
  std::vector<ReferencedValue> slots_;
  std::vector<Variable> rates_;                    // FMI 3: the inputs der(u) (rate.h)
  std::vector<std::span<const double>> computed_;  // real outputs and states
  struct Block {
    const Variable *unknown, *known;
    bool elementwise;
    std::size_t first;  // in partials_
  };
  std::vector<Block> blocks_;  // of the unit's Jacobian
  std::vector<double> partials_;
  std::vector<std::string> warnings_;
  bool warned_of_held_inputs_ = false;
  Memory memory_;
  std::uint64_t initialisation_ = 0;
  std::unordered_map<const void*, std::unique_ptr<Saved>> saved_;
};

template <class Call>
void Exported::in_unit(Call call) {
  try {
    call();
  } catch (...) {
    memory_.state = kFailed;
    throw;
  }
}

/// Runs `body` for `instance` if it is in one of the `allowed` states. Exceptions become kError and a log message that begins
/// with the function's name.
template <class Body>
Status guarded(Exported* instance, const char* function, unsigned allowed, Body body) noexcept {
  if (instance == nullptr) return Status::kError;
  try {
    try {
      if ((instance->state() & allowed) == 0) {
        instance->report(Status::kError, std::string(function) + ": must not be called " + name_of(instance->state()));
        return Status::kError;
      }
      return body(*instance);
    } catch (const std::exception& error) {
      instance->report(Status::kError, std::string(function) + ": " + error.what());
    }
  } catch (...) {
    return Status::kError;  // out of memory for the message
  }
  return Status::kError;
}

}  // namespace cotwin::fmu
