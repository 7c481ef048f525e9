#include "components/io/links/sensor_link.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"

namespace cotwin::io {

namespace {

// One stream of random numbers per signal.
enum Stream : std::uint32_t { kPosition = 0x5e4501, kSpeed, kTorque, kExternalTorque };

double quantised(double value, double resolution) {
  return resolution > 0 ? resolution * std::round(value / resolution) : value;
}

/// q, q̇, q̈, τ, τ_e one after the other.
void gather(const Measured& m, std::span<double> sample) {
  auto to = sample.begin();
  for (const auto* x : {&m.q, &m.dq, &m.ddq, &m.tau, &m.tau_e}) to = std::copy(x->begin(), x->end(), to);
}

void scatter(std::span<const double> sample, Measured& m) {
  auto from = sample.begin();
  for (auto* x : {&m.q, &m.dq, &m.ddq, &m.tau, &m.tau_e}) {
    std::copy_n(from, x->size(), x->begin());
    from += static_cast<std::ptrdiff_t>(x->size());
  }
}

}  // namespace

SensorLink::SensorLink(std::size_t joints, std::size_t history) {
  for (auto* v : {&q_true_, &dq_true_, &tau_true_, &tau_e_true_, &q_sigma_, &dq_sigma_, &tau_sigma_, &tau_e_sigma_,
                  &q_resolution_, &tau_offset_, &tau_e_offset_, &tau_e_filtered_}) {
    v->assign(joints, 0.0);
  }
  tau_gain_.assign(joints, 1.0);
  tau_e_gain_.assign(joints, 1.0);
  if (history == 0) return;
  line_.emplace(5 * joints, history);
  sample_.resize(5 * joints);
}

void SensorLink::declare(Variables& v, JointVariables& joints) {
  joints.input("q_true", q_true_, "rad", "true joint position at the sensor").essential();
  joints.input("dq_true", dq_true_, "rad/s", "true joint speed");
  joints.input("tau_true", tau_true_, "N.m", "true joint torque");
  joints.input("tau_e_true", tau_e_true_, "N.m", "true external joint torque");
  joints.parameter("q_sigma", q_sigma_, "rad", "standard deviation of the noise of q").range(0, 1e3);
  joints.parameter("dq_sigma", dq_sigma_, "rad/s", "standard deviation of the noise of dq").range(0, 1e3);
  joints.parameter("tau_sigma", tau_sigma_, "N.m", "standard deviation of the noise of tau").range(0, 1e6);
  joints.parameter("tau_e_sigma", tau_e_sigma_, "N.m", "standard deviation of the noise of tau_e").range(0, 1e6);
  joints.parameter("q_resolution", q_resolution_, "rad", "resolution of the position sensor; 0: not quantised").range(0, 1);
  v.parameter("tau_gain", tau_gain_, "1", "gain of the torque sensor; 1: exact");
  joints.parameter("tau_offset", tau_offset_, "N.m", "offset of the torque sensor");
  v.parameter("tau_e_gain", tau_e_gain_, "1", "gain of tau_e; 1: exact");
  joints.parameter("tau_e_offset", tau_e_offset_, "N.m", "offset of tau_e");
  v.parameter("tau_e_cutoff", tau_e_cutoff_, "Hz", "cutoff frequency of the first-order low-pass of tau_e; 0: no filter")
      .range(0, 1e6);
  v.parameter("seed", seed_, "seed of the noise");
  v.state("count", count_, "number of steps, from which the noise is derived");
  joints.state("tau_e_filtered", tau_e_filtered_, "N.m", "tau_e after its low-pass");
  v.parameter("delay", delay_, "s", "time after which measurements leave the sensors; needs a history").range(0, 1e6);
  if (line_) line_->declare(v, "sent", "1", "q, dq, ddq, tau and tau_e as measured");
}

void SensorLink::initialise(Time start, Measured& measured) {
  if (delay_ > 0 && !line_) {
    throw Error("unit:io.delay", "is " + text::to_text(delay_) +
                                     " s, but no samples are kept for it, expected a setting history=N with N > delay/step");
  }
  count_ = 0;
  measured.has_tau = measured.has_tau_e = true;
  measured.done = false;
  measure(0, measured);
  if (!line_) return;
  gather(measured, sample_);
  line_->start(start, sample_);
}

StepResult SensorLink::step(Time now, Duration h, const Command&, Measured& measured) {
  ++count_;
  if (line_) scatter(line_->latest(), measured);
  measure(h.seconds(), measured);
  if (line_) delay(now + h, measured);
  return StepResult::kDone;
}

void SensorLink::delay(Time now, Measured& measured) {
  gather(measured, sample_);
  line_->push(now, sample_);
  if (!line_->at(now + Duration{-Duration::from_seconds(delay_).ns}, sample_)) {
    throw Error("unit:io.delay",
                "is " + text::to_text(delay_) + " s, longer than the samples that are kept, expected a larger setting history");
  }
  scatter(sample_, measured);
}

void SensorLink::measure(double h, Measured& measured) {
  constexpr double kTurn = 6.283185307179586;
  const double old = h > 0 && tau_e_cutoff_ > 0 ? std::exp(-kTurn * tau_e_cutoff_ * h) : 0;
  for (std::size_t i = 0; i < q_true_.size(); ++i) {
    const auto noise = [&](Stream stream) {
      return numerics::normal({static_cast<std::uint64_t>(static_cast<std::uint32_t>(seed_)), stream,
                               static_cast<std::uint32_t>(count_), static_cast<std::uint32_t>(i), 0});
    };
    const double dq = dq_true_[i] + dq_sigma_[i] * noise(kSpeed);
    measured.ddq[i] = h > 0 ? (dq - measured.dq[i]) / h : 0;
    measured.dq[i] = dq;
    measured.q[i] = quantised(q_true_[i] + q_sigma_[i] * noise(kPosition), q_resolution_[i]);
    measured.tau[i] = tau_gain_[i] * (tau_true_[i] + tau_sigma_[i] * noise(kTorque)) + tau_offset_[i];
    const double tau_e = tau_e_true_[i] + tau_e_sigma_[i] * noise(kExternalTorque);
    tau_e_filtered_[i] = tau_e + old * (tau_e_filtered_[i] - tau_e);
    measured.tau_e[i] = tau_e_gain_[i] * tau_e_filtered_[i] + tau_e_offset_[i];
  }
  measured.fresh = true;
}

}  // namespace cotwin::io
