#pragma once
#include "components/compliance/cartesian/parameters.h"
#include "components/compliance/cartesian/translation.h"

namespace cotwin::compliance {

/// Condition for stiffness and damping that vary while M is constant (Kronander and Billard, IEEE T-RO 32(5), 2016): there is an α
/// > 0 with
///   α M ≤ D      Ṡ + α Ḋ ≤ 2 α S
/// Then V = ½ (ẋ + αx)ᵀ M (ẋ + αx) + ½ xᵀ (S + αD − α²M) x has V̇ ≤ fᵀ (ẋ + αx): without force the motion never grows, whatever
/// the state. Unlike the tank this needs no measured state, but it is no passivity from f to ẋ, and a stiffness that is 0 cannot
/// rise.
///
/// For values that are constant over steps of h seconds and jump in between, half of the rate is allowed, ΔS + αΔD ≤ α h S, and α
/// h² S ≤ D − αM: xᵀSx at the end of a step is at most twice its mean plus h ∫ ẋᵀSẋ. Returns whether a change from `now` to `next`
/// satisfies it.
bool changes_slowly(const Impedance& now, const Impedance& next, double alpha, double h);

/// Moves the tunables of translation towards those wanted, of whose difference `remaining` is left, as far as changes_slowly()
/// allows it; M_T stays. Returns false if it did not.
bool change_slowly(CartesianParameters& now, const CartesianParameters& wanted, double remaining, double alpha, double h);

/// Copies the tunables of translation.
void keep_translation(const CartesianParameters& from, CartesianParameters& to);

/// The matrices of translation with the damping of zeta_T.
Impedance translation_of(const CartesianParameters& p);

}  // namespace cotwin::compliance
