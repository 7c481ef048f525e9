#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// A rigid part mounted on the robot: a tool, a force/torque sensor, a payload (IV-A2).
struct Attachment {
  std::string name;                     // name of its frame A on the robot
  std::string parent;                   // the frame it is mounted on
  Pose X_PA;                            // A in the parent frame
  Inertia inertia;                      // in A; zero for a frame without mass
  std::vector<PartFrame> further = {};  // for example the tool centre point
};

/// Mounts `what`: adds its inertia to the carrying body (Steiner) and logs the change in the history. Throws Error for an
/// unknown parent, a duplicate name or one that a URDF cannot have, an invalid pose, an unphysical inertia or a time before that of
/// the last change. A point mass (mass without moments) is accepted
/// if the composite body is physical. `time`: s, of the change in a run.
void attach(RobotModel& robot, const Attachment& what, const std::string& reason = "", std::optional<double> time = {});

/// Removes `name` with its further frames and logs the change: the carrying body becomes, to the last bit, what it would be if
/// `name` had never been mounted. If the body was set or tuned since then, the attachment's inertia is subtracted instead. Throws Error if `name` is
/// not attached, if another part is mounted on it, if the remaining inertia is unphysical, or as attach() for the time.
void detach(RobotModel& robot, const std::string& name, const std::string& reason = "", std::optional<double> time = {});

/// Replaces the inertia of a body (−1: the base), for example by a tuned one, and logs the change. Throws Error for an invalid
/// body index or an unphysical inertia, or as attach() for the time.
void set_inertia(RobotModel& robot, int body, const Inertia& inertia, const std::string& reason,
                 std::optional<double> time = {});

/// The robot before entry `change` of its history; history.size() gives the present robot. Throws Error for larger values.
RobotModel before(const RobotModel& robot, std::size_t change);

/// The number of changes up to `time`, s: before(robot, changes_until(robot, t)) is the robot at time t. Changes without a time
/// count as earlier than all others. The times of a history do not decrease.
std::size_t changes_until(const RobotModel& robot, double time);

}  // namespace cotwin::robot
