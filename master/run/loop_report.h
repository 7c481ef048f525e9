#pragma once
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
};

/// A loop of continuous connections, for the summary.
struct LoopReport {
  std::string members;                                     // "drive, world"
  bool solved = false;                                     // implicit; otherwise its units step explicitly
  bool algebraic = false;                                  // its values depend on one another without delay
  double gain = std::numeric_limits<double>::quiet_NaN();  // largest GroupSolver::loop_gain of a tick; NaN if not measured
  double gain_time = 0;                                    // s, when it was measured
  bool unmeasurable = false;                               // a member has no cheap way back (Unit::goes_back)
  LoopCounts counts{};                                     // if solved
};

}  // namespace cotwin::master
