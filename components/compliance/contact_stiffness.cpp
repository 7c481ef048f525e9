#include "components/compliance/contact_stiffness.h"

#include <algorithm>
#include <cmath>
#include <complex>

namespace cotwin::compliance {
namespace {

using Complex = std::complex<double>;

/// x/f = numerator/denominator at s, without poles in either.
struct Response {
  Complex numerator, denominator;
};

// Everything that the controller gets from measurements comes z = e^(−s step/2) late:
//   x_c = z f/A,   A = M s² + D s + S
// Rigid joints:
//   m s² x = f + m s² x_c + (K_P + K_D s)(x_c − z x) − z f
// Elastic joints, κ = k + d s, F = (w/(s + w))²:
//   m s² x = κ (θ − x) + f
//   b s² θ + κ (θ − x) = r u − (r − 1) z k (θ − x)
//   u = (b/r) s² θ_c + τ_w + (K_P + K_D s)(θ_c − z θ),   τ_w = F (m s² x_c − z f),   θ_c = x_c + τ_w/k
Response response(const SecondOrder& a, const FollowingRobot& r, Complex s) {
  const Complex s2 = s * s, z = std::exp(-r.step / 2 * s);
  const Complex A = a.M * s2 + a.D * s + a.S, gain = r.K_P + r.K_D * s;
  if (r.stiffness == 0) {
    return {A * (1.0 - z) + z * (r.mass * s2 + gain), (r.mass * s2 + z * gain) * A};
  }
  const Complex kappa = r.stiffness + r.damping * s, held = (r.shaping - 1) * r.stiffness * z;
  // Times A (s + w)²:
  const Complex common = A * (s + r.bandwidth) * (s + r.bandwidth);
  const Complex x_c = z * (s + r.bandwidth) * (s + r.bandwidth);
  const Complex tau_w = r.bandwidth * r.bandwidth * z * (r.mass * s2 - A);
  const Complex theta_c = x_c + tau_w / r.stiffness;
  const Complex drive = r.motor * s2 * theta_c + r.shaping * (tau_w + gain * theta_c);
  const Complex motor = r.motor * s2 + kappa + r.shaping * z * gain + held;
  return {motor * common + kappa * drive, ((r.mass * s2 + kappa) * motor - kappa * (kappa + held)) * common};
}

}  // namespace

double largest_contact_stiffness(const SecondOrder& admittance, double omega, double zeta) {
  // (M s² + D s + S)(s² + 2ζω s + ω²) + K_e ω² = 0: K_e is in a₀ alone.
  const auto [M, D, S] = admittance;
  const double two_zw = 2 * zeta * omega, w2 = omega * omega;
  const double a3 = D + two_zw * M;
  const double a2 = S + two_zw * D + w2 * M;
  const double a1 = two_zw * S + w2 * D;
  if (!(a3 > 0)) return 0;
  return std::max(a1 * (a3 * a2 - M * a1) / (a3 * a3 * w2) - S, 0.0);
}

double largest_contact_stiffness(const SecondOrder& admittance, const FollowingRobot& robot) {
  constexpr int kPoints = 80;
  constexpr double kLowest = 0.1;  // rad/s
  const double pi = std::acos(-1.0), ratio = std::pow(pi / (robot.step * kLowest), 1.0 / kPoints);
  double largest = std::min(admittance.M, robot.mass) / (robot.step * robot.step);
  Complex before;  // −1/G
  double Omega = kLowest;
  for (int k = 0; k <= kPoints; ++k, Omega *= ratio) {
    const Response G = response(admittance, robot, {0, Omega});
    const Complex now = -G.denominator / G.numerator;
    if (k > 0 && (now.imag() > 0) != (before.imag() > 0)) {
      const double share = before.imag() / (before.imag() - now.imag());
      const double K_e = before.real() + share * (now.real() - before.real());
      if (K_e > 0) largest = std::min(largest, K_e);
    }
    before = now;
  }
  return largest;
}

}  // namespace cotwin::compliance
