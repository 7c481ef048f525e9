#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <span>
#include <vector>

#include "components/compliance/limits.h"
#include "components/compliance/links.h"
#include "components/compliance/tracking.h"
#include "models/mechanics/pose.h"
#include "models/robot/dynamics.h"

namespace cotwin::compliance {

/// A pose in the base frame, m, with its twist [v; ω], m/s, rad/s.
struct MovingPose {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Quaterniond Q{1, 0, 0, 0};
  Twist V = Twist::Zero();
};

/// The joints where the task is evaluated. `J`: of the rendered directions, rotations times JointMotion::kLength.
struct AtJoints {
  const Eigen::VectorXd &q, &dq;
  const Eigen::MatrixXd &M, &J;
};

struct JointMotionGains {
  double omega_k = 100;   // 1/s; rate at which the drift of the pose decays
  double sigma_0 = 0.03;  // m; below this least singular value the task is damped
  double lambda_0 = 0.1;  // 1; damping at σ_min = 0
  double k_nu = 4;        // 1/s; damping of the null space
};

/// The motion of the joints that moves frame E with a given motion, at the acceleration level (IV-A3):
///   q̈_c = J̄ (ẍ_c − J̇ q̇_c + K_v (ẋ_c − J q̇_c) + K_p e) + N ξ       J̄ = M⁻¹ Jᵀ Λ,   N = I − J̄ J,   K_v = 2 omega_k, K_p = omega_k²
/// at (q_c, q̇_c), so that measured noise does not enter J. e: the error of the pose; its rotation is 2 η ε. Near singular
/// poses Λ = (J M⁻¹ Jᵀ + λ² μ I)⁻¹ with μ the mean eigenvalue of J M⁻¹ Jᵀ and λ² = lambda_0² (1 − (σ_min/sigma_0)²) for σ_min <
/// sigma_0: the joints stay slow, and the pose is reached only in part.
class JointMotion {
 public:
  /// m; makes rotations comparable with translations.
  static constexpr double kLength = 0.3;

  /// `directions`: the rows of the twist [v; ω] in the base's axes that are rendered.
  JointMotion(const robot::RobotModel& robot, std::vector<int> directions);

  void set_frame(const robot::FrameOnBody& E) { E_ = E; }
  const robot::FrameOnBody& frame() const { return E_; }
  /// At rest in `pose` or, if V ≠ 0, with the speed of least kinetic energy.
  void start(Links& links, const Eigen::VectorXd& at, const Twist& V, const JointMotionGains& gains);
  /// A step of h seconds, in which E moves from `before` to `after`, where its acceleration is `end_acceleration`.
  void advance(Links& links, const MovingPose& before, const MovingPose& after, const Twist& end_acceleration,
               std::span<const Limits> limits, const JointMotionGains& gains, double h);
  /// J̄ᵀ τ at q_c: the wrench at E that has the effect of `tau` on the task; 0 in directions that are not rendered.
  Wrench wrench_of(Links& links, const Eigen::VectorXd& tau, const JointMotionGains& gains);

  // States.
  Eigen::VectorXd q, dq;  // rad, rad/s; n
  // Results of advance().
  Eigen::VectorXd ddq;            // rad/s²; at the end of the step
  double sigma_min = 0;           // m
  double lambda = 0;              // 1
  std::vector<std::int32_t> met;  // Limit that acted, by joint

 private:
  void evaluate(Links& links, const Eigen::VectorXd& at, const JointMotionGains& gains);
  void null_space(const AtJoints& at, const JointMotionGains& gains, Eigen::VectorXd& xi);
  void part(Links& links, const MovingPose& before, const Twist& acceleration, std::span<const Limits> limits,
            const JointMotionGains& gains, double h);
  void bound(std::span<const Limits> limits, double h);

  std::vector<int> directions_;
  robot::FrameOnBody E_;
  // Scratch.
  Pose X_;  // of E at the last evaluation
  Eigen::Matrix<double, 6, Eigen::Dynamic> J6_;
  Eigen::MatrixXd J_, M_, Y_;  // Y = L⁻¹ Jᵀ with M = L Lᵀ
  Eigen::MatrixXd A_, G_;      // J M⁻¹ Jᵀ damped; J Jᵀ
  Eigen::LLT<Eigen::MatrixXd> M_llt_, A_llt_;
  Eigen::VectorXd q_mid_, xi_, tau_;  // n
  Eigen::VectorXd r_;                 // of the rendered directions
};

}  // namespace cotwin::compliance
