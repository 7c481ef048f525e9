#pragma once
#include <memory>
#include <optional>

#include "components/services/json/move_json.h"
#include "models/optimisation/end_posture.h"

namespace cotwin::services {

/// The members "directions", some of x, y, z, rx, ry, rz, and "axes".
robot::TaskDirections read_directions(Reader& r);
/// The members "p_m" and "quaternion_wxyz"; none if they are optional and neither is given.
std::optional<robot::PoseTarget> read_target(Reader& r, bool optional);

/// The member "to_pose" as it is given.
struct PoseGoal {
  robot::Frame frame;
  robot::TaskDirections directions;
  std::optional<robot::PoseTarget> target;  // without it the pose at to_q
};
std::optional<PoseGoal> read_pose_goal(Reader& request, const robot::RobotModel& robot);

/// The goal of a motion whose end posture is searched: all postures that reach a pose of a frame.
struct EndPose {
  std::unique_ptr<robot::InverseKinematics> kinematics;
  robot::PoseTarget target;
  bool has_freedom = false;  // more joints than directions
};
/// The member "to_pose": {"frame", "directions", "axes", "p_m", "quaternion_wxyz"}; without p_m and quaternion_wxyz the pose at the
/// problem's end. ends.q_to becomes a posture that reaches the pose within the bounds. Throws RequestError, also if there is none.
std::optional<EndPose> read_end_pose(Reader& r, optimisation::Problem& problem);

}  // namespace cotwin::services
