#include "components/contact_world/assemble.h"

#include "models/foundation/support/error.h"
#include "models/scene/robot_links.h"

namespace cotwin::contact_world {

Assembled assemble(scene::Scene& scene, const robot::RobotModel& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq, const std::string& prefix) {
  const auto n = static_cast<std::size_t>(robot.n());
  if (q.size() != n || dq.size() != n) {
    throw Error("robot " + robot.name, "start values: " + std::to_string(q.size()) + " positions and " +
                                           std::to_string(dq.size()) + " speeds, expected " + std::to_string(n) + " of each");
  }
  if (base == Base::kFloating) {
    const std::string why = robot.base.inertia.unphysical();
    if (!why.empty()) throw Error("robot " + robot.name, "base '" + robot.base.name + "' cannot float: " + why);
  }

  const std::size_t all = robot.bodies.size();
  std::vector<Pose> X_WL(all);
  std::vector<Twist> V_WL(all);
  scene::place_links(robot, X_WB, q, dq, X_WL, V_WL);

  Assembled parts;
  parts.base = scene.bodies.size();
  scene::Body root;
  root.name = prefix + (robot.base.name.empty() ? "base" : robot.base.name);
  root.motion = base == Base::kFixed    ? scene::Motion::kStatic
                : base == Base::kDriven ? scene::Motion::kDriven
                                        : scene::Motion::kDynamic;
  root.X_WB = X_WB;
  root.inertia = robot.base.inertia;
  scene.bodies.push_back(root);
  for (std::size_t i = 0; i < all; ++i) {
    parts.bodies.push_back(scene.bodies.size());
    scene::Body body;
    body.name = prefix + robot.bodies[i].name;
    body.X_WB = X_WL[i];
    body.V_WB = V_WL[i];
    body.inertia = robot.bodies[i].inertia;
    scene.bodies.push_back(body);
  }
  for (std::size_t i = 0; i < all; ++i) {
    const robot::Joint& from = robot.joint_of(static_cast<int>(i));
    scene::Joint joint;
    joint.name = prefix + from.name;
    joint.type = from.type == robot::JointType::kRevolute ? scene::JointType::kRevolute : scene::JointType::kPrismatic;
    joint.parent = static_cast<int>(from.parent < 0 ? parts.base : parts.bodies[static_cast<std::size_t>(from.parent)]);
    joint.child = static_cast<int>(parts.bodies[i]);
    joint.X_PJ = from.X_PJ;
    joint.axis = from.axis;
    joint.q = scene::position_of(robot, i, q);
    if (i < n) {  // the limits of a leader are those of its group
      joint.q_min = from.q_min;
      joint.q_max = from.q_max;
    }
    parts.joints.push_back(scene.joints.size());
    scene.joints.push_back(joint);
  }
  for (std::size_t k = 0; k < robot.mimics.size(); ++k) {
    const robot::Mimic& mimic = robot.mimics[k];
    scene.gears.push_back({static_cast<int>(parts.joints[static_cast<std::size_t>(mimic.leader)]),
                           static_cast<int>(parts.joints[n + k]), mimic.multiplier, mimic.offset});
  }
  return parts;
}

Assembled assemble(scene::Scene& scene, const scene::PlacedRobot& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq) {
  Assembled parts = assemble(scene, robot.model, X_WB, base, q, dq, robot.name.empty() ? "" : robot.name + "/");
  for (std::size_t i = 0; i < robot.shapes.size(); ++i) {
    scene.bodies[i == 0 ? parts.base : parts.bodies[i - 1]].shapes = robot.shapes[i];
  }
  return parts;
}

}  // namespace cotwin::contact_world
