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
  const Complex k = l.K_J + l.D_J * s;
  const Complex Delta = (l.mass - l.B) * s * s * (motor + k) + k * motor;
  return {k * l.mass * l.omega * l.omega * z / Delta, (motor + k) / Delta};
}

/// P e^(−s cycle) of the synchronisation.
Complex correction(const Loop& l, Complex s) {
  if (l.K_P == 0 && l.K_D == 0) return 0;
  const Complex before = std::exp(-s * l.cycle);
  return (l.K_P + l.K_D * (1.0 - before) / l.cycle) * before;
}

/// 1 + K_e C + P T e^(−s (cycle + delay)): its zeros are the poles of the gain.
Complex robot_loop(const Loop& l, Complex s) {
  const Robot robot = l.omega == 0 ? Robot{1, 0} : position_controlled(l, s);
  return 1.0 + hand_stiffness(l, s) * robot.C + correction(l, s) * robot.T * std::exp(-s * l.delay);
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
  for (const double x :
       {l.m_h, l.D_h, l.K_h, l.D_g, l.K_g, l.cutoff, l.delay, l.omega, l.zeta, l.mass, l.h, l.K_J, l.D_J, l.B, l.cycle}) {
    if (!(x >= 0 && std::isfinite(x))) throw Error("guidance loop", "a value is " + text::to_text(x) + ", expected >= 0");
  }
  if (l.K_J > 0 && !(l.B > 0 && l.mass > l.B)) {
    throw Error("guidance loop", "B is " + text::to_text(l.B) + " kg, expected a part of the mass, " + text::to_text(l.mass) +
                                     " kg, because the gear is elastic");
  }
  if (!(M > 0 && std::isfinite(M))) throw Error("guidance loop", "M is " + text::to_text(M) + " kg, expected > 0");
  if (!(std::isfinite(l.K_P) && std::isfinite(l.K_D)) || ((l.K_P != 0 || l.K_D != 0) && l.cycle == 0)) {
    throw Error("guidance loop", "K_P is " + text::to_text(l.K_P) + ", K_D " + text::to_text(l.K_D) + " s and cycle " +
                                     text::to_text(l.cycle) +
                                     " s, expected finite gains, and a cycle > 0 of the synchronisation");
  }
}

/// How often f, which is positive at w = 0 and tends to a positive number, turns around 0 while s goes along the imaginary axis: the zeros with
/// Re s > 0 of a function without poles there.
template <class Function>
int zeros_on_the_right(const Loop& l, double from, double beyond, const Function& f) {
  constexpr double kSettled = 0.02;  // beyond, f does not turn around 0 any more
  const double limit = std::abs(f(1e6 * beyond));
  double w = from;
  Complex before = f(w);
  double turn = std::arg(before);
  while (w < beyond || std::abs(before - limit) > kSettled * limit) {
    w = next(l, w);
    const Complex now = f(w);
    turn += std::arg(now / before);
    before = now;
  }
  turn -= std::arg(before);
  return static_cast<int>(std::lround(-turn / std::numbers::pi));
}

}  // namespace

Complex gain(const Loop& l, Complex s) {
  const Complex sensed = hand_stiffness(l, s) * low_pass(l, s) * std::exp(-s * l.delay);
  const Complex T = l.omega == 0 ? Complex(1) : position_controlled(l, s).T;
  return sensed * T * (1.0 + correction(l, s)) / robot_loop(l, s);
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

int unstable_poles(const Loop& loop, double M, double D) {
  check(loop, M > 0 ? M : 1);
  int poles = 0;
  const bool synchronises = loop.K_P != 0 || loop.K_D != 0;
  if (synchronises && loop.omega == 0) {
    // T = 1: |P| ≥ 1 for some frequency gives poles without number on the right.
    const double largest = std::max(std::abs(loop.K_P), std::abs(loop.K_P + 2 * loop.K_D / loop.cycle));
    if (largest >= 1) return 1;
  } else if (synchronises) {
    if (loop.K_P <= -1) return 1;  // a real one
    const double beyond = 10 * fastest(loop);
    poles = zeros_on_the_right(loop, lowest(loop, 1), beyond, [&](double w) { return robot_loop(loop, Complex(0, w)); });
  }
  if (M == 0) return poles;
  // f = (M s² + D s + gain)/(M (s + 1)²) has the loop's poles with Re s > 0 as zeros, those of the gain as poles, and f → 1.
  const double beyond = 10 * std::max({1.0, fastest(loop), std::sqrt(loop.K_h / M), D / M});
  return poles + zeros_on_the_right(loop, lowest(loop, M), beyond, [&](double w) {
           const Complex s(0, w);
           return (M * s * s + D * s + gain(loop, s)) / (M * (s + 1.0) * (s + 1.0));
         });
}

double synchronisation_border(Loop loop, double M, double D) {
  const auto stable = [&](double K_P) {
    loop.K_P = K_P;
    return unstable_poles(loop, M, D) == 0;
  };
  loop.K_D = 0;
  constexpr double kLeast = 0.02, kMost = 10, kRatio = 1.1;
  if (!stable(0)) return 0;
  double low = 0, high = kLeast;
  while (stable(high)) {
    if (high >= kMost) return kMost;
    low = high;
    high *= kRatio;
  }
  while (high > low + 1e-3 * high) {
    const double middle = (low + high) / 2;
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace cotwin::guidance
