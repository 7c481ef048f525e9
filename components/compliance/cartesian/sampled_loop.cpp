#include "components/compliance/cartesian/sampled_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// A ← A⁻¹ B by elimination with pivoting of rows, without allocation.
void solve(MatrixXd& A, MatrixXd& B) {
  const Index n = A.rows();
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < n; ++i) {
      if (std::abs(A(i, k)) > std::abs(A(pivot, k))) pivot = i;
    }
    A.row(k).swap(A.row(pivot));
    B.row(k).swap(B.row(pivot));
    for (Index i = 0; i < n; ++i) {
      if (i == k || A(i, k) == 0) continue;
      const double factor = A(i, k) / A(k, k);
      A.row(i) -= factor * A.row(k);
      B.row(i) -= factor * B.row(k);
    }
  }
  for (Index k = 0; k < n; ++k) B.row(k) /= A(k, k);
}

/// The inertia of a motor, which may be given as 0.
double motor_of(const SampledRobot& robot, Index i) { return std::max(robot.B[i], 1e-6); }

}  // namespace

SampledRobot::SampledRobot(int n)
    : M(MatrixXd::Identity(n, n)),
      B(Eigen::VectorXd::Ones(n)),
      K(Eigen::VectorXd::Zero(n)),
      D(K),
      shaping(B),
      H(MatrixXd::Zero(n, n)),
      R(H) {}

SampledLoop::SampledLoop(int n) : n_(n), motor_(static_cast<std::size_t>(n)), llt_(MatrixXd::Identity(n, n)) {
  for (Matrix* A : {&A_, &Phi_, &Phi_2_, &term_, &scratch_}) A->setZero(4 * n, 4 * n);
  for (Matrix* A : {&input_, &Gamma_, &Gamma_2_, &product_}) A->setZero(4 * n, n);
  for (Matrix* A : {&k_, &twist_}) A->setZero(n, n);
  C_.setZero(n, 4 * n);
  const int most = (4 + kMostSteps + 1) * n;
  step_.setZero(most, most);
  square_.setZero(most, most);
}

/// ẋ = A x + input τ of x = (y, ẏ/rate), y the links and the motors of elastic joints.
void SampledLoop::set_plant(const SampledRobot& r) {
  p_ = n_;
  k_ = r.M;
  for (int i = 0; i < n_; ++i) {
    const bool soft = r.K[i] > 0;
    motor_[static_cast<std::size_t>(i)] = soft ? p_++ : i;
    if (!soft) k_(i, i) += r.B[i];
  }
  llt_.compute(k_);
  twist_.setIdentity();
  llt_.solveInPlace(twist_);  // the inverse inertia of the links and rigid drives
  double fastest = 1 / (r.step * r.step);
  for (int i = 0; i < n_; ++i) {
    if (r.K[i] > 0) fastest = std::max(fastest, r.K[i] * (twist_(i, i) + 1 / motor_of(r, i)));
  }
  rate_ = std::sqrt(fastest);

  A_.setZero();
  input_.setZero();
  A_.block(0, p_, p_, p_).diagonal().setConstant(rate_);
  for (int i = 0; i < n_; ++i) {
    const int motor = motor_[static_cast<std::size_t>(i)];
    if (motor < n_) {
      input_.col(i).segment(p_, n_) = twist_.col(i) / rate_;
      continue;
    }
    input_(p_ + motor, i) = 1 / (rate_ * motor_of(r, i));
    // The gear's torque on motor and links.
    for (const auto& [column, gain] : {std::pair{0, r.K[i] / rate_}, std::pair{p_, r.D[i]}}) {
      A_(p_ + motor, column + motor) -= gain / motor_of(r, i);
      A_(p_ + motor, column + i) += gain / motor_of(r, i);
      A_.col(column + motor).segment(p_, n_) += gain * twist_.col(i);
      A_.col(column + i).segment(p_, n_) -= gain * twist_.col(i);
    }
  }
}

/// τ = −C x.
void SampledLoop::set_control(const SampledRobot& r) {
  // k = H (1 − relief K⁻¹ H)⁻¹ = (1 − relief H K⁻¹)⁻¹ H
  twist_.setIdentity();
  for (int i = 0; i < n_; ++i) {
    if (r.K[i] > 0) twist_.col(i) -= r.relief / r.K[i] * r.H.col(i);
  }
  k_ = r.H;
  solve(twist_, k_);
  C_.setZero();
  for (int i = 0; i < n_; ++i) {
    const bool soft = r.K[i] > 0;
    const double shaping = soft ? r.shaping[i] : 1;
    for (int j = 0; j < n_; ++j) {
      const int motor = motor_[static_cast<std::size_t>(j)];
      C_(i, motor) = shaping * k_(i, j);
      C_(i, p_ + motor) = shaping * r.R(i, j) * rate_;
    }
    if (!soft) continue;
    C_(i, motor_[static_cast<std::size_t>(i)]) += (shaping - 1) * r.K[i];
    C_(i, i) -= (shaping - 1) * r.K[i];
  }
}

