#include "components/drive_train/exponential.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "components/drive_train/events.h"
#include "components/drive_train/ldlt.h"

namespace cotwin::drive_train {
namespace {

constexpr double kStretch = 12;      // rad: rounding errors of a series are exp(kStretch) larger than those of its sum
constexpr double kWatchStretch = 1;  // the same while event functions are watched
constexpr int kMostTerms = 60;
constexpr double kSeriesError = 1e-2;  // of a tolerance
// The estimated error is that of the solution of order 2. The solution of order 3 is better by this factor where R is smooth over
// the sub-step, and less where R follows oscillations that are shorter: by frequency times length, up to 1.
constexpr double kEstimate = 0.1, kEstimateOfOscillation = 0.02;
constexpr double kNearTheEvent = 1e-9;  // share of the event function at the beginning of the stretch
constexpr int kMostRefinements = 20;

// Two numbers of one SSE2 register, which may overlay arrays of double.
typedef double Pair __attribute__((vector_size(16), may_alias));

const Pair* pack(const double* v) { return reinterpret_cast<const Pair*>(v); }
Pair* pack(double* v) { return reinterpret_cast<Pair*>(v); }

std::size_t padded(std::size_t n) { return (n + 3) / 4 * 4; }

}  // namespace

Exponential::Exponential(Equations& equations)
    : equations_(equations),
      n_(equations.n()),
      stride_(padded(equations.n())),
      stage_(equations.n()),
      middle_point_(equations.n()) {
  W_.resize(stride_ * stride_);
  factors_.resize(n_ * n_);
  for (auto* v : {&kappa_, &D_, &d_l_, &k_l_, &B_inverse_, &f_w_, &f_z_, &z_w_, &z_z_, &padded_}) v->resize(stride_);
  for (auto* v : {&b0_, &b1_, &ramp_, &bend_, &shifted_, &shifted_ramp_, &delta_, &half_, &correction_, &half_correction_,
                  &linear_, &R_a_, &R_b_, &R_1_}) {
    v->resize(5 * stride_);
  }
  terms_.resize((kMostTerms + 1) * 5 * stride_);
  u_.resize(equations.size());
  middle_.resize(equations.size());
  tau_.resize(2 * n_);
  for (auto* v : {&events_, &events_begin_, &events_end_}) v->resize(2 * n_);
}

void Exponential::linearise(const Point& p) {
  const Equations& e = equations_;
  const Parameters& q = e.parameters();
  if (e.inside()) invert_M(p);
  for (std::size_t i = 0; i < n_; ++i) {
    kappa_[i] = p.kappa[i];
    D_[i] = q.D[i];
    d_l_[i] = p.d_l[i];
    k_l_[i] = p.k_l[i];
    B_inverse_[i] = e.stuck(i) ? 0 : 1 / q.B[i];
    f_w_[i] = p.f_w[i];
    f_z_[i] = p.f_z[i];
    z_w_[i] = p.z_w[i];
    z_z_[i] = p.z_z[i];
  }
  bound_rates();
}

// W = L⁻ᵀ D⁻¹ L⁻¹ of M = L D Lᵀ.
void Exponential::invert_M(const Point& p) {
  const std::size_t n = n_;
  factors_ = p.M;
  double* L = factors_.data();
  ldlt(L, n);
  for (std::size_t j = 0; j < n; ++j) {  // L⁻¹ in place of L
    double* column = L + j * n;
    for (std::size_t i = j + 1; i < n; ++i) {
      double sum = -column[i];
      for (std::size_t k = j + 1; k < i; ++k) sum -= L[k * n + i] * column[k];
      column[i] = sum;
    }
  }
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = j; i < n; ++i) {
      double sum = (i == j ? 1 : L[j * n + i]) * L[i * n + i];
      for (std::size_t k = i + 1; k < n; ++k) sum += L[i * n + k] * L[j * n + k] * L[k * n + k];
      W_[j * stride_ + i] = W_[i * stride_ + j] = sum;
    }
  }
}

