#include "components/drive_train/rosenbrock.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "components/drive_train/events.h"

namespace cotwin::drive_train {
namespace {

constexpr double kD = 1 / (2 + std::numbers::sqrt2);
constexpr double kC32 = 6 + std::numbers::sqrt2;
constexpr double kSafety = 0.8;
constexpr double kLargestGrowth = 4, kLargestCut = 0.2;
constexpr double kOnTheEvent = 1e-10;  // rad/s, rad or N.m: an event function this close to zero is at it

}  // namespace

void add_torque_work(const Equations& e, double t, double h, const double* x0, const double* x1, StepAccount& account) {
  const std::size_t n = e.n();
  const std::size_t angle = e.flexible() ? 2 * n : 0, speed = angle + n;
  const Course& c = e.course();
  // ∫ τ ω dt = [τ θ] − τ̇ ∫ θ dt, with ∫ θ dt = h (θ₀ + θ₁)/2 − h² (ω₁ − ω₀)/12
  const auto work = [&](double tau, double dtau, double before, double after, double dbefore, double dafter) {
    return (tau + dtau * (t + 0.5 * h)) * (after - before) + dtau * h * h / 12 * (dafter - dbefore);
  };
  for (std::size_t i = 0; i < n; ++i) {
    account.work_m += work(c.tau_m[i], c.dtau_m[i], x0[angle + i], x1[angle + i], x0[speed + i], x1[speed + i]);
    if (e.inside()) account.work_e += work(c.tau_e[i], c.dtau_e[i], x0[i], x1[i], x0[n + i], x1[n + i]);
  }
}

Rosenbrock::Rosenbrock(Equations& equations)
    : equations_(equations), a_(equations.n()), b_(equations.n()), stage_(equations.n()), tau_(equations.n()) {
  for (auto* v : {&x1_, &rhs_, &k1_, &k2_, &k3_, &f0_, &f1_}) v->resize(equations.size());
  for (auto* v : {&events_, &events_low_, &events_high_}) v->resize(2 * equations.n());
}

// One sub-step from x to x1_, with the forces there in p1_. Returns error / tolerance, NaN if something is not finite.
double Rosenbrock::attempt(double t, double h, const double* x, const Tolerances& tolerances) {
  Equations& e = equations_;
  const std::size_t n = e.n();
  const Course& c = e.course();
  const bool inside = e.inside(), flexible = e.flexible();
  const double gamma = kD * h;
  const std::size_t v = n, w = 3 * n, z = 4 * n;
  e.factorise(*p0_, gamma);

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
      F[w + i] += gamma * (p0_->kappa[i] * x[v + i] + e.parameters().D[i] * ddq);
    }
  };

  rows(t, x, *p0_, f0_.data());
  for (std::size_t i = 0; i < n; ++i) f0_[v + i] = inside ? e.link_balance(*p0_, i, t, p0_->h[i]) : 0;  // (2a)
  rhs_ = f0_;
  add_time_derivative(rhs_.data());
  e.solve(rhs_.data(), k1_.data());

  for (std::size_t i = 0; i < 5 * n; ++i) x1_[i] = x[i] + 0.5 * h * k1_[i];
  e.prescribe(t + 0.5 * h, x1_.data());
  e.confine_bristles(x1_.data());
  e.evaluate_joints(x1_.data(), stage_);
  rows(t + 0.5 * h, x1_.data(), stage_, f1_.data());
  // From here on f1_ holds F1 − k1, which both W (k2 − k1) and the error use.
  for (std::size_t i = 0; i < n; ++i) {
    f1_[i] -= k1_[i];
    f1_[2 * n + i] -= k1_[2 * n + i];
    f1_[w + i] -= e.parameters().B[i] * k1_[w + i];
    f1_[z + i] -= k1_[z + i];
  }
  if (inside) {
    e.inverse_dynamics(x1_.data(), k1_.data() + v, tau_.data());
    for (std::size_t i = 0; i < n; ++i) f1_[v + i] = e.link_balance(stage_, i, t + 0.5 * h, tau_[i]);
  }
  e.solve(f1_.data(), k2_.data());  // k2 − k1 until the end of this function

  for (std::size_t i = 0; i < 5 * n; ++i) x1_[i] = x[i] + h * (k1_[i] + k2_[i]);
  e.prescribe(t + h, x1_.data());
  e.confine_bristles(x1_.data());
  e.evaluate(x1_.data(), *p1_);

  // the right side of k3, with k2 − F1 = (k2 − k1) − (F1 − k1)
  rows(t + h, x1_.data(), *p1_, rhs_.data());
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
    e.times_M(p1_->M.data(), a, product);
    e.times_M(p0_->M.data(), combined, tau_.data());
    for (std::size_t i = 0; i < n; ++i) {
      rhs_[v + i] = e.link_balance(*p1_, i, t + h, p1_->h[i]) - product[i] + tau_[i] + kC32 * f1_[v + i] + 2 * f0_[v + i];
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
      const double size = std::max(std::abs(x[i]), std::abs(x1_[i]));
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

// The first event of the sub-step just attempted, and the share of the sub-step after which it happens by linear
// interpolation; 1 if there is none.
std::pair<std::size_t, double> Rosenbrock::first_event(const std::vector<double>& low, const std::vector<double>& high) const {
  std::pair<std::size_t, double> first{0, 1};
  for (std::size_t i = 0; i < event_count(equations_); ++i) {
    if (high[i] >= 0) continue;
    const double share = low[i] > 0 ? low[i] / (low[i] - high[i]) : 0;
    if (share < first.second) first = {i, share};
  }
  return first;
}

// Shortens the sub-step just attempted so that it ends at its first event, by attempts of other lengths. Returns the length of
// the sub-step; without an event `length`, with happens = false.
double Rosenbrock::locate(double t, double length, const double* x, const Tolerances& tolerances, int& attempts,
                          std::size_t& event, bool& happens) {
  event_values(equations_, t, x, events_low_.data());
  event_values(equations_, t + length, x1_.data(), events_high_.data());
  happens = false;
  double low = 0, high = length, now = length;
  int same_side = 0;
  bool was_beyond = true;
  for (;;) {
    const auto [first, share] = first_event(events_low_, events_high_);
    if (share >= 1) return now;
    happens = true;
    event = first;
    if (-events_high_[event] <= kOnTheEvent || high - low <= 1e-10 * length || attempts <= 0) break;
    // the zero of the secant; bisection where it stays on one side
    now = low + (same_side > 1 ? 0.5 : std::clamp(share, 1e-3, 0.999)) * (high - low);
    attempt(t, now, x, tolerances);
    --attempts;
    event_values(equations_, t + now, x1_.data(), events_.data());
    const bool beyond = first_event(events_low_, events_).second < 1;
    same_side = beyond == was_beyond ? same_side + 1 : 0;
    was_beyond = beyond;
    (beyond ? high : low) = now;
    (beyond ? events_high_ : events_low_) = events_;
  }
  if (now != high) attempt(t, high, x, tolerances);  // just beyond the event, where the next mode begins
  now = high;
  return now;
}

// Adds the energy lost in a sub-step and the work of a link outside, by the trapezoidal rule, which has the method's order.
void Rosenbrock::add_losses(double length, const double* x, StepAccount& account) const {
  const std::size_t n = equations_.n();
  account.dissipated += 0.5 * length * (equations_.dissipation(x, *p0_) + equations_.dissipation(x1_.data(), *p1_));
  for (std::size_t i = 0; i < n && !equations_.inside(); ++i) {
    account.work_e -= 0.5 * length * (p0_->tau_J[i] * x[n + i] + p1_->tau_J[i] * x1_[n + i]);
  }
}

void Rosenbrock::begin(double t, double* x) {
  equations_.prescribe(t, x);
  if (!valid_) {
    equations_.evaluate(x, *p0_);
  } else if (!equations_.inside()) {
    equations_.evaluate_joints(x, *p0_);
  }
  valid_ = true;
}

bool Rosenbrock::step(double h, double* x, double& proposal, const Tolerances& tolerances, int max_substeps,
                      StepAccount& account) {
  begin(0, x);
  if (settle_modes(equations_, x, false)) equations_.evaluate_joints(x, *p0_);
  const std::size_t size = equations_.size();
  double t = 0;
  int attempts = max_substeps;
  double wanted = proposal > 0 ? proposal : h;
  while (t < h) {
    const double rest = h - t;
    // Equal sub-steps to the end, not more than the attempts that are left.
    const int pieces = std::clamp(static_cast<int>(std::ceil(std::min(rest / wanted, 1e6) - 1e-9)), 1, std::max(attempts, 1));
    const bool must = pieces >= attempts;
    double length = rest / pieces;
    bool last = pieces == 1;
    double error = attempt(t, length, x, tolerances);
    --attempts;
    const double factor = std::clamp(kSafety / std::cbrt(std::max(error, 1e-10)), kLargestCut, kLargestGrowth);
    if (!(error <= 1) && !must) {
      wanted = std::isfinite(error) ? length * factor : length * kLargestCut;
      continue;
    }
    if (!std::isfinite(error)) return false;
    std::size_t event = 0;
    bool happens = false;
    if (event_count(equations_) > 0) {
      const double whole = length;
      length = locate(t, whole, x, tolerances, attempts, event, happens);
      last = last && length == whole;
      account.events += happens;
    }
    add_torque_work(equations_, t, length, x, x1_.data(), account);
    add_losses(length, x, account);
    std::copy_n(x1_.data(), size, x);
    std::swap(p0_, p1_);
    account.error = std::max(account.error, error);
    account.forced += error > 1;
    ++account.substeps;
    t = last ? h : t + length;
    if (happens) {
      apply_event(equations_, event, t, x);
      equations_.evaluate_joints(x, *p0_);
    } else {
      wanted = length * factor;
    }
  }
  proposal = wanted;
  return true;
}

}  // namespace cotwin::drive_train
