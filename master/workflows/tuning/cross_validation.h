#pragma once
#include "master/workflows/tuning/data.h"

namespace cotwin::master::tuning {

/// The settings that cross_validate chooses; the others stay as the user gave them. A cutoff of 0 of the user is replaced by
/// Survey::cutoff() of the training logs.
struct Open {
  bool cutoff = true, load = true, prior_weight = true;
};

/// Returns `settings` with the open ones chosen from the training part alone. Its samples are split into kFolds contiguous
/// parts; each is predicted by feasible least squares on the others, and the setting with the smallest error is taken. In
/// order: the cutoff of the low-pass, from up to eight around Survey::cutoff(); whether friction grows with the load; the prior
/// weight; the cutoff again. The score is Σ_joints (Σ errors² / the same of the first trial) / n. Errors are against the
/// torques as measured, because errors behind a low-pass decrease with its cutoff for any model. All cutoffs are compared on
/// the same samples, which end before the held-out part by the reach of the slowest filter. Each trial adds a sentence to
/// settings.chosen. The result does not depend on the number of threads, which call hooks.stop concurrently. Throws Error where
/// a fold has too few samples, and Stopped.
Settings cross_validate(Settings settings, const Open& open, int threads, const Hooks& hooks);

inline constexpr std::size_t kFolds = 5;

}  // namespace cotwin::master::tuning
