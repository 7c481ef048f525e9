#pragma once
#include <span>
#include <string_view>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/unit/unit.h"

/// The Jacobian of the drive train's outputs by its inputs and its state (q, q̇, θ, θ̇, z) at one instant, analytically.
namespace cotwin::drive_train {

/// Flexible, link inside, with τ_id(q, q̇, q̈) = M q̈ + C q̇ + g:
///   ∂q̈/∂τ_e = M⁻¹   ∂q̈/∂θ = M⁻¹ κ   ∂q̈/∂θ̇ = M⁻¹ D                              (2a), (2c)
///   ∂q̈/∂q = −M⁻¹ (∂τ_id/∂q + κ + k_l)   ∂q̈/∂q̇ = −M⁻¹ (∂τ_id/∂q̇ + D + d_l)
///   ∂τ_J/∂θ = −∂τ_J/∂q = κ   ∂τ_J/∂θ̇ = −∂τ_J/∂q̇ = D                                (2c)
///   ∂τ_f/∂θ̇, ∂τ_f/∂z   of the friction model; of a motor that Coulomb friction holds τ_f = τ_m − τ_J   (2b)
/// Rigid: q̈ follows τ_m, τ_f and τ_e alike, and τ_J = τ_m − τ_f − B q̈. Friction that grows with the load adds its ∂/∂q to
/// ∂τ_id/∂q. At a kink (friction at rest, the edge of a backlash or a stop) the slope is one-sided, as in the solver.
class Partials {
 public:
  explicit Partials(const Equations& equations);
  std::span<const Partial> list() const { return list_; }
  /// Set this to (q | q̇ | θ | θ̇ | z) before evaluate().
  std::vector<double>& state() { return x_; }
  /// Allocates nothing.
  void evaluate(Equations& equations, std::span<const double> tau_m, std::span<const double> tau_e,
                std::span<const double> tau_load, std::span<double> values);

 private:
  /// A block of `values`; add() does nothing for a block that is not listed.
  struct Block {
    double* values = nullptr;
    std::size_t columns = 0;  // 0: elementwise
    void add(std::size_t row, std::size_t column, double value) const {
      if (values != nullptr) values[columns > 0 ? row * columns + column : row] += value;
    }
  };
  void accelerations(Equations& equations, std::span<const double> tau_m, std::span<const double> tau_e,
                     std::span<const double> tau_load, std::span<double> values);
  void torques(const Equations& equations, std::span<double> values) const;
  void energies(Equations& equations, std::span<double> values);
  void powers(const Equations& equations, std::span<const double> tau_m, std::span<const double> tau_e,
              std::span<double> values) const;
  Block block(std::span<double> values, std::string_view unknown, std::string_view known) const;
  std::size_t size_of(const Partial& partial) const;

  std::size_t n_;
  std::vector<Partial> list_;
  std::vector<double> x_;
  Point point_;
  std::vector<double> factors_, by_q_, by_dq_, ddq_, column_;  // n x n by columns; n
  std::vector<double> load_by_q_, scratch_;                    // n x n
};

}  // namespace cotwin::drive_train
