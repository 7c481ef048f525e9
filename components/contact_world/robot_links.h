#pragma once
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/robot_model.h"

/// Forward kinematics of a robot's links and the joint torques of forces on them.
namespace cotwin::contact_world {

/// Poses and twists (of the frame's origin, expressed in W) of every body of `robot`, whose base rests at X_WB.
void place_links(const robot::RobotModel& robot, const Pose& X_WB, std::span<const double> q, std::span<const double> dq,
                 std::span<Pose> X_WL, std::span<Twist> V_WL);

/// Adds Jᵀ F of a force f on body `body` at p, both expressed in W, to tau (n); body −1, the base, adds nothing.
void add_joint_torques(const robot::RobotModel& robot, std::span<const Pose> X_WL, int body, const Eigen::Vector3d& p_W,
                       const Eigen::Vector3d& f_W, std::span<double> tau);

}  // namespace cotwin::contact_world
