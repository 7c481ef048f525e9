#include "master/clock/phase_locked_loop.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cotwin::master {

namespace {

constexpr double kMostDrift = 1e-3;  // of two quartz clocks: at most 200 ppm
constexpr double kMostGain = 0.25;   // of ωT: the sampled loop stays well damped
constexpr int kAveragedTicks = 64;   // measurements in a mean
constexpr int kStepAfter = 16;       // outliers in a row that agree

/// a − b of times that may come from a damaged packet.
std::int64_t difference(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b));
}

}  // namespace

std::int64_t wrap(std::int64_t ns, std::int64_t cycle) {
  const std::int64_t rest = ns % cycle;
  if (rest > cycle / 2) return rest - cycle;
  return rest < -((cycle - 1) / 2) ? rest + cycle : rest;
}

double wrap(double ns, double cycle) { return ns - cycle * std::ceil(ns / cycle - 0.5); }

PhaseLockedLoop::PhaseLockedLoop(const Settings& settings)
    : settings_(settings), gate_(static_cast<double>(settings.cycle) / 4) {
  if (settings_.within <= 0) settings_.within = std::max<std::int64_t>(1, settings_.cycle / 20);
}

void PhaseLockedLoop::start(std::int64_t host) {
  drift_ = 0;
  restart(host);
}

void PhaseLockedLoop::restart(std::int64_t host) {
  instant_ = host;
  fraction_ = 0;
  begin_averages();
}

void PhaseLockedLoop::begin_averages() {
  used_ = 0;
  mean_ = square_ = 0;
  suspects_ = 0;
  locked_ = false;
}

void PhaseLockedLoop::advance(std::int64_t ns) {
  instant_ += ns;
  move(static_cast<double>(ns) * drift_);
}

void PhaseLockedLoop::move(double ns) {
  const double moved = fraction_ + ns;
  const double whole = std::floor(moved);
  instant_ += static_cast<std::int64_t>(whole);
  fraction_ = moved - whole;
}

/// e: the phase of the source minus that of the instants, at the time of the measurement. Whole cycles are removed in integers,
/// because a double does not hold nanoseconds since 2000.
double PhaseLockedLoop::late_by(const Arrival& arrival) const {
  const std::int64_t age = difference(arrival.host, instant_);
  const std::int64_t phase = arrival.source % settings_.cycle - settings_.shift % settings_.cycle - age % settings_.cycle;
  const double drifted = static_cast<double>(age) * drift_ + fraction_;
  return wrap(static_cast<double>(wrap(phase, settings_.cycle)) + drifted, static_cast<double>(settings_.cycle));
}

PhaseLockedLoop::Use PhaseLockedLoop::measure(const Arrival& arrival) {
  const double e = late_by(arrival);
  offset_ = e;
  if (used_ > 0 && std::abs(e) > gate_) {
    if (!is_step(e)) return Use::kOutlier;
    move(-wrap(suspect_ + excess_ / suspects_, static_cast<double>(settings_.cycle)));
    last_ = arrival.host;
    begin_averages();
    used_ = 1;
    ++steps_;
    return Use::kStep;
  }
  suspects_ = 0;
  const double since = 1e-9 * static_cast<double>(std::max<std::int64_t>(0, difference(arrival.host, last_)));  // s
  last_ = arrival.host;
  if (used_ == 0) {
    move(-e);
    offset_ = 0;
    used_ = 1;
    return Use::kUsed;
  }
  const double omega = 2 * std::numbers::pi * settings_.bandwidth;
  const double gain = std::min(kMostGain, omega * since);
  move(-std::max(2 * gain, 1 / static_cast<double>(used_ + 1)) * e);
  drift_ = std::clamp(drift_ - omega * gain * 1e-9 * e, -kMostDrift, kMostDrift);
  ++used_;
  average(e);
  return Use::kUsed;
}

/// Whether enough outliers in a row agree.
bool PhaseLockedLoop::is_step(double e) {
  const double off = wrap(e - suspect_, static_cast<double>(settings_.cycle));
  if (suspects_ == 0 || std::abs(off) > gate_) {
    suspect_ = e;
    excess_ = 0;
    suspects_ = 1;
    return false;
  }
  excess_ += off;
  return ++suspects_ >= kStepAfter;
}

void PhaseLockedLoop::average(double e) {
  const double weight = 1 / static_cast<double>(std::min<std::int64_t>(used_, kAveragedTicks));
  mean_ += weight * (e - mean_);
  square_ += weight * (e * e - square_);
  const double within = static_cast<double>(settings_.within), cycle = static_cast<double>(settings_.cycle);
  const double slack = locked_ ? 2 : 1;
  const double rms = std::sqrt(square_);
  locked_ = used_ > kAveragedTicks && std::abs(mean_) <= slack * within && rms <= (locked_ ? cycle / 6 : cycle / 8);
}

void PhaseLockedLoop::unlock() {
  locked_ = false;
  used_ = std::min<std::int64_t>(used_, 1);
}

double PhaseLockedLoop::jitter() const { return std::sqrt(std::max(0.0, square_ - mean_ * mean_)); }

}  // namespace cotwin::master
