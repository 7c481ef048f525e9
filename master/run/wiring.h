#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "master/run/members.h"
#include "master/run/schedule.h"
#include "models/support/error.h"

/// Connections as flat lists of copies: to = factor · from + offset.
namespace cotwin::master {

/// What one connection does, in terms of the two variables: the units of measure and the connection's own linear
/// transformation are already folded into factor and offset.
struct Link {
  Signal from, to;
  double factor = 1, offset = 0;
  /// It ends at a parameter, which follows the output during initialisation and keeps what it has then (SSP:
  /// calculatedParameter → parameter), as where a drive starts at the first position of a recording.
  bool initial = false;
  /// Of a real output the time derivative of which is another variable of its unit: that variable's values; else empty.
  std::span<const double> derivative;
};

/// Resolves the connections. Throws Error `a.x -> b.u: …` for roles other than output → input or parameter, kinds, sizes and
/// measures that do not fit, and for an input that is fed twice.
/// With `complain` every connection that is not right is told there, and left out.
using ComplainOfLink = std::function<void(const Error&)>;
std::vector<Link> resolve_links(const Scenario& scenario, std::span<const Member> members,
                                const ComplainOfLink& complain = nullptr);

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

  Wiring(const std::vector<Link>& links, const Schedule& schedule);

  /// What is copied into the inputs of the slots [first, last).
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
  void exchange(std::size_t first, std::size_t last) const {
    for (const Copy& copy : copies(first, last)) run(copy);
  }

  /// Inputs that their unit follows linearly over its step (Variable::rate). From a unit of an earlier stage the value at the
  /// end of the step is known and the input runs there from the last value; otherwise it continues with the derivative that
  /// the source knows, else with the slope of the last step, or is held if its source steps more rarely. `h`: the step to come;
  /// `last`: the step before, 0 if none.
  bool ramped(std::size_t slot) const { return ramp_begin_[slot] != ramp_begin_[slot + 1]; }
  void begin_ramps(std::size_t slot, Duration h, Duration last);
  /// Leaves the inputs at the values that hold at the end of the step.
  void end_ramps(std::size_t slot);

  /// As exchange(slot, slot + 1) with every ramp at rest; true if any input is not what it was before, bit for bit.
  bool settle(std::size_t slot);
  /// The real inputs of the slot that reals feed, element by element.
  std::vector<double*> fed_reals(std::size_t slot) const;

 private:
  enum class Ramp : std::uint8_t { kInterpolate, kExtrapolate, kHold };
  struct RampCopy {
    Ramp ramp;
    std::uint32_t count;
    const double* from;
    double* to;
    double* rate;
    double* target;
    double factor, offset;
    const double* derivative;  // of `from`, nullptr if it is not known
  };

  static void run_other(const Copy& copy);
  static bool differs(const Copy& copy);
  static bool settle(const Copy& copy);
  static Copy make_copy(const Link& link);
  void add(const Link& link, bool earlier_stage, bool slower_source);

  std::vector<Copy> copies_;          // by slot
  std::vector<std::size_t> begin_;    // slot → its first copy; one more at the end
  std::vector<Copy> initial_copies_;  // likewise, those of initialisation alone
  std::vector<std::size_t> initial_begin_;
  std::vector<RampCopy> ramps_;
  std::vector<std::size_t> ramp_begin_;
  std::vector<double> targets_;
};

}  // namespace cotwin::master
