#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/unit/tick_source.h"
#include "components/unit/time.h"
#include "components/unit/variables.h"

namespace cotwin {

enum class [[nodiscard]] StepResult : std::uint8_t{
    kDone,     // outputs hold at now + h
    kDiscard,  // the step is impossible with this h; the unit's variables are as they were before it, or the master
               // restores them
    kFinished  // as kDone; the unit requests the end of the run and makes no further step
};

/// A block of a unit's Jacobian: partial derivatives of a real output by a real input, output or state at one instant.
struct Partial {
  const char* unknown;
  const char* known;
  bool elementwise = false;  // element i of one depends only on element i of the other
};

/// A co-simulation unit: its variables and three verbs. The call order is
///   1. declare      once; names every variable and binds it to the member that holds it
///   2.   parameters, inputs and start values are written into the variables
///   3. initialise   makes states and outputs agree with parameters and inputs; 2 and 3 may repeat, also after steps, for a
///                   new start
///   4.   inputs and tunables are written
///   5. step         from now to now + h; 4 and 5 repeat; `now` is the end of the last step
///   6. restored     after a snapshot was written into the variables; then 4
///   7. end          after the last step; then 2 for a new start
/// A unit is used by one thread at a time, not always the same one. Two units share nothing that either writes.
class Unit {
 public:
  virtual ~Unit() = default;
  virtual void declare(Variables&) = 0;
  /// Throws Error if the user must act: a parameter that is not allowed, a file that cannot be read.
  virtual void initialise(Time start) = 0;
  /// Allocates nothing, blocks on nothing, reads no clock, prints nothing. `h` > 0 may differ from step to step.
  virtual StepResult step(Time now, Duration h) = 0;
  virtual void restored() {}
  /// Replaces `bytes` by what steps keep outside the variables: an FMU's state, compressed samples. A snapshot passes them to
  /// restore_memory(), of this instance or a new one, after the variables were written and before restored(). Bytes of an
  /// earlier call that are replaced are not restored any more, unless they were copied.
  virtual void save_memory(std::string& bytes) { bytes.clear(); }
  virtual void restore_memory(const std::string&) {}
  /// False for a unit whose step reaches outside (a bus, a robot) and cannot be taken back.
  virtual bool restorable() const { return true; }
  /// Whether going back to an earlier state is cheap: false for an FMU that needs a new instance for it.
  virtual bool has_cheap_rollback() const { return restorable(); }
  /// The blocks of the unit's analytic Jacobian, if it has one; the list does not change after declare. Blocks that are not
  /// listed are 0: the output does not depend on the input or state at the same instant.
  virtual std::span<const Partial> partials() const { return {}; }
  /// Writes the values of the blocks, one block after the other, for the present inputs and states: row by row (rows: elements
  /// of the unknown), of elementwise blocks only the diagonal. Call it after initialise. Changes no variable.
  virtual void evaluate_partials(std::span<double>) {}
  /// Appends sentences on the run so far, for the summary.
  virtual void append_notes(std::vector<std::string>&) const {}
  /// The clock of the robot or bus that the unit is connected to, for a scenario whose ticks follow it; nullptr if there is
  /// none. Owned by the unit; does not change after declare.
  virtual TickSource* tick_source() { return nullptr; }
  /// The run is over, at its stop time or by an error or a signal: what the unit operates goes to its safe state. May wait, for less
  /// than a second. Afterwards only append_notes() and initialise() are called. May be called repeatedly, and before initialise(). The
  /// destructor of a unit that was not ended does the same.
  virtual void end() noexcept {}
};

}  // namespace cotwin
