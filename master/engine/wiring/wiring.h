#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/schedule.h"
#include "models/foundation/support/error.h"

/// Connections as flat lists of copies: to = factor · from + offset.
namespace cotwin::master {

/// A connection between two variables. Factor and offset include the conversion of units of measure and the connection's own
/// linear transformation.
struct ResolvedConnection {
  Signal from, to;
  double factor = 1, offset = 0;
  /// The target is a parameter, which is set during initialisation only (SSP: calculatedParameter → parameter). Example: a
  /// drive starts at the first position of a recording.
  bool initial = false;
  bool suppress_unit_conversion = false;  // as the connection says; `factor` has it already
  /// Values of the variable that is the time derivative of `from`; empty if its unit has none.
  std::span<const double> derivative;
};

/// Resolves the connections. Throws Error `a.x -> b.u: …` for roles other than output → input, tunable or parameter, for kinds,
/// sizes and measures that do not fit, for an input that is fed twice, and for one that is
/// fed and has a value of the user for this run (ParameterValue::by_user). With `report`, calls it with each such error instead
/// and leaves the connection out.
using ReportConnectionError = std::function<void(const Error&)>;
std::vector<ResolvedConnection> resolve_connections(const Scenario& scenario, std::span<const Member> members,
                                                    const ReportConnectionError& report = nullptr);

class Wiring {
 public:
  enum class Way : std::uint8_t { kReal, kReals, kAffine, kInteger, kBoolean, kString, kIntegerToReal };
  struct Copy {
    Way way;
    std::uint32_t count;
    const void* from;
    void* to;
    double factor, offset;
  };

  /// `group_of`: member → its solved group, or kNoGroup (arrangement.h); continuous connections within a group are left out.
  Wiring(const std::vector<ResolvedConnection>& links, const Schedule& schedule, std::span<const std::size_t> group_of);

  /// Copies into the inputs of the slots [first, last).
  std::span<const Copy> copies(std::size_t first, std::size_t last) const {
    return std::span(copies_).subspan(begin_[first], begin_[last] - begin_[first]);
  }
  static void run(const Copy& copy) {
    if (copy.way == Way::kReal) {
      *static_cast<double*>(copy.to) = *static_cast<const double*>(copy.from);
    } else {
      run_other(copy);
    }
  }
  void exchange(std::size_t slot) const {
    for (const Copy& copy : copies(slot, slot + 1)) run(copy);
  }

  /// Ramps: inputs that their unit follows linearly over its step (Variable::rate). If the source is in an earlier stage, its
  /// value at the end of the step is known and the input goes there from the last value. Otherwise the input continues from the
  /// last value known with the derivative of the source where one is declared, else with the slope of the last step. It is held
  /// if its source is discrete or steps less often. `end`: of the next step of the slot, which has made none since slot.time.
  bool ramped(std::size_t slot) const { return ramp_begin_[slot] != ramp_begin_[slot + 1]; }
  void begin_ramps(std::span<const ScheduledUnit> slots, std::size_t slot, Time end);
  /// Sets the inputs to their values at the end of the step.
  void end_ramps(std::size_t slot);

  /// For initialisation: copies as exchange(), also into parameters, with slope 0 for ramps. Returns whether a bit of an input
  /// changed.
  bool update(std::size_t slot);

 private:
  enum class Ramp : std::uint8_t { kInterpolate, kExtrapolate, kHold };
  struct RampCopy {
    Ramp ramp;
    std::uint32_t count;
    std::size_t source;  // slot
    const double* from;
    double* to;
    double* rate;
    double* target;
    double factor, offset;
    const double* derivative;  // of `from`, nullptr if not declared
  };

  static void run_other(const Copy& copy);
  static bool differs(const Copy& copy);
  static bool update(const Copy& copy);
  static Copy make_copy(const ResolvedConnection& link);
  void add(const ResolvedConnection& link, std::size_t source, bool earlier_stage, bool slower_source);

  std::vector<Copy> copies_;          // by slot
  std::vector<std::size_t> begin_;    // slot → its first copy; one more at the end
  std::vector<Copy> initial_copies_;  // likewise, for initialisation only
  std::vector<std::size_t> initial_begin_;
  std::vector<RampCopy> ramps_;
  std::vector<std::size_t> ramp_begin_;
  std::vector<double> targets_;  // values of the ramps at the end of the step
};

}  // namespace cotwin::master
