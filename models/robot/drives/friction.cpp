#include "models/robot/drives/friction.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cotwin::robot {
namespace {

double sign(double v) { return v < 0 ? -1.0 : 1.0; }

// a(z, v) of the elasto-plastic bristle with its partial derivatives, for z and v of the same sign.
struct Plasticity {
  double a = 0, by_z = 0, by_v = 0;
};

Plasticity plasticity(const Bristle& p, const TorqueAndSlope& g, double z) {
  const double share = p.sigma0 * std::abs(z) / g.torque;  // |z| / z_max
  if (share <= p.breakaway) return {};
  if (share >= 1) return {1, 0, 0};
  const double u = (share - 0.5 * (1 + p.breakaway)) / (1 - p.breakaway);
  const double slope = 0.5 * std::numbers::pi * std::cos(std::numbers::pi * u) / (1 - p.breakaway);  // da/d(share)
  return {0.5 * (1 + std::sin(std::numbers::pi * u)), slope * sign(z) * p.sigma0 / g.torque,
          -slope * share * g.slope / g.torque};
}

// Both laws: ż = v − a λ z with λ = σ0 |v| / g.
BristleRates rates(const Bristle& p, double v, double z, const TorqueAndSlope& g, const Plasticity& plastic) {
  const double lambda = p.sigma0 * std::abs(v) / g.torque;
  const double lambda_by_v = p.sigma0 / g.torque * sign(v) - lambda * g.slope / g.torque;
  BristleRates r;
  r.dz = v - plastic.a * lambda * z;
  r.dz_by_v = 1 - (plastic.a * lambda_by_v + plastic.by_v * lambda) * z;
  r.dz_by_z = -lambda * (plastic.a + plastic.by_z * z);
  r.torque = p.sigma0 * z + p.sigma1 * r.dz + p.sigma2 * v;
  r.torque_by_v = p.sigma1 * r.dz_by_v + p.sigma2;
  r.torque_by_z = p.sigma0 + p.sigma1 * r.dz_by_z;
  return r;
}

BristleRates viscous_only(const Bristle& p, double v) { return {.torque = p.sigma2 * v, .torque_by_v = p.sigma2}; }

}  // namespace

TorqueAndSlope CoulombViscous::sliding(double v) const {
  const double t = std::tanh(v / v_R);
  TorqueAndSlope f{tau_C * t + sigma2 * v + tau_0, tau_C * (1 - t * t) / v_R + sigma2};
  if (tau_S > tau_C) {
    const double ratio = std::abs(v / v_S), power = std::pow(ratio, delta);
    const double rise = (tau_S - tau_C) * std::exp(-power);
    f.torque += rise * t;
    f.slope += rise * (1 - t * t) / v_R;
    if (ratio > 0) f.slope -= rise * delta * power / std::abs(v) * std::abs(t);
  }
  return f;
}

bool Harmonics::present() const {
  return std::any_of(a, a + kMost, [](double x) { return x != 0; }) ||
         std::any_of(b, b + kMost, [](double x) { return x != 0; });
}

TorqueAndSlope Harmonics::at(double q) const {
  TorqueAndSlope sum;
  if (!present()) return sum;
  for (int i = 0; i < kMost; ++i) {
    const int k = i + 1;
    const double sine = std::sin(k * q), cosine = std::cos(k * q);
    sum.torque += a[i] * sine + b[i] * cosine;
    sum.slope += k * (a[i] * cosine - b[i] * sine);
  }
  return sum;
}

double Harmonics::energy(double q) const {
  double sum = 0;
  for (int i = 0; i < kMost; ++i) {
    const int k = i + 1;
    sum += (b[i] * std::sin(k * q) - a[i] * std::cos(k * q)) / k;
  }
  return sum;
}

TorqueAndSlope Bristle::stribeck(double v) const {
  const double rise = tau_S - tau_C, least = kLeastSliding * tau_S;
  if (rise == 0) return {tau_C, 0};
  const double u = std::abs(v) / v_S;
  const double power = delta == 2 ? u * u : delta == 1 ? u : std::pow(u, delta);
  const double e = rise * std::exp(-power);
  // d/dv e^{−u^δ} = −δ u^{δ−1} e^{−u^δ} / v_S. At rest it is 0 for δ > 1; for δ ≤ 1 there is a kink, and 0 is returned.
  const double slope = u > 0 ? -sign(v) * delta * power / u * e / v_S : 0;
  if (tau_C + e < least) return {least, 0};
  return {tau_C + e, slope};
}

