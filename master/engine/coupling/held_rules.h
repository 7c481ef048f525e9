#pragma once
#include <iterator>

namespace cotwin::master {

/// What an input that its unit holds gets in a solved step: a share of the value at the end of the step, the rest is the value at the beginning.
struct HeldRule {
  double share;
  bool all;  // also inputs that act without delay, which have the value at the end otherwise
};
inline constexpr HeldRule kHeldRules[] = {{0.5, false}, {0.75, false}, {1, false}, {0, false}, {0, true}};
inline constexpr int kHeldRuleCount = static_cast<int>(std::size(kHeldRules));
inline constexpr int kDampingRules = 3;      // the first rules, from the most exact to the one that damps most
inline constexpr double kStiffGain = 0.3;    // of a loop in a step, above which no mean is tried first
inline constexpr int kMostRuleHalvings = 4;  // of a step with the first rule

}  // namespace cotwin::master
