#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

namespace cotwin::master {

/// What a solved loop has cost.
struct LoopCounts {
  std::int64_t steps = 0;           // of the loop, that were accepted
  std::int64_t iterations = 0;      // of Newton's method
  std::int64_t linearisations = 0;  // Jacobians computed by probing
  std::int64_t evaluations = 0;     // steps of single units, all together
  std::int64_t divided = 0;         // steps that were divided

  static auto fields(auto& c, auto each) { return each(c.steps, c.iterations, c.linearisations, c.evaluations, c.divided); }
};

/// Largest number of exchanged values of a loop whose gain coupling=auto measures.
inline constexpr std::size_t kMostMeasured = 1000;
/// Largest gain of a loop in a tick that coupling=auto leaves to explicit steps.
inline constexpr double kExplicitGain = 0.1;

/// A loop of continuous connections.
struct LoopReport {
  std::string members;                                     // "drive, world"
  bool solved = false;                                     // implicit; otherwise its units step explicitly
  bool algebraic = false;                                  // its values depend on one another without delay
  double gain = std::numeric_limits<double>::quiet_NaN();  // largest GroupSolver::loop_gain of a tick; NaN if not measured
  double gain_time = 0;                                    // s, when it was measured
  bool grows = false;                                      // a small deviation grows if its units step explicitly
  double solved_from = std::numeric_limits<double>::quiet_NaN();  // s, since when it is solved, if not from the start
  bool unmeasurable = false;                                      // a member has no cheap way back (Unit::has_cheap_rollback)
  std::size_t unknowns = 0;                                       // elements of its outputs
  /// s, the step from which on explicit steps let a small deviation grow; 0: also with 1/1024 tick; infinity: not up to `examined`;
  /// NaN: not measured. See Engine::measure_loops.
  double border = std::numeric_limits<double>::quiet_NaN();
  double examined = 0;         // s, the longest step that was looked at: 1024 ticks, or what all units make in reasonable time
  LoopCounts counts{};         // if solved
  std::string not_restorable;  // the member because of which it cannot be solved; else empty

  /// Whether coupling=auto solves it, if its gain was measured.
  bool needs_solving() const { return algebraic || grows || !(gain <= kExplicitGain); }
};

}  // namespace cotwin::master
