#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/exponential.h"
#include "components/drive_train/rosenbrock.h"
#include "components/drive_train/step_account.h"

namespace cotwin::drive_train {

/// Integrates a communication step in sub-steps of one of two methods, with control of their error, and finds the events.
///
/// kAuto takes the exponential method for a sub-step if its Taylor series are short, or if oscillation is faster than all decay,
/// or if the Rosenbrock method would reach max_substeps; otherwise the Rosenbrock method, which is L-stable. The choice depends
/// only on the state, so it is the same after a snapshot. kExponential leaves to the Rosenbrock method only sub-steps whose work
/// would have no practical bound, and those that max_substeps forces with a large error.
class Integrator {
 public:
  enum class Method : std::uint8_t { kAuto, kExponential, kRosenbrock };
  /// Transmission::kRigid has no oscillation of gears: the method is kRosenbrock for every `method`.
  Integrator(Equations& equations, Method method);

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
  bool chooses_exponential(double rest, bool must) const;
  double attempt(double t, double& h, const double* x, const Tolerances& tolerances, bool watch);
  std::pair<std::size_t, double> first_event(const std::vector<double>& low, const std::vector<double>& high) const;
  double locate(double t, double length, const double* x, const Tolerances& tolerances, int& attempts, std::size_t& event,
                bool& happens);
  void add_losses(double t, double length, const double* x, StepAccount& account) const;
  void begin(double t, double* x);

  Equations& equations_;
  Method method_;
  Rosenbrock rosenbrock_;
  Exponential exponential_;
  bool exponential_now_ = false;  // the method of the last attempt
  Point a_, b_;
  Point* p0_ = &a_;  // at the sub-step's beginning
  Point* p1_ = &b_;  // at its end
  bool valid_ = false;
  std::vector<double> x1_, events_, events_low_, events_high_;
};

}  // namespace cotwin::drive_train
