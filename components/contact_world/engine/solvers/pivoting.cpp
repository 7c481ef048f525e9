#include "components/contact_world/engine/solvers/pivoting.h"
#include "components/contact_world/engine/solvers/numbers.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::contact_world {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// Longest step of √A_ii x_i, relative to the largest |b_j| / √A_jj; longer steps result from rounding.
constexpr double kFarthest = 1e8;
constexpr double kTrust = 1e-6;     // of |w_i|: larger remainders after the step to w_i = 0 trigger a new factorisation
constexpr int kFreedomsOfPair = 6;  // between two bodies; further rows of the pair are dependent
constexpr int kChanges = 40;        // of the basis before a new factorisation

// Two elements at a time in two partial sums, a reordering that the compiler may not do. Rows have no alignment.
using Two [[gnu::vector_size(16)]] = double;
using TwoInPlace [[gnu::aligned(8), gnu::may_alias]] = Two;

}  // namespace

void Pivoting::reserve(int n) {
  const std::size_t size = index(n);
  for (std::vector<double>* v : {&x, &lo, &hi, &w, &zero_, &scale_, &dx_}) v->reserve(size);
  state_.reserve(size);
  in_basis_.reserve(size);
  factored_.reserve(size);
  ldl_.reserve(n);  // becomes empty if it grows
  version_ = 0;
}

void Pivoting::begin(int n, double tolerance, double pivot_tolerance) {
  n_ = n;
  for (std::vector<double>* v : {&x, &lo, &hi, &w, &zero_, &scale_, &dx_}) v->resize(index(n));
  state_.resize(index(n));
  tolerance_ = tolerance;
  pivot_tolerance_ = pivot_tolerance;
  pivots_ = 0;
}

bool Pivoting::solve(const BoxedSystem& system, int limit) {
  system_ = system;
  limit_ = limit;
  stalls_ = 0;
  find_basis();
  evaluate();
  if (!settle()) return false;
  for (int refinement = 0; refinement < 3; ++refinement) {
    const int pivots = pivots_;
    for (int i = next(); i >= 0; i = next()) {
      if (!enter(i)) return false;
    }
    if (pivots_ == pivots) break;
    evaluate();  // without the rounding of the pivots
    if (!settle()) return false;
    for (State& state : state_) {
      if (state == State::kContradicting && refinement == 0) state = State::kParked;  // the blocking rows may have changed
    }
  }
  return true;
}

// Computes the scales that depend on A's diagonal alone.
void Pivoting::measure() {
  double largest = 0;
  for (int i = 0; i < n_; ++i) largest = std::max(largest, row(i)[i]);
  noise_ = 4 * kEpsilon * largest;  // rounding of sums of products
  for (int i = 0; i < n_; ++i) {
    scale_[index(i)] = 1 / std::sqrt(std::max({row(i)[i], noise_, std::numeric_limits<double>::min()}));
  }
}

void Pivoting::find_basis() {
  for (int i = 0; i < n_; ++i) {
    const std::size_t k = index(i);
    x[k] = std::clamp(x[k], lo[k], hi[k]);
    if (lo[k] == hi[k]) {
      state_[k] = State::kFixed;
    } else if (x[k] == lo[k]) {
      state_[k] = State::kLow;
    } else if (x[k] == hi[k]) {
      state_[k] = State::kHigh;
    } else {
      state_[k] = State::kFree;
    }
  }
  const auto is_free = [](State state) { return state == State::kFree; };
  const bool same = system_.version != 0 && system_.version == version_;
  if (!same) measure();
  if (same && std::equal(state_.begin(), state_.end(), factored_.begin(), factored_.end(),
                         [&](State now, State then) { return is_free(now) == is_free(then); })) {
    for (int i = 0; i < n_; ++i) {
      if (is_free(state_[index(i)]) && !ldl_.contains(i)) state_[index(i)] = State::kParked;
    }
    return;
  }
  factored_ = state_;
  factor();
  version_ = system_.version;
}