double Bristle::steady_deflection(double v) const { return v == 0 || !present() ? 0 : sign(v) * stribeck(v).torque / sigma0; }

BristleRates lugre(const Bristle& p, double v, double z) {
  if (!p.present()) return viscous_only(p, v);
  return rates(p, v, z, p.stribeck(v), {1, 0, 0});
}

double lugre_after(const Bristle& p, double v, double z, double h) {
  if (!p.present() || v == 0) return z;
  const double g = p.stribeck(v).torque;
  const double x = p.sigma0 * std::abs(v) * h / g;
  // z∞ + (z − z∞) e^{−x} with z∞ = sign(v) g/σ0, written without cancellation for small x.
  return z + (sign(v) * g / p.sigma0 - z) * -std::expm1(-x);
}

BristleRates elasto_plastic(const Bristle& p, double v, double z) {
  if (!p.present()) return viscous_only(p, v);
  const TorqueAndSlope g = p.stribeck(v);
  return rates(p, v, z, g, v * z > 0 ? plasticity(p, g, z) : Plasticity{});
}

int StickSlip::mode_at_rest(const Bristle& p, double load) { return std::abs(load) <= p.tau_S ? 0 : load > 0 ? 1 : -1; }

TorqueAndSlope StickSlip::slipping(const Bristle& p, double v, int direction) {
  // The search for the instant of stopping evaluates v slightly beyond 0: g is continued there as an even function.
  const TorqueAndSlope g = p.stribeck(v);
  return {direction * g.torque + p.sigma2 * v, direction * g.slope + p.sigma2};
}

TorqueAndSlope Torsion::with_backlash(double phi) const {
  const double e = 0.1 * backlash, minus = phi - backlash, plus = phi + backlash;
  const double r_minus = std::hypot(minus, e), r_plus = std::hypot(plus, e);
  return {K * (phi + 0.5 * (r_minus - r_plus)), K * (1 + 0.5 * (minus / r_minus - plus / r_plus))};
}

double Torsion::energy(double phi) const {
  if (backlash == 0) return 0.5 * K * phi * phi;
  const double e = 0.1 * backlash, minus = phi - backlash, plus = phi + backlash;
  // ∫ √(x² + ε²) dx = ½ (x √(x² + ε²) + ε² arsinh(x/ε)), an odd function of x
  const auto integral = [e](double x) { return 0.5 * (x * std::hypot(x, e) + e * e * std::asinh(x / e)); };
  return K * (0.5 * phi * phi + 0.5 * (integral(minus) - integral(plus) + 2 * integral(backlash)));
}

double Torsion::under_with_backlash(double torque) const {
  // The characteristic is odd, monotonic and, for φ > 0, between K (φ − b) and K φ: Newton's method, with bisection where a
  // Newton step leaves the interval.
  const double wanted = std::abs(torque);
  double low = wanted / K, high = wanted / K + backlash, phi = high;
  for (int i = 0; i < 100 && low < high; ++i) {
    const TorqueAndSlope t = at(phi);
    (t.torque < wanted ? low : high) = phi;
    const double newton = phi - (t.torque - wanted) / t.slope;
    const double next = newton > low && newton < high ? newton : 0.5 * (low + high);
    if (next == phi) break;
    phi = next;
  }
  return std::copysign(phi, torque);
}

StopTorque stop_torque(double stiffness, double damping, double v_0, double depth, double speed) {
  const double d = v_0 > 0 ? damping / v_0 : 0;
  const double factor = 1 + d * speed;
  if (depth <= 0 || factor <= 0) return {};
  return {stiffness * depth * factor, stiffness * factor, stiffness * depth * d};
}

double stop_damping(double restitution) {
  const double e = restitution;
  if (e >= 1) return 0;
  // f(x) = ln((1 + x)/(1 − e x)) − (1 + e) x is negative between its roots 0 and x, and tends to +∞ at 1/e. Bisection between
  // its minimum at (1 − e)/e, where f′ = 0, and 1/e.
  const auto f = [e](double x) { return std::log1p(x) - std::log1p(-e * x) - (1 + e) * x; };
  double low = (1 - e) / e, high = 1 / e;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    (f(middle) < 0 ? low : high) = middle;
  }
  return low;
}

}  // namespace cotwin::robot
