#include "models/robot/frame_kinematics.h"

#include <algorithm>
#include <cstddef>

namespace cotwin::robot {

FrameKinematics::FrameKinematics(const RobotModel& robot, const Frame& frame)
    : mechanism_(robot), data_(mechanism_), frame_(on_body(frame)), last_(frame.X_BF.R), J_(6, robot.n()) {
  for (int body = frame.body; body >= 0; body = robot.joint_of(body).parent) {
    const Joint& joint = robot.joint_of(body);
    Turn turn{Eigen::Quaterniond(joint.X_PJ.R), Eigen::Vector3d::Zero(), robot.leader_of(body), 1, 0};
    if (joint.type == JointType::kRevolute) turn.axis = joint.axis.normalized();
    if (body >= robot.n()) {
      const Mimic& mimic = robot.mimics[static_cast<std::size_t>(body - robot.n())];
      turn.rate = mimic.multiplier;
      turn.offset = mimic.offset;
    }
    turns_.push_back(turn);
  }
  std::reverse(turns_.begin(), turns_.end());
}

Eigen::Quaterniond FrameKinematics::orientation(const VectorIn& q) const {
  Eigen::Quaterniond Q = Eigen::Quaterniond::Identity();
  for (const Turn& turn : turns_) {
    const double half = 0.5 * (turn.rate * q[turn.joint] + turn.offset);
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
    if (turn.axis != Eigen::Vector3d::Zero()) {
      rotation.w() = std::cos(half);
      rotation.vec() = std::sin(half) * turn.axis;
    }
    Q = Q * turn.fixed * rotation;
  }
  return (Q * last_).normalized();
}

FrameMotion FrameKinematics::at(const VectorIn& q, const VectorIn& dq, const VectorIn& ddq) {
  FrameMotion m = jacobian(q, J_);
  m.V.noalias() = J_ * dq;
  m.dV = bias(q, dq);
  m.dV.noalias() += J_ * ddq;
  return m;
}

FrameMotion FrameKinematics::jacobian(const VectorIn& q, MatrixOut J) {
  FrameMotion m;
  m.p = robot::jacobian(mechanism_, data_, q, frame_, J).p;
  m.Q = orientation(q);
  return m;
}

Twist FrameKinematics::bias(const VectorIn& q, const VectorIn& dq) {
  Twist a;
  jacobian_dot_times_dq(mechanism_, data_, q, dq, frame_, a);
  return a;
}

}  // namespace cotwin::robot
