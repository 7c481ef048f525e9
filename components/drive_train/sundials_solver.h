#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/rosenbrock.h"

namespace cotwin::drive_train {

/// CVODE's BDF or ARKODE's DIRK of order 3 with our Jacobian and its structured solution (SUNLINEARSOLVER_MATRIX_EMBEDDED),
/// adaptive in step and order. History is kept from one communication step to the next where the course is continuous, and
/// begun afresh where it jumps.
///
/// That history lies in SUNDIALS' memory. What a snapshot needs of it is the Log: the state at the last beginning and the
/// communication steps since, from which replay() brings the memory back bit for bit. The log is bounded: after kLogLength
/// steps the history begins afresh.
class SundialsSolver {
 public:
  enum class Method : std::uint8_t { kCvode, kArkode };
  static constexpr std::size_t kLogLength = 32;

  /// Plain data, declared as state by the unit.
  struct Log {
    explicit Log(std::size_t n);
    std::int32_t count = 0;  // communication steps since the beginning; 0: the next one begins afresh
    std::vector<double> x;   // at the beginning
    Modes modes;
    std::vector<double> steps;  // kLogLength times (h | course)
  };

  SundialsSolver(Equations& equations, Method method);
  ~SundialsSolver();
  SundialsSolver(const SundialsSolver&) = delete;
  SundialsSolver& operator=(const SundialsSolver&) = delete;

  /// Tolerances, and whether there are events to look for, of the equations' parameters as adopted.
  void configure(const Tolerances& tolerances);
  Log& log() { return log_; }

  /// From x at t = 0 to x at h under the equations' course. Returns false if the solver gave up; then x is undefined.
  [[nodiscard]] bool step(double h, double* x, StepAccount& account);
  /// The log was written by a snapshot: makes the memory agree with it. The equations' modes and course are those of the
  /// snapshot afterwards.
  void replay();
  /// Forces at the end of the last step.
  const Point& end() const { return end_; }

 private:
  struct Memory;  // what SUNDIALS owns
  void warm_up();
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