// For a positive semidefinite diag(s) and the symmetric W, no eigenvalue of s^½ W s^½ exceeds its largest sum of absolute values
// in a row, nor its Frobenius norm.
void Exponential::bound_rates() {
  const auto links = [this](const auto& weight) {
    for (std::size_t i = 0; i < n_; ++i) padded_[i] = std::sqrt(weight(i));
    double row = 0, squares = 0;
    for (std::size_t j = 0; j < n_; ++j) {
      double sum = 0;
      for (std::size_t i = 0; i < n_; ++i) {
        const double entry = std::abs(W_[j * stride_ + i]) * padded_[i];
        sum += entry;
        squares += entry * entry * padded_[j] * padded_[j];
      }
      row = std::max(row, sum * padded_[j]);
    }
    return std::min(row, std::sqrt(squares));
  };
  double stiffness = 0, damping = 0, bristle = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    stiffness = std::max(stiffness, B_inverse_[i] * (std::abs(kappa_[i]) + std::abs(f_z_[i] * z_w_[i])));
    damping = std::max(damping, B_inverse_[i] * (D_[i] + std::abs(f_w_[i])));
    bristle = std::max(bristle, std::abs(z_z_[i]));
  }
  if (equations_.inside()) {
    stiffness += links([this](std::size_t i) { return std::abs(kappa_[i]) + std::abs(k_l_[i]); });
    damping += links([this](std::size_t i) { return D_[i] + std::abs(d_l_[i]); });
  }
  frequency_ = std::sqrt(stiffness);
  decay_ = std::max(damping, bristle);
  fastest_ = std::max(0.5 * damping + std::sqrt(0.25 * damping * damping + stiffness), bristle);
}

// out = scale (J y + force_scale force). P: the stride, 0 if it is not known at compile time.
template <std::size_t P>
void Exponential::term(double scale, const double* y, const double* force, double force_scale, double* out) {
  const std::size_t pairs = (P > 0 ? P : stride_) / 2;
  const Pair *q = pack(y), *v = q + pairs, *theta = v + pairs, *w = theta + pairs, *z = w + pairs;
  Pair *dq = pack(out), *dv = dq + pairs, *dtheta = dv + pairs, *dw = dtheta + pairs, *dz = dw + pairs;
  const Pair *kappa = pack(kappa_.data()), *D = pack(D_.data()), *d_l = pack(d_l_.data()), *k_l = pack(k_l_.data());
  const Pair *f_w = pack(f_w_.data()), *f_z = pack(f_z_.data()), *z_w = pack(z_w_.data()), *z_z = pack(z_z_.data());
  const Pair *B_inverse = pack(B_inverse_.data()), s = {scale, scale};
  double* load = padded_.data();
  for (std::size_t i = 0; i < pairs; ++i) {
    const Pair tau_J = kappa[i] * (theta[i] - q[i]) + D[i] * (w[i] - v[i]);
    const Pair on_link = s * (tau_J - d_l[i] * v[i] - k_l[i] * q[i]), on_motor = tau_J + f_w[i] * w[i] + f_z[i] * z[i];
    const Pair rate_z = s * (z_w[i] * w[i] + z_z[i] * z[i]);
    pack(load)[i] = on_link;
    dq[i] = s * v[i];
    dtheta[i] = s * w[i];
    dw[i] = -s * B_inverse[i] * on_motor;
    dz[i] = rate_z;
  }
  if constexpr (P > 0) {
    Pair sum[P / 2] = {};
    const Pair* column = pack(W_.data());
    for (std::size_t j = 0; j < P; ++j, column += P / 2) {
      const Pair l = {load[j], load[j]};
      for (std::size_t i = 0; i < P / 2; ++i) sum[i] += column[i] * l;
    }
    for (std::size_t i = 0; i < P / 2; ++i) dv[i] = sum[i];
  } else {
    std::fill_n(dv, pairs, Pair{});
    const Pair* column = pack(W_.data());
    for (std::size_t j = 0; j < n_; ++j, column += pairs) {
      const Pair l = {load[j], load[j]};
      for (std::size_t i = 0; i < pairs; ++i) dv[i] += column[i] * l;
    }
  }
  if (force == nullptr) return;
  const Pair f = {scale * force_scale, scale * force_scale};
  for (std::size_t i = 0; i < 5 * pairs; ++i) dq[i] += f * pack(force)[i];
}

