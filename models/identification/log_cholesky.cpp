#include "models/identification/log_cholesky.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin::identification {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using Eigen::Vector4d;

/// The upper triangular U with P = U Uᵀ; false where P is not positive definite.
bool factorise(const Matrix4d& P, Matrix4d& U) {
  U.setZero();
  for (int c = 3; c >= 0; --c) {
    double d = P(c, c);
    for (int k = c + 1; k < 4; ++k) d -= U(c, k) * U(c, k);
    if (!(d > 0)) return false;
    U(c, c) = std::sqrt(d);
    for (int r = 0; r < c; ++r) {
      double x = P(r, c);
      for (int k = c + 1; k < 4; ++k) x -= U(r, k) * U(c, k);
      U(r, c) = x / U(c, c);
    }
  }
  return U.allFinite();
}

/// Where s12, s23, s13, t1, t2, t3 stand in U.
constexpr int kPlace[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

Matrix4d relative_factor(const Vector10d& xi) {
  Matrix4d V = Matrix4d::Zero();
  for (int i = 0; i < 3; ++i) V(i, i) = std::exp(xi[1 + i]);
  V(3, 3) = 1;
  for (int k = 0; k < 6; ++k) V(kPlace[k][0], kPlace[k][1]) = xi[4 + k];
  return std::exp(xi[0]) * V;
}

}  // namespace

Matrix4d pseudo_inertia(const Vector10d& pi) {
  Matrix3d I;
  I << pi[4], pi[5], pi[6], pi[5], pi[7], pi[8], pi[6], pi[8], pi[9];
  Matrix4d P;
  P.topLeftCorner<3, 3>() = 0.5 * I.trace() * Matrix3d::Identity() - I;
  P.topRightCorner<3, 1>() = pi.segment<3>(1);
  P.bottomLeftCorner<1, 3>() = pi.segment<3>(1).transpose();
  P(3, 3) = pi[0];
  return P;
}

Vector10d from_pseudo_inertia(const Matrix4d& P) {
  Vector10d pi;
  pi << P(3, 3), P(0, 3), P(1, 3), P(2, 3), P(1, 1) + P(2, 2), -P(0, 1), -P(0, 2), P(0, 0) + P(2, 2), -P(1, 2),
      P(0, 0) + P(1, 1);
  return pi;
}

LogCholesky::LogCholesky(const Inertia& prior) {
  if (!factorise(pseudo_inertia(prior.parameters()), U_0_))
    throw Error("inertia",
                "of mass " + text::to_text(prior.mass) +
                    " kg has a pseudo-inertia that is not positive definite, expected a body that fills some volume");
}

Vector10d LogCholesky::parameters(const Vector10d& xi) const {
  const Matrix4d U = U_0_ * relative_factor(xi);
  return from_pseudo_inertia(U * U.transpose());
}

Vector10d LogCholesky::parameters(const Vector10d& xi, Matrix10d& jacobian) const {
  const Matrix4d U = U_0_ * relative_factor(xi);
  const Matrix4d P = U * U.transpose();
  const double scale = std::exp(xi[0]);
  // An element (r, c) of U(ξ) that grows by w: dP = w (u_0r u_cᵀ + u_c u_0rᵀ), with the columns u_0 of U_0 and u of U_0 U.
  const auto by_element = [&](int r, int c, double w) -> Vector10d {
    const Matrix4d half = w * U_0_.col(r) * U.col(c).transpose();
    return from_pseudo_inertia(half + half.transpose());
  };
  jacobian.col(0) = from_pseudo_inertia(2 * P);
  for (int i = 0; i < 3; ++i) jacobian.col(1 + i) = by_element(i, i, scale * std::exp(xi[1 + i]));
  for (int k = 0; k < 6; ++k) jacobian.col(4 + k) = by_element(kPlace[k][0], kPlace[k][1], scale);
  return from_pseudo_inertia(P);
}

Vector10d divergence_roots(const Vector10d& xi, Matrix10d& jacobian) {
  // P_0⁻¹ P is similar to V Vᵀ with V = U(ξ): D = Σ v_ij² − 4 − 2 Σ ln v_ii. A diagonal element v = e^x gives e^(2x) − 1 − 2x.
  Vector10d roots;
  jacobian.setZero();
  const double scale = std::exp(xi[0]);
  for (int i = 0; i < 4; ++i) {
    const double x = i == 0 ? xi[0] : xi[0] + xi[i];
    // about 0, where the difference cancels, its series
    const double square = std::abs(x) < 1e-2 ? 2 * x * x * (1 + x * (2.0 / 3 + x * (1.0 / 3 + x * (2.0 / 15 + x * 2.0 / 45))))
                                             : std::expm1(2 * x) - 2 * x;
    roots[i] = std::copysign(std::sqrt(square), x);
    const double slope = roots[i] == 0 ? std::sqrt(2.0) : std::expm1(2 * x) / roots[i];
    jacobian(i, 0) = slope;
    if (i > 0) jacobian(i, i) = slope;
  }
  for (int k = 4; k < 10; ++k) {
    roots[k] = scale * xi[k];
    jacobian(k, 0) = roots[k];
    jacobian(k, k) = scale;
  }
  return roots;
}

Inertia consistent(const Inertia& inertia, double least_mass, double least_radius) {
  Inertia body = inertia;
  body.mass = std::max(inertia.mass, least_mass);
  if (inertia.mass > 0 && inertia.mass < least_mass) body.I_CC *= least_mass / inertia.mass;
  const Matrix3d spread = 0.5 * body.I_CC.trace() * Matrix3d::Identity() - body.I_CC;  // ∫ r rᵀ dm about C
  const numerics::SymmetricEigen<3> axes = numerics::symmetric_eigen<3>(spread);
  const double least = body.mass * least_radius * least_radius;
  if (axes.values.minCoeff() >= least) return body;
  const Matrix3d wider = axes.vectors * axes.values.cwiseMax(least).asDiagonal() * axes.vectors.transpose();
  body.I_CC = wider.trace() * Matrix3d::Identity() - wider;
  return body;
}

}  // namespace cotwin::identification
