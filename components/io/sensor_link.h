#pragma once
#include <cstdint>
#include <vector>

#include "components/io/link.h"

namespace cotwin::io {

/// The sensors of an emulated robot. Measurements of the true signals x at the inputs:
///   q = quantised(x + σ ν)   q̇ = x + σ ν   τ, τ_e = gain (x + σ ν) + offset   q̈ from two successive q̇
/// τ_e passes an additional first-order low-pass, because controllers estimate it. The white noise ν of variance 1 is new in
/// each step and depends only on (seed, joint, step). Commands are ignored: the robot behind the sensors has its own inputs.
class SensorLink final : public Link {
 public:
  explicit SensorLink(std::size_t joints);

  void declare(Variables& v, JointVariables& joints) override;
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
  std::int32_t count_ = 0;              // states: number of steps
  std::vector<double> tau_e_filtered_;  // τ_e after its low-pass
};

}  // namespace cotwin::io
