#include "components/compliance/cartesian/frame/variable_stiffness.h"
#include "models/numerics/dense.h"

#include <algorithm>
#include <array>
#include <span>

namespace cotwin::compliance {
namespace {

using Eigen::Matrix3d;
using Parameters = CartesianParameters;

template <int N>
bool at_most(const Eigen::Matrix<double, N, N>& A, const Eigen::Matrix<double, N, N>& B) {  // as quadratic forms
  constexpr double kRounding = 1e-12;
  const double least = numerics::symmetric_eigenvalues<N>(B - A)[0];
  return least >= -kRounding * (A.cwiseAbs().maxCoeff() + B.cwiseAbs().maxCoeff());
}
bool at_most(const Matrix3d& A, const Matrix3d& B) { return at_most<3>(A, B); }

using Values = Parameters::Values Parameters::*;
constexpr std::array<Values, 5> kOfTranslation{&Parameters::S_T, &Parameters::S_T_off, &Parameters::D_T, &Parameters::D_T_off,
                                               &Parameters::zeta_T};
constexpr std::array<Values, 5> kOfRotation{&Parameters::K_o, &Parameters::K_o_off, &Parameters::D_R, &Parameters::D_R_off,
                                            &Parameters::zeta_R};
constexpr std::array<Values, 1> kOfBoth{&Parameters::omega_free};
constexpr std::array<Values, 4> kHeldStiffness{&Parameters::M_T, &Parameters::M_T_off, &Parameters::M_R, &Parameters::M_R_off};

/// Moves `values`, which belong together, as far as translation and rotation allow it.
bool change_slowly(std::span<const Values> values, Parameters& now, const Parameters& wanted, double part, double alpha,
                   double h, const DeviationRate& turn) {
  if (std::ranges::all_of(values, [&](Values v) { return now.*v == wanted.*v; })) return true;
  const Impedance T = translation_of(now), R = rotation_of(now);
  constexpr std::size_t kMost = 5;
  std::array<std::array<double, 3>, kMost> start{};
  for (std::size_t k = 0; k < values.size(); ++k) std::ranges::copy(now.*values[k], start[k].begin());
  constexpr int kHalvings = 8;
  for (int halving = 0; halving <= kHalvings; ++halving, part /= 2) {
    if (halving == kHalvings) part = 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
      Parameters::Values& to = now.*values[k];
      for (std::size_t i = 0; i < to.size(); ++i) to[i] = start[k][i] + part * ((wanted.*values[k])[i] - start[k][i]);
    }
    const auto unchanged = [](const Impedance& a, const Impedance& b) { return a.S == b.S && a.D == b.D; };
    const Impedance T_next = translation_of(now), R_next = rotation_of(now);
    if (part == 0 || ((unchanged(T, T_next) || changes_slowly(T, T_next, alpha, h)) &&
                      (unchanged(R, R_next) || changes_slowly(R, R_next, alpha, h, turn)))) {
      return halving == 0;
    }
  }
  return false;
}

}  // namespace

DeviationRate rate_of(Potential potential, const Eigen::Quaterniond& Q) {
  if (potential == Potential::kLog) return {inverse_left_jacobian(axis_angle(Q)), 1};
  const double sign = Q.w() < 0 ? -1 : 1;
  return {sign * (Q.w() * Matrix3d::Identity() - cross_matrix(Q.vec())), sign * Q.w()};
}

Impedance translation_of(const CartesianParameters& p) {
  Impedance z{symmetric(p.M_T, p.M_T_off), symmetric(p.D_T, p.D_T_off), symmetric(p.S_T, p.S_T_off)};
  z.D += modal_damping(z.M, z.S, p.zeta_T[0], p.omega_free[0]);
  return z;
}

Impedance rotation_of(const CartesianParameters& p) {
  Impedance z{symmetric(p.M_R, p.M_R_off), symmetric(p.D_R, p.D_R_off), symmetric(p.K_o, p.K_o_off)};
  z.D += modal_damping(z.M, z.S, p.zeta_R[0], p.omega_free[0]);
  return z;
}

bool changes_slowly(const Impedance& now, const Impedance& next, double alpha, double h, const DeviationRate& rate) {
  if (!at_most(next.S - now.S + alpha * (next.D - now.D), alpha * rate.kappa * h * now.S)) return false;
  if (!at_most(alpha * h * h * now.S, now.D - alpha * now.M)) return false;
  if (rate.A == Matrix3d::Identity()) return at_most(alpha * next.M, next.D);
  const Matrix3d AM = rate.A.transpose() * next.M;
  Eigen::Matrix<double, 6, 6> form;
  form.topLeftCorner<3, 3>() = next.D - alpha / 2 * (AM + AM.transpose());
  form.bottomLeftCorner<3, 3>() = -alpha / 2 * next.D * (rate.A - Matrix3d::Identity());
  form.topRightCorner<3, 3>() = form.bottomLeftCorner<3, 3>().transpose();
  form.bottomRightCorner<3, 3>() = alpha / 2 * rate.kappa * next.S;
  return at_most<6>(Eigen::Matrix<double, 6, 6>::Zero(), form);
}

bool change_slowly(CartesianParameters& now, const CartesianParameters& wanted, double remaining, double alpha, double h,
                   const DeviationRate& turn) {
  const bool held = std::ranges::all_of(kHeldStiffness, [&](Values v) { return now.*v == wanted.*v; });
  const double part = 1 - remaining;
  const bool T = change_slowly(kOfTranslation, now, wanted, part, alpha, h, turn);
  const bool R = change_slowly(kOfRotation, now, wanted, part, alpha, h, turn);
  return change_slowly(kOfBoth, now, wanted, part, alpha, h, turn) && T && R && held;
}

void keep_slow(const CartesianParameters& from, CartesianParameters& to) {
  for (const Values v : kOfTranslation) to.*v = from.*v;
  for (const Values v : kOfRotation) to.*v = from.*v;
  for (const Values v : kOfBoth) to.*v = from.*v;
  for (const Values v : kHeldStiffness) to.*v = from.*v;
}

}  // namespace cotwin::compliance
