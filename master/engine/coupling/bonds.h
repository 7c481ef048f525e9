#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/wiring/members.h"
#include "master/engine/wiring/schedule.h"

/// Energy that passes the power bonds of a scenario.
namespace cotwin::master {

/// Measure of a power: kg.m2/s3, with or without the rad of an angular flow (N.m · rad/s, N · m/s).
bool is_power(const si::Measure& effort, const si::Measure& flow);

/// Throws Error at `place` if effort and flow differ in size, or if their product is no power. Returns the factor of the
/// product into W; 1 where a measure is unknown.
double power_factor(const Signal& effort, const Signal& flow, const std::string& place);

/// Energy that entered a power bond on side a and left it on side b.
struct Bonded {
  std::string name;
  double energy_a = 0, energy_b = 0, leak = 0;  // J; leak = a − b
  double tolerance = 0;                         // J
  double throughput = 0;                        // J, ∫|power| of side a
  double share = 0;                             // |leak| / throughput; 0 without throughput
};

/// The work on each side of a bond is Σ ½ h ((e f)_begin + (e f)_end) over the steps of the side's unit, with the inputs that
/// the step used: the value that was held, or both ends of a ramp. The difference of both sides is the energy that the coupling
/// creates (leak < 0) or loses. A side whose effort and flow belong to two units is sampled at the ends of the ticks or their
/// parts.
class Bonds {
 public:
  /// Throws Error at the bond's place for signals that do not exist, are not real, differ in size, or are no power.
  Bonds(const Scenario& scenario, std::span<const Member> members);

  bool empty() const { return bonds_.empty(); }
  /// Whether begin() and end() must be called for the steps of the member.
  bool meters(std::size_t member) const { return !of_member_[member].empty(); }

  /// Call after the initialisation.
  void start();
  /// Call before a step of the member of length `h`, when its inputs are set, and after it. A repeated begin() starts again.
  void begin(std::size_t member, Duration h);
  void end(std::size_t member, Duration h);
  /// Call after all units have stepped from the end of the last part by `h`.
  void end_part(Duration h);

  /// Largest change of a leak since `before` (an earlier state) relative to `tolerance` · (reference + energy that has passed).
  /// Leaves out bonds of members that do not make every step: those with a period, and those that cannot be restored.
  double error(std::span<const double> before, double tolerance) const;

  /// All sums and the last samples.
  std::span<const double> state() const { return numbers_; }
  /// Leaves out sides of members that cannot be restored.
  void restore(std::span<const double> state);

  std::vector<Bonded> results() const;

 private:
  /// Effort or flow of a side.
  struct Quantity {
    std::span<const double> values;
    std::span<const double> rate;  // of an input that its unit follows linearly
    bool input = false;
    bool held = false;  // an output that had its value at the end of the step all over the step
    std::vector<double> begin, end;

    void at_begin(double h);
    void at_end();
  };
  struct Side {
    Quantity effort, flow;
    double factor = 1;
    double* sums;       // its kNumbers numbers
    bool kept = false;  // belongs to a member that cannot be restored
  };
  enum : std::size_t { kWork, kThroughput, kLastPower, kNumbers };  // kLastPower: of a side with two members

  static Quantity quantity(const Signal& signal);
  std::size_t add_side(const std::string& effort, const std::string& flow, std::span<const Member> members,
                       const std::string& place);
  double leak(std::size_t bond, std::span<const double> numbers) const;

  struct Bond {
    std::string name;
    std::size_t a, b;  // sides
    double tolerance, reference;
    bool controlled;  // both sides make every step
  };
  std::vector<Bond> bonds_;
  std::vector<Side> sides_;
  std::vector<std::vector<std::size_t>> of_member_;  // sides
  std::vector<std::size_t> of_two_members_;          // sides
  std::vector<double> numbers_;
};

}  // namespace cotwin::master
