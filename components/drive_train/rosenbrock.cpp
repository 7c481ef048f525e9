#include "components/drive_train/rosenbrock.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cotwin::drive_train {
namespace {

constexpr double kD = 1 / (2 + std::numbers::sqrt2);
constexpr double kC32 = 6 + std::numbers::sqrt2;

}  // namespace

Rosenbrock::Rosenbrock(Equations& equations) : equations_(equations), stage_(equations.n()), tau_(equations.n()) {
  for (auto* v : {&rhs_, &k1_, &k2_, &k3_, &f0_, &f1_}) v->resize(equations.size());
}

double Rosenbrock::attempt(double t, double h, const double* x, const Tolerances& tolerances, const Point& p0, double* x1,
                           Point& p1) {
  Equations& e = equations_;
  const std::size_t n = e.n();
  const Course& c = e.course();
  const bool inside = e.inside(), flexible = e.flexible();
  const double gamma = kD * h;
  const std::size_t v = n, w = 3 * n, z = 4 * n;
  e.factorise(p0, gamma);

  // F = (q̇, M q̈, θ̇, B θ̈, ż) from x and p, without M q̈
  const auto rows = [&](double time, const double* state, const Point& p, double* F) {
    for (std::size_t i = 0; i < n; ++i) {
      const bool moves = flexible && !e.stuck(i);
      F[i] = inside ? state[v + i] : 0;
      F[2 * n + i] = moves ? state[w + i] : 0;
      F[w + i] = moves ? e.motor_balance(p, i, e.motor_torque(i, time)) : 0;  // (2b)
      F[z + i] = p.dz[i];
    }
  };
  // Adds γ ∂f/∂t to F: ramped torques, and a link outside that moves the spring
  const auto add_time_derivative = [&](double* F) {
    for (std::size_t i = 0; i < n; ++i) {
      if (inside) F[v + i] += gamma * (c.dtau_e[i] + (flexible ? 0 : c.dtau_m[i]));
      if (!flexible || e.stuck(i)) continue;
      F[w + i] += gamma * c.dtau_m[i];
      if (inside) continue;
      const double ddq = 2 * c.link[2 * n + i] + 6 * t * c.link[3 * n + i];
      F[w + i] += gamma * (p0.kappa[i] * x[v + i] + e.parameters().D[i] * ddq);
    }
  };

  rows(t, x, p0, f0_.data());
  for (std::size_t i = 0; i < n; ++i) f0_[v + i] = inside ? e.link_balance(p0, i, t, p0.h[i]) : 0;  // (2a)
  rhs_ = f0_;
  add_time_derivative(rhs_.data());
  e.solve(rhs_.data(), k1_.data());

  for (std::size_t i = 0; i < 5 * n; ++i) x1[i] = x[i] + 0.5 * h * k1_[i];
  e.prescribe(t + 0.5 * h, x1);
  e.confine_bristles(x1);
  e.evaluate_joints(x1, stage_);
  rows(t + 0.5 * h, x1, stage_, f1_.data());
  // From here on f1_ holds F1 − k1, which both W (k2 − k1) and the error use.
  for (std::size_t i = 0; i < n; ++i) {
    f1_[i] -= k1_[i];
    f1_[2 * n + i] -= k1_[2 * n + i];
    f1_[w + i] -= e.parameters().B[i] * k1_[w + i];
    f1_[z + i] -= k1_[z + i];
  }
  if (inside) {
    e.inverse_dynamics(x1, k1_.data() + v, tau_.data());
    for (std::size_t i = 0; i < n; ++i) f1_[v + i] = e.link_balance(stage_, i, t + 0.5 * h, tau_[i]);
  }
  e.solve(f1_.data(), k2_.data());  // k2 − k1 until the end of this function

  for (std::size_t i = 0; i < 5 * n; ++i) x1[i] = x[i] + h * (k1_[i] + k2_[i]);
  e.prescribe(t + h, x1);
  e.confine_bristles(x1);
  e.evaluate(x1, p1);

  // the right side of k3, with k2 − F1 = (k2 − k1) − (F1 − k1)
  rows(t + h, x1, p1, rhs_.data());
  const auto combine = [&](std::size_t i, double scale, double F2) {
    const double k1 = scale * k1_[i], u = scale * k2_[i];
    return F2 - kC32 * (u - f1_[i]) - 2 * (k1 - f0_[i]);
  };
  for (std::size_t i = 0; i < n; ++i) {
    rhs_[i] = combine(i, 1, rhs_[i]);
    rhs_[2 * n + i] = combine(2 * n + i, 1, rhs_[2 * n + i]);
    rhs_[w + i] = combine(w + i, e.parameters().B[i], rhs_[w + i]);
  }
  if (inside) {
    // M₀ F2 = M₀ a + (force − h − M₁ a) with a = k2; together with −c M₀ u − 2 M₀ k1 one product with each matrix
    double *a = k3_.data(), *combined = k3_.data() + n, *product = k3_.data() + 2 * n;
    for (std::size_t i = 0; i < n; ++i) {
      a[i] = k1_[v + i] + k2_[v + i];
      combined[i] = a[i] - kC32 * k2_[v + i] - 2 * k1_[v + i];
    }
    e.times_M(p1.M.data(), a, product);
    e.times_M(p0.M.data(), combined, tau_.data());
    for (std::size_t i = 0; i < n; ++i) {
      rhs_[v + i] = e.link_balance(p1, i, t + h, p1.h[i]) - product[i] + tau_[i] + kC32 * f1_[v + i] + 2 * f0_[v + i];
    }
  } else {
    std::fill_n(rhs_.begin() + static_cast<std::ptrdiff_t>(v), n, 0.0);
  }
  for (std::size_t i = 0; i < n; ++i) rhs_[z + i] = combine(z + i, 1, rhs_[z + i]);
  add_time_derivative(rhs_.data());
  e.solve(rhs_.data(), k3_.data());

  double worst = 0;
  const auto weigh = [&](std::size_t from, double absolute) {
    for (std::size_t i = from; i < from + n; ++i) {
      const double error = h / 6 * (k3_[i] - k1_[i] - 2 * k2_[i]);  // k1 − 2 k2 + k3
      const double size = std::max(std::abs(x[i]), std::abs(x1[i]));
      const double scaled = std::abs(error) / (absolute + tolerances.relative * size);
      if (!(scaled <= worst)) worst = scaled;  // NaN too
    }
  };
  if (inside) {
    weigh(0, tolerances.angle);
    weigh(v, tolerances.speed);
  }
  if (flexible) {
    weigh(2 * n, tolerances.angle);
    weigh(w, tolerances.speed);
  }
  return worst;
}

}  // namespace cotwin::drive_train
