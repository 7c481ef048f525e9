#include "components/compliance/cartesian/frame/translation.h"
#include "models/numerics/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

namespace cotwin::compliance {

using Eigen::Matrix3d;

Matrix3d modal_damping(const Matrix3d& M, const Matrix3d& S, double zeta, double omega_free) {
  const Matrix3d L = M.llt().matrixL();
  Matrix3d W = L.triangularView<Eigen::Lower>().solve(S);
  W = L.triangularView<Eigen::Lower>().solve(Matrix3d(W.transpose()));
  const numerics::SymmetricEigen<3> modes = numerics::symmetric_eigen<3>((W + W.transpose()) / 2);
  const auto omega = modes.values.cwiseMax(0).cwiseSqrt().cwiseMax(omega_free);
  const Matrix3d LV = L * modes.vectors;
  return LV * (2 * zeta * omega).asDiagonal() * LV.transpose();
}

// The series of second_order.cpp with matrices, in coordinates y = Lᵀ x with M = L Lᵀ, where P = L⁻¹ D L⁻ᵀ and W = L⁻¹ S L⁻ᵀ are
// symmetric: impulse response G(t) = Σ a_k tᵏ/k!, a_0 = 0, a_1 = I, a_(k+2) = −P a_(k+1) − W a_k.
void Propagator::prepare(const Impedance& impedance, double h) {
  if (h == h_ && impedance == impedance_) return;
  h_ = h;
  impedance_ = impedance;
  const Matrix3d L = impedance.M.llt().matrixL();
  const auto lower = L.triangularView<Eigen::Lower>();
  const auto congruent = [&](const Matrix3d& A) -> Matrix3d {
    const Matrix3d half = lower.solve(A);
    const Matrix3d whole = lower.solve(Matrix3d(half.transpose()));
    return (whole + whole.transpose()) / 2;
  };
  const Matrix3d P = congruent(impedance.D), W = congruent(impedance.S);
  const double p = P.cwiseAbs().rowwise().sum().maxCoeff(), w2 = W.cwiseAbs().rowwise().sum().maxCoeff();
  int doublings = 0;
  double t = h;
  while (p * t + w2 * t * t > 0.25) {
    t *= 0.5;
    ++doublings;
  }
  constexpr int kTerms = 12;
  Matrix3d a = Matrix3d::Zero(), a_next = Matrix3d::Identity();
  Matrix3d impulse = Matrix3d::Zero(), step = Matrix3d::Zero(), ramp = Matrix3d::Zero();
  double power = 1;
  for (int k = 0; k < kTerms; ++k) {
    impulse += a * power;
    step += a * (power * t / (k + 1));
    ramp += a * (power * t * t / ((k + 1) * (k + 2)));
    const Matrix3d a_after = -(P * a_next) - W * a;
    a = a_next;
    a_next = a_after;
    power *= t / (k + 1);
  }
  xx_ = -step * W;
  xv_ = impulse;
  vx_ = -impulse * W;
  vv_ = -impulse * P - step * W;
  x0_ = step;
  v0_ = impulse;
  x1_ = ramp;
  v1_ = step;
  for (; doublings > 0; --doublings, t *= 2) {
    const Matrix3d xx = 2 * xx_ + xx_ * xx_ + xv_ * vx_, xv = 2 * xv_ + xx_ * xv_ + xv_ * vv_;
    const Matrix3d vx = 2 * vx_ + vx_ * xx_ + vv_ * vx_, vv = 2 * vv_ + vx_ * xv_ + vv_ * vv_;
    const Matrix3d x0 = 2 * x0_ + xx_ * x0_ + xv_ * v0_, v0 = 2 * v0_ + vx_ * x0_ + vv_ * v0_;
    const Matrix3d x1 = 2 * x1_ + xx_ * x1_ + xv_ * v1_ + t * x0_, v1 = 2 * v1_ + vx_ * x1_ + vv_ * v1_ + t * v0_;
    xx_ = xx;
    xv_ = xv;
    vx_ = vx;
    vv_ = vv;
    x0_ = x0;
    v0_ = v0;
    x1_ = x1;
    v1_ = v1;
  }
  // Back to x: L⁻ᵀ (…) Lᵀ for states, L⁻ᵀ (…) L⁻¹ for the input.
  const auto left = [&](const Matrix3d& A) -> Matrix3d { return lower.transpose().solve(A); };
  const Matrix3d inverse = lower.solve(Matrix3d(Matrix3d::Identity()));
  for (Matrix3d* E : {&xx_, &xv_, &vx_, &vv_}) *E = (left(*E) * L.transpose()).eval();
  for (Matrix3d* Gamma : {&x0_, &v0_, &x1_, &v1_}) *Gamma = (left(*Gamma) * inverse).eval();
}

void Propagator::advance(Eigen::Vector3d& x, Eigen::Vector3d& dx, const Eigen::Vector3d& u0, const Eigen::Vector3d& u1) const {
  const Eigen::Vector3d change = xx_ * x + xv_ * dx + x0_ * u0 + x1_ * u1;
  dx += vx_ * x + vv_ * dx + v0_ * u0 + v1_ * u1;
  x += change;
}

}  // namespace cotwin::compliance