// Factorises the independent free rows as the basis; parks the others.
void Pivoting::factor() {
  ldl_.clear(n_);
  changes_ = 0;
  version_ = 0;
  in_basis_.assign(index(n_), 0);
  for (int i = 0; i < n_; ++i) {
    if (state_[index(i)] != State::kFree) continue;
    const int pair = system_.pairs.empty() ? -1 : system_.pairs[index(i)];
    const bool full = pair >= 0 && in_basis_[index(pair)] == kFreedomsOfPair;
    if (!full && pivot(i) > least_pivot(i)) {
      ldl_.append();
      if (pair >= 0) ++in_basis_[index(pair)];
    } else {
      state_[index(i)] = State::kParked;
    }
  }
}

void Pivoting::evaluate() {
  double x_scale = 0;
  b_scale_ = 0;
  for (int i = 0; i < n_; ++i) {
    const double* a = row(i);
    Two s01{system_.b[i], 0}, s23{0, 0};  // over whole rows including zeros, so that every NaN of A is found
    const int end = system_.profile[i].end;
    int j = system_.profile[i].begin;
    for (; j + 4 <= end; j += 4) {
      s01 += *reinterpret_cast<const TwoInPlace*>(a + j) * *reinterpret_cast<const TwoInPlace*>(x.data() + j);
      s23 += *reinterpret_cast<const TwoInPlace*>(a + j + 2) * *reinterpret_cast<const TwoInPlace*>(x.data() + j + 2);
    }
    s01 += s23;
    double sum = s01[0] + s01[1];
    for (; j < end; ++j) sum += a[j] * x[index(j)];
    w[index(i)] = sum;
    b_scale_ = std::max(b_scale_, std::abs(system_.b[i]) * scale_[index(i)]);
    x_scale += std::abs(x[index(i)]) / scale_[index(i)];
  }
  // |A_ij| ≤ √(A_ii A_jj) bounds the rounding of the sums.
  for (int i = 0; i < n_; ++i) zero_[index(i)] = (tolerance_ * b_scale_ + 4 * kEpsilon * x_scale) / scale_[index(i)];
}

double Pivoting::violation(int i) const {
  const double w_i = w[index(i)];
  switch (state_[index(i)]) {
    case State::kLow:
      return std::max(0.0, -w_i);
    case State::kHigh:
      return std::max(0.0, w_i);
    case State::kFixed:
      return 0;
    default:
      return std::abs(w_i);
  }
}

int Pivoting::next() const {
  const bool lowest_index = stalls_ > n_;
  int worst = -1;
  double most = 0;
  for (int i = 0; i < n_; ++i) {
    if (state_[index(i)] == State::kFree || state_[index(i)] == State::kContradicting) continue;
    const double v = violation(i);
    if (v > zero_[index(i)] && v * scale_[index(i)] > most) {
      if (lowest_index) return i;
      worst = i;
      most = v * scale_[index(i)];
    }
  }
  return worst;
}

// Returns the position of the basis row that reaches its bound first along `dx` (by position) within `length`, and shortens
// `length` to that; −1 if there is none.
int Pivoting::blocking(const double* dx, double& length) const {
  const bool lowest_index = stalls_ > n_;
  int first = -1;
  for (int p = 0; p < ldl_.size(); ++p) {
    const std::size_t j = index(ldl_.row(p));
    if (std::abs(dx[p]) <= 0) continue;
    const double t = std::max(0.0, ((dx[p] > 0 ? hi[j] : lo[j]) - x[j]) / dx[p]);
    if (t > length || t == kInfinity) continue;
    if (t == length && first >= 0) {  // ties: the largest pivot, or the lowest index
      const std::size_t f = index(ldl_.row(first));
      if (lowest_index ? f < j : std::abs(dx[first]) * scale_[j] >= std::abs(dx[p]) * scale_[f]) continue;
    }
    length = t;
    first = p;
  }
  return first;
}

// w += dx A_j
void Pivoting::add_column(int j, double dx) {
  const double* a = row(j);
  double* const y = w.data();
  for (int i = system_.profile[j].begin; i < system_.profile[j].end; ++i) y[i] += dx * a[i];
}

