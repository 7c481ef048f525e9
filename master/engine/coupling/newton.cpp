#include "master/engine/coupling/newton.h"

#include <algorithm>
#include <cmath>

namespace cotwin::master {

namespace {

constexpr double kRounding = 1e-15;
constexpr double kSingularPivot = 1e-10;  // pivot of I − ∂y/∂x / largest entry of its row, at least 1
constexpr double kLinear = 1e-7;          // error of a step's linear prediction, relative: below it y is taken for linear
constexpr double kNoise = 1e-9;           // of the same, absolute, in units of scale: may be rounding in the units
constexpr double kTinyNoise = 1e-13;      // likewise: too small for a correction of ∂y/∂x
constexpr int kShortenings = 4;           // of a step that increases the residual
constexpr int kBalancings = 10;           // sweeps over the matrix

}  // namespace

Newton::Newton(Eigen::Index n)
    : jacobian_(Eigen::MatrixXd::Zero(n, n)),
      y_(n),
      last_y_(n),
      last_x_(n),
      dx_(n),
      residual_(n),
      change_(n),
      balance_(n),
      matrix_(n, n),
      lu_(n) {}

void Newton::find_residual(const Eigen::VectorXd& x, const Eigen::VectorXd& scale) {
  residual_ = y_ - x;
  worst_ = 0;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    const double r = std::abs(residual_[i]) / scale[i];
    if (r <= worst_) continue;
    worst_ = r;
    worst_unknown_ = i;
    if (!std::isfinite(r)) return;
  }
}

bool Newton::is_small(const Eigen::VectorXd& x, const Eigen::VectorXd& scale, double tolerance) const {
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    double error = tolerance * scale[i];
    if (known_) error = std::max(error, kRounding * jacobian_.row(i).cwiseAbs().dot(x.cwiseAbs()));
    if (!(std::abs(residual_[i]) <= error)) return false;
  }
  return true;
}

/// dx = (I − ∂y/∂x)⁻¹ (y − x). Returns false if the matrix has no inverse. A small pivot may also be due to unknowns of very
/// different magnitudes: the matrix is then balanced, and decomposed again.
bool Newton::find_step() {
  matrix_ = -jacobian_;
  matrix_.diagonal().array() += 1;
  if (!matrix_.allFinite()) return false;
  if (decompose()) {
    dx_ = lu_.solve(residual_);
    return dx_.allFinite();
  }
  balance();
  if (!decompose()) return false;
  residual_ = residual_.cwiseQuotient(balance_);
  dx_ = lu_.solve(residual_);
  dx_.array() *= balance_.array();
  residual_ = residual_.cwiseProduct(balance_);
  return dx_.allFinite();
}

/// Returns false if a pivot is close to 0.
bool Newton::decompose() {
  lu_.compute(matrix_);
  const auto& row_of = lu_.permutationP().indices();
  for (Eigen::Index i = 0; i < matrix_.rows(); ++i) {
    const double pivot = std::abs(lu_.matrixLU()(row_of[i], row_of[i]));
    if (!(pivot > kSingularPivot * std::max(1.0, matrix_.row(i).cwiseAbs().maxCoeff()))) return false;
  }
  return true;
}

/// matrix ← D⁻¹ · matrix · D with powers of two in D, so that the entries of row i and column i beside the diagonal have similar
/// magnitudes (Parlett and Reinsch, Numer. Math. 13, 1969).
void Newton::balance() {
  balance_.setOnes();
  bool changed = true;
  for (int round = 0; round < kBalancings && changed; ++round) {
    changed = false;
    for (Eigen::Index i = 0; i < matrix_.rows(); ++i) {
      const double own = std::abs(matrix_(i, i));
      const double row = matrix_.row(i).cwiseAbs().sum() - own, column = matrix_.col(i).cwiseAbs().sum() - own;
      if (!(row > 0) && !(column > 0)) continue;
      const double wanted = !(column > 0) ? row : !(row > 0) ? 1 / column : std::sqrt(row / column);
      const double factor = std::exp2(std::round(std::log2(wanted)));
      if (factor == 1) continue;
      matrix_.row(i) /= factor;
      matrix_.col(i) *= factor;
      balance_[i] *= factor;
      changed = true;
    }
  }
}

