#include "components/io/link/robot_kinematics.h"
#include "models/numerics/dense.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cotwin::io {

namespace {

Eigen::Map<const Eigen::VectorXd> vector_of(std::span<const double> values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

}  // namespace

Wrench moved(const Wrench& F, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  Wrench there = F;
  there.tail<3>() += (from - to).cross(F.head<3>());
  return there;
}

RobotKinematics::RobotKinematics(const robot::RobotModel& robot)
    : mechanism_(robot),
      data_(mechanism_),
      tool_(robot::on_body(robot.end_effector())),
      J_(Eigen::MatrixXd::Zero(6, robot.n())),
      M_(Eigen::MatrixXd::Zero(robot.n(), robot.n())),
      g_(Eigen::VectorXd::Zero(robot.n())),
      q_(g_),
      step_(g_) {}

Pose RobotKinematics::pose(std::span<const double> q) {
  q_ = vector_of(q);
  return robot::forward_kinematics(mechanism_, data_, q_, tool_);
}

const Eigen::MatrixXd& RobotKinematics::jacobian(std::span<const double> q) {
  q_ = vector_of(q);
  robot::jacobian(mechanism_, data_, q_, tool_, J_);
  return J_;
}

Twist RobotKinematics::twist(std::span<const double> dq) const { return J_.lazyProduct(vector_of(dq)); }

const Eigen::MatrixXd& RobotKinematics::mass_matrix(std::span<const double> q) {
  q_ = vector_of(q);
  robot::mass_matrix(mechanism_, data_, q_, M_);
  return M_;
}

const Eigen::VectorXd& RobotKinematics::gravity(std::span<const double> q) {
  q_ = vector_of(q);
  robot::gravity(mechanism_, data_, q_, g_);
  return g_;
}

void RobotKinematics::torques_of(const Wrench& F, std::span<const double> q, std::span<double> tau) {
  jacobian(q);
  for (int i = 0; i < n(); ++i) tau[static_cast<std::size_t>(i)] = J_.col(i).dot(F);
}

Wrench RobotKinematics::wrench_of(std::span<const double> tau, std::span<const double> q) {
  constexpr double kSmall = 0.02;  // σ_0
  jacobian(q);
  using Six = Eigen::Matrix<double, 6, 6>;
  const Six JJ = J_.lazyProduct(J_.transpose());
  const Wrench generalised = J_.lazyProduct(vector_of(tau));
  const numerics::SymmetricEigen<6> squares = numerics::symmetric_eigen<6>(JJ);
  Wrench F = squares.vectors.transpose() * generalised;
  for (Eigen::Index k = 0; k < 6; ++k) F[k] /= std::max(squares.values[k], kSmall * kSmall);
  return squares.vectors * F;
}

bool RobotKinematics::reach(const Pose& X, std::optional<double> third, std::span<double> q) {
  constexpr double kTolerance = 1e-9, kLongest = 0.5;  // m, rad
  constexpr int kSteps = 40;
  if (third && n() < 3) return false;
  const Eigen::Matrix3d R = Eigen::Quaterniond(X.R).normalized().toRotationMatrix();  // of single floats
  q_ = vector_of(q);
  for (int k = 0; k < kSteps; ++k) {
    const Pose at = robot::jacobian(mechanism_, data_, q_, tool_, J_);
    const Eigen::AngleAxisd turn(R * at.R.transpose());
    Eigen::Matrix<double, 7, 1> e;
    e << X.p - at.p, turn.angle() * turn.axis(), third ? *third - q_[2] : 0.0;
    if (e.cwiseAbs().maxCoeff() <= kTolerance) {
      std::copy_n(q_.data(), q.size(), q.begin());
      return true;
    }
    Eigen::Matrix<double, 7, 7> A = Eigen::Matrix<double, 7, 7>::Identity();
    A.topLeftCorner<6, 6>() = J_.lazyProduct(J_.transpose());
    if (third) A.col(6).head<6>() = A.row(6).head<6>() = J_.col(2);
    A.diagonal().array() += 1e-3 * e.squaredNorm() + 1e-15;
    const Eigen::Matrix<double, 7, 1> y = numerics::solve_ldlt<7>(A, e);
    step_ = J_.transpose().lazyProduct(y.head<6>());
    if (third) step_[2] += y[6];
    const double longest = step_.cwiseAbs().maxCoeff();
    if (!std::isfinite(longest)) return false;
    q_ += longest > kLongest ? kLongest / longest * step_ : step_;
  }
  return false;
}

}  // namespace cotwin::io
