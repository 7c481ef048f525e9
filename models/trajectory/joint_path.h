#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/inverse_kinematics.h"
#include "models/trajectory/pose_path.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// The motion of the joints along a path of poses. Postures by InverseKinematics::track are computed once, on a grid that is
/// refined until quintics between them leave less than 1e-9 m and rad. at() corrects the interpolated posture by Newton steps,
/// and q̇ and q̈ from the table by the least change with which
///   J_e q̇ = ∂e/∂t        e(t): error of the pose, e = 0; ∂e/∂t: its rate with the robot at rest
///   J_e q̈ = b            b: second derivative of e with q̇ and without q̈, in which J̇ q̇ is contained
/// in the directions of the task. So the pose is met to rounding at any time, without memory of earlier times; along the
/// self-motion q̇ and q̈ are the derivatives of the table.
class JointPath {
 public:
  /// `X_WB`: pose of the base. The motion begins in the posture that track() finds from `start`. Throws Error with the time if
  /// the pose is out of reach or the posture would jump.
  JointPath(const PosePath& poses, const Pose& X_WB, robot::InverseKinematics& kinematics, const Eigen::VectorXd& reference,
            const Eigen::VectorXd& start);

  const Path& table() const { return table_; }
  /// Joint positions and derivatives with respect to t; n elements each. Allocates nothing.
  void at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq);

  /// Smallest singular value of the Jacobian of the task, rotations times 0.3 m; linear between the postures of the table.
  double sigma_min(double t) const;
  /// The least of them in the table, and its time.
  const Peak& least_sigma() const { return least_sigma_; }
  /// Largest error of the pose of the table without correction, in the middle between knots, m or rad.
  double table_error() const { return table_error_; }

 private:
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1>;
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;
  struct Grid {
    std::vector<double> t, q, dq, ddq, sigma;
    double error = 0;
  };

  PoseMotion in_base(double t) const;
  robot::PoseTarget target(double t) const;
  Grid solve_interval(double a, double b, const Eigen::VectorXd& start);
  Grid sample(double a, double b, std::size_t parts, const Eigen::VectorXd& start);
  void advance(double from, double to, Eigen::VectorXd& q, int depth);
  void prepare_correction();
  double smallest_singular_value() const;
  void correct(const Rows& b, Eigen::Ref<Eigen::VectorXd> x) const;
  void correct_derivatives(const PoseMotion& pose, Eigen::Ref<Eigen::VectorXd> q, Eigen::Ref<Eigen::VectorXd> dq,
                           Eigen::Ref<Eigen::VectorXd> ddq);

  PosePath poses_;
  Eigen::Matrix3d R_BW_;
  Eigen::Vector3d p_BW_;
  Eigen::Vector4d Q_BW_;
  robot::InverseKinematics* kinematics_;
  Eigen::VectorXd reference_;
  Path table_;
  Eigen::MatrixXd J_;  // rows × n
  Rows e_;
  Square inverse_;             // of J Jᵀ + λ²
  std::vector<double> sigma_;  // by knot of the table
  double table_error_ = 0;
  long postures_ = 0;  // that were searched since the beginning of an interval
  Peak least_sigma_;
};

}  // namespace cotwin::trajectory
