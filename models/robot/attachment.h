#pragma once
#include <cstddef>
#include <string>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Something rigid mounted on the robot: a tool, a force/torque sensor, a payload (IV-A2).
struct Attachment {
  std::string name;    // becomes a frame of the robot, at the attachment's own frame A
  std::string parent;  // the frame it is mounted on
  Pose X_PA;           // A in the parent frame
  Inertia inertia;     // given in A; all zero for a mere frame
};

/// Mounts `what`: the carrying body becomes the equivalent composite body (Steiner), and the change is logged in the history.
/// Throws Error for an unknown parent, a doubled name, a pose that is none, an unphysical inertia. A point mass (mass without
/// moments) is taken if the composite body is physical.
void attach(RobotModel& robot, const Attachment& what, const std::string& reason = "");

/// Takes `name` off again and logs that too: the carrying body becomes, to the last bit, what it would be if `name` had never
/// been mounted on it. If the body was set or tuned since, with the attachment on it, the attachment's inertia is subtracted.
/// Throws Error if nothing of that name is attached, if something else is still mounted on it, if what would remain is
/// unphysical.
void detach(RobotModel& robot, const std::string& name, const std::string& reason = "");

/// Replaces the inertia of a body (−1: the base), e.g. by a tuned one, and logs it. Throws Error for a body that the robot does
/// not have and for an unphysical inertia.
void set_inertia(RobotModel& robot, int body, const Inertia& inertia, const std::string& reason);

/// The robot as entry `change` of its history found it; history.size() gives the robot as it is. Throws Error beyond that.
RobotModel before(const RobotModel& robot, std::size_t change);

}  // namespace cotwin::robot
