#pragma once
#include <cstddef>

/// Of Watch.
namespace cotwin::anomaly {

inline constexpr double kFaster = 1.3;                                        // than in the baseline: not judged
inline constexpr double kSlow = 0.05;                                         // rad/s, of joints that friction may hold
inline constexpr double kSign = 0.02;                                         // rad/s, over which friction changes its sign
inline constexpr double kAtLimit = 0.99;                                      // of the limit of torque: saturated
inline constexpr double kLeastReference = 0.5, kLeastLimit = 4, kClip = 3.5;  // of CUSUMs
inline constexpr double kLittle = 0.02;            // of the usual information: the block does not count
inline constexpr double kSettled = 0.3;            // of the usual information, added to that of each block
inline constexpr double kLeastChange = 0.01;       // of the limit of torque: a change that matters; half of it is ignored
inline constexpr double kFriction = 0.2;           // of the tuned friction, a change that matters
inline constexpr double kPeak = 3;                 // times the largest residual of the baseline
inline constexpr double kHold = 10;                // blocks in which the size of a change is estimated
inline constexpr double kLongest = 60;             // blocks, by which a change may be dated back
inline constexpr double kQuiet = 0.01;             // added to the ratio of squares whose logarithm is the spread
inline constexpr double kBears = 0.05;             // of what the first joint bears
inline constexpr double kExplained = 0.5;          // of the excess of squares that a cause must explain
inline constexpr double kAsGood = 0.8;             // of the best explanation's gain
inline constexpr double kSure = 3, kVerySure = 5;  // deviations, of the size of a change that is told, and told at once
inline constexpr double kBlowOfLimit = 0.04;       // of the limit of torque, the least blow
inline constexpr double kFarthest = 0.35;          // rad or m, by which an encoder may be off
inline constexpr double kBlow = 2;                 // blocks that a blow takes at most
inline constexpr double kScatter = 4;              // times the squares of the baseline, a spread that matters

/// What the baseline fits to the residuals of a joint: the friction of the day, as 1, tanh(q̇/0.02 rad/s), q̇, |q̇| q̇. Their share of the data's
/// weight by which coefficients other than the constant are drawn to 0.
inline constexpr std::size_t kFits = 4;
inline constexpr double kRidge = 0.02;

/// A block: the time at which it begins; per joint number of samples, Σ r², greatest and least r, Σ x_f r, Σ x_f x_g (f ≤ g) of the fitted x; per
/// term, a joint whose torque a cause changes, Σ φ r, Σ φ x_f, Σ φ².
enum : std::size_t {
  kCount,
  kSquares,
  kGreatest,
  kLeast,
  kWith,
  kPairs = kWith + kFits,
  kPerJoint = kPairs + kFits * (kFits + 1) / 2
};
enum : std::size_t { kProduct, kFitted, kEffect = kFitted + kFits, kPerTerm };

}  // namespace cotwin::anomaly
