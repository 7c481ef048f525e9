#include "components/drive_train/integrator.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "components/drive_train/events.h"

namespace cotwin::drive_train {
namespace {

constexpr double kSafety = 0.8;
constexpr double kLargestGrowth = 4, kLargestCut = 0.2;
// Of the fastest rate times the rest of the step. Within kEasy the exponential method needs less time than the Rosenbrock method
// for a microradian (measured on the LWR 4); within kPossible its time is bounded, about 10 ms for 7 joints.
constexpr double kEasy = 16, kPossible = 2e4;
// A sub-step of the exponential method that must be taken with a larger error over tolerance is replaced by one of the Rosenbrock
// method, which is L-stable.
constexpr double kUnstable = 1e3;

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

Integrator::Integrator(Equations& equations, Method method)
    : equations_(equations),
      method_(equations.flexible() ? method : Method::kRosenbrock),
      rosenbrock_(equations),
      exponential_(equations),
      a_(equations.n()),
      b_(equations.n()) {
  x1_.resize(equations.size());
  for (auto* v : {&events_, &events_low_, &events_high_}) v->resize(2 * equations.n());
}

// `must`: the Rosenbrock method would have to give up the tolerance. A bound that is not finite chooses Rosenbrock.
bool Integrator::chooses_exponential(double rest, bool must) const {
  const double work = exponential_.fastest() * rest;
  if (!(work <= kPossible)) return false;
  return method_ == Method::kExponential || work <= kEasy || must || exponential_.frequency() > exponential_.decay();
}

// One sub-step from x to x1_, with the forces there in p1_. Returns error / tolerance, NaN if something is not finite.
// `watch`: shortens h to an event on the way.
double Integrator::attempt(double t, double& h, const double* x, const Tolerances& tolerances, bool watch) {
  if (!exponential_now_) return rosenbrock_.attempt(t, h, x, tolerances, *p0_, x1_.data(), *p1_);
  return exponential_.attempt(t, h, x, tolerances, *p0_, x1_.data(), *p1_, watch);
}

// The first event of the sub-step just attempted, and the share of the sub-step after which it happens by linear
// interpolation; 1 if there is none.
std::pair<std::size_t, double> Integrator::first_event(const std::vector<double>& low, const std::vector<double>& high) const {
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
double Integrator::locate(double t, double length, const double* x, const Tolerances& tolerances, int& attempts,
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
    now = low + (same_side > 1 ? 0.5 : std::clamp(share, 1e-3, 1 - 1e-6)) * (high - low);
    attempt(t, now, x, tolerances, false);
    --attempts;
    event_values(equations_, t + now, x1_.data(), events_.data());
    const bool beyond = first_event(events_low_, events_).second < 1;
    same_side = beyond == was_beyond ? same_side + 1 : 0;
    was_beyond = beyond;
    (beyond ? high : low) = now;
    (beyond ? events_high_ : events_low_) = events_;
  }
  if (now != high) attempt(t, high, x, tolerances, false);  // just beyond the event, where the next mode begins
  now = high;
  return now;
}

// Adds the energy lost in a sub-step and the work of a link outside, by the trapezoidal rule or by Simpson's, which have the order
// of the method. A sub-step of the exponential method may contain many oscillations of τ_J. Their work on the link follows by
// parts from (2b), with ϑ = θ − θ(t):
//   −∫ τ_J q̇ dt = −∫ (τ_m − τ_f) q̇ dt + B [θ̇ q̇] − B [ϑ q̈] + B ∫ ϑ dt d³q/dt³
void Integrator::add_losses(double t, double length, const double* x, StepAccount& account) const {
  const std::size_t n = equations_.n();
  const bool by_parts = exponential_now_ && !equations_.inside();
  const double *x1 = x1_.data(), *middle = exponential_.middle();
  const auto add = [&](double weight, double time, const double* state, const Point& p) {
    account.dissipated += weight * length * equations_.dissipation(state, p);
    for (std::size_t i = 0; i < n && !equations_.inside(); ++i) {
      const double torque = by_parts && !equations_.stuck(i) && !equations_.passive(i)
                                ? equations_.motor_torque(i, time) - p.tau_f[i]
                                : p.tau_J[i];
      account.work_e -= weight * length * torque * state[n + i];
    }
  };
  const double ends = exponential_now_ ? 1.0 / 6 : 0.5;
  add(ends, t, x, *p0_);
  if (exponential_now_) add(4.0 / 6, t + 0.5 * length, middle, exponential_.middle_point());
  add(ends, t + length, x1, *p1_);
  const std::vector<double>& link = equations_.course().link;
  for (std::size_t i = 0; i < n && by_parts; ++i) {
    if (equations_.stuck(i) || equations_.passive(i)) continue;
    const std::size_t v = n + i, theta = 2 * n + i, w = 3 * n + i;
    const Parameters& c = equations_.parameters();
    const auto simpson = [length](double a, double b, double d) { return length / 6 * (a + 4 * b + d); };
    const double B = c.B[i], dtheta = x1[theta] - x[theta];
    double integral = simpson(0, middle[theta] - x[theta], dtheta);
    if (c.backlash[i] == 0) {  // by (2c) and (2b): K ∫ (θ − q) dt = ∫ (τ_m − τ_f) dt − B [θ̇] − D [θ − q]
      const double impulse = simpson(equations_.motor_torque(i, t) - p0_->tau_f[i],
                                     equations_.motor_torque(i, t + 0.5 * length) - exponential_.middle_point().tau_f[i],
                                     equations_.motor_torque(i, t + length) - p1_->tau_f[i]);
      integral = simpson(x[i] - x[theta], middle[i] - x[theta], x1[i] - x[theta]) +
                 (impulse - B * (x1[w] - x[w]) - c.D[i] * (dtheta - x1[i] + x[i])) / c.K[i];
    }
    const double jerk = 6 * link[3 * n + i], ddq = 2 * link[2 * n + i] + jerk * (t + length);
    account.work_e += B * (x1[w] * x1[v] - x[w] * x[v] - dtheta * ddq + integral * jerk);
  }
}

void Integrator::begin(double t, double* x) {
  equations_.prescribe(t, x);
  if (!valid_) {
    equations_.evaluate(x, *p0_);
  } else if (!equations_.inside()) {
    equations_.evaluate_joints(x, *p0_);
  }
  valid_ = true;
}

bool Integrator::step(double h, double* x, double& proposal, const Tolerances& tolerances, int max_substeps,
                      StepAccount& account) {
  begin(0, x);
  if (settle_modes(equations_, x, false)) equations_.evaluate_joints(x, *p0_);
  const std::size_t size = equations_.size();
  const bool watch = event_count(equations_) > 0;
  double t = 0;
  int attempts = max_substeps;
  double wanted = proposal > 0 ? proposal : h;
  bool afresh = true;  // the last attempt was accepted
  while (t < h) {
    const double rest = h - t;
    // Equal sub-steps to the end, not more than the attempts that are left.
    const int pieces = std::clamp(static_cast<int>(std::ceil(std::min(rest / wanted, 1e6) - 1e-9)), 1, std::max(attempts, 1));
    const bool must = pieces >= attempts;
    if (method_ != Method::kRosenbrock) {
      if (afresh) exponential_.linearise(*p0_);
      exponential_now_ = chooses_exponential(rest, must);
    }
    double length = rest / pieces;
    const double tried = length;
    double error = attempt(t, length, x, tolerances, watch);
    --attempts;
    if (must && exponential_now_ && !(error <= kUnstable)) {
      exponential_now_ = false;
      length = tried;
      error = attempt(t, length, x, tolerances, watch);
    }
    const double factor = std::clamp(kSafety / std::cbrt(std::max(error, 1e-10)), kLargestCut, kLargestGrowth);
    afresh = false;
    if (!(error <= 1) && !must) {
      wanted = std::isfinite(error) ? length * factor : length * kLargestCut;
      continue;
    }
    if (!std::isfinite(error)) return false;
    std::size_t event = 0;
    bool happens = false;
    if (watch) {
      length = locate(t, length, x, tolerances, attempts, event, happens);
      account.events += happens;
    }
    const bool last = pieces == 1 && length == tried;
    add_torque_work(equations_, t, length, x, x1_.data(), account);
    add_losses(t, length, x, account);
    std::copy_n(x1_.data(), size, x);
    std::swap(p0_, p1_);
    account.error = std::max(account.error, error);
    account.forced += error > 1;
    ++account.substeps;
    t = last ? h : t + length;
    afresh = true;
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