// δ' = J δ + b0 + b1 t + b2 t² from δ(0) = 0: writes δ(h) and, where `half` is given, δ(h/2). Forces may be null. Returns false
// if a series does not converge.
template <std::size_t P>
bool Exponential::solve(double h, const double* b0, const double* b1, const double* b2, double* delta, double* half) {
  const std::size_t size = 5 * (P > 0 ? P : stride_), speeds = P > 0 ? P : stride_;
  const double longest = (watches_ ? kWatchStretch : kStretch) / fastest_;
  const bool one = h <= longest;
  const double pieces = one ? 1 : 2 * std::ceil(0.5 * h / longest);
  const double s = h / pieces;
  const double small_squared = small_speed_ * small_speed_;
  std::fill(delta, delta + size, 0.0);
  const double* forces[3] = {b0, b1, b2};
  for (double piece = 0; piece < pieces; ++piece) {
    const double t = piece * s;
    if (piece > 0) {  // b(t + s) = (b0 + b1 t + b2 t²) + (b1 + 2 b2 t) s + b2 s²
      for (std::size_t i = 0; i < size; ++i) {
        const double c0 = b0 != nullptr ? b0[i] : 0, c1 = b1 != nullptr ? b1[i] : 0, c2 = b2 != nullptr ? b2[i] : 0;
        shifted_[i] = c0 + t * (c1 + t * c2);
        shifted_ramp_[i] = c1 + 2 * t * c2;
      }
      forces[0] = shifted_.data();
      forces[1] = shifted_ramp_.data();
    }
    double* y = terms_.data();
    std::copy(delta, delta + size, y);
    double power = 1;
    bool zero = piece == 0;                        // all terms so far
    bool small_before = false, converged = false;  // without damping, every second term of the speeds may be 0
    int k = 0;
    for (; k < kMostTerms && !converged; ++k, y += size) {
      double* next = y + size;
      const double* force = k < 3 ? forces[k] : nullptr;
      if (!zero) {
        term<P>(s / (k + 1), y, force, power, next);
      } else if (force == nullptr) {
        std::fill(next, next + size, 0.0);
      } else {
        const Pair factor = {s / (k + 1) * power, s / (k + 1) * power};
        for (std::size_t i = 0; i < size / 2; ++i) pack(next)[i] = factor * pack(force)[i];
        zero = false;
      }
      power *= s;
      Pair squares = {};
      for (std::size_t i = 0; i < speeds / 2; ++i) {
        const Pair link = pack(next + speeds)[i], motor = pack(next + 3 * speeds)[i];
        squares += link * link + motor * motor;
      }
      const bool small = squares[0] + squares[1] < small_squared;
      converged = k >= 3 && small && small_before;
      small_before = small;
    }
    if (!converged) return false;
    for (std::size_t i = 0; i < size / 2; ++i) {  // the last terms, which are the smallest, first
      const Pair* from = pack(y) + i;
      Pair sum = {}, at_half = {};
      for (int m = k; m >= 0; --m, from -= size / 2) {
        sum += *from;
        at_half = 0.5 * at_half + *from;
      }
      pack(delta)[i] = sum;
      if (one && half != nullptr) pack(half)[i] = at_half;
    }
    if (half != nullptr && !one && piece + 1 == 0.5 * pieces) std::copy(delta, delta + size, half);
    if (watches_) watch_events(t, s, k);
  }
  return true;
}

bool Exponential::solve(double h, const double* b0, const double* b1, const double* b2, double* delta, double* half) {
  switch (stride_) {
    case 4:
      return solve<4>(h, b0, b1, b2, delta, half);
    case 8:
      return solve<8>(h, b0, b1, b2, delta, half);
    default:
      return solve<0>(h, b0, b1, b2, delta, half);
  }
}

