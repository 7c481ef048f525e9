#include "components/services/json/end_pose_json.h"

#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::services {

robot::TaskDirections read_directions(Reader& r) {
  if (r.describes())
    r.declare("directions",
              {{"type", {"array", "string"}},
               {"items", {{"type", "string"}, {"enum", {"all", "x", "y", "z", "rx", "ry", "rz"}}}},
               {"minItems", 1}},
              false, "that have to be reached; the joints may have one more; without it all six");
  std::string names;
  for (const std::string& name : r.texts("directions", {"all"}, nullptr)) names += (names.empty() ? "" : ",") + name;
  const bool of_tool = r.word("axes", {"base", "tool"}, "of the directions") == "tool";
  try {
    return robot::task_directions(names, of_tool);
  } catch (const Error& e) {
    throw RequestError(r.pointer("directions"), e.what());
  }
}

std::optional<robot::PoseTarget> read_target(Reader& r, bool optional) {
  const bool given = !optional || r.any("p_m") || r.any("quaternion_wxyz");
  const std::vector<double> p = r.vector("p_m", 3, !given, "in the base"),
                            Q = r.vector("quaternion_wxyz", 4, !given, "of the frame in the base");
  if (!given || r.describes()) return {};
  const Eigen::Quaterniond q(Q[0], Q[1], Q[2], Q[3]);
  if (!(std::abs(q.norm() - 1) < 1e-3))
    throw RequestError(r.pointer("quaternion_wxyz"), "has the norm " + Json(q.norm()).dump() + ", expected 1");
  return robot::PoseTarget{Eigen::Vector3d(p[0], p[1], p[2]), q.normalized()};
}

std::optional<PoseGoal> read_pose_goal(Reader& request, const robot::RobotModel& robot) {
  std::string name;
  PoseGoal goal;
  const auto read = [&](Reader& r) {
    name = r.text("frame", "", "of the URDF; without it the end effector");
    goal.directions = read_directions(r);
    goal.target = read_target(r, true);
  };
  if (request.describes())
    request.declare(
        "to_pose", Reader::schema_of(read), false,
        "the motion may end in any posture that reaches this pose; without p_m and quaternion_wxyz the pose at to_q");
  const Json* given = request.any("to_pose");
  if (!given) return {};
  Reader r(*given, request.pointer("to_pose"));
  read(r);
  r.finish();
  try {
    goal.frame = name.empty() ? robot.end_effector() : robot.frame(name);
  } catch (const Error& e) {
    throw RequestError(r.pointer("frame"), e.what());
  }
  return goal;
}

std::optional<EndPose> read_end_pose(Reader& request, optimisation::Problem& problem) {
  const std::optional<PoseGoal> goal = read_pose_goal(request, problem.robot);
  if (!goal) return {};
  EndPose end;
  if (goal->target) end.target = *goal->target;

  robot::RobotModel bounded = problem.robot;  // postures are searched within the bounds of the request
  for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
    bounded.joints[j].q_min = problem.bounds.q_min[j];
    bounded.joints[j].q_max = problem.bounds.q_max[j];
  }
  end.kinematics = std::make_unique<robot::InverseKinematics>(bounded, goal->frame, goal->directions);
  end.has_freedom = end.kinematics->n() > end.kinematics->rows();
  if (end.kinematics->n() > end.kinematics->rows() + 1)
    throw RequestError(request.pointer("to_pose") + "/directions",
                       "leaves " + std::to_string(end.kinematics->n() - end.kinematics->rows()) +
                           " directions of the joints free, expected at most one: more directions, or locked_q");
  const Eigen::Map<const Eigen::VectorXd> q(problem.ends.q_to.data(), problem.robot.n());
  if (!goal->target) {
    robot::FrameKinematics kinematics(bounded, goal->frame);
    Eigen::MatrixXd J(6, problem.robot.n());
    const robot::FrameMotion pose = kinematics.jacobian(q, J);
    end.target = {pose.p, pose.Q};
    return end;
  }
  const robot::Posture posture = end.kinematics->solve(end.target, q);
  if (!posture.reached)
    throw RequestError(request.pointer("to_pose"), "is not reached: " + posture.message + ", expected a pose within reach");
  problem.ends.q_to.assign(posture.q.begin(), posture.q.end());
  return end;
}

}  // namespace cotwin::services
