#include "components/services/json/end_pose_json.h"

#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::services {

namespace {

/// Some of x, y, z, rx, ry, rz.
robot::TaskDirections read_directions(Reader& r) {
  std::string names;
  for (const std::string& name : r.texts("directions", {"all"})) names += (names.empty() ? "" : ",") + name;
  const bool of_tool = r.word("axes", {"base", "tool"}) == "tool";
  try {
    return robot::task_directions(names, of_tool);
  } catch (const Error& e) {
    throw RequestError(r.pointer("directions"), e.what());
  }
}

std::vector<double> read_vector(Reader& r, const char* name, std::size_t size) {
  std::vector<double> x = r.numbers(name);
  if (x.size() != size)
    throw RequestError(r.pointer(name), "has " + std::to_string(x.size()) + " values, expected " + std::to_string(size));
  return x;
}

robot::PoseTarget read_target(Reader& r) {
  const std::vector<double> p = read_vector(r, "p_m", 3), Q = read_vector(r, "quaternion_wxyz", 4);
  const Eigen::Quaterniond q(Q[0], Q[1], Q[2], Q[3]);
  if (!(std::abs(q.norm() - 1) < 1e-3))
    throw RequestError(r.pointer("quaternion_wxyz"), "has the norm " + Json(q.norm()).dump() + ", expected 1");
  return {Eigen::Vector3d(p[0], p[1], p[2]), q.normalized()};
}

}  // namespace

std::optional<EndPose> read_end_pose(Reader& request, optimisation::Problem& problem) {
  const Json* given = request.any("to_pose");
  if (!given) return {};
  Reader r(*given, request.pointer("to_pose"));
  const std::string name = r.text("frame", "");
  const robot::TaskDirections directions = read_directions(r);
  const bool has_target = r.any("p_m") || r.any("quaternion_wxyz");
  EndPose end;
  if (has_target) end.target = read_target(r);
  r.finish();

  robot::RobotModel bounded = problem.robot;  // postures are searched within the bounds of the request
  for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
    bounded.joints[j].q_min = problem.bounds.q_min[j];
    bounded.joints[j].q_max = problem.bounds.q_max[j];
  }
  const robot::Frame* frame = nullptr;
  try {
    frame = name.empty() ? &bounded.end_effector() : &bounded.frame(name);
  } catch (const Error& e) {
    throw RequestError(r.pointer("frame"), e.what());
  }
  end.kinematics = std::make_unique<robot::InverseKinematics>(bounded, *frame, directions);
  end.has_freedom = end.kinematics->n() > end.kinematics->rows();
  if (end.kinematics->n() > end.kinematics->rows() + 1)
    throw RequestError(r.pointer("directions"),
                       "leaves " + std::to_string(end.kinematics->n() - end.kinematics->rows()) +
                           " directions of the joints free, expected at most one: more directions, or locked_q");
  const Eigen::Map<const Eigen::VectorXd> q(problem.ends.q_to.data(), problem.robot.n());
  if (!has_target) {
    robot::FrameKinematics kinematics(bounded, *frame);
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
