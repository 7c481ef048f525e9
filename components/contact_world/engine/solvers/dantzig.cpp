#include "components/contact_world/engine/solvers/dantzig.h"
#include "components/contact_world/engine/solvers/numbers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace cotwin::contact_world {
namespace {

constexpr double kLargestCurvature = 1e3;  // of A_tt; above it rotation alone converges as fast
constexpr int kTurnsOfContradictions = 4;
constexpr double kNoGrowth = 1e3;
constexpr double kLargestGrowth = 100;  // largest factor between predicted and present normals; jamming has no finite solution
constexpr double kLeastCurvature = 0.01;  // of A_tt; keeps x from drifting along redundant contacts that stick at the cone

double length_of(double x, double y) { return std::sqrt(x * x + y * y); }

double finite(double v) { return std::isfinite(v) ? v : 0; }

// Solves M x = y in place (m x m, row-major, M is destroyed) by elimination with pivoting; returns false if M is singular.
bool solve_dense(double* M, double* y, std::size_t m) {
  for (std::size_t k = 0; k < m; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < m; ++i) {
      if (std::abs(M[i * m + k]) > std::abs(M[pivot * m + k])) pivot = i;
    }
    if (!(std::abs(M[pivot * m + k]) > 1e-12)) return false;
    if (pivot != k) {
      std::swap_ranges(M + k * m, M + (k + 1) * m, M + pivot * m);
      std::swap(y[k], y[pivot]);
    }
    for (std::size_t i = k + 1; i < m; ++i) {
      const double f = M[i * m + k] / M[k * m + k];
      if (f == 0) continue;
      for (std::size_t j = k + 1; j < m; ++j) M[i * m + j] -= f * M[k * m + j];
      y[i] -= f * y[k];
    }
  }
  for (std::size_t k = m; k-- > 0;) {
    for (std::size_t j = k + 1; j < m; ++j) y[k] -= M[k * m + j] * y[j];
    y[k] /= M[k * m + k];
  }
  return true;
}

}  // namespace

void Dantzig::reserve(int n, int cones) {
  const std::size_t rows = index(n), count = index(cones);
  box_.reserve(n);
  A_.reserve(rows * rows);
  for (std::vector<double>* v : {&b_, &column_}) v->reserve(rows);
  in_cone_.reserve(rows);
  profile_.reserve(rows);
  rotated_.reserve(count);
  bound_.reserve(count);
  sides_.reserve(2 * count);
  change_.reserve(2 * count);
  response_.reserve(2 * count * count);
  system_.reserve(4 * count * count);
}

bool Dantzig::valid(const BoxedProblem& problem, std::size_t x, std::size_t w) {
  if (problem.n < 0 || x != index(problem.n) || w != x) return false;
  if (!problem.pairs.empty() && problem.pairs.size() != x) return false;
  if (problem.profile.empty()) {
    profile_.assign(x, {0, problem.n});
  } else if (problem.profile.size() == x) {
    profile_.assign(problem.profile.begin(), problem.profile.end());
  } else {
    return false;
  }
  double stiffest = 0;
  for (std::size_t i = 0; i < x; ++i) stiffest = std::max(stiffest, problem.A[i * (x + 1)]);
  for (std::size_t i = 0; i < x; ++i) {
    if (!problem.pairs.empty() && problem.pairs[i] >= problem.n) return false;
    if (profile_[i].begin < 0 || profile_[i].begin > profile_[i].end || profile_[i].end > problem.n) return false;
    if (!std::isfinite(problem.b[i]) || !(problem.A[i * (x + 1)] >= -1e-9 * stiffest)) return false;
  }
  in_cone_.assign(x, 0);
  for (const FrictionCone& cone : problem.cones) {
    if (cone.normal < 0 || cone.normal >= problem.n || cone.t1 < 0 || cone.t1 >= problem.n || cone.t2 < -1 ||
        cone.t2 >= problem.n || cone.t1 == cone.t2 || cone.normal == cone.t1 || cone.normal == cone.t2 ||
        !(problem.lo[cone.normal] >= 0) || !std::isfinite(cone.mu) || cone.mu < 0) {
      return false;
    }
    for (const int t : {cone.t1, cone.t2}) {
      if (t < 0) continue;
      if (in_cone_[index(t)]) return false;
      in_cone_[index(t)] = 1;
    }
  }
  for (std::size_t i = 0; i < x; ++i) {
    if (!in_cone_[i] && !(problem.lo[i] <= problem.hi[i])) return false;
  }
  return true;
}

