#pragma once
#include <cstddef>
#include <utility>
#include <vector>

#include "components/drive_train/equations.h"

namespace cotwin::drive_train {

struct Tolerances {
  double relative = 0;
  double angle = 0;  // rad, of q and θ
  double speed = 0;  // rad/s, of q̇ and θ̇
};

/// Energy flows of a step and the quality of its solution.
struct StepAccount {
  double work_m = 0;      // ∫ τ_m θ̇ dt, J
  double work_e = 0;      // ∫ τ_e q̇ dt, J; link outside: −∫ τ_J q̇ dt
  double dissipated = 0;  // in friction, damping and stops, J
  double error = 0;       // largest local error estimate over tolerance; ≤ 1 unless substeps were forced
  int substeps = 0;       // accepted
  int forced = 0;         // of them, accepted beyond the tolerance because max_substeps was reached
  int events = 0;
};

/// Adds the work of the course's torques over [t, t + h], in which x goes from x0 to x1: exact for held torques, of fourth
/// order for ramped ones.
void add_torque_work(const Equations& equations, double t, double h, const double* x0, const double* x1, StepAccount& account);

/// The linearly implicit method for hard real time: two stages of order 2 and a third stage for the error, after Shampine and
/// Reichelt (SIAM J. Sci. Comput. 18(1), 1997, "modified Rosenbrock formula"). It is L-stable and of order 2 for any W, so W
/// needs only the stiff terms:
///   W k1 = F0 + γ ∂f/∂t                      W = I − γ J, γ = d h, d = 1/(2 + √2)
///   W (k2 − k1) = F1 − k1                    F1 = f(t + h/2, x + h/2 k1)
///   x1 = x + h k2                            F2 = f(t + h, x1), F0 of the next sub-step
///   W k3 = F2 − (6 + √2)(k2 − F1) − 2 (k1 − F0) + γ ∂f/∂t,   error = h/6 (k1 − 2 k2 + k3)
/// Departures: (i) rows of speeds are multiplied by M and B, so that no stage needs M⁻¹; (ii) in F1 and F2, M(x₀) q̈ is M(x₀) a
/// + (force − inverse dynamics of a) with a = k1 or k2; the error (M − M(x₀)) (q̈ − a) = O(h²) keeps order 2, and this costs one
/// recursion instead of a mass matrix and its factors; (iii) the error of z, which follows θ̇ and has no tolerance, is not
/// counted; (iv) z is clamped to the range of exact solutions, so that sub-steps beyond the tolerance stay bounded.
class Rosenbrock {
 public:
  explicit Rosenbrock(Equations& equations);

  /// Integrates x from t = 0 to h in at most `max_substeps` attempts (and two more for an event), whatever the error.
  /// `proposal` is the length of the first sub-step, s; it is updated for the next call. Returns false if the state is not
  /// finite; then x is undefined.
  [[nodiscard]] bool step(double h, double* x, double& proposal, const Tolerances& tolerances, int max_substeps,
                          StepAccount& account);

  /// Discards the forces of the last step's end: x or the parameters were changed.
  void forget() { valid_ = false; }
  /// Forces at the end of the last step.
  const Point& end() const { return *p0_; }

 private:
  double attempt(double t, double h, const double* x, const Tolerances& tolerances);
  std::pair<std::size_t, double> first_event(const std::vector<double>& low, const std::vector<double>& high) const;
  double locate(double t, double length, const double* x, const Tolerances& tolerances, int& attempts, std::size_t& event,
                bool& happens);
  void add_losses(double length, const double* x, StepAccount& account) const;
  void begin(double t, double* x);

  Equations& equations_;
  Point a_, b_, stage_;
  Point* p0_ = &a_;  // at the sub-step's beginning
  Point* p1_ = &b_;  // at its end
  bool valid_ = false;
  std::vector<double> x1_, rhs_, k1_, k2_, k3_, f0_, f1_, tau_, events_, events_low_, events_high_;
};

}  // namespace cotwin::drive_train
