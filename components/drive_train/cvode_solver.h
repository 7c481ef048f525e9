#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/step_account.h"

namespace cotwin::drive_train {

/// SUNDIALS' CVODE, a BDF with the analytic Jacobian and its structured solution (SUNLINEARSOLVER_MATRIX_EMBEDDED), adaptive in
/// step and order. The history of the integration continues over communication
/// steps while the course is continuous; the integration restarts where the course jumps.
///
/// The history is in SUNDIALS' memory, which a snapshot cannot contain. The Log has the state at the last restart and the
/// communication steps since; replay() repeats these steps and gives the same bits. The integration restarts after kLogLength
/// steps, so the log is bounded.
class CvodeSolver {
 public:
  static constexpr std::size_t kLogLength = 32;

  /// Plain data, declared as state by the unit.
  struct Log {
    explicit Log(std::size_t n);
    std::int32_t count = 0;  // communication steps since the restart; 0: the next step restarts
    std::vector<double> x;   // at the restart
    Modes modes;
    std::vector<double> steps;  // kLogLength times (h | course)
  };

  explicit CvodeSolver(Equations& equations);
  ~CvodeSolver();
  CvodeSolver(const CvodeSolver&) = delete;
  CvodeSolver& operator=(const CvodeSolver&) = delete;

  /// Sets the tolerances and the event functions, for the adopted parameters of the equations.
  void configure(const Tolerances& tolerances);
  Log& log() { return log_; }

  /// Integrates x from t = 0 to h under the equations' course. Returns false if the solver failed; then x is undefined.
  [[nodiscard]] bool step(double h, double* x, StepAccount& account);
  /// Rebuilds SUNDIALS' memory from the log after a snapshot was restored. Sets the modes and the course of the equations to
  /// those of the snapshot.
  void replay();
  /// Forces at the end of the last step.
  const Point& end() const { return end_; }

 private:
  struct Memory;  // the objects of SUNDIALS
  bool continues() const;
  void restart(const double* x);
  bool advance(double h, double* x, StepAccount& account);

  Equations& equations_;
  Log log_;
  Point end_, begin_;
  std::vector<double> x_before_, x_replayed_, events_;
  std::unique_ptr<Memory> memory_;
};

}  // namespace cotwin::drive_train
