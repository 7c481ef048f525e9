#include "models/control/guidance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::guidance {
namespace {

using Complex = std::complex<double>;

Complex hold(Complex s, double h) { return h > 0 ? (1.0 - std::exp(-s * h)) / (s * h) : Complex(1); }

/// G F/(G + F), also for rigid grips.
Complex hand_stiffness(const Loop& l, Complex s) {
  const Complex F = l.K_h + s * (l.D_h + s * l.m_h);
  if (l.K_g == 0) return F;
  const Complex G = l.K_g + s * l.D_g;
  return G * F / (G + F);
}

Complex low_pass(const Loop& l, Complex s) {
  if (l.cutoff == 0) return 1;
  const double w = 2 * std::numbers::pi * l.cutoff;
  if (l.h == 0) return 1.0 / (1.0 + s / w);
  const double old = std::exp(-w * l.h);
  return (1 - old) / (1.0 - old * std::exp(-s * l.h));
}

struct Robot {
  Complex T, C;  // p = T p_c + C f
};
Robot position_controlled(const Loop& l, Complex s) {
  const Complex z = hold(s, l.h), control = (2 * l.zeta * l.omega * s + l.omega * l.omega) * z;
  if (l.K_J == 0) {
    const Complex N = s * s + control;
    return {l.omega * l.omega * z / N, l.mass > 0 ? 1.0 / (l.mass * N) : Complex(0)};
  }
  const Complex motor = l.B * s * s + l.mass * control;
  const Complex Delta = (l.mass - l.B) * s * s * (motor + l.K_J) + l.K_J * motor;
  return {l.K_J * l.mass * l.omega * l.omega * z / Delta, (motor + l.K_J) / Delta};
}

/// Far below all resonances of the loop, rad/s.
double lowest(const Loop& l, double M) { return 1e-3 * std::min(1.0, std::sqrt(std::max(l.K_h, 1e-6) / (l.m_h + M))); }

/// The highest resonance of the position-controlled robot, rad/s.
double fastest(const Loop& l) {
  return l.K_J > 0 ? std::max(l.omega, std::sqrt(l.K_J * l.mass / (l.B * (l.mass - l.B)))) : l.omega;
}

/// The next frequency of a sweep: 0.5 % further, and at most 1/20 rad of the delay.
double next(const Loop& l, double omega) {
  const double delay = l.delay + l.h;
  return omega + (delay > 0 ? std::min(5e-3 * omega, 0.05 / delay) : 5e-3 * omega);
}

void check(const Loop& l, double M) {
  for (const double x : {l.m_h, l.D_h, l.K_h, l.D_g, l.K_g, l.cutoff, l.delay, l.omega, l.zeta, l.mass, l.h, l.K_J, l.B}) {
    if (!(x >= 0 && std::isfinite(x))) throw Error("guidance loop", "a value is " + text::to_text(x) + ", expected >= 0");
  }
  if (l.K_J > 0 && !(l.B > 0 && l.mass > l.B)) {
    throw Error("guidance loop", "B is " + text::to_text(l.B) + " kg, expected a part of the mass, " + text::to_text(l.mass) +
                                     " kg, because the gear is elastic");
  }
  if (!(M > 0 && std::isfinite(M))) throw Error("guidance loop", "M is " + text::to_text(M) + " kg, expected > 0");
}

}  // namespace

Complex gain(const Loop& l, Complex s) {
  const Complex K_e = hand_stiffness(l, s), sensed = K_e * low_pass(l, s) * std::exp(-s * l.delay);
  if (l.omega == 0) return sensed;
  const Robot robot = position_controlled(l, s);
  return sensed * robot.T / (1.0 + K_e * robot.C);
}

Border damping_border(const Loop& loop, double M) {
  check(loop, M);
  const auto excess = [&](double w) { return gain(loop, Complex(0, w)).real() - M * w * w; };
  constexpr double kSettled = 1e-4;  // beyond, the inertia outweighs the hand
  Border border;
  double low = lowest(loop, M), at_low = excess(low);
  while (true) {
    const double high = next(loop, low), at_high = excess(high);
    if ((at_low > 0) != (at_high > 0)) {
      double a = low, b = high;
      for (int i = 0; i < 60; ++i) {
        const double middle = (a + b) / 2;
        ((excess(middle) > 0) == (at_low > 0) ? a : b) = middle;
      }
      const double D = -gain(loop, Complex(0, a)).imag() / a;
      if (D > border.D) border = {D, a};
    }
    if (high > 10 * fastest(loop) && std::abs(gain(loop, Complex(0, high))) < kSettled * M * high * high) return border;
    low = high;
    at_low = at_high;
  }
}

double stiffness_border(Loop loop, double M, double D) {
  const auto stable = [&](double K_h) {
    loop.K_h = K_h;
    return unstable_poles(loop, M, D) == 0;
  };
  constexpr double kLeast = 1, kMost = 1e8, kRatio = 1.1;  // N/m
  if (!stable(kLeast)) return 0;
  double low = kLeast;
  while (stable(low * kRatio)) {
    low *= kRatio;
    if (low > kMost) return std::numeric_limits<double>::infinity();
  }
  double high = low * kRatio;
  while (high > low * (1 + 1e-5)) {
    const double middle = std::sqrt(low * high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

int unstable_poles(const Loop& loop, double M, double D) {
  check(loop, M);
  // f = (M s² + D s + gain)/(M (s + 1)²) has the loop's poles with Re s > 0 as zeros, no poles there, and f → 1.
  const auto f = [&](double w) {
    const Complex s(0, w);
    return (M * s * s + D * s + gain(loop, s)) / (M * (s + 1.0) * (s + 1.0));
  };
  constexpr double kSettled = 0.02;  // beyond, f does not turn around 0 any more
  double w = lowest(loop, M);
  Complex before = f(w);
  double turn = std::arg(before);  // f(0) > 0
  const double beyond = 10 * std::max({1.0, fastest(loop), std::sqrt(loop.K_h / M), D / M});
  while (w < beyond || std::abs(before - 1.0) > kSettled) {
    w = next(loop, w);
    const Complex now = f(w);
    turn += std::arg(now / before);
    before = now;
  }
  turn -= std::arg(before);
  return static_cast<int>(std::lround(-turn / std::numbers::pi));
}

}  // namespace cotwin::guidance
