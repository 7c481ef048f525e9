#include "models/mechanics/inertia.h"

#include <limits>

#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Published inertias are often rounded to three significant digits. Each principal moment then has an error of up to 0.5e-3 of
/// the largest, and a lamina, for which the triangle inequality is an equality, can violate it by this.
constexpr double kRounding = 1.5e-3;

/// Copies the upper triangle to the lower one: symmetric to the last bit.
Matrix3d symmetric(const Matrix3d& A) { return A.selfadjointView<Eigen::Upper>(); }

/// p·p U − p pᵀ: the inertia of a unit point mass at p about the origin.
Matrix3d steiner(const Vector3d& p) { return symmetric(p.squaredNorm() * Matrix3d::Identity() - p * p.transpose()); }

std::string listed(const Vector3d& v) {
  return text::to_text(v[0], 4) + ", " + text::to_text(v[1], 4) + ", " + text::to_text(v[2], 4);
}

}  // namespace

Matrix3d Inertia::about_origin() const { return symmetric(I_CC + mass * steiner(p_LC)); }

Eigen::Matrix<double, 10, 1> Inertia::parameters() const {
  const Matrix3d I = about_origin();
  Eigen::Matrix<double, 10, 1> pi;
  pi << mass, mass * p_LC, I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2);
  return pi;
}

Inertia Inertia::from_parameters(const Eigen::Matrix<double, 10, 1>& pi) {
  Inertia body;
  body.mass = pi[0];
  const Vector3d m_c = pi.segment<3>(1);
  if (!m_c.isZero(0)) body.p_LC = m_c / body.mass;
  Matrix3d I_LL;
  I_LL << pi[4], pi[5], pi[6], pi[5], pi[7], pi[8], pi[6], pi[8], pi[9];
  body.I_CC = symmetric(I_LL - body.mass * steiner(body.p_LC));
  return body;
}

Inertia Inertia::seen_from(const Pose& X_AL) const {
  if (X_AL.R == Matrix3d::Identity()) return {mass, X_AL * p_LC, I_CC};  // exact
  return {mass, X_AL * p_LC, symmetric(X_AL.R * I_CC * X_AL.R.transpose())};
}

Inertia operator+(const Inertia& a, const Inertia& b) {
  if (b.is_nothing()) return a;
  if (a.is_nothing()) return b;
  Inertia sum;
  sum.mass = a.mass + b.mass;
  sum.I_CC = a.I_CC + b.I_CC;
  if (a.mass == 0 || b.mass == 0) {
    sum.p_LC = b.mass == 0 ? a.p_LC : b.p_LC;
    return sum;
  }
  // Parallel axes: the reduced mass at the distance of the centres.
  const Vector3d p_AB = b.p_LC - a.p_LC;
  const double share = b.mass / sum.mass;
  sum.p_LC = a.p_LC + share * p_AB;
  sum.I_CC += a.mass * share * steiner(p_AB);
  return sum;
}

std::string Inertia::unphysical(Least least) const {
  if (!std::isfinite(mass) || !p_LC.allFinite() || !I_CC.allFinite()) return "mass, centre of mass or inertia is not finite";
  if (!(mass > 0)) return "mass " + text::to_text(mass) + " kg, expected > 0";
  if (I_CC != I_CC.transpose()) return "the inertia matrix is not symmetric";
  const double scale = I_CC.cwiseAbs().maxCoeff();
  if (scale == 0) return least == Least::kZero ? "" : "no moments of inertia, expected > 0 kg m2";
  const Vector3d J = scale * numerics::symmetric_eigenvalues<3>(I_CC / scale);  // ascending
  const double rounding = 4 * std::numeric_limits<double>::epsilon() * scale;   // of the eigenvalues
  if (least == Least::kZero ? J[0] < -kRounding * scale : J[0] <= rounding) {
    return "principal moments " + listed(J) + " kg m2 are not all > 0";
  }
  if (J[0] + J[1] < (1 - kRounding) * J[2]) return "principal moments " + listed(J) + " kg m2 violate the triangle inequality";
  return "";
}

}  // namespace cotwin