bool Dantzig::solve_box(const BoxedProblem& problem, int limit) {
  const bool turned = A_now_ != problem.A;
  return box_.solve(
      {A_now_, b_now_, profile_.data(), turned ? std::span<const int>() : problem.pairs, turned ? 0 : problem.version}, limit);
}

// w_i of the unrotated problem with its own profile; profile_ belongs to the rotated copy.
double Dantzig::velocity(const BoxedProblem& problem, int i, const double* x) const {
  const auto [begin, end] = problem.profile.empty() ? RowProfile{0, problem.n} : problem.profile[index(i)];
  return std::inner_product(x + begin, x + end, problem.A + index(i) * n_ + begin, problem.b[i]);
}

// Initialises the box from x and the bounds; the cones' bounds follow from the start normals.
void Dantzig::start(const BoxedProblem& problem, std::span<const double> x) {
  box_.begin(problem.n, options_.tolerance, options_.pivot_tolerance);
  std::copy_n(problem.lo, n_, box_.lo.begin());
  std::copy_n(problem.hi, n_, box_.hi.begin());
  std::transform(x.begin(), x.end(), box_.x.begin(), finite);
  rotated_.assign(problem.cones.size(), {});
  bound_.resize(problem.cones.size());
  for (std::size_t k = 0; k < rotated_.size(); ++k) {
    const FrictionCone& cone = problem.cones[k];
    const std::size_t normal = index(cone.normal);
    const double r = cone.mu * std::clamp(box_.x[normal], box_.lo[normal], box_.hi[normal]);
    rotated_[k].r = r;
    for (const int t : {cone.t1, cone.t2}) {
      if (t < 0) continue;
      box_.lo[index(t)] = -r;
      box_.hi[index(t)] = r;
    }
  }
  A_now_ = problem.A;
  b_now_ = problem.b;

  highest_ = 0;
  // Contacts that slip at the start get rotated axes at once; for contacts that stick at the cone this has no benefit.
  constexpr double kCone = 1e-6, kRests = 1e-9;  // of the friction impulse, and of the velocity that it could change
  bool slips = false;
  for (std::size_t k = 0; k < rotated_.size(); ++k) {
    const FrictionCone& cone = problem.cones[k];
    bound_[k] = rotated_[k].r;
    box_.w[index(cone.t1)] = 0;
    if (cone.t2 < 0) continue;
    const bool here = bound_[k] > 0 && length_of(box_.x[index(cone.t1)], box_.x[index(cone.t2)]) > bound_[k] * (1 - kCone);
    for (const int t : {cone.t1, cone.t2}) {
      box_.w[index(t)] = here ? velocity(problem, t, box_.x.data()) : 0;
    }
    const double slip = length_of(box_.w[index(cone.t1)], box_.w[index(cone.t2)]);
    slips = slips || slip > kRests * bound_[k] * std::max(diagonal(cone.t1), diagonal(cone.t2));
  }
  if (slips) rotate_cones(problem);
}

Dantzig::Result Dantzig::solve(const BoxedProblem& problem, std::span<double> x, std::span<double> w) {
  Result result;
  n_ = index(std::max(0, problem.n));
  if (!valid(problem, x.size(), w.size())) return reject(problem, x, w);
  start(problem, x);
  const int limit = options_.pivots > 0 ? options_.pivots : 10 * problem.n + 100;
  if (problem.cones.empty()) {
    if (!solve_box(problem, limit)) result.status = Status::kPivotLimit;
    rotate_back(problem, x, w);
  } else {
    solve_cones(problem, limit, result, x, w);
  }
  if (!std::all_of(w.begin(), w.end(), [](double v) { return std::isfinite(v); })) return reject(problem, x, w);
  result.pivots = box_.pivots();
  result.redundant = box_.count(Pivoting::State::kParked);
  result.contradicting = box_.count(Pivoting::State::kContradicting);
  if (result.status == Status::kSolved && result.contradicting > 0) result.status = Status::kContradiction;
  if (problem.cones.empty()) {
    for (int i = 0; i < problem.n; ++i) result.residual = std::max(result.residual, box_.violation(i));
  }
  return result;
}

