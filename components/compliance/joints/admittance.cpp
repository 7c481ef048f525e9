#include "components/compliance/joints/admittance.h"

#include <algorithm>
#include <cmath>

namespace cotwin::compliance {

SecondOrder relation(const Admittance& a) {
  const double D = a.D_a + 2 * a.zeta_a * std::sqrt(a.S_a * a.M_a);
  return {a.M_a, std::max(D, 2 * a.zeta_a * a.M_a * a.omega_free), a.S_a};
}

double pay(double energy_of_M, double energy_of_S, Tank& tank) {
  const double released = std::max(-energy_of_M, 0.0) + std::max(-energy_of_S, 0.0);
  const double needed = std::max(energy_of_M, 0.0) + std::max(energy_of_S, 0.0);
  const double available = std::max(tank.energy + released, 0.0);
  const double share = needed > available ? available / needed : 1.0;
  tank.energy = std::clamp(available - share * needed, 0.0, tank.capacity);
  return share;
}

bool change(Admittance& now, const Admittance& next, const Deviation& at, Tank& tank) {
  if (next.M_a == now.M_a && next.S_a == now.S_a) return true;
  const double energy_of_M = (next.M_a - now.M_a) * at.dx * at.dx / 2;
  const double energy_of_S = (next.S_a - now.S_a) * at.x * at.x / 2;
  const double share = pay(energy_of_M, energy_of_S, tank);
  now.M_a = energy_of_M > 0 && share < 1 ? now.M_a + share * (next.M_a - now.M_a) : next.M_a;
  now.S_a = energy_of_S > 0 && share < 1 ? now.S_a + share * (next.S_a - now.S_a) : next.S_a;
  return share == 1;
}

namespace {

double stored(const SecondOrder& system, const Deviation& at) {
  return (system.M * at.dx * at.dx + system.S * at.x * at.x) / 2;
}

/// A step that is short compared with the time constants of the motion, with or without a limit.
Compliant advance_shortly(const SecondOrder& system, const Deviation& start, double tau_e, double tau_e_rate,
                          const Limits& limits, const Desired& desired, double h, Tank& tank) {
  const Deviation free = advance(system, start, tau_e, tau_e_rate, h);
  const Allowed may = allowed(limits, desired, start, h);
  if (clear_of(limits, desired, free, h) ||
      (free.dx <= may.dx_high && free.x <= may.x_high && free.dx >= may.dx_low && free.x >= may.x_low)) {
    // A lower bound of D ∫ Δ̇² dt (Cauchy–Schwarz): the tank receives at most the dissipated energy.
    const double moved = free.x - start.x;
    tank.energy = std::min(tank.energy + system.D * moved * moved / h, tank.capacity);
    return {free, acceleration(system, free, tau_e + tau_e_rate * h), Limit::kNone};
  }
  const bool from_above = free.dx > may.dx_high || free.x > may.x_high;
  Compliant c;
  c.limit = from_above ? may.high : may.low;
  c.Delta.dx = std::max(std::min(free.dx, may.dx_high), may.dx_low);
  c.Delta.x = std::max(std::min(start.x + h * (start.dx + c.Delta.dx) / 2, may.x_high), may.x_low);
  // A wall gives no energy. The excess due to constant acceleration is taken from the tank, or else from the speed.
  const double work = (tau_e + tau_e_rate * h / 2) * (c.Delta.x - start.x);
  double excess = stored(system, c.Delta) - stored(system, start) - work;
  if (excess > 0) {
    const double paid = std::min(excess, tank.energy);
    tank.energy -= paid;
    excess -= paid;
    const double squared = c.Delta.dx * c.Delta.dx - 2 * excess / system.M;
    if (excess > 0) c.Delta.dx = std::copysign(std::sqrt(std::max(squared, 0.0)), c.Delta.dx);
  }
  c.ddDelta = (c.Delta.dx - start.dx) / h;
  return c;
}

}  // namespace

Compliant advance(const Admittance& a, const Deviation& start, double tau_e, double tau_e_rate, const Limits& limits,
                  const Desired& desired, double h, Tank& tank) {
  const SecondOrder system = relation(a);
  const Deviation free = advance(system, start, tau_e, tau_e_rate, h);
  if (clear_of(limits, desired, free, h)) {
    const double moved = free.x - start.x;
    tank.energy = std::min(tank.energy + system.D * moved * moved / h, tank.capacity);  // as below
    return {free, acceleration(system, free, tau_e + tau_e_rate * h), Limit::kNone};
  }
  // At a limit the motion is approximated by constant acceleration, in parts that are short compared with its time constants.
  constexpr double kShort = 0.1, kMostParts = 100;
  const double rate = std::sqrt(system.S / system.M) + system.D / system.M;
  const double parts = std::clamp(std::ceil(h * rate / kShort), 1.0, kMostParts);
  const double part = h / parts;
  Compliant c{start, 0, Limit::kNone};
  Limit met = Limit::kNone;
  for (double k = 1; k <= parts; ++k) {
    const Desired then{desired.q - desired.dq * (parts - k) * part, desired.dq};
    c = advance_shortly(system, c.Delta, tau_e + tau_e_rate * (k - 1) * part, tau_e_rate, limits, then, part, tank);
    if (c.limit != Limit::kNone) met = c.limit;
  }
  c.limit = met;
  return c;
}

}  // namespace cotwin::compliance
