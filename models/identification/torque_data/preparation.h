#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::identification {

/// The filter for identification during a run, for n joints: q, q̇ and τ pass the same critically damped state-variable filter
///   y = ω² / (s + ω)² u,      ω = 2π cutoff,
/// whose states give filtered q and q̇ and their derivatives: q̈ is the derivative of the filtered q̇ (exact, no differences).
/// Linear relations between signals hold for the filtered ones, delayed. Nonlinear terms of the dynamics cause errors of second
/// order in the delay. The discretisation is exact for inputs that are linear between samples, so any step is stable.
class CausalFilter {
 public:
  /// Throws Error unless 0 < cutoff.
  CausalFilter(std::size_t joints, double cutoff);

  /// Changes the cutoff; throws Error as above. Values and storage of the state do not change.
  void set_cutoff(double cutoff);
  /// Sets the state to the steady state for these values.
  void reset(std::span<const double> q, std::span<const double> dq, std::span<const double> tau);
  /// Takes the next sample, h seconds after the last. Allocates nothing.
  void step(double h, std::span<const double> q, std::span<const double> dq, std::span<const double> tau);

  std::span<const double> q() const { return part(0); }
  std::span<const double> dq() const { return part(1); }
  std::span<const double> ddq() const { return part(2); }
  std::span<const double> tau() const { return part(3); }
  double delay() const;  // s, at low frequency: 2/ω
  /// The whole state, for the declared state of a unit.
  std::span<double> state() { return state_; }
  void restored() { write_output(); }  // after state() was written

 private:
  void write_output();
  std::span<const double> part(std::size_t k) const { return {output_.data() + k * joints_, joints_}; }

  std::size_t joints_;
  double omega_;
  std::vector<double> state_;   // per signal and joint: last input, y, ẏ
  std::vector<double> output_;  // 4n
};

}  // namespace cotwin::identification
