#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "fmu/import/foreign.h"
#include "fmu/import/variables.h"
#include "models/support/bytes.h"

namespace cotwin::fmu {

/// The clocks of an FMU for Co-Simulation (FMI 3.0.2, 2.2.10), which tick in its event mode alone:
///   time-based input clocks   are activated when their time has come: constant, fixed and tunable ones every interval from
///                             start + shift on, changing and countdown ones an interval after the event that told it
///   triggered input clocks    are activated at the beginning of a step for which their variable is true
///   triggered output clocks   are activated by the FMU, and asked for before each update of its discrete states
/// Each clock is a boolean variable of the unit. An input's asks for a tick; all others tell whether there was one in the last
/// step. Variables that belong to clocks are exchanged when one of these is active.
class ForeignClocks {
 public:
  /// The variables must live as long as this.
  ForeignClocks(const ModelDescription& description, ForeignVariables& variables);

  bool empty() const { return timed_.empty() && triggered_.empty() && outputs_.empty(); }
  /// In initialisation mode: when everything ticks for the first time. Throws Error for an interval that is none.
  void begin(ForeignInstance& instance, double start);
  /// Forgets what ticked.
  void begin_step();
  /// s; of time-based clocks.
  std::optional<double> next() const;
  bool due(double t) const;
  /// A triggered input clock is asked for.
  bool triggered() const;

  // In event mode, in this order
  /// Activates what is due at `t` and, if wanted, triggered; exchanges what belongs to it.
  void activate(ForeignInstance& instance, double t, bool triggered);
  /// Asks for the output clocks, and for what belongs to the active ones.
  void observe(ForeignInstance& instance);
  /// After the updates: when everything ticks next.
  void schedule(ForeignInstance& instance, double t);

  /// How often clocks were activated since begin().
  std::uint64_t ticks() const { return ticks_; }

  void write(ByteWriter& out) const;
  void read(ByteReader& in);

 private:
  struct Timed {
    std::uint32_t reference = 0;
    std::string name;
    IntervalVariability variability = IntervalVariability::kConstant;
    bool told = false;                // the description has the interval
    double interval = 0, origin = 0;  // s; ticks at origin + count · interval
    std::uint64_t count = 0;
    double next = 0;  // s; infinite: not known
    bool active = false;
    std::span<bool> ticked;
  };
  struct Triggered {
    std::uint32_t reference = 0;
    std::span<bool> ticked;
  };
  static bool periodic(const Timed& clock);
  void ask(ForeignInstance& instance, Timed& clock, double t, bool first);

  ForeignVariables& variables_;
  std::vector<Timed> timed_;
  std::vector<Triggered> triggered_, outputs_;
  std::vector<std::uint32_t> active_, output_references_;
  std::unique_ptr<bool[]> output_active_;
  std::uint64_t ticks_ = 0;
};

}  // namespace cotwin::fmu