Dantzig::Result Dantzig::reject(const BoxedProblem& problem, std::span<double> x, std::span<double> w) {
  Result result;
  result.status = Status::kBadInput;
  std::fill(w.begin(), w.end(), 0.0);
  std::fill(x.begin(), x.end(), 0.0);
  if (problem.n < 0 || x.size() != index(problem.n)) return result;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (problem.lo[i] <= problem.hi[i]) x[i] = finite(std::clamp(0.0, problem.lo[i], problem.hi[i]));
  }
  for (const FrictionCone& cone : problem.cones) {
    for (const int t : {cone.t1, cone.t2}) {
      if (t >= 0 && index(t) < x.size()) x[index(t)] = 0;
    }
  }
  return result;
}

void Dantzig::solve_cones(const BoxedProblem& problem, int limit, Result& result, std::span<double> x, std::span<double> w) {
  for (;; ++result.turns) {
    const bool solved = solve_box(problem, limit);
    double worst = 0;  // as a multiple of the zero threshold, without rows that contradict others
    double residual = 0;
    bool contradicts = false;
    for (std::size_t k = 0; k < rotated_.size(); ++k) {
      const double e = coulomb_violation(friction(problem.cones[k], rotated_[k]));
      residual = std::max(residual, e);
      worst = std::max(worst, e / (2 * box_.zero(problem.cones[k].t1) + std::numeric_limits<double>::min()));
    }
    for (int i = 0; i < problem.n; ++i) {
      if (in_cone_[index(i)]) continue;
      const double v = box_.violation(i);
      residual = std::max(residual, v);
      if (box_.state(i) == Pivoting::State::kContradicting) {
        contradicts = true;
      } else {
        worst = std::max(worst, v / (2 * box_.zero(i) + std::numeric_limits<double>::min()));
      }
    }
    const bool progress = residual < 0.9 * result.residual;
    // The zero threshold grows with x; a multiple of it is not meaningful if the residual has grown as well.
    const bool good = worst <= 1 && (result.turns == 0 || residual <= kNoGrowth * result.residual);
    if (good || result.turns == 0 || residual < result.residual) {
      result.residual = residual;
      rotate_back(problem, x, w);
    }
    const int turns = contradicts ? std::min(options_.turns, kTurnsOfContradictions) : options_.turns;
    if (good || !solved || result.turns >= turns) {
      if (!good) result.status = solved ? Status::kTurnLimit : Status::kPivotLimit;
      break;
    }
    predict_bounds(problem);
    if (result.turns >= 6 && !progress) {  // Newton's iteration cycles
      for (std::size_t k = 0; k < bound_.size(); ++k) bound_[k] = 0.5 * (bound_[k] + rotated_[k].r);
    }
    rotate_cones(problem);
  }
  if (result.status == Status::kSolved) return;
  for (const FrictionCone& cone : problem.cones) {  // scale the best solution into the cones
    double none = 0;
    double &x1 = x[index(cone.t1)], &x2 = cone.t2 < 0 ? none : x[index(cone.t2)];
    const double r = cone.mu * x[index(cone.normal)], length = length_of(x1, x2);
    if (length <= r) continue;
    x1 *= r / length;
    x2 *= r / length;
  }
  for (int i = 0; i < problem.n; ++i) w[index(i)] = velocity(problem, i, x.data());
}

Dantzig::Friction Dantzig::friction(const FrictionCone& cone, const Rotated& rotated) const {
  Friction f;
  const std::size_t t1 = index(cone.t1);
  f.r = cone.mu * box_.x[index(cone.normal)];
  f.x1 = box_.x[t1];
  f.w1 = box_.w[t1];
  double stiffest = diagonal(cone.t1);
  if (cone.t2 >= 0) {
    f.x2 = box_.x[index(cone.t2)];
    f.w2 = box_.w[index(cone.t2)] - rotated.curvature * f.x2;
    stiffest = std::max(stiffest, diagonal(cone.t2) - rotated.curvature);
  }
  f.rho = stiffest > 0 ? 1 / stiffest : 0;
  return f;
}

