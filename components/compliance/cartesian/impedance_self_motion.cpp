#include "components/compliance/cartesian/impedance_self_motion.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;

}  // namespace

ImpedanceSelfMotion::ImpedanceSelfMotion(const robot::RobotModel& robot, SelfMotion& self_motion)
    : self_motion_(self_motion), tasks_(self_motion.tasks()), cascade_(robot.n(), row_counts(tasks_)) {
  for (VectorXd* v : {&gradient_, &nu_, &M_nu_}) v->setZero(robot.n());
  held_J6_.setZero(6, robot.n());
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    for (std::size_t i = 0; i < tasks_[k].directions.size(); ++i)
      cascade_.tasks[k].scale[static_cast<Index>(i)] = tasks_[k].directions[i] < 3 ? 1 : JointMotion::kLength;
  }
}

void ImpedanceSelfMotion::evaluate(LinkDynamics& links, const VectorXd& q, const VectorXd& dq, const robot::FrameOnBody& E,
                                   const Eigen::MatrixXd& J6, const Eigen::MatrixXd& M, const JointMotionGains& gains,
                                   const Posture* posture, VectorXd& ddq) {
  std::size_t held = 0;
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    control::Task& task = cascade_.tasks[k];
    task.a.setZero();
    const TaskEntry& entry = tasks_[k];
    if (!entry.held) {
      for (std::size_t i = 0; i < entry.directions.size(); ++i) task.J.row(static_cast<Index>(i)) = J6.row(entry.directions[i]);
      continue;
    }
    const SelfMotion::Held to = self_motion_.held(held++);
    const Vector3d e = to.target - links.jacobian(q, entry.frame, held_J6_).p;
    task.activation = to.activation;
    for (std::size_t i = 0; i < entry.directions.size(); ++i) {
      const auto row = static_cast<Index>(i);
      task.J.row(row) = held_J6_.row(entry.directions[i]);
      task.a[row] = to.omega * (to.omega * e[entry.directions[i]] - 2 * task.J.row(row).dot(dq));
    }
  }
  cascade_.sigma_0 = gains.sigma_0;
  cascade_.lambda_0 = std::max(gains.lambda_0, 1e-3);
  if (!cascade_.decompose(M))
    throw Error("space=cartesian", "the mass matrix of the robot is not positive definite, expected mass on every joint");
  cascade_.solve(ddq);
  for (std::size_t k = 0; k < tasks_.size(); ++k) {
    const control::Task& task = cascade_.tasks[k];
    self_motion_.task_sigma[k] = task.sigma_min;
    self_motion_.task_residual[k] = std::sqrt((task.residual.array() * task.scale.array()).square().sum());
  }

  gradient_.setZero();
  const double potential = self_motion_.add_goals(links, q, E, gradient_);
  cascade_.solve_mass(gradient_);
  nu_ = -gains.k_nu * dq - gradient_;
  if (posture != nullptr) nu_ += posture->ddq + gains.k_nu * posture->dq + gains.k_nu * gains.k_nu / 4 * (posture->q - q);
  cascade_.project(nu_);
  ddq += nu_;

  nu_ = dq;
  cascade_.project(nu_);
  M_nu_.noalias() = M.lazyProduct(nu_);
  const double twice = nu_.dot(M_nu_);
  self_motion_.write_outputs({nu_, twice / 2, potential, -gains.k_nu * twice});
}

}  // namespace cotwin::compliance