// w += Σ dx_p A_p and x += dx over the basis.
void Pivoting::add_columns(const double* dx) {
  const int m = ldl_.size();
  double* const y = w.data();
  int p = 0;
  while (p < m) {
    const int j0 = ldl_.row(p);
    const auto [begin, end] = system_.profile[j0];
    const auto alike = [&, first = begin, last = end](int position) {
      const RowProfile& other = system_.profile[ldl_.row(position)];
      return other.begin == first && other.end == last;
    };
    if (p + 3 < m && alike(p + 1) && alike(p + 2) && alike(p + 3)) {
      const double *a0 = row(j0), *a1 = row(ldl_.row(p + 1)), *a2 = row(ldl_.row(p + 2)), *a3 = row(ldl_.row(p + 3));
      const double s0 = dx[p], s1 = dx[p + 1], s2 = dx[p + 2], s3 = dx[p + 3];
      for (int i = begin; i < end; ++i) y[i] += (s0 * a0[i] + s1 * a1[i]) + (s2 * a2[i] + s3 * a3[i]);
      p += 4;
    } else {
      add_column(j0, dx[p]);
      ++p;
    }
  }
  for (p = 0; p < m; ++p) {
    const std::size_t j = index(ldl_.row(p));
    x[j] = std::clamp(x[j] + dx[p], lo[j], hi[j]);
  }
}

void Pivoting::to_bound(int i, bool high) {
  x[index(i)] = high ? hi[index(i)] : lo[index(i)];
  state_[index(i)] = high ? State::kHigh : State::kLow;
}

// Brings w of the basis to 0; rows that reach a bound leave the basis.
bool Pivoting::settle() {
  while (ldl_.size() > 0) {
    const int m = ldl_.size();
    for (int p = 0; p < m; ++p) dx_[index(p)] = -w[index(ldl_.row(p))];
    ldl_.solve(dx_.data());
    double length = 1;
    const int first = blocking(dx_.data(), length);
    const bool high = first >= 0 && dx_[index(first)] > 0;
    for (int p = 0; p < m; ++p) dx_[index(p)] *= length;
    add_columns(dx_.data());
    if (first < 0) return true;
    const int leaving = ldl_.row(first);
    to_bound(leaving, high);
    leave(leaving);
    if (++pivots_ >= limit_) return false;
  }
  return true;
}

// Drives w_i to 0 by moving x_i inwards; the basis follows so that its w stays 0.
bool Pivoting::enter(int i) {
  const std::size_t k = index(i);
  const double sign = w[k] < 0 ? 1 : -1;
  for (;;) {
    if (++pivots_ > limit_) {
      if (x[k] > lo[k] && x[k] < hi[k]) state_[k] = State::kParked;
      return false;
    }
    const double d = pivot(i);
    const bool dependent = !(d > least_pivot(i));
    const int m = ldl_.size();
    ldl_.column(dx_.data());
    for (int p = 0; p < m; ++p) {
      double& dx = dx_[index(p)];
      dx *= -sign;
      // Components of a null direction that are rounding must not block.
      if (dependent && std::abs(dx) * scale_[k] < 1e-6 * scale_[index(ldl_.row(p))]) dx = 0;
    }
    const double own = sign > 0 ? hi[k] - x[k] : x[k] - lo[k], full = dependent ? kInfinity : std::abs(w[k]) / d;
    double length = std::min(own, full);
    const int first = blocking(dx_.data(), length);
    if (!(length <= kFarthest * b_scale_ * scale_[k])) {  // unbounded, or beyond the accuracy of A
      state_[k] = State::kContradicting;
      return true;
    }
    stalls_ = length * std::abs(w[k]) > 0 ? 0 : stalls_ + 1;

    const bool high = first >= 0 && dx_[index(first)] > 0;
    for (int p = 0; p < m; ++p) dx_[index(p)] *= length;
    add_columns(dx_.data());
    add_column(i, length * sign);
    x[k] += length * sign;
    if (first >= 0) {
      const int leaving = ldl_.row(first);
      to_bound(leaving, high);
      leave(leaving);
      ++changes_;
      if (sign * w[k] >= -zero_[k]) {
        state_[k] = State::kParked;
        return true;
      }
    } else if (own <= full) {
      to_bound(i, sign > 0);
      return true;
    } else {
      state_[k] = State::kFree;
      if (std::abs(w[k]) > kTrust * full * d || ++changes_ > kChanges) {  // updates have degraded the factors
        factor();
        evaluate();
        return settle();
      }
      ldl_.append();
      version_ = 0;
      w[k] = 0;
      return true;
    }
  }
}

int Pivoting::count(State state) const { return static_cast<int>(std::count(state_.begin(), state_.end(), state)); }

}  // namespace cotwin::contact_world
