#pragma once
#include <stddef.h>

#include "models/robot/kernels/kernels.h"

/// What judgement.inc reads. Compiled for the processor and for a GPU: only plain structs and C headers are used here.
namespace cotwin::optimisation {

constexpr int kMostJudgedJoints = 16, kMostJudgedColumns = 32;

/// Costs by the names of Quantity.
enum JudgedCost {
  kJudgedTime,
  kJudgedTorque,
  kJudgedWork,
  kJudgedSharedWork,
  kJudgedAcceleration,
  kJudgedJerk,
  kJudgedEnergy,
  kJudgedCosts
};

struct JudgedJoint {
  double low[4], high[4], scale[4];         // bounds of q, dq, ddq, dddq; what their violation is relative to
  double tau;                               // torque bound less its margin; +∞: none
  double B, sigma2, tau_C, tau_0;           // DriveTerms
  double copper, converter, iron, eddy;     // DrivePower
  double dq_from, ddq_from, dq_to, ddq_to;  // of ends in motion
  double c_max;                             // of drawn motions, as all below
  double from[2], to[2];                    // boxes; unused where postures are listed
};

/// A problem as constants, in one block of memory without pointers, so that it may be copied to a device. Arrays lie behind this
/// structure: `x_at` is the place of its array in doubles from the beginning.
struct JudgedProblem {
  robot::KernelModel model;  // its pointers are not used
  size_t links_at, theta_0_at, joints_at;
  size_t hull_at[4];    // dʳβ_c/dsʳ bounded by MotionBasis::hull(parts, r), row by row
  size_t points_at[4];  // control points of dʳβ_c/dsʳ, row by row
  size_t tables_at;     // β_c, β_c′ and β_c″ of each sample in turn
  size_t weights_at;    // of the samples
  size_t exact_at[2];   // β_c″ and β_c‴ at `degree` nodes
  size_t exact_weights_at;
  size_t from_at, to_at;  // lists of `starts` and `goals` postures
  int n, columns, boundary, redundant, degree, parts, samples;
  int torques;  // whether the dynamics are computed
  int terms, costs[kJudgedCosts];
  int separate, shared;                                                     // energetics::Bus
  double idle, controller, per_supplied, per_returned, least, most, start;  // DrivePower
  unsigned starts, goals;                                                   // 0: a box
  unsigned long long seed;
  double T_min, T_max, ln_T_ratio;
};

/// What is told of motion i of a batch of `count`, at [k · count + i]: k = 0 the kinematic violation, 1 that of torques, 2 the bound that is exceeded
/// most as `bound · n + joint`, or kUndecided, then its costs, NaN where a kinematic bound is exceeded.
constexpr int kVerdictCosts = 3;
constexpr double kUndecided = -1;  // a derivative is too close to its bound, or something is not finite

}  // namespace cotwin::optimisation
