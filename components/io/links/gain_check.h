#pragma once
#include <span>
#include <string>

#include "components/unit/variables.h"
#include "models/control/guidance.h"

namespace cotwin::io {

/// Whether robot and twin stay together with the gains K_P and K_D of their synchronisation (synchronisation.h), decided before the run. The loop
/// is that of models/control/guidance.h: a hand, the admittance by which external torques move the twin, delays, and the position control
/// of a robot with elastic joints. It has to be stable for every hand of people (100 to 500 N/m, 0.5 to 1 kg, 10 N.s/m), for no hand at
/// all, with and without a low-pass of 40 Hz of the torques, and with kMargin times the gains.
class GainCheck {
 public:
  static constexpr double kMargin = 1.5;

  /// `omega`: of the robot's position control, 1/s.
  explicit GainCheck(double omega) : omega_(omega) {}

  void declare(Variables& v);
  /// Gains per joint; `cycles`: between two commands, those that are possible, s; from a measurement to the command that it changes `delay` cycles
  /// pass besides that of the synchronisation. Throws Error at `place` with the largest gain that is allowed.
  void check(std::span<const double> K_P, std::span<const double> K_D, std::span<const double> cycles, double delay,
             const std::string& place) const;

 private:
  guidance::Loop robot(double cycle, double delay) const;
  double inertia(const guidance::Loop& loop) const;
  template <class Condition>
  bool for_every_hand(guidance::Loop loop, const Condition& holds) const;
  bool is_stable(const guidance::Loop& loop, double K_P, double K_D) const;
  double largest_gain(std::span<const double> cycles, double delay) const;

  double M_ = -1, D_ = 0;  // of the admittance
  double omega_, resonance_ = 60, mass_ = 10;
};

}  // namespace cotwin::io
