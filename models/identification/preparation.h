#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/identification/torque_model.h"
#include "models/trajectory/series.h"

namespace cotwin::identification {

struct PreparationOptions {
  double cutoff = 0;   // Hz of the zero-phase low-pass on q, q̇ and τ alike; 0: a tenth of the rate, at most 10 Hz; < 0: none
  int order = 4;       // of one pass (models/trajectory/filter.h)
  double trim = 0.02;  // share of the recording cut off at each end, where derivatives are one-sided
};

/// Samples for identification from a finished recording: positions (and speeds, where measured) and torques through the same
/// zero-phase filter, q̈ from the spline through the speeds, or q̇ and q̈ from that through the positions. `dq` and `theta` may
/// be empty series; theta: the motors' positions behind the gear. Throws Error for a cutoff at or above half the rate.
Samples prepare(const trajectory::Series& q, const trajectory::Series& dq, const trajectory::Series& tau,
                const trajectory::Series& theta = {}, const PreparationOptions& options = {});

/// The filter of a running twin, for n joints: q, q̇ and τ pass through the same critically damped state-variable filter
///   y = ω² / (s + ω)² u,      ω = 2π cutoff,
/// whose states give q and q̇ filtered and the derivatives of both: q̈ is the filtered derivative of q̇ (exact, no differences).
/// What is linear in filtered signals stays true of them, only delayed, and the dynamics' nonlinearity is second-order in the
/// filter's delay. Exact discretisation for inputs linear between samples, so that any step is stable.
class CausalFilter {
 public:
  /// Throws Error unless 0 < cutoff.
  CausalFilter(std::size_t joints, double cutoff);

  /// Another cutoff; throws Error as above. What it remembers stays, and where.
  void set_cutoff(double cutoff);
  /// Starts in the steady state of these values.
  void reset(std::span<const double> q, std::span<const double> dq, std::span<const double> tau);
  /// The next sample after h seconds. Allocates nothing.
  void step(double h, std::span<const double> q, std::span<const double> dq, std::span<const double> tau);

  std::span<const double> q() const { return part(0); }
  std::span<const double> dq() const { return part(1); }
  std::span<const double> ddq() const { return part(2); }
  std::span<const double> tau() const { return part(3); }
  double delay() const;  // s, at low frequency: 2/ω
  /// Everything that it remembers; for a unit's declared state.
  std::span<double> state() { return state_; }
  void restored() { write_output(); }  // after state() was written

 private:
  void write_output();
  std::span<const double> part(std::size_t k) const { return {output_.data() + k * joints_, joints_}; }

  std::size_t joints_;
  double omega_;
  std::vector<double> state_;   // per signal and joint: input before, y, ẏ
  std::vector<double> output_;  // 4n
};

}  // namespace cotwin::identification
