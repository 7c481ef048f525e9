#include "models/scene/robot_links.h"

#include <Eigen/Geometry>

namespace cotwin::scene {

double rate_of(const robot::RobotModel& robot, std::size_t body) {
  return body < robot.joints.size() ? 1 : robot.mimics[body - robot.joints.size()].multiplier;
}

double position_of(const robot::RobotModel& robot, std::size_t body, std::span<const double> q) {
  if (body < robot.joints.size()) return q[body];
  const robot::Mimic& mimic = robot.mimics[body - robot.joints.size()];
  return mimic.multiplier * q[static_cast<std::size_t>(mimic.leader)] + mimic.offset;
}

void place_links(const robot::RobotModel& robot, const Pose& X_WB, std::span<const double> q, std::span<const double> dq,
                 std::span<Pose> X_WL, std::span<Twist> V_WL) {
  int independent = 0, following = 0;
  for (int place = 0; place < robot.body_count(); ++place) {
    const bool follows = following < robot.body_count() - robot.n() &&
                         (robot.mimics[static_cast<std::size_t>(following)].place == place || independent == robot.n());
    const int body = follows ? robot.n() + following++ : independent++;
    const auto i = static_cast<std::size_t>(body);
    const robot::Joint& joint = robot.joint_of(body);
    const double q_i = position_of(robot, i, q);
    const double dq_i = rate_of(robot, i) * dq[static_cast<std::size_t>(robot.leader_of(body))];
    const bool on_base = joint.parent < 0;
    const auto parent = static_cast<std::size_t>(joint.parent);
    const Pose& X_WP = on_base ? X_WB : X_WL[parent];
    const Twist V_WP = on_base ? Twist::Zero() : V_WL[parent];

    Pose X_WJ = X_WP * joint.X_PJ;
    const Eigen::Vector3d axis_W = X_WJ.R * joint.axis;
    Eigen::Vector3d w = V_WP.tail<3>();
    Eigen::Vector3d v = Eigen::Vector3d::Zero();
    if (joint.type == robot::JointType::kRevolute) {
      X_WJ.R = X_WJ.R * Eigen::AngleAxisd(q_i, joint.axis).toRotationMatrix();
      w += axis_W * dq_i;
    } else {
      X_WJ.p += axis_W * q_i;
      v = axis_W * dq_i;
    }
    v += V_WP.head<3>() + V_WP.tail<3>().cross(X_WJ.p - X_WP.p);
    X_WL[i] = X_WJ;
    V_WL[i] << v, w;
  }
}

void add_joint_torques(const robot::RobotModel& robot, std::span<const Pose> X_WL, int body, const Eigen::Vector3d& p_W,
                       const Eigen::Vector3d& f_W, std::span<double> tau) {
  for (int i = body; i >= 0; i = robot.joint_of(i).parent) {
    const auto k = static_cast<std::size_t>(i);
    const robot::Joint& joint = robot.joint_of(i);
    const Eigen::Vector3d axis_W = X_WL[k].R * joint.axis;  // invariant under the joint's own motion
    const double own = joint.type == robot::JointType::kRevolute ? axis_W.dot((p_W - X_WL[k].p).cross(f_W)) : axis_W.dot(f_W);
    tau[static_cast<std::size_t>(robot.leader_of(i))] += rate_of(robot, k) * own;
  }
}

void add_joint_torques(const robot::RobotModel& robot, std::span<const Pose> X_WL, int body, const Eigen::Vector3d& p_W,
                       const Wrench& F_W, std::span<double> tau) {
  add_joint_torques(robot, X_WL, body, p_W, Eigen::Vector3d(F_W.head<3>()), tau);
  for (int i = body; i >= 0; i = robot.joint_of(i).parent) {
    const auto k = static_cast<std::size_t>(i);
    if (robot.joint_of(i).type == robot::JointType::kRevolute)
      tau[static_cast<std::size_t>(robot.leader_of(i))] +=
          rate_of(robot, k) * (X_WL[k].R * robot.joint_of(i).axis).dot(F_W.tail<3>());
  }
}

}  // namespace cotwin::scene