/// Φ = e^(A t) and Γ = ∫ e^(A s) ds input, by a series and doublings.
void SampledLoop::discretise(double t, Matrix& Phi, Matrix& Gamma) {
  const int size = 2 * p_;
  const auto square = [&](Matrix& X) { return X.topLeftCorner(size, size); };
  const auto columns = [&](Matrix& X) { return X.topRows(size); };
  const double norm = square(A_).cwiseAbs().rowwise().sum().maxCoeff();
  int doublings = 0;
  for (double part = t; norm * part > 0.5; part /= 2) ++doublings;
  const double part = std::ldexp(t, -doublings);
  // The sum of (A t)ᵏ/(k + 1)! is ∫ e^(A s) ds/t.
  constexpr int kTerms = 14;
  square(Phi).setIdentity();
  square(term_).setIdentity();
  for (int k = 1; k < kTerms; ++k) {
    square(scratch_).noalias() = (part / (k + 1)) * square(A_).lazyProduct(square(term_));
    square(term_) = square(scratch_);
    square(Phi) += square(term_);
  }
  columns(Gamma).noalias() = part * square(Phi).lazyProduct(columns(input_));
  square(scratch_).noalias() = part * square(A_).lazyProduct(square(Phi));
  square(Phi) = square(scratch_);
  square(Phi).diagonal().array() += 1;
  for (; doublings > 0; --doublings) {
    columns(product_).noalias() = square(Phi).lazyProduct(columns(Gamma));
    columns(Gamma) += columns(product_);
    square(scratch_).noalias() = square(Phi).lazyProduct(square(Phi));
    square(Phi) = square(scratch_);
  }
}

double SampledLoop::growth(const SampledRobot& robot) {
  set_plant(robot);
  set_control(robot);
  const double h = std::max(robot.step, robot.delay / kMostSteps);
  const double delay = robot.delay - (h - robot.step) / 2;  // the middle of a held torque is as late
  // The torque of a step begins `whole` steps and the rest of one after its measurement.
  const int whole = static_cast<int>(std::floor(delay / h + 1e-9));
  const double rest = std::max(delay - whole * h, 0.0);
  const bool parts = rest > 1e-9 * h;
  const int size = 2 * p_, all = size + n_ * (whole + (parts ? 1 : 0));
  auto X = step_.topLeftCorner(all, all);
  X.setZero();
  /// Where the torque of a measurement `steps` steps ago acts.
  const auto act = [&](int steps, const auto& Gamma) {
    if (steps == 0) {
      X.topLeftCorner(size, size).noalias() -= Gamma.lazyProduct(C_.leftCols(size));
    } else {
      X.block(0, size + n_ * (steps - 1), size, n_) += Gamma;
    }
  };
  discretise(h - rest, Phi_, Gamma_);
  if (parts) {
    discretise(rest, Phi_2_, Gamma_2_);
    X.topLeftCorner(size, size).noalias() = Phi_.topLeftCorner(size, size).lazyProduct(Phi_2_.topLeftCorner(size, size));
    product_.topRows(size).noalias() = Phi_.topLeftCorner(size, size).lazyProduct(Gamma_2_.topRows(size));
    act(whole + 1, product_.topRows(size));
  } else {
    X.topLeftCorner(size, size) = Phi_.topLeftCorner(size, size);
  }
  act(whole, Gamma_.topRows(size));
  if (all > size) X.block(size, 0, n_, size) = -C_.leftCols(size);
  if (all > size + n_) X.block(size + n_, size, all - size - n_, all - size - n_).setIdentity();

  // ln ‖X^(2ᵏ)‖ rises by 2ᵏ ln λ from k to k + 1, λ the growth.
  constexpr int kDoublings = 21;
  constexpr double kSmall = -40, kLarge = 600;
  auto S = square_.topLeftCorner(all, all);
  double length = std::log(X.norm()), power = 1, rise = 0;
  X /= X.norm();
  for (int k = 0; k < kDoublings && length > kSmall && length < kLarge; ++k) {
    S.noalias() = X.lazyProduct(X);
    const double norm = S.norm(), before = length;
    if (!(norm > 0)) return -1;  // nilpotent
    length = 2 * length + std::log(norm);
    rise = (length - before) / power;
    power *= 2;
    X = S / norm;
  }
  return rise * robot.step / h;
}

}  // namespace cotwin::compliance