// Looks for the first event in the stretch [t, t + s] whose series has just been computed, with `terms` terms.
void Exponential::watch_events(double t, double s, int terms) {
  if (t >= seen_) return;
  const std::size_t count = event_count(equations_), size = 5 * stride_;
  const auto values = [&](double share, std::vector<double>& at) {
    const double* last = terms_.data() + static_cast<std::size_t>(terms) * size;
    for (std::size_t part = 0; part < 5; ++part) {
      for (std::size_t i = 0; i < n_; ++i) {
        const double* from = last + part * stride_ + i;
        double sum = 0;
        for (int m = terms; m >= 0; --m, from -= size) sum = share * sum + *from;
        u_[part * n_ + i] = x_[part * n_ + i] + sum;
      }
    }
    const double time = watch_from_ + t + share * s;
    equations_.prescribe(time, u_.data());
    event_values(equations_, time, u_.data(), at.data());
  };
  values(1, events_end_);
  if (std::none_of(events_end_.begin(), events_end_.begin() + static_cast<std::ptrdiff_t>(count),
                   [](double value) { return value < -kOnTheEvent; })) {
    return;
  }
  values(0, events_begin_);
  // The least of those event functions that become negative, each from 1 at the beginning: positive before the first event.
  const auto least = [&](const std::vector<double>& at) {
    double least_share = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < count; ++i) {
      if (events_end_[i] < -kOnTheEvent) least_share = std::min(least_share, at[i] / std::max(events_begin_[i], kOnTheEvent));
    }
    return least_share;
  };
  double low = 0, high = 1, at_low = least(events_begin_), at_high = least(events_end_);
  seen_ = t + s;
  if (at_low < 1) return;                                                   // begins at the event, or beyond it
  for (int i = 0; i < kMostRefinements && at_high < -kNearTheEvent; ++i) {  // regula falsi, Illinois
    const double now = high - (high - low) * at_high / (at_high - at_low);
    values(now, events_);
    const double at = least(events_);
    if (at < 0) {
      high = now;
      at_high = at;
      at_low *= 0.5;
    } else {
      low = now;
      at_low = at;
      at_high *= 0.5;
    }
  }
  seen_ = t + high * s;
}

// J δ + b0 + b1 t
void Exponential::rates(const double* delta, const double* b0, const double* b1, double t, double* out) {
  switch (stride_) {
    case 4:
      term<4>(1, delta, b0, 1, out);
      break;
    case 8:
      term<8>(1, delta, b0, 1, out);
      break;
    default:
      term<0>(1, delta, b0, 1, out);
  }
  if (b1 == nullptr) return;
  for (std::size_t i = 0; i < 5 * stride_; ++i) out[i] += t * b1[i];
}

// u = x + δ
void Exponential::add(const double* x, const double* delta, double* u) const {
  for (std::size_t part = 0; part < 5; ++part) {
    for (std::size_t i = 0; i < n_; ++i) u[part * n_ + i] = x[part * n_ + i] + delta[part * stride_ + i];
  }
}

// R = rates at (t, u) − linear, for a prediction of R that is in R. Leaves the forces at u in stage_.
void Exponential::rest(double t, const double* u, const double* linear, double* R) {
  Equations& e = equations_;
  const std::size_t n = n_, p = stride_;
  e.evaluate_joints(u, stage_);
  for (std::size_t i = 0; i < n; ++i) {
    R[3 * p + i] = B_inverse_[i] * e.motor_balance(stage_, i, e.motor_torque(i, t)) - linear[3 * p + i];  // (2b)
    R[4 * p + i] = stage_.dz[i] - linear[4 * p + i];
  }
  if (!e.inside()) return;
  double *a = tau_.data(), *tau = a + n;
  for (std::size_t i = 0; i < n; ++i) a[i] = linear[p + i] + R[p + i];
  e.inverse_dynamics(u, a, tau);
  for (std::size_t j = 0; j < n; ++j) {
    const double missing = e.link_balance(stage_, j, t, tau[j]);  // (2a)
    for (std::size_t i = 0; i < n; ++i) R[p + i] += W_[j * p + i] * missing;
  }
}

