#pragma once
#include "master/program/tuning/data.h"

namespace cotwin::master::tuning {

/// What cross_validate may choose; what the user gave stays as it is. Where it gives a cutoff of 0 that is the rule's,
/// Survey::cutoff() of the training logs, which then stands in the settings.
struct Open {
  bool cutoff = true, load = true, prior_weight = true;
};

/// `settings` with what is open chosen by a rule that sees the training part alone: its samples fall into kFolds contiguous
/// parts, each of which is predicted by feasible least squares on the others, and what predicts best is taken. First the
/// low-pass's cutoff, of up to eight around Survey::cutoff(); then whether friction grows with the load; then the prior weight,
/// of six decades; then the cutoff once more. Judged by Σ_joints (Σ errors² / the same of the first trial) / n, of errors
/// against the torques as they were measured: those behind a low-pass fall with its cutoff whatever the model is. All cutoffs
/// are tried on the same samples, which end before the held-out part by as much as the slowest filter reaches. Each trial
/// becomes a sentence in settings.chosen. The same on any number of threads, which ask hooks.stop at once. Throws Error where a
/// fold has too few samples; Stopped.
Settings cross_validate(Settings settings, const Open& open, int threads, const Hooks& hooks);

inline constexpr std::size_t kFolds = 5;

}  // namespace cotwin::master::tuning
