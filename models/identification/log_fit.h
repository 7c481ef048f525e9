#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "models/identification/diagnosis.h"

/// Least squares on the samples of a Diagnosis, under hypotheses.
namespace cotwin::identification {

inline constexpr double kLeastError = 1e-4;  // of a joint's torque: smaller errors are rounding

/// Of one hypothesis.
struct Fit {
  Eigen::VectorXd rms;         // n
  double score = 0;            // Σ ln rms over the joints that count
  Eigen::VectorXd friction;    // n: mean power of friction over the RMS speed,
  Eigen::VectorXd deviation;   // and its standard deviation under independent errors
  Eigen::VectorXd torque_rms;  // n
  Eigen::VectorXd beta;        // base parameters
};

class LogFit {
 public:
  /// `times`: number of times at which torques are kept. All arguments must outlive this.
  LogFit(const robot::RobotModel& robot, const ModelOptions& options, const Diagnosis::Kept& kept, std::size_t times);

  const std::vector<int>& joints() const { return all_; }      // that count: neither passive nor at rest
  const Eigen::VectorXd& moments() const { return moments_; }  // of the URDF: base parameters, 0 but for those of gravity

  /// Weighted least squares of all joints' torques over at most `most` samples: each joint is weighted by its own error. `rich`:
  /// with columns of friction that real joints may have, which changes with direction, load, time and the way since the motion
  /// turned. Damage that they explain, too, is none.
  Fit fit(const Hypothesis& h, std::size_t most, bool rich = false);
  /// n: RMS errors of feasible least squares about the URDF on all samples. Where the motion excites little, a wrong hypothesis
  /// may fit better, too, with masses that cannot exist.
  Eigen::VectorXd errors_of_possible(const Hypothesis& h) const;

 private:
  struct Columns {
    Hypothesis of;
    std::size_t every = 0;              // samples
    std::vector<Eigen::MatrixXd> C, A;  // per joint: of its torque, base parameters first; their products
  };

  bool counts(std::size_t joint) const {
    return !robot_.joints[joint].passive && (options_.still.empty() || options_.still[joint] == 0);
  }
  std::size_t samples() const { return kept_.q.size() / n_; }
  std::size_t every(std::size_t most) const { return (samples() + most - 1) / most; }
  std::size_t count(std::size_t most) const { return (samples() + every(most) - 1) / every(most); }
  const Columns& columns_of(const Hypothesis& h, std::size_t most, bool rich);
  std::vector<Eigen::VectorXd> torques_of(const Hypothesis& h, std::size_t most) const;

  const robot::RobotModel& robot_;
  const ModelOptions& options_;
  const Diagnosis::Kept& kept_;
  std::size_t n_, times_;
  std::vector<int> base_, all_;  // columns of the regressor; joints that count
  Eigen::VectorXd moments_;
  std::array<Columns, 4> columns_;  // of few samples and of all; the same, rich
};

}  // namespace cotwin::identification
