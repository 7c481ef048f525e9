#include "models/anomaly/attribution.h"

#include <cmath>

#include "models/identification/torque_data/torque_model.h"

namespace cotwin::anomaly {

namespace {

/// The robot's joints with 1 kg at its end and no other mass.
robot::RobotModel with_load_alone(robot::RobotModel robot) {
  for (robot::Body& body : robot.bodies) body.inertia = {};
  const robot::Frame end = robot.end_effector();
  if (end.body < 0) return robot;
  const Eigen::Vector3d& p = end.X_BF.p;
  const Eigen::Matrix3d about_origin = p.squaredNorm() * Eigen::Matrix3d::Identity() - p * p.transpose();
  Eigen::Matrix<double, 10, 1> pi;
  pi << 1, p, about_origin(0, 0), about_origin(0, 1), about_origin(0, 2), about_origin(1, 1), about_origin(1, 2),
      about_origin(2, 2);
  robot.bodies[static_cast<std::size_t>(end.body)].inertia = Inertia::from_parameters(pi);
  return robot;
}

}  // namespace

const char* to_text(Cause cause) {
  switch (cause) {
    case Cause::kLoad:
      return "load";
    case Cause::kFriction:
      return "friction";
    case Cause::kContact:
      return "contact";
    case Cause::kEncoder:
      break;
  }
  return "encoder";
}

TorqueModel::TorqueModel(const robot::RobotModel& robot, bool motor)
    : drives(robot.joints.size()),
      motor_(motor),
      mechanism_(robot),
      load_(with_load_alone(robot)),
      data_(mechanism_),
      load_data_(load_) {
  const Eigen::Index n = robot.n();
  for (Eigen::VectorXd* v : {&q_, &dq_, &ddq_, &tau_, &gravity_, &load_tau_}) v->setZero(n);
  for (Eigen::MatrixXd* m : {&by_q_, &by_dq_}) m->setZero(n, n);
  effects_.setZero(n, causes());
  std::ranges::fill(drives.B, 0.0);
  has_friction_.assign(robot.joints.size(), 0);
  for (const robot::Joint& joint : robot.joints) usual_.push_back(identification::speed_scale(joint));
}

double TorqueModel::friction(std::size_t j, double v, double gravity) const {
  const robot::LinkSideParameters link = robot::link_side(drives, j);
  double torque =
      link.friction.at(v).torque + link.sigmoid.at(v).torque + link.load_friction(gravity).at(v).torque - link.constant();
  if (motor_) torque += robot::motor_friction(drives, j).at(v).torque - drives.tau_0[j];
  return torque;
}

void TorqueModel::update() {
  for (std::size_t j = 0; j < usual_.size(); ++j) has_friction_[j] = friction(j, usual_[j], 1) != 0;
}

void TorqueModel::evaluate(const double* q, const double* dq, const double* ddq) {
  const int n = joints();
  q_ = Eigen::Map<const Eigen::VectorXd>(q, n);
  dq_ = Eigen::Map<const Eigen::VectorXd>(dq, n);
  ddq_ = Eigen::Map<const Eigen::VectorXd>(ddq, n);
  robot::inverse_dynamics(mechanism_, data_, q_, dq_, ddq_, tau_);
  robot::gravity(mechanism_, data_, q_, gravity_);
  robot::inverse_dynamics(load_, load_data_, q_, dq_, ddq_, load_tau_);
  robot::inverse_dynamics_derivatives(mechanism_, data_, q_, dq_, ddq_, by_q_, by_dq_);
  effects_.col(0) = load_tau_;
  effects_.rightCols(n) = by_q_;
  for (int j = 0; j < n; ++j) {
    const std::size_t i = static_cast<std::size_t>(j);
    const robot::LinkSideParameters link = robot::link_side(drives, i);
    const double curve = friction(i, dq[j], gravity_[j]), constant = link.constant() + (motor_ ? drives.tau_0[i] : 0);
    constexpr double kSlow = 0.02;  // rad/s
    tau_[j] += curve + constant + link.spring.at(q[j]).torque + (motor_ ? drives.B[i] * ddq[j] : 0);
    effects_(j, 1 + j) = has_friction_[i] ? curve : std::tanh(dq[j] / kSlow);
    effects_(j, 1 + n + j) = 1;
  }
}

}  // namespace cotwin::anomaly