double Exponential::attempt(double t, double& length, const double* x, const Tolerances& tolerances, const Point& p0,
                            double* x1, Point& p1, bool watch) {
  Equations& e = equations_;
  const std::size_t n = n_, p = stride_, v = p, theta = 2 * p, w = 3 * p, z = 4 * p, size = 5 * p;
  const Course& c = e.course();
  const bool inside = e.inside();
  constexpr double kFailed = std::numeric_limits<double>::quiet_NaN();
  double h = length;
  small_speed_ = kSeriesError * std::min(tolerances.speed, tolerances.angle / h);
  x_ = x;
  watch_from_ = t;
  seen_ = h;

  // the rates and their slopes in time at x; with the link outside its acceleration is given
  bool ramps = false;
  std::fill(b0_.begin(), b0_.end(), 0.0);
  std::fill(b1_.begin(), b1_.end(), 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const bool moves = B_inverse_[i] > 0;
    b0_[i] = x[n + i];
    b0_[theta + i] = moves ? x[3 * n + i] : 0;
    b0_[w + i] = B_inverse_[i] * e.motor_balance(p0, i, e.motor_torque(i, t));
    b0_[z + i] = p0.dz[i];
    b1_[w + i] = B_inverse_[i] * c.dtau_m[i];
    ramps = ramps || b1_[w + i] != 0 || (inside ? c.dtau_e[i] != 0 : c.link[3 * n + i] != 0);
    if (!inside) {
      b0_[v + i] = 2 * c.link[2 * n + i] + 6 * t * c.link[3 * n + i];
      b1_[v + i] = 6 * c.link[3 * n + i];
    }
  }
  for (std::size_t j = 0; j < n && inside; ++j) {
    const double balance = e.link_balance(p0, j, t, p0.h[j]), slope = c.dtau_e[j];
    for (std::size_t i = 0; i < n; ++i) {
      b0_[v + i] += W_[j * p + i] * balance;
      b1_[v + i] += W_[j * p + i] * slope;
    }
  }
  const double* b1 = ramps ? b1_.data() : nullptr;

  if (watch) {
    watches_ = true;
    const bool solved = solve(h, b0_.data(), b1, nullptr, delta_.data(), nullptr);
    watches_ = false;
    if (!solved) return kFailed;
    h = length = seen_;
  }
  if (!solve(h, b0_.data(), b1, nullptr, delta_.data(), half_.data())) return kFailed;
  rates(half_.data(), b0_.data(), b1, 0.5 * h, linear_.data());
  add(x, half_.data(), u_.data());
  e.prescribe(t + 0.5 * h, u_.data());
  e.confine_bristles(u_.data());
  std::fill(R_a_.begin(), R_a_.end(), 0.0);
  rest(t + 0.5 * h, u_.data(), linear_.data(), R_a_.data());

  for (std::size_t i = 0; i < size; ++i) ramp_[i] = 2 / h * R_a_[i];
  if (!solve(h, nullptr, ramp_.data(), nullptr, correction_.data(), half_correction_.data())) return kFailed;
  for (std::size_t i = 0; i < size; ++i) {
    half_[i] += half_correction_[i];
    delta_[i] += correction_[i];
  }
  rates(half_.data(), b0_.data(), b1, 0.5 * h, linear_.data());
  add(x, half_.data(), u_.data());
  e.prescribe(t + 0.5 * h, u_.data());
  e.confine_bristles(u_.data());
  R_b_ = R_a_;
  rest(t + 0.5 * h, u_.data(), linear_.data(), R_b_.data());
  std::copy(u_.begin(), u_.end(), middle_.begin());
  std::swap(stage_, middle_point_);

  rates(delta_.data(), b0_.data(), b1, h, linear_.data());
  add(x, delta_.data(), u_.data());
  e.prescribe(t + h, u_.data());
  e.confine_bristles(u_.data());
  for (std::size_t i = 0; i < size; ++i) R_1_[i] = 2 * R_b_[i];
  rest(t + h, u_.data(), linear_.data(), R_1_.data());

  // R(t) = (4 R_b − R_1) t/h + 2 (R_1 − 2 R_b) (t/h)² less that of 2.
  for (std::size_t i = 0; i < size; ++i) {
    ramp_[i] = (4 * R_b_[i] - R_1_[i] - 2 * R_a_[i]) / h;
    bend_[i] = 2 * (R_1_[i] - 2 * R_b_[i]) / (h * h);
  }
  if (!solve(h, nullptr, ramp_.data(), bend_.data(), correction_.data(), nullptr)) return kFailed;
  for (std::size_t i = 0; i < size; ++i) delta_[i] += correction_[i];
  add(x, delta_.data(), x1);
  e.prescribe(t + h, x1);
  e.confine_bristles(x1);
  e.evaluate(x1, p1);

  const double share = std::clamp(kEstimateOfOscillation * frequency_ * h, kEstimate, 1.0);
  double worst = 0;
  const auto weigh = [&](std::size_t part, double absolute) {
    for (std::size_t i = 0; i < n; ++i) {
      const double size_of_x = std::max(std::abs(x[part * n + i]), std::abs(x1[part * n + i]));
      const double scaled = share * std::abs(correction_[part * p + i]) / (absolute + tolerances.relative * size_of_x);
      if (!(scaled <= worst)) worst = scaled;  // NaN too
    }
  };
  if (inside) {
    weigh(0, tolerances.angle);
    weigh(1, tolerances.speed);
  }
  weigh(2, tolerances.angle);
  weigh(3, tolerances.speed);
  return worst;
}

}  // namespace cotwin::drive_train
