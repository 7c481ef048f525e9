#include "components/compliance/cartesian/frame/parameters.h"

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"

namespace cotwin::compliance {

CartesianParameters::CartesianParameters() { write_start_values(*this, kCartesian, 3); }

Eigen::Matrix3d symmetric(const CartesianParameters::Values& d, const CartesianParameters::Values& off) {
  Eigen::Matrix3d A;
  A << d[0], off[0], off[1], off[0], d[1], off[2], off[1], off[2], d[2];
  return A;
}

void check_definite(const CartesianParameters& p, const std::string& place) {
  struct Matrix {
    const char* name;
    const CartesianParameters::Values &diagonal, &off;
    bool positive;
  };
  const Matrix matrices[] = {{"M_T", p.M_T, p.M_T_off, true},  {"D_T", p.D_T, p.D_T_off, false},
                             {"S_T", p.S_T, p.S_T_off, false}, {"M_R", p.M_R, p.M_R_off, true},
                             {"D_R", p.D_R, p.D_R_off, false}, {"K_o", p.K_o, p.K_o_off, false}};
  for (const Matrix& m : matrices) {
    const Eigen::Matrix3d A = symmetric(m.diagonal, m.off);
    const double least = numerics::symmetric_eigenvalues<3>(A)[0];
    constexpr double kRounding = 1e-12;
    const double bound = kRounding * A.cwiseAbs().maxCoeff();
    if (m.positive ? least > bound : least >= -bound) continue;
    throw Error(place + "." + m.name, std::string("with ") + m.name + "_off has the eigenvalue " + text::to_text(least, 6) +
                                          ", expected a " + (m.positive ? "positive definite" : "positive semidefinite") +
                                          " matrix (all eigenvalues " + (m.positive ? "> 0)" : ">= 0)"));
  }
}

bool change(CartesianParameters& now, const CartesianParameters& wanted, const Stores& which, double remaining,
            const StoredAt& at, Tank& tank) {
  const auto same = [&](CartesianParameters::Values CartesianParameters::*values) { return now.*values == wanted.*values; };
  if (same(which.M) && same(which.M_off) && same(which.S) && same(which.S_off)) return true;
  const auto part = [&](auto diagonal, auto off, const Eigen::Vector3d& v) {
    const Eigen::Matrix3d difference = symmetric(wanted.*diagonal, wanted.*off) - symmetric(now.*diagonal, now.*off);
    return (1 - remaining) * v.dot(difference * v) / 2;
  };
  const double energy_of_M = part(which.M, which.M_off, at.dx), energy_of_S = part(which.S, which.S_off, at.x);
  const double share = pay(energy_of_M, energy_of_S, tank);
  const auto towards = [&](CartesianParameters::Values CartesianParameters::*values, double energy) {
    const double left = energy > 0 && share < 1 ? 1 - share * (1 - remaining) : remaining;
    for (std::size_t i = 0; i < 3; ++i) {
      const double target = (wanted.*values)[i];
      (now.*values)[i] = target + ((now.*values)[i] - target) * left;
    }
  };
  towards(which.M, energy_of_M);
  towards(which.M_off, energy_of_M);
  towards(which.S, energy_of_S);
  towards(which.S_off, energy_of_S);
  return share == 1;
}

}  // namespace cotwin::compliance
