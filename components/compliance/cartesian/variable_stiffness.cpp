#include "components/compliance/cartesian/variable_stiffness.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>

namespace cotwin::compliance {
namespace {

using Eigen::Matrix3d;

/// A ≤ B as quadratic forms.
bool at_most(const Matrix3d& A, const Matrix3d& B) {
  constexpr double kRounding = 1e-12;
  const double least = Eigen::SelfAdjointEigenSolver<Matrix3d>(B - A, Eigen::EigenvaluesOnly).eigenvalues()[0];
  return least >= -kRounding * (A.cwiseAbs().maxCoeff() + B.cwiseAbs().maxCoeff());
}

using Values = CartesianParameters::Values CartesianParameters::*;
constexpr std::array<Values, 6> kVaried{&CartesianParameters::S_T,    &CartesianParameters::S_T_off,
                                        &CartesianParameters::D_T,    &CartesianParameters::D_T_off,
                                        &CartesianParameters::zeta_T, &CartesianParameters::omega_free};
constexpr std::array<Values, 2> kHeld{&CartesianParameters::M_T, &CartesianParameters::M_T_off};

}  // namespace

Impedance translation_of(const CartesianParameters& p) {
  Impedance z{symmetric(p.M_T, p.M_T_off), symmetric(p.D_T, p.D_T_off), symmetric(p.S_T, p.S_T_off)};
  z.D += modal_damping(z.M, z.S, p.zeta_T[0], p.omega_free[0]);
  return z;
}

bool changes_slowly(const Impedance& now, const Impedance& next, double alpha, double h) {
  return at_most(next.S - now.S + alpha * (next.D - now.D), alpha * h * now.S) && at_most(alpha * next.M, next.D) &&
         at_most(alpha * h * h * now.S, now.D - alpha * now.M);
}

bool change_slowly(CartesianParameters& now, const CartesianParameters& wanted, double remaining, double alpha, double h) {
  bool same = true, held = true;
  for (const Values v : kVaried) same = same && now.*v == wanted.*v;
  for (const Values v : kHeld) held = held && now.*v == wanted.*v;
  if (same) return held;
  const Impedance before = translation_of(now);
  std::array<std::array<double, 3>, kVaried.size()> start{};
  for (std::size_t k = 0; k < kVaried.size(); ++k)
    std::copy((now.*kVaried[k]).begin(), (now.*kVaried[k]).end(), start[k].begin());
  constexpr int kHalvings = 8;
  double share = 1 - remaining;
  for (int halving = 0; halving <= kHalvings; ++halving, share /= 2) {
    if (halving == kHalvings) share = 0;
    for (std::size_t k = 0; k < kVaried.size(); ++k) {
      CartesianParameters::Values& values = now.*kVaried[k];
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = start[k][i] + share * ((wanted.*kVaried[k])[i] - start[k][i]);
    }
    if (share == 0 || changes_slowly(before, translation_of(now), alpha, h)) return held && halving == 0;
  }
  return false;
}

void keep_translation(const CartesianParameters& from, CartesianParameters& to) {
  for (const Values v : kVaried) to.*v = from.*v;
  for (const Values v : kHeld) to.*v = from.*v;
}

}  // namespace cotwin::compliance
