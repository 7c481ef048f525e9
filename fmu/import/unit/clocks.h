#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "fmu/import/foreign.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/bytes.h"

namespace cotwin::fmu {

/// The clocks of an FMU for Co-Simulation (FMI 3.0.2, 2.2.10). They tick only in event mode:
///   time-based input clocks   are activated at their times: constant, fixed and tunable ones periodically from start + shift
///                             on, changing and countdown ones an interval after the event that gave the interval
///   triggered input clocks    are activated at the beginning of a step for which their variable is true
///   triggered output clocks   are activated by the FMU; they are read before each update of its discrete states
/// Each clock is a boolean variable of the unit. The variable of a triggered input clock requests a tick; the others are true
/// if the clock ticked in the last step. Clocked variables are exchanged while one of their clocks is active.
class ForeignClocks {
 public:
  /// `variables` must outlive this object.
  ForeignClocks(const ModelDescription& description, ForeignVariables& variables);

  bool empty() const { return timed_.empty() && triggered_.empty() && outputs_.empty(); }
  /// In Initialization Mode: computes the first tick of each clock. Throws Error for an invalid interval.
  void begin(ForeignInstance& instance, double start);
  /// Clears the ticks of the last step.
  void begin_step();
  /// Returns the time of the next tick of a time-based clock, s.
  std::optional<double> next() const;
  bool due(double t) const;
  /// Returns whether a tick of a triggered input clock is requested.
  bool triggered() const;

  // In event mode, in this order
  /// Activates the clocks that are due at `t` and, if `triggered`, the requested ones; exchanges their variables.
  void activate(ForeignInstance& instance, double t, bool triggered);
  /// Reads the output clocks and the variables of the active ones.
  void observe(ForeignInstance& instance);
  /// After the updates of discrete states: computes the next ticks.
  void schedule(ForeignInstance& instance, double t);

  std::uint64_t ticks() const { return ticks_; }  // since begin()

  void write(ByteWriter& out) const;
  void read(ByteReader& in);

 private:
  struct Timed {
    std::uint32_t reference = 0;
    std::string name;
    IntervalVariability variability = IntervalVariability::kConstant;
    bool declared = false;            // the description gives the interval
    double interval = 0, origin = 0;  // s; ticks at origin + count · interval
    std::uint64_t count = 0;
    double next = 0;  // s; infinite: unknown
    bool active = false;
    std::span<bool> ticked;
  };
  struct Triggered {
    std::uint32_t reference = 0;
    std::span<bool> ticked;
  };
  static bool periodic(const Timed& clock);
  void query_interval(ForeignInstance& instance, Timed& clock, double t, bool first);

  ForeignVariables& variables_;
  std::vector<Timed> timed_;
  std::vector<Triggered> triggered_, outputs_;
  std::vector<std::uint32_t> active_, output_references_;
  std::unique_ptr<bool[]> output_active_;
  std::uint64_t ticks_ = 0;
};

}  // namespace cotwin::fmu
