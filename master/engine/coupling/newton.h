#pragma once
#include <Eigen/Core>
#include <Eigen/LU>

/// Newton's method with Broyden's update, for the interfaces between units.
namespace cotwin::master {

/// Outputs y(x) of units whose inputs depend linearly on the values x that are assumed for the same outputs.
class CoupledOutputs {
 public:
  virtual ~CoupledOutputs() = default;
  /// Computes y(x). Returns false if a unit cannot make its step.
  virtual bool evaluate(const Eigen::VectorXd& x, Eigen::VectorXd& y) = 0;
  /// Computes ∂y/∂x at `x`, where y(x) = `y`. May evaluate at other points, and may change how y depends on x: then `y` is
  /// the new y(x). Returns false as evaluate().
  virtual bool linearise(const Eigen::VectorXd& x, Eigen::VectorXd& y, Eigen::MatrixXd& jacobian) = 0;
};

/// Solves y(x) = x. ∂y/∂x is corrected along each step (Broyden, Math. Comp. 19, 1965, the "good" update, each unknown divided
/// by its scale) and kept for the next solve(). Where an iteration reduces the residual by less than kSlow, it is computed
/// again. After the constructor nothing is allocated for up to about 100 unknowns (Eigen's blocks of larger matrices are).
class Newton {
 public:
  static constexpr double kSlow = 0.3;
  static constexpr double kFast = 1e-4;
  enum class Outcome {
    kConverged,
    kStopped,   // evaluate() or linearise() returned false
    kDiverged,  // not converged after all iterations, or a value is not finite
    kSingular   // I − ∂y/∂x has no inverse: no solution, or infinitely many
  };
  struct Limits {
    int iterations = 10;
    double tolerance = 1e-12;  // of |y − x| / scale; at least the rounding error of y is accepted
    double noise = 0;          // accepted where an iteration improves the residual by less than 1/kFast
    double weak = 1e-8;        // accepted where no iteration improves the residual
    double stagnant = 0;  // accepted after all iterations if one with a new ∂y/∂x has left more than kSlow of the residual
  };

  explicit Newton(Eigen::Index n);

  /// `x`: first guess and result. On kConverged the last evaluation was at `x`, and y() is its result. `scale`: > 0, magnitude
  /// of each unknown.
  Outcome solve(CoupledOutputs& outputs, Eigen::VectorXd& x, const Eigen::VectorXd& scale, const Limits& limits);

  const Eigen::VectorXd& y() const { return y_; }
  /// Of the last solve().
  int iterations() const { return iterations_; }
  int linearisations() const { return linearisations_; }
  double worst() const { return worst_; }  // largest |y − x| / scale
  /// Index of the unknown with the largest residual of the last solve().
  Eigen::Index worst_unknown() const { return worst_unknown_; }
  /// Whether ∂y/∂x changed along a step by more than rounding: y is not linear. Of the last solve().
  bool nonlinear() const { return nonlinear_; }

  /// ∂y/∂x, to save and restore it. `known`: otherwise solve() computes it when it is needed.
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }
  Eigen::MatrixXd& jacobian() { return jacobian_; }
  bool known() const { return known_; }
  void set_known(bool known) { known_ = known; }

 private:
  void find_residual(const Eigen::VectorXd& x, const Eigen::VectorXd& scale);
  bool is_small(const Eigen::VectorXd& x, const Eigen::VectorXd& scale, double tolerance) const;
  bool find_step();
  bool decompose();
  void balance();
  void correct_jacobian(const Eigen::VectorXd& scale);

  Eigen::MatrixXd jacobian_;
  bool known_ = false;
  Eigen::VectorXd y_, last_y_, last_x_, dx_, residual_, change_, balance_;
  Eigen::MatrixXd matrix_;
  Eigen::PartialPivLU<Eigen::MatrixXd> lu_;
  double worst_ = 0;
  Eigen::Index worst_unknown_ = 0;
  int iterations_ = 0, linearisations_ = 0;
  bool nonlinear_ = false;
};

}  // namespace cotwin::master
