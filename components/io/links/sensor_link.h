#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "components/io/link/link.h"
#include "components/unit/delay_line.h"

namespace cotwin::io {

/// The sensors of an emulated robot. Measurements of the true signals x at the inputs:
///   q = quantised(x + σ ν)   q̇ = x + σ ν   τ, τ_e = gain (x + σ ν) + offset   q̈ from two successive q̇
/// τ_e passes an additional first-order low-pass, because controllers estimate it. The white noise ν of variance 1 is new in
/// each step and depends only on (seed, joint, step). With a history, all measurements leave the sensors `delay` later, exact
/// to the bit for whole steps. Commands are ignored: the robot behind the sensors has its own inputs.
class SensorLink final : public Link {
 public:
  /// `history`: samples kept for the delay; 0: there is none.
  SensorLink(std::size_t joints, std::size_t history);

  void declare(Variables& v, JointVariables& joints) override;
  void initialise(Time start, Measured& measured) override;
  StepResult step(Time now, Duration h, const Command& command, Measured& measured) override;
  bool restorable() const override { return true; }

 private:
  void measure(double h, Measured& measured);
  void delay(Time now, Measured& measured);

  std::vector<double> q_true_, dq_true_, tau_true_, tau_e_true_;      // inputs
  std::vector<double> q_sigma_, dq_sigma_, tau_sigma_, tau_e_sigma_;  // parameters
  std::vector<double> q_resolution_, tau_gain_, tau_offset_, tau_e_gain_, tau_e_offset_;
  double tau_e_cutoff_ = 0;
  std::int32_t seed_ = 1;
  std::int32_t count_ = 0;              // states: number of steps
  std::vector<double> tau_e_filtered_;  // τ_e after its low-pass
  double delay_ = 0;                    // s
  std::optional<DelayLine> line_;       // q, q̇, q̈, τ, τ_e as measured
  std::vector<double> sample_;          // of the line: scratch
};

}  // namespace cotwin::io
