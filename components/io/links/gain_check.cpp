#include "components/io/links/gain_check.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

struct Hand {
  double m_h, D_h, K_h;  // kg, N.s/m, N/m
};
// The corners of the ranges of healthy arms (components/operator_hand/README.md) with the least damping, and no hand.
constexpr Hand kHands[] = {{0, 0, 0}, {0.5, 10, 100}, {0.5, 10, 500}, {1, 10, 100}, {1, 10, 500}};
constexpr double kCutoffs[] = {0, 40};  // Hz, of the external torques
constexpr double kMiddleOfFive = 2;     // messages by which what is used is late (link/belief.h)
constexpr double kMotorShare = 0.5;     // of the effective mass
constexpr double kGearDamping = 0.03;   // of the critical damping of the motor on the gear

}  // namespace

void GainCheck::declare(Variables& v) {
  v.parameter(
       "guided_M", M_, "kg",
       "for the check of K_P and K_D: inertia of the admittance by which tau_e moves q_command (M_T of the compliance); 0: "
       "q_command does not depend on tau_e; -1: not known, K_P and K_D have to be 0")
      .range(-1, 1e6);
  v.parameter("guided_D", D_, "N.s/m", "likewise: its damping (D_T)").range(0, 1e9);
  v.parameter("robot_omega", omega_, "1/s", "likewise: bandwidth of the robot's position control").range(1e-3, 1e6);
  v.parameter("robot_resonance", resonance_, "rad/s",
              "likewise: the lowest resonance of the links on their gears while the motors are held (assumed); 0: rigid")
      .range(0, 1e6);
  v.parameter("robot_mass", mass_, "kg", "likewise: effective mass of the robot at the tool, half of it that of the motors")
      .range(1e-3, 1e6);
}

guidance::Loop GainCheck::robot(double cycle, double delay) const {
  const double late = M_ > 0 ? kMiddleOfFive : 0;  // tau_e, by which the admittance moves
  guidance::Loop loop{.K_h = 0, .delay = (delay + late) * cycle, .omega = omega_, .mass = mass_, .cycle = cycle};
  if (resonance_ > 0) {
    loop.B = kMotorShare * mass_;
    loop.K_J = resonance_ * resonance_ * (mass_ - loop.B);
    loop.D_J = 2 * kGearDamping * std::sqrt(loop.K_J * loop.B);
  }
  return loop;
}

/// Without a hand nothing moves the admittance.
double GainCheck::inertia(const guidance::Loop& loop) const { return loop.K_h > 0 ? M_ : 0; }

/// Whether `holds` is true for each.
template <class Condition>
bool GainCheck::for_every_hand(guidance::Loop loop, const Condition& holds) const {
  for (const Hand& hand : kHands) {
    loop.m_h = hand.m_h;
    loop.D_h = hand.D_h;
    loop.K_h = hand.K_h;
    for (const double cutoff : kCutoffs) {
      loop.cutoff = cutoff;
      if (!holds(loop)) return false;
      if (M_ == 0 || hand.K_h == 0) break;  // the torques move nothing
    }
  }
  return true;
}

bool GainCheck::is_stable(const guidance::Loop& loop, double K_P, double K_D) const {
  guidance::Loop tried = loop;
  for (const double scale : {0.5, 1.0, kMargin}) {
    tried.K_P = scale * K_P;
    tried.K_D = scale * K_D;
    if (guidance::unstable_poles(tried, inertia(tried), D_) > 0) return false;
  }
  return true;
}

double GainCheck::largest_gain(std::span<const double> cycles, double delay) const {
  double most = std::numeric_limits<double>::infinity();
  for (const double cycle : cycles) {
    for_every_hand(robot(cycle, delay), [&](const guidance::Loop& loop) {
      if (std::isfinite(most) && is_stable(loop, most / kMargin, 0)) return true;
      most = std::min(most, guidance::synchronisation_border(loop, inertia(loop), D_));
      return most > 0;
    });
  }
  return std::floor(1e3 * most / kMargin) / 1e3;
}

void GainCheck::check(std::span<const double> K_P, std::span<const double> K_D, std::span<const double> cycles, double delay,
                      const std::string& place) const {
  for (std::size_t i = 0; i < K_P.size(); ++i) {
    const bool same = i > 0 && K_P[i] == K_P[i - 1] && K_D[i] == K_D[i - 1];
    if (same || (K_P[i] == 0 && K_D[i] == 0)) continue;
    if (M_ < 0) {
      throw Error(place + ": K_P, K_D",
                  "not 0, but guided_M is not given: whether robot, hand and twin vibrate depends on it; expected guided_M and "
                  "guided_D of the admittance, or guided_M=0 if q_command does not depend on tau_e");
    }
    for (const double cycle : cycles) {
      const auto stable = [&](const guidance::Loop& loop) { return is_stable(loop, K_P[i], K_D[i]); };
      if (for_every_hand(robot(cycle, delay), stable)) continue;
      throw Error(place + ": K_P, K_D", text::to_text(K_P[i], 4) + " and " + text::to_text(K_D[i], 4) + " s of joint " +
                                            std::to_string(i + 1) + ": robot and twin would vibrate with guided_M " +
                                            text::to_text(M_, 4) + " kg, guided_D " + text::to_text(D_, 4) +
                                            " N.s/m and a cycle of " + text::to_text(1e3 * cycle, 4) +
                                            " ms, expected K_P at most " + text::to_text(largest_gain(cycles, delay), 4) +
                                            " with K_D 0, or the parameters robot_... of another robot (docs/fri.md)");
    }
  }
}

}  // namespace cotwin::io
