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

/// A unit behind the C interfaces of FMI: what FMI 2 and FMI 3 have in common. export_fmi2.cpp and export_fmi3.cpp translate
/// calls, types and status; everything that is remembered is here.
namespace cotwin::fmu {

/// The kind of unit that this library exports. Defined in the source that CMake writes for each (fmu.cmake).
const UnitType& exported_unit();

/// In the numbers of fmi2Status and fmi3Status.
enum class Status { kOk, kWarning, kDiscard, kError };

/// Where an instance is in its life; as bits, so that a function's allowed states are a set.
enum State : unsigned {
  kInstantiated = 1,
  kInitialising = 2,   // Initialization Mode
  kStepping = 4,       // FMI 2: stepComplete, FMI 3: Step Mode
  kStepDiscarded = 8,  // FMI 2: stepFailed
  kTerminated = 16,
  kFailed = 32  // the unit threw
};
inline constexpr unsigned kAnyState = 63;
const char* name_of(State state);

/// What value references mean: both versions give 0 to time. FMI 2 then numbers every element of every variable, FMI 3 every
/// variable, in the order of their declaration, and then the slopes of inputs (rate.h).
enum class References { kElements, kVariables };

class Exported {
 public:
  /// Receives what is logged. `category` is one of kLogCategoryTexts.
  using Log = std::function<void(Status, const char* category, const std::string& message)>;

  /// Builds the unit from the package in `resources` or, where that is not given, in the folder resources/ of the archive that
  /// this library lies in. Throws Error for a package that is missing or has another token, and what the unit throws.
  Exported(References references, const std::string& token, const std::optional<std::filesystem::path>& resources);

  State state() const { return memory_.state; }
  bool restorable() const { return unit_ != nullptr && unit_->restorable(); }
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// What follows throws Error and leaves the instance as it was if the call was wrong; if the unit fails, the state is
  /// kFailed.
  void setup(double start, std::optional<double> stop);
  void enter_initialisation();
  void exit_initialisation();
  /// kOk or kDiscard. Times are the host's, in seconds, and may be sums of step sizes. After a step in which the unit asked for
  /// an end of the run, finished() is true and no further step is made.
  Status step(double now, double h);
  void terminate();
  void reset();
  double time() const { return memory_.host_time; }
  bool finished() const { return memory_.finished; }

  /// Reads or writes variables of one kind; Host is the type by which the C interface carries an Element. `values` has as many
  /// elements as the variables together. set() writes all or, if it throws, nothing.
  template <class Element, class Host>
  void get(std::span<const unsigned> references, std::span<Host> values);
  template <class Element, class Host>
  void set(std::span<const unsigned> references, std::span<const Host> values);
  /// Time derivatives of inputs over the next step. A slope of an input that the unit does not follow, and orders above the
  /// first, are left out: kWarning, and a message the first time. Throws Error for what is no real input.
  Status set_rates(std::span<const unsigned> references, std::span<const int> orders, std::span<const double> values);

  /// First time derivatives of real variables, as the variables that the unit declares to be them. Throws Error for others.
  void output_derivatives(std::span<const unsigned> references, std::span<const int> orders, std::span<double> values);
  /// J seed or, adjoint, Jᵀ seed, of the Jacobian of `unknowns` by `knowns` as the variables are now.
  void directional(std::span<const unsigned> unknowns, std::span<const unsigned> knowns, std::span<const double> seed,
                   std::span<double> sensitivity, bool adjoint);
  bool has_partials() const { return !blocks_.empty(); }

  /// Saved states, known by their addresses and freed with the instance at the latest.
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
  /// Throws Error for a category that is not declared. None means all.
  void choose_categories(bool on, std::span<const char* const> categories);

 private:
  /// A variable, or an element of one, that a value reference means.
  struct Slot {
    const Variable* variable = nullptr;  // nullptr: time
    std::size_t first = 0, count = 1;
  };
  /// What this layer remembers beside the unit's variables.
  struct Memory {
    State state = kInstantiated;
    bool initialised = false;  // the unit agrees with its variables
    std::int64_t start_ns = 0, time_ns = 0;
    bool has_stop = false;
    std::int64_t stop_ns = 0;
    std::uint64_t steps = 0;  // since the start: how many additions the host's time may have seen
    double host_time = 0;     // s
    bool finished = false;    // the unit asked for the end
  };
  struct Saved {
    Memory memory;
    Snapshot snapshot;
    std::uint64_t initialisation =
        0;  // the one that the unit's fixed parameters and hidden memory stem from; 0: another instance's
  };

  void build();
  void drop();
  Unit& unit() const;
  template <class Call>
  void in_unit(Call call);
  void initialise();
  void check_finite() const;
  const Slot& slot(unsigned reference) const;
  template <class Element>
  std::span<Element> elements(unsigned reference, const Slot& slot) const;
  std::string name_of(const Slot& slot) const;
  void check_writable(const Slot& slot) const;
  const Saved& find(const void* saved) const;
  void find_partials();
  std::size_t check_reals(std::span<const unsigned> references) const;

  References references_;
  Package package_;
  std::filesystem::path resources_;
  std::unique_ptr<Unit> unit_;  // nullptr after a reset that failed
  Variables variables_;
  std::vector<Slot> slots_;
  std::vector<Variable> rates_;                    // FMI 3: the slopes of inputs as inputs (rate.h)
  std::vector<std::span<const double>> computed_;  // real outputs and states
  struct Block {
    const Variable *unknown, *known;
    bool elementwise;
    std::size_t first;  // in partials_
  };
  std::vector<Block> blocks_;  // of the unit's Jacobian
  std::vector<double> partials_;
  std::vector<std::string> warnings_;
  bool told_of_held_inputs_ = false;
  Memory memory_;
  std::uint64_t initialisation_ = 0;
  std::unordered_map<const void*, std::unique_ptr<Saved>> saved_;
};

/// Runs `body` for `instance` if that is in one of the `allowed` states. No exception leaves it: what is wrong becomes kError
/// and a logged message that begins with the function's name.
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
    return Status::kError;  // not even the message could be made
  }
  return Status::kError;
}

}  // namespace cotwin::fmu
