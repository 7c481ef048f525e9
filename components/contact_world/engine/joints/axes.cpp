#include "components/contact_world/engine/joints/axes.h"
#include "components/contact_world/engine/solvers/numbers.h"

#include <algorithm>
#include <cmath>

namespace cotwin::contact_world {
namespace {

/// Share of a limit violation that one step corrects; a larger share would accelerate light links too much.
constexpr double kAxisCorrection = 0.2;

/// Largest speed of the correction, as that of contacts: the velocity stage keeps it, and with it its energy.
constexpr double kFastestAxisCorrection = 0.1;  // rad/s or m/s

}  // namespace

LimitSpeeds::LimitSpeeds(const Joint& joint, Stage stage, double h) {
  const auto speed = [&](double room) {  // room ≥ 0 inside the limit
    if (room >= 0) return -room / h;
    return stage == Stage::kPosition ? std::min(-kAxisCorrection * room / h, kFastestAxisCorrection) : 0.0;
  };
  if (joint.q_min > -kInfinity) lower = speed(joint.q - joint.q_min);
  if (joint.q_max < kInfinity) upper = -speed(joint.q_max - joint.q);
  if (lower > upper) lower = upper = (lower + upper) / 2;  // contradicting limits
}

AxisDrive::AxisDrive(const Joint& joint, const Axis& axis, Stage stage, double h) {
  softness = h / 2 * (joint.damping + axis.damping) + axis.inertia;
  tau = h / 2 * (axis.tau + axis.damping * axis.rate + joint.stiffness * (joint.q_spring - joint.q)) + axis.momentum;
  if (stage == Stage::kPosition) {
    softness += h / 2 * (axis.stiffness + joint.stiffness) * h / 2;
    tau += h / 2 * axis.stiffness * h / 2 * axis.rate;
  } else {
    tau += h / 2 * axis.spring;
  }
}

AxisLaw::AxisLaw(const Joint& joint, const Axis& axis, Stage stage, double h) {
  const LimitSpeeds limits(joint, stage, h);
  const auto add = [&](double speed, double below, double above, std::int32_t id) {
    int k = count_++;
    for (; k > 0 && corners_[k - 1].speed > speed; --k) corners_[k] = corners_[k - 1];
    corners_[k] = {speed, below, above, id};
  };
  if (limits.lower > -kInfinity) add(limits.lower, kInfinity, 0, 1);
  if (joint.friction > 0) add(0, joint.friction * h / 2, -joint.friction * h / 2, 2);
  if (axis.motor_torque > 0) add(axis.motor_speed, axis.motor_torque * h / 2, -axis.motor_torque * h / 2, 3);
  if (limits.upper < kInfinity) add(limits.upper, 0, -kInfinity, 4);
}

double AxisLaw::impulse_in(int region) const {
  double sum = 0;
  for (int k = 0; k < count_; ++k) sum += k < region ? corners_[k].above : corners_[k].below;
  return sum;
}

// Unbounded torque leaves no speed between two corners: the next corner holds.
void AxisLaw::release(Axis& axis, Forest::Freedom& freedom, double tau, int region) {
  const double impulse = impulse_in(region);
  if (!(std::abs(impulse) < kInfinity))
    return hold(axis, freedom, tau, std::clamp(impulse < 0 ? region - 1 : region, 0, count_ - 1));
  region_ = region;
  held_ = -1;
  axis.lock = 0;
  freedom.locked = false;
  freedom.tau = tau + impulse;
}

void AxisLaw::hold(Axis& axis, Forest::Freedom& freedom, double tau, int corner) {
  held_ = corner;
  axis.lock = corners_[corner].id;
  freedom.locked = true;
  freedom.target = corners_[corner].speed;
  freedom.tau = tau;
}

void AxisLaw::begin(const Axis& axis, Forest::Freedom& freedom, double tau) {
  Axis held = axis;
  for (int k = 0; k < count_; ++k) {
    if (axis.lock == corners_[k].id) return hold(held, freedom, tau, k);
  }
  int region = 0;
  while (region < count_ && corners_[region].speed < freedom.s) ++region;
  release(held, freedom, tau, region);
}

bool AxisLaw::move(Axis& axis, Forest::Freedom& freedom, double tau) {
  if (held_ >= 0) {
    axis.lock = corners_[held_].id;
    const double slack = 1e-12 * std::abs(freedom.impulse);
    if (freedom.impulse > impulse_in(held_) + slack) {
      release(axis, freedom, tau, held_);
      return true;
    }
    if (freedom.impulse < impulse_in(held_ + 1) - slack) {
      release(axis, freedom, tau, held_ + 1);
      return true;
    }
    return false;
  }
  axis.lock = 0;
  const double slack = 1e-13 * (1 + std::abs(freedom.s));
  if (region_ < count_ && freedom.s > corners_[region_].speed + slack) {
    hold(axis, freedom, tau, region_);
    return true;
  }
  if (region_ > 0 && freedom.s < corners_[region_ - 1].speed - slack) {
    hold(axis, freedom, tau, region_ - 1);
    return true;
  }
  return false;
}

}  // namespace cotwin::contact_world
