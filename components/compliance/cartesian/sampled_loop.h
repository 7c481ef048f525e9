#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace cotwin::compliance {

/// A robot of n joints under impedance_control.h with a torque that is held for a step, linearised at rest in one position without
/// gravity:
///   M q̈ = K (θ − q) + D (θ̇ − q̇)      B θ̈ + K (θ − q) + D (θ̇ − q̇) = τ
///   τ = r u − (r − 1) K (θ − q)       u = −H (1 − relief K⁻¹ H)⁻¹ θ − R θ̇
/// of measurements that are `delay` old at the beginning of the step. Joints with K = 0 are rigid: θ = q.
struct SampledRobot {
  explicit SampledRobot(int n);

  Eigen::MatrixXd M;                 // of the links (n x n)
  Eigen::VectorXd B, K, D, shaping;  // of motors and gears; r (n)
  Eigen::MatrixXd H, R;              // stiffness and damping of the frame and of the null space in the joints (n x n)
  double relief = 1;                 // as in ImpedanceControl
  double step = 1e-3, delay = 0;     // s
};

/// Whether that loop is stable, by powers of its matrix from one step to the next. The motion between two samples is exact. An evaluation
/// allocates nothing.
class SampledLoop {
 public:
  /// Delays of more steps are examined with longer steps, which changes little: the torque is held for a small part of the delay.
  static constexpr int kMostSteps = 8;

  explicit SampledLoop(int n);

  /// ln of the factor by which a motion grows in a step, to about 1 %; below kNone: it does not. An eigenvalue of 1 (frames without stiffness) counts
  /// as 0.
  double growth(const SampledRobot& robot);
  static constexpr double kNone = 1e-6;

 private:
  using Matrix = Eigen::MatrixXd;
  void set_plant(const SampledRobot& robot);
  void set_control(const SampledRobot& robot);
  void discretise(double t, Matrix& Phi, Matrix& Gamma);

  int n_;
  int p_ = 0;               // coordinates: links, motors of elastic joints
  std::vector<int> motor_;  // coordinate that τ_i drives
  double rate_ = 1;         // 1/s; velocities are in its units
  // Scratch, of the largest size.
  Matrix A_, Phi_, Phi_2_, term_, scratch_;   // 4n x 4n
  Matrix input_, Gamma_, Gamma_2_, product_;  // 4n x n
  Matrix C_;                                  // n x 4n
  Matrix k_, twist_;                          // n x n
  Matrix step_, square_;                      // with the torques of earlier steps
  Eigen::LLT<Matrix> llt_;
};

}  // namespace cotwin::compliance
