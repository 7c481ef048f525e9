#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "models/optimisation/evaluation/evaluation.h"

namespace cotwin::optimisation {

/// low < y_i < high of variable i, or of the cost term i − (number of variables).
struct BarrierBox {
  std::size_t index = 0;
  double low = 0, high = 0;
};

/// Local minimum of Σ weight · cost by an interior-point method: Newton's method on
///   f(y) − μ Σ_i ln(slack_i(y)),      μ → 0,
/// with the slacks of all bounds at samples of the motion. Derivatives are differences of eight motions evaluated together; the
/// slacks are linearised (Gauss–Newton), the costs have their Hessian.
class Barrier {
 public:
  /// Sets one lane to the motion with the variables y.
  using Decode = std::function<void(const Eigen::VectorXd& y, std::size_t lane, Motions& motions)>;
  /// `margins`: share of each bound that is kept free at the samples, of joint j and bound r (0 position, of its range; 1 speed, 2
  /// acceleration, 3 jerk, 4 torque) at [5 j + r]. Those of positions vanish towards the ends of the motion, which may be at a bound.
  Barrier(const Evaluator& evaluator, Evaluator::Scratch& scratch, std::vector<BarrierBox> boxes, std::size_t variables,
          const std::vector<double>& margins, Decode decode);
  /// Asked between Newton's steps with evaluations(); minimise() ends with the best point so far when it returns false.
  void set_going(std::function<bool(std::uint64_t)> going) { going_ = std::move(going); }

  /// From y = 0. If a bound is violated there, the bounds are first widened as far as necessary and then narrowed from one
  /// analytic centre to the next; returns the last centre if they are not met.
  Eigen::VectorXd minimise();
  std::uint64_t evaluations() const { return evaluations_; }

 private:
  using VectorXd = Eigen::VectorXd;
  using MatrixXd = Eigen::MatrixXd;
  /// Bounded values of one lane, and the cost.
  struct Sample {
    VectorXd values;
    double cost = 0;
  };
  bool going() const { return !going_ || going_(evaluations_); }
  bool enter(VectorXd& y, Sample& here);
  bool newton(VectorXd& y, Sample& here, double mu, bool with_cost);
  double excess(const Sample& sample) const;  // relative to the scales; negative inside
  void evaluate(const std::vector<VectorXd>& points, std::vector<Sample>& samples, bool with_values = true);
  double barrier(const Sample& sample) const;  // −Σ ln(slack); +∞ outside
  void derivatives(const VectorXd& y);
  void cost_hessian(const VectorXd& y);

  const Evaluator& evaluator_;
  Evaluator::Scratch& scratch_;
  std::vector<BarrierBox> boxes_;
  std::size_t variables_;
  Decode decode_;
  std::function<bool(std::uint64_t)> going_;
  Motions motions_;
  Values values_;
  struct Block {  // grid rows of one joint and derivative
    std::size_t joint;
    int derivative;
  };
  std::vector<Block> blocks_;
  std::array<numerics::BatchMatrix, 4> grid_;
  std::array<std::size_t, 4> points_{};
  std::vector<std::size_t> torque_joints_;
  VectorXd low_, high_, scale_;
  std::vector<double> rows_;
  MatrixXd J_, H_;
  VectorXd gradient_, hessian_at_;
  std::uint64_t evaluations_ = 0;
};

}  // namespace cotwin::optimisation
