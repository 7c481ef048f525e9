#pragma once
#include <cstdint>
#include <vector>

#include "components/io/link.h"

namespace cotwin::io {

/// The sensors of an emulated robot: what they make of the true signals x at its inputs,
///   q = quantised(x + σ ν)   q̇ = x + σ ν   τ, τ_e = gain (x + σ ν) + offset   q̈ from two successive q̇
/// where τ_e passes a first-order low-pass of its own (controllers estimate it), with white noise ν of variance 1, new at each
/// step, keyed by (seed, joint, step): the same seed makes the same noise whatever else runs. Commands are ignored: the robot
/// behind the sensors gets its own.
class SensorLink final : public Link {
 public:
  explicit SensorLink(std::size_t joints);

  void declare(Variables& v) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return true; }

 private:
  void measure(double h, Measured& measured);

  std::vector<double> q_true_, dq_true_, tau_true_, tau_e_true_;      // inputs
  std::vector<double> q_sigma_, dq_sigma_, tau_sigma_, tau_e_sigma_;  // parameters
  std::vector<double> q_resolution_, tau_gain_, tau_offset_, tau_e_gain_, tau_e_offset_;
  double tau_e_cutoff_ = 0;
  std::int32_t seed_ = 1;
  std::int32_t count_ = 0;              // states: steps made
  std::vector<double> tau_e_filtered_;  // τ_e behind its low-pass
};

}  // namespace cotwin::io
