#pragma once
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/time.h"
#include "master/engine/wiring/members.h"
#include "master/engine/wiring/schedule.h"

/// Whether the steps of coupled units let a small deviation grow: their stability, without knowledge of the units' equations.
namespace cotwin::master {

/// The state of coupled units between two steps.
struct CoupledState {
  std::vector<Snapshot> units;                      // per slot
  std::vector<std::pair<Time, Duration>> progress;  // likewise: Slot::time, last_step
  std::vector<double> numbers;                      // CoupledSteps::numbers()
};

/// Units of a loop, with a way to step them together.
class CoupledSteps {
 public:
  virtual ~CoupledSteps() = default;
  /// Steps all units. Returns false if they cannot make the step. May throw Error.
  virtual bool step(Time begin, Duration h) = 0;
  /// Lets the inputs of the next step deviate a little, by different amounts.
  virtual void deviate() = 0;
  /// The outputs that are exchanged, and their magnitudes (> 0).
  virtual std::span<double* const> values() const = 0;
  virtual double magnitude(std::size_t value) const = 0;
  virtual std::span<ScheduledUnit* const> slots() const = 0;
  virtual std::span<const Member> members() const = 0;
  /// On what the next step depends beside the units and their slots.
  virtual std::vector<double> numbers() const { return {}; }
  virtual void set_numbers(std::span<const double>) {}

  void save(CoupledState& state) const;
  void restore(const CoupledState& state);
  /// For measure_growth: the same places each time, because some FMUs keep a few states only.
  CoupledState begin, plain, deviating;
};

/// The magnitude of a real variable whose value is not known: its nominal value, or 1e-3 of its SI measure.
double magnitude_of(const Variable& variable);
/// The deviation of value number `value` in a trial, relative to its magnitude.
double deviation_of(std::size_t value);

/// The growth of a small deviation.
struct StepGrowth {
  bool grows = false;
  /// Per step, in the second half of the steps: of linear units the spectral radius of a step, if there were enough steps. 0: the deviation has
  /// vanished; infinity: a step with the deviation cannot be made; NaN: no step can be made.
  double factor = std::numeric_limits<double>::quiet_NaN();
  int steps = 0;       // that were made without the deviation
  bool ended = false;  // and no more could be made
};

/// Makes up to `most` steps twice, without and with a deviation, and compares; fewer where the result is clear. `grows` is said of exponential
/// growth: the power of time that a chain of integrators lets grow is none. Growth by a factor below about 1 + 6/`most` a step is not seen. Leaves the
/// units as they are.
StepGrowth measure_growth(CoupledSteps& system, Time now, Duration h, int most);

/// Whether this many steps can be made. Leaves the units as they are.
bool can_step(CoupledSteps& system, Time now, Duration h, int count);

}  // namespace cotwin::master
