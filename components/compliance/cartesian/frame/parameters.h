#pragma once
#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "components/compliance/joints/admittance.h"
#include "models/foundation/support/parameter_table.h"

namespace cotwin::compliance {

/// The tunables of Cartesian compliance. A symmetric matrix A is given by its diagonal A (xx, yy, zz) and the values beside it,
/// A_off (xy, xz, yz), which are 0 unless the principal axes are turned.
struct CartesianParameters {
  CartesianParameters();
  using Values = std::vector<double>;
  Values M_T, M_T_off, D_T, D_T_off, S_T, S_T_off, zeta_T;  // translation (3a)
  Values M_R, M_R_off, D_R, D_R_off, K_o, K_o_off, zeta_R;  // rotation (3b)
  Values omega_free;
  Values omega_k, sigma_0, lambda_0, k_nu;  // joints

  friend bool operator==(const CartesianParameters&, const CartesianParameters&) = default;
};

Eigen::Matrix3d symmetric(const CartesianParameters::Values& diagonal, const CartesianParameters::Values& off);

/// In the order of declaration. The tank limits how masses and stiffnesses follow their tunables.
inline constexpr auto kCartesian = [] {
  using P = CartesianParameters;
  using Row = ParameterRow<P>;
  constexpr double least = Row::kPositive, most = Row::kLargest, any = Row::kNoLimit;
  constexpr Mutability tunable = Mutability::kFollowed, by_tank = Mutability::kByUnit;
  return std::to_array<Row>({
      {"M_T", &P::M_T, "kg", "desired mass (3a): xx, yy, zz", 10, least, most, by_tank, 1, false},
      {"M_T_off", &P::M_T_off, "kg", "desired mass beside the diagonal: xy, xz, yz", 0, -any, any, by_tank, 1, false},
      {"D_T", &P::D_T, "N.s/m", "desired damping (3a), beside that of zeta_T: xx, yy, zz", 0, 0, most, tunable, 1, false},
      {"D_T_off", &P::D_T_off, "N.s/m", "desired damping beside the diagonal: xy, xz, yz", 0, -any, any, tunable, 1, false},
      {"S_T", &P::S_T, "N/m", "desired stiffness (3a): xx, yy, zz; 0: freely guided", 1000, 0, most, by_tank, 1, false},
      {"S_T_off", &P::S_T_off, "N/m", "desired stiffness beside the diagonal: xy, xz, yz", 0, -any, any, by_tank, 1, false},
      {"zeta_T", &P::zeta_T, "1", "damping ratio of all modes of translation, added to D_T; 1: aperiodic limit", 1, 0, most,
       tunable, 0, false},
      {"M_R", &P::M_R, "kg.m2", "desired rotational inertia (3b), in the desired frame: xx, yy, zz", 1, least, most, by_tank, 1,
       false},
      {"M_R_off", &P::M_R_off, "kg.m2", "desired rotational inertia beside the diagonal: xy, xz, yz", 0, -any, any, by_tank, 1,
       false},
      {"D_R", &P::D_R, "N.m.s/rad", "desired rotational damping (3b), beside that of zeta_R: xx, yy, zz", 0, 0, most, tunable,
       1, false},
      {"D_R_off", &P::D_R_off, "N.m.s/rad", "desired rotational damping beside the diagonal: xy, xz, yz", 0, -any, any, tunable,
       1, false},
      {"K_o", &P::K_o, "N.m/rad", "desired rotational stiffness (3b), in the desired frame: xx, yy, zz; 0: freely guided", 100,
       0, most, by_tank, 1, false},
      {"K_o_off", &P::K_o_off, "N.m/rad", "desired rotational stiffness beside the diagonal: xy, xz, yz", 0, -any, any, by_tank,
       1, false},
      {"zeta_R", &P::zeta_R, "1", "damping ratio of all modes of rotation, added to D_R; 1: aperiodic limit", 1, 0, most,
       tunable, 0, false},
      {"omega_free", &P::omega_free, "rad/s", "zeta_T and zeta_R damp every mode at least like one of this frequency", 2, 0,
       most, tunable, 0, false},
      {"omega_k", &P::omega_k, "1/s", "rate at which the joints remove a drift of the compliant pose", 100, least, 1e5, tunable,
       0, false},
      {"sigma_0", &P::sigma_0, "m", "the joints are damped where the least singular value of J is below this", 0.03, least,
       most, tunable, 0, false},
      {"lambda_0", &P::lambda_0, "1", "damping of a direction that is lost in a singular pose, in units of sigma_0", 1, 0, most,
       tunable, 0, false},
      {"k_nu", &P::k_nu, "1/s", "damping of the motion in the null space", 4, 0, 1e5, tunable, 0, false},
  });
}();

/// Throws Error `place.S_T: …` that names the first matrix that is not definite, with its least eigenvalue.
void check_definite(const CartesianParameters& p, const std::string& place);

/// Mass and stiffness of translation or of rotation.
struct Stores {
  CartesianParameters::Values CartesianParameters::*M, CartesianParameters::*M_off, CartesianParameters::*S,
      CartesianParameters::*S_off;
};
inline constexpr Stores kTranslation{&CartesianParameters::M_T, &CartesianParameters::M_T_off, &CartesianParameters::S_T,
                                     &CartesianParameters::S_T_off};
inline constexpr Stores kRotation{&CartesianParameters::M_R, &CartesianParameters::M_R_off, &CartesianParameters::K_o,
                                  &CartesianParameters::K_o_off};

/// The energy is ½ dxᵀ M dx + ½ xᵀ S x: x is Δ, or 2 ε or the angle φ of a rotation.
struct StoredAt {
  const Eigen::Vector3d &x, &dx;
};
/// Moves a mass and a stiffness of `now` towards those of `wanted`, of whose difference `remaining` is left, as far as the tank
/// has the energy for it (admittance.h). The matrices stay definite: they move on straight lines. Returns false if the energy
/// was not sufficient.
bool change(CartesianParameters& now, const CartesianParameters& wanted, const Stores& which, double remaining,
            const StoredAt& at, Tank& tank);

}  // namespace cotwin::compliance
