#include "components/unit/surroundings/surroundings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "components/unit/joint_variables.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"
#include "models/robot/start.h"
#include "models/scene/robot_links.h"

namespace cotwin::surroundings {

void PosePorts::set(const Pose& X) {
  p = {X.p.x(), X.p.y(), X.p.z()};
  put_quaternion(X.R, quat);
}

void PosePorts::set_before(const Pose& X) {
  std::copy_n(X.p.data(), 3, before.begin());
  const Eigen::Quaterniond Q(X.R);
  std::ranges::copy(std::array{Q.w(), Q.x(), Q.y(), Q.z()}, before.begin() + 3);
}

void PosePorts::remember() {
  std::ranges::copy(p, before.begin());
  std::ranges::copy(quat, before.begin() + 3);
}

bool PosePorts::is_finite() const {
  return std::ranges::all_of(std::array{&p, &quat, &v, &w}, [](const Values* values) {
    return std::ranges::all_of(*values, [](double x) { return std::isfinite(x); });
  });
}

Pose PosePorts::last() const {
  return {Eigen::Quaterniond(before[3], before[4], before[5], before[6]).normalized().toRotationMatrix(),
          {before[0], before[1], before[2]}};
}

Body::Body(const scene::Body& body) : prefix(text::identifier(body.name) + ".") { pose.set(body.X_WB); }

Robot::Robot(const scene::PlacedRobot& robot)
    : placed(&robot),
      prefix(robot.name.empty() ? "" : text::identifier(robot.name) + "."),
      base_prefix(prefix + "base_"),
      of(robot.name.empty() ? "of the robot" : "of robot " + robot.name),
      X_WL(robot.model.bodies.size()),
      V_WL(X_WL.size()) {
  for (Values* values : {&q, &dq, &q_before}) values->assign(static_cast<std::size_t>(robot.model.n()), 0.0);
  for (std::size_t i = 0; i < q.size(); ++i) q[i] = robot::default_start(robot.model.joints[i]);
  for (const std::vector<scene::Shape>& shapes : robot.shapes) {
    for (const scene::Shape& shape : shapes) {
      if (!shape.tool.empty() && std::ranges::find(tools, shape.tool) == tools.end()) tools.push_back(shape.tool);
    }
  }
  tools_wanted.assign(tools.size(), 0.0);
  tools_in_force = tools_wanted;
}

std::string Robot::add_to(collision::Cell& cell, bool floating) {
  first = cell.parts.size();
  const std::string bare = cell.add(*placed, floating);
  number = cell.parts[first].robot;
  return bare;
}

void Robot::remember() {
  std::ranges::copy(q, q_before.begin());
  base.remember();
}

void Robot::place(collision::Cell& cell, std::span<const double> q_at, std::span<const double> dq_at) {
  scene::place_links(placed->model, X_WB, q_at, dq_at, X_WL, V_WL);
  if (is_in_cell()) cell.place(number, X_WB, X_WL);
}

bool Robot::show_tools(collision::Cell& cell, std::size_t link) const {
  bool changed = false;
  const std::vector<scene::Shape>& shapes = placed->shapes[link];
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    if (shapes[k].tool.empty()) continue;
    const auto at = static_cast<std::size_t>(std::ranges::find(tools, shapes[k].tool) - tools.begin());
    cell.parts[first + link].body.set_present(k, tools_wanted[at] != 0);
    changed = changed || tools_wanted[at] != tools_in_force[at];
  }
  return changed;
}

void declare_pose(Variables& v, const std::string& prefix, PosePorts& pose, const std::string& of, bool moves,
                  Velocity velocity, bool may_be_lost) {
  if (!moves) {
    v.parameter(prefix + "p0", pose.p, "m", "position " + of + " in W");
    v.parameter(prefix + "quat0", pose.quat, "1", "orientation " + of + " in W, unit quaternion (w, x, y, z)");
    return;
  }
  std::vector<Variables::Declared> inputs;
  inputs.push_back(v.input(prefix + "p", pose.p, "m", "position " + of + " in W").essential());
  inputs.push_back(v.input(prefix + "quat", pose.quat, "1", "orientation " + of + " in W, unit quaternion (w, x, y, z)"));
  if (velocity == Velocity::kUsed) {
    inputs.push_back(v.input(prefix + "v", pose.v, "m/s", "velocity of its origin in W"));
    inputs.push_back(v.input(prefix + "w", pose.w, "rad/s", "its angular velocity in W"));
  }
  if (!may_be_lost) return;
  inputs[2].essential();
  for (Variables::Declared& input : inputs) input.may_be_lost();
}

void declare_tools(Variables& v, Robot& robot) {
  for (std::size_t k = 0; k < robot.tools.size(); ++k) {
    v.tunable(robot.prefix + "tool." + text::identifier(robot.tools[k]), robot.tools_wanted[k], "1",
              "1 while the shapes of tool " + robot.tools[k] + " are there, else 0")
        .range(0, 1);
  }
}

void declare_before(Variables& v, Robot& robot, bool floating) {
  const JointMeasures measures(&robot.placed->model);
  JointVariables(v, measures).state(robot.prefix + "q_before", robot.q_before, "rad", "q at the last step");
  if (floating) v.state(robot.prefix + "base_before", robot.base.before, "1", "pose of the base at the last step");
}

void check_finite(const std::string& place, const std::string& prefix, const char* name, const Values& values, Time now) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (std::isfinite(values[i])) continue;
    throw Error(place + "." + prefix + name + "[" + std::to_string(i + 1) + "]",
                "is " + text::to_text(values[i]) + " at " + text::to_text(now.seconds()) + " s, expected a finite value");
  }
}

void check_finite(const std::string& place, const std::string& prefix, const PosePorts& pose, Time now) {
  check_finite(place, prefix, "p", pose.p, now);
  check_finite(place, prefix, "quat", pose.quat, now);
  check_finite(place, prefix, "v", pose.v, now);
  check_finite(place, prefix, "w", pose.w, now);
}

}  // namespace cotwin::surroundings