// Violation of Coulomb's law in the measure of w: |x_t − P(x_t − ρ w_t)| / ρ with the projection P onto the disc of
// radius μ x_normal.
double Dantzig::coulomb_violation(const Friction& f) {
  if (f.rho == 0) return 0;
  const double y1 = f.x1 - f.rho * f.w1, y2 = f.x2 - f.rho * f.w2, length = length_of(y1, y2);
  const double shrink = length > f.r ? f.r / length : 1;
  return length_of(f.x1 - shrink * y1, f.x2 - shrink * y2) / f.rho;
}

// bound_ := μ x_normal predicted for the case that the rows at their bounds move to their new bounds: with G the change of the
// normals per change of these rows, (I − S μ G) Δx = S μ x_normal − x.
void Dantzig::predict_bounds(const BoxedProblem& problem) {
  const IncrementalLdl& basis = box_.basis();
  const std::size_t m_cones = rotated_.size();
  sides_.clear();
  double largest = 0;
  for (std::size_t k = 0; k < m_cones; ++k) {
    const FrictionCone& cone = problem.cones[k];
    const double x_normal = box_.x[index(cone.normal)];
    largest = std::max(largest, x_normal);
    bound_[k] = x_normal;
    if (rotated_[k].r <= 0) continue;
    for (const int t : {cone.t1, cone.t2}) {
      if (t < 0) continue;
      const Pivoting::State state = box_.state(t);
      if (state == Pivoting::State::kHigh || state == Pivoting::State::kLow) {
        sides_.push_back({t, static_cast<int>(k), state == Pivoting::State::kHigh ? 1.0 : -1.0});
      }
    }
  }
  if (highest_ == 0) highest_ = kLargestGrowth * largest;
  const std::size_t m = sides_.size();
  response_.resize(m_cones * m);
  system_.resize(m * m);
  change_.resize(m);
  column_.resize(n_);
  for (std::size_t e = 0; e < m; ++e) {
    const double* a = A_now_ + index(sides_[e].row) * n_;
    const auto [begin, end] = profile_[index(sides_[e].row)];
    for (int p = 0; p < basis.size(); ++p) {
      const int j = basis.row(p);
      column_[index(p)] = j >= begin && j < end ? -a[j] : 0;
    }
    basis.solve(column_.data());
    for (std::size_t k = 0; k < m_cones; ++k) {
      const int p = basis.position(problem.cones[k].normal);
      response_[k * m + e] = p < 0 ? 0 : column_[index(p)];
    }
  }
  for (std::size_t e = 0; e < m; ++e) {
    const std::size_t k = index(sides_[e].cone);
    const double slope = sides_[e].sign * problem.cones[k].mu;
    for (std::size_t j = 0; j < m; ++j) system_[e * m + j] = (e == j ? 1 : 0) - slope * response_[k * m + j];
    change_[e] = slope * box_.x[index(problem.cones[k].normal)] - box_.x[index(sides_[e].row)];
  }
  if (solve_dense(system_.data(), change_.data(), m)) {
    for (std::size_t k = 0; k < m_cones; ++k) {
      for (std::size_t e = 0; e < m; ++e) bound_[k] += response_[k * m + e] * change_[e];
    }
  }
  for (std::size_t k = 0; k < m_cones; ++k) bound_[k] = problem.cones[k].mu * std::clamp(bound_[k], 0.0, highest_);
}

