#pragma once
#include "components/compliance/cartesian/frame/parameters.h"
#include "components/compliance/cartesian/frame/rotation.h"
#include "components/compliance/cartesian/frame/translation.h"

namespace cotwin::compliance {

/// How the deviation x of (3a) or (3b) moves: ẋ = A v, with the elastic moment Aᵀ S x and xᵀ Aᵀ S x = kappa xᵀ S x. Translation: v = ẋ, A = 1;
/// rotation: v = Δω, x = 2 ε with A = E, kappa = η, or x = φ with A = J_l⁻¹, kappa = 1 (rotation.h).
struct DeviationRate {
  Eigen::Matrix3d A = Eigen::Matrix3d::Identity();
  double kappa = 1;
};
DeviationRate rate_of(Potential potential, const Eigen::Quaterniond& Q);

/// Condition for stiffness and damping that vary while M is constant (Kronander and Billard, IEEE T-RO 32(5), 2016): there is an α
/// > 0 with
///   α M ≤ D      Ṡ + α Ḋ ≤ 2 α S
/// Then V = ½ (ẋ + αx)ᵀ M (ẋ + αx) + ½ xᵀ (S + αD − α²M) x has V̇ ≤ fᵀ (ẋ + αx): without force the motion never grows, whatever
/// the state. Unlike the tank this needs no measured state, but it is no passivity from f to ẋ, and a stiffness that is 0 cannot
/// rise.
///
/// In rotation V̇ = −Δωᵀ (D − α sym(AᵀM)) Δω + α xᵀ D (A − 1) Δω − ½ xᵀ (2 α kappa S − Ṡ − αḊ) x + mᵀ (Δω + αx), so the present turn
/// counts: the quadratic form has to be positive semidefinite. Nothing changes near turns of 180°, where kappa = 0.
///
/// For values that are constant over steps of h seconds and jump in between, half of the rate is allowed, ΔS + αΔD ≤ α kappa h S, and α
/// h² S ≤ D − αM: xᵀSx at the end of a step is at most twice its mean plus h ∫ ẋᵀSẋ. Returns whether a change from `now` to `next`
/// satisfies it.
bool changes_slowly(const Impedance& now, const Impedance& next, double alpha, double h, const DeviationRate& rate = {});

/// Moves stiffness and damping of translation and rotation towards those wanted, of whose difference `remaining` is left, as far as
/// changes_slowly() allows it; M_T and M_R stay. Returns false if it did not.
bool change_slowly(CartesianParameters& now, const CartesianParameters& wanted, double remaining, double alpha, double h,
                   const DeviationRate& turn);

/// Copies what change_slowly() moves or keeps.
void keep_slow(const CartesianParameters& from, CartesianParameters& to);

/// The matrices of translation and rotation with the damping of zeta_T and zeta_R.
Impedance translation_of(const CartesianParameters& p);
Impedance rotation_of(const CartesianParameters& p);

}  // namespace cotwin::compliance
