#pragma once
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/robot_model.h"

/// Forward kinematics of a robot's links and the joint torques of forces on them.
namespace cotwin::scene {

/// Poses and twists (of the frame's origin, expressed in W) of every body of `robot`, whose base rests at X_WB and whose
/// independent joints are at q, dq (n each).
void place_links(const robot::RobotModel& robot, const Pose& X_WB, std::span<const double> q, std::span<const double> dq,
                 std::span<Pose> X_WL, std::span<Twist> V_WL);

/// Position of the joint that moves `body`, from those of the independent joints.
double position_of(const robot::RobotModel& robot, std::size_t body, std::span<const double> q);
/// Its speed per speed of RobotModel::leader_of(body).
double rate_of(const robot::RobotModel& robot, std::size_t body);

/// Adds Jᵀ F of a force f on body `body` at p, both expressed in W, to tau (n); body −1, the base, adds nothing.
void add_joint_torques(const robot::RobotModel& robot, std::span<const Pose> X_WL, int body, const Eigen::Vector3d& p_W,
                       const Eigen::Vector3d& f_W, std::span<double> tau);

/// The same of a wrench.
void add_joint_torques(const robot::RobotModel& robot, std::span<const Pose> X_WL, int body, const Eigen::Vector3d& p_W,
                       const Wrench& F_W, std::span<double> tau);

}  // namespace cotwin::scene