/// Makes ∂y/∂x · dx = Δy for the last step, with the smallest change of the scaled matrix. An error of the prediction that may
/// be rounding changes nothing.
void Newton::correct_jacobian(const Eigen::VectorXd& scale) {
  change_ = y_ - last_y_;
  const double size = change_.cwiseQuotient(scale).norm();
  change_.noalias() -= jacobian_ * dx_;
  const double error = change_.cwiseQuotient(scale).norm();
  if (error > kLinear * size + kNoise) nonlinear_ = true;
  if (error <= std::max(kLinear * size, kTinyNoise)) return;
  dx_ = dx_.cwiseQuotient(scale);
  const double square = dx_.squaredNorm();
  if (square == 0) return;
  dx_ = dx_.cwiseQuotient(scale) / square;
  jacobian_.noalias() += change_ * dx_.transpose();
}

Newton::Outcome Newton::solve(CoupledOutputs& outputs, Eigen::VectorXd& x, const Eigen::VectorXd& scale, const Limits& limits) {
  iterations_ = linearisations_ = 0;
  nonlinear_ = false;
  if (!outputs.evaluate(x, y_)) return Outcome::kStopped;
  find_residual(x, scale);
  bool computed_here = false;  // ∂y/∂x belongs to x
  bool singular = false;
  bool evaluated = true;  // the last evaluation was at x
  double accepted = limits.weak;
  while (residual_.allFinite()) {
    if (is_small(x, scale, limits.tolerance)) return Outcome::kConverged;
    if (iterations_ == limits.iterations) break;
    ++iterations_;
    if (!known_ || (singular && !computed_here)) {
      known_ = false;
      if (!outputs.linearise(x, y_, jacobian_)) return Outcome::kStopped;
      ++linearisations_;
      known_ = computed_here = true;
      find_residual(x, scale);
    }
    singular = !find_step();
    if (singular) {
      if (computed_here) return Outcome::kSingular;
      continue;
    }
    const double before = worst_;
    evaluated = true;
    last_x_ = x;
    last_y_ = y_;
    bool made = false;
    for (int shortening = 0; shortening <= kShortenings && !made; ++shortening, dx_ /= 4) {
      x = last_x_ + dx_;
      if (!outputs.evaluate(x, y_)) return Outcome::kStopped;
      find_residual(x, scale);
      made = residual_.allFinite() && (worst_ < before || is_small(x, scale, limits.tolerance) || !computed_here);
      if (made) break;
    }
    const bool slow = !made || worst_ > kSlow * before;
    const bool wrong = !made || (worst_ > before && !is_small(x, scale, limits.tolerance));
    if (made && worst_ <= limits.noise && worst_ > kFast * before) return Outcome::kConverged;
    if (slow && computed_here) accepted = std::max(limits.weak, limits.stagnant);
    if (wrong && !computed_here) {  // an old matrix that points the wrong way: compute it where it began
      x = last_x_;
      y_ = last_y_;
      find_residual(x, scale);
      known_ = evaluated = false;
      continue;
    }
    if (!made) {
      x = last_x_;  // no shorter step helps: the residual is as small as it gets, or there is no solution in this direction
      if (!outputs.evaluate(x, y_)) return Outcome::kStopped;
      find_residual(x, scale);
      break;
    }
    dx_ = x - last_x_;
    correct_jacobian(scale);
    if (slow && !computed_here) known_ = false;
    computed_here = false;
  }
  if (residual_.allFinite() && worst_ <= accepted && (evaluated || outputs.evaluate(x, y_))) return Outcome::kConverged;
  known_ = false;
  return Outcome::kDiverged;
}

}  // namespace cotwin::master