// Sets the box of the next pass: bounds μ x_normal, first axis along x_t − ρ w_t where that is outside the cone.
void Dantzig::rotate_cones(const BoxedProblem& problem) {
  for (std::size_t k = 0; k < rotated_.size(); ++k) {
    const FrictionCone& cone = problem.cones[k];
    Rotated& now = rotated_[k];
    const Friction f = friction(cone, now);
    const double r = now.r = bound_[k], y1 = f.x1 - f.rho * f.w1, y2 = f.x2 - f.rho * f.w2, length = length_of(y1, y2);
    const std::size_t t1 = index(cone.t1);
    const bool slips = length > r * (1 - 1e-12);
    box_.lo[t1] = -r;
    box_.hi[t1] = r;
    if (cone.t2 < 0) {
      if (slips) box_.x[t1] = std::copysign(r, y1);
      continue;
    }
    const std::size_t t2 = index(cone.t2);
    box_.lo[t2] = -r;
    box_.hi[t2] = r;
    if (now.curvature != 0) {
      A_[t2 * (n_ + 1)] -= now.curvature;
      now.curvature = 0;
    }
    if (!slips || length == 0) continue;
    rotate_axes(problem, cone, now, y1 / length, y2 / length);
    box_.x[t1] = r;
    box_.x[t2] = 0;
    const double curvature = r > 0 ? std::max(length_of(f.w1, f.w2) / r, kLeastCurvature / f.rho) : 0;
    if (curvature * f.rho < kLargestCurvature) {
      A_[t2 * (n_ + 1)] += now.curvature = curvature;
    } else {
      box_.lo[t2] = box_.hi[t2] = 0;
    }
  }
}

// Extends row i of the rotated copy to the columns `begin` to `end`.
void Dantzig::extend_profile(int i, int begin, int end) {
  RowProfile& now = profile_[index(i)];
  double* a = A_.data() + index(i) * n_;
  if (begin < now.begin) std::fill(a + begin, a + std::exchange(now.begin, begin), 0.0);
  if (end > now.end) std::fill(a + std::exchange(now.end, end), a + end, 0.0);
}

void Dantzig::rotate_axes(const BoxedProblem& problem, const FrictionCone& cone, Rotated& now, double c, double s) {
  if (A_now_ == problem.A) {
    A_.resize(n_ * n_);
    for (std::size_t i = 0; i < n_; ++i) {
      std::copy(problem.A + i * n_ + profile_[i].begin, problem.A + i * n_ + profile_[i].end,
                A_.data() + i * n_ + profile_[i].begin);
    }
    b_.assign(problem.b, problem.b + n_);
    A_now_ = A_.data();
    b_now_ = b_.data();
  }
  const auto rotate = [c, s](double& v1, double& v2) {
    const double v = c * v1 + s * v2;
    v2 = c * v2 - s * v1;
    v1 = v;
  };
  const std::size_t t1 = index(cone.t1), t2 = index(cone.t2);
  const RowProfile both{std::min(profile_[t1].begin, profile_[t2].begin), std::max(profile_[t1].end, profile_[t2].end)};
  for (const int t : {cone.t1, cone.t2}) extend_profile(t, both.begin, both.end);
  double *row1 = A_.data() + t1 * n_, *row2 = A_.data() + t2 * n_;
  for (std::size_t j = index(both.begin); j < index(both.end); ++j) rotate(row1[j], row2[j]);
  for (int i = both.begin; i < both.end; ++i) {
    extend_profile(i, std::min(cone.t1, cone.t2), std::max(cone.t1, cone.t2) + 1);
    rotate(A_[index(i) * n_ + t1], A_[index(i) * n_ + t2]);
  }
  rotate(b_[index(cone.t1)], b_[index(cone.t2)]);
  const double c_now = now.c;
  now.c = c_now * c - now.s * s;
  now.s = now.s * c + c_now * s;
}

// Rotates the box's x and w back into the problem's axes.
void Dantzig::rotate_back(const BoxedProblem& problem, std::span<double> x, std::span<double> w) const {
  std::copy(box_.x.begin(), box_.x.end(), x.begin());
  std::copy(box_.w.begin(), box_.w.end(), w.begin());
  for (std::size_t k = 0; k < rotated_.size(); ++k) {
    const FrictionCone& cone = problem.cones[k];
    if (cone.t2 < 0) continue;
    const Rotated& now = rotated_[k];
    const Friction f = friction(cone, now);
    x[index(cone.t1)] = now.c * f.x1 - now.s * f.x2;
    x[index(cone.t2)] = now.s * f.x1 + now.c * f.x2;
    w[index(cone.t1)] = now.c * f.w1 - now.s * f.w2;
    w[index(cone.t2)] = now.s * f.w1 + now.c * f.w2;
  }
}

}  // namespace cotwin::contact_world
