#include "components/unit/joint_variables.h"

#include <utility>

#include "models/robot/body_parameters.h"
#include "models/robot/robot_model.h"

namespace cotwin {
namespace {

std::string prismatic_si(std::string_view revolute) {
  std::string si(revolute);
  for (const auto& [of_revolute, of_prismatic] : {std::pair{"N.m", "N"}, {"kg.m2", "kg"}, {"rad", "m"}}) {
    const std::size_t at = si.find(of_revolute);
    if (at != std::string::npos) si.replace(at, std::string_view(of_revolute).size(), of_prismatic);
  }
  return si;
}

}  // namespace

JointMeasures::JointMeasures(const robot::RobotModel* robot) {
  if (robot == nullptr) return;
  std::size_t count = 0;
  for (std::size_t i = 0; i < robot->joints.size(); ++i) {
    if (robot->joints[i].type != robot::JointType::kPrismatic) continue;
    prismatic_among_ += (count++ == 0 ? "" : ", ") + std::to_string(i + 1);
  }
  prismatic_ = count > 0 && count == robot->joints.size();
  if (prismatic_) prismatic_among_.clear();
  if (!prismatic_among_.empty()) prismatic_among_.insert(0, count == 1 ? "joint " : "joints ");
}

std::string JointMeasures::si(std::string_view revolute) const {
  return prismatic_ ? prismatic_si(revolute) : std::string(revolute);
}

std::string JointMeasures::description(std::string_view revolute, std::string text) const {
  const std::string other = prismatic_si(revolute);
  return prismatic_among_.empty() || other == revolute ? text : text + " (" + other + " for " + prismatic_among_ + ")";
}

Variables::Declared JointVariables::declare(Role role, std::string name, Reals storage, std::string_view si,
                                            std::string description, bool prismatic_differs) {
  std::string measure = prismatic_differs ? measures_.si(si) : std::string(si);
  if (prismatic_differs) description = measures_.description(si, std::move(description));
  switch (role) {
    case Role::kInput:
      return variables_.input(std::move(name), storage, std::move(measure), std::move(description));
    case Role::kOutput:
      return variables_.output(std::move(name), storage, std::move(measure), std::move(description));
    case Role::kParameter:
      return variables_.parameter(std::move(name), storage, std::move(measure), std::move(description));
    case Role::kTunable:
      return variables_.tunable(std::move(name), storage, std::move(measure), std::move(description));
    case Role::kState:
      break;
  }
  return variables_.state(std::move(name), storage, std::move(measure), std::move(description));
}

void declare_bodies(Variables& v, robot::BodyParameters& b, bool tunable, const std::string& prefix) {
  const auto declare = [&](const char* name, std::vector<double>& values, const char* si, const char* description) {
    return tunable ? v.tunable(prefix + name, values, si, description) : v.parameter(prefix + name, values, si, description);
  };
  declare("mass", b.mass, "kg", "mass of each body of the robot, as its model has it at the start");
  declare("first_moment", b.first_moment, "kg.m", "mass times centre of mass of body after body, in its frame (x, y, z)");
  declare("inertia", b.inertia, "kg.m2", "inertia of body after body about its frame's origin: xx, xy, xz, yy, yz, zz");
  v.state(prefix + "bodies", b.in_force, "1", "the ten inertial parameters in force of body after body");
}

}  // namespace cotwin
