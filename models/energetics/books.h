#pragma once
#include <span>
#include <vector>

#include "models/energetics/dc_link.h"
#include "models/energetics/drives.h"

namespace cotwin::energetics {

/// Where the energy of a run or motion went, J, for n joints. By construction, up to rounding,
///   supplied − returned = Σ (mechanical_positive + mechanical_negative + copper + converter + iron) + idle + stored + chopped
///   drawn = supplied − returned + supply_losses + controller
struct EnergyBooks {
  EnergyBooks() = default;
  explicit EnergyBooks(std::size_t joints);
  void clear();

  double time = 0;                              // s
  std::vector<double> mechanical_positive;      // per joint: ∫ max(τ_m θ̇, 0) dt
  std::vector<double> mechanical_negative;      // per joint: ∫ min(τ_m θ̇, 0) dt
  std::vector<double> copper, converter, iron;  // per joint
  double idle = 0;                              // stand-by, brakes
  double regenerable = 0;                       // ∫ max(−Σ P_el, 0) dt: what all drives together gave back
  LinkFlows link;
  double stored = 0;  // rise of ½ C V² since the start
  double supply_losses = 0, controller = 0;
  double drawn = 0;       // from the mains, less what was fed back
  double peak_power = 0;  // W, largest power of the DC link at a node, with the stand-by

  double mechanical() const;  // net work of the motors
  /// drawn − all entries: rounding.
  double residual() const;
};

/// Adds up books over intervals. One per thread; allocates in the constructor only.
class Accountant {
 public:
  /// `efficiency` and the other values of `supply` are checked by check().
  Accountant(std::size_t joints, Bus bus);

  DriveLosses losses;
  Current current = Current::kDc;
  DcLink link;
  Supply supply;

  /// Throws Error `place.name: …` for values out of range.
  void check(const std::string& place) const;
  /// Computes factors from `losses` and `current`; to be called after they were changed.
  void adopt();

  /// Values at the nodes of an interval, node by node (kNodes · n): τ_m, N.m; θ̇, rad/s; i, A. add() reads them.
  std::vector<double> tau, speed, i;
  /// Sets i = τ_m/k_t.
  void currents_from_torques();

  /// Adds an interval of h seconds. `energised`: motors without current (servo off) have no losses of current. `idle`: W. `extra`:
  /// J, mechanical work that the nodes do not show. V: voltage of the link, updated.
  void add(double h, bool energised, double idle, double extra, double controller, double& V, EnergyBooks& books) const;

  /// m R τ²/k_t² + V_0 |τ|/k_t of all joints at rest, W.
  double holding_power(std::span<const double> tau_m) const;

 private:
  std::size_t n_;
  Bus bus_;
  std::vector<double> r_;  // m R
};

}  // namespace cotwin::energetics
