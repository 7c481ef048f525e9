#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/optimisation/evaluation/problem.h"

namespace cotwin::optimisation {

/// Electrical power and energy of motions sampled in time, for the cost kEnergy. Immutable: may be shared by threads.
class DrivePower {
 public:
  /// Of a problem that check() accepts.
  DrivePower(const Electrical& electrical, std::size_t joints);

  /// Power that all drives and the stand-by take from the DC link in `states` states, W: τ_m and q̇ of joint j in state i at
  /// [j · states + i]. With separate rectifiers a joint's negative power is burnt and counts as 0.
  void power(std::size_t states, const double* tau, const double* dq, double* power) const;
  /// Energy drawn from the mains in T seconds, J, of powers with the quadrature's weights (Σ w = 1). The power of a sample acts
  /// on the link over its weight's share of T.
  double drawn(std::span<const double> power, std::span<const double> weights, double T) const;

  struct Joint {
    double copper, converter, iron, eddy;  // W per τ², |τ|, |q̇| and q̇²
  };
  struct Constants {
    std::vector<Joint> joints;
    energetics::Bus bus;
    double idle, controller;            // W
    double per_supplied, per_returned;  // J of the mains per J of the link
    double least, most, start;          // J in the link's capacitor
  };
  const Constants& constants() const { return c_; }

 private:
  Constants c_;
};

}  // namespace cotwin::optimisation
