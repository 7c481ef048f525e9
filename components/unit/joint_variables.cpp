#include "components/unit/joint_variables.h"

#include <algorithm>
#include <utility>

#include "models/robot/body_parameters.h"
#include "models/robot/robot_model.h"

namespace cotwin {

std::string prismatic_si(std::string_view revolute) {
  std::string si(revolute);
  for (const auto& [of_revolute, of_prismatic] : {std::pair{"N.m", "N"}, {"kg.m2", "kg"}, {"rad", "m"}}) {
    const std::size_t at = si.find(of_revolute);
    if (at != std::string::npos) si.replace(at, std::string_view(of_revolute).size(), of_prismatic);
  }
  return si;
}

JointMeasures::JointMeasures(const robot::RobotModel* robot) {
  if (robot == nullptr) return;
  for (const robot::Joint& joint : robot->joints) {
    names_.push_back(joint.name);
    prismatic_.push_back(joint.type == robot::JointType::kPrismatic);
  }
}

std::string JointMeasures::si(std::string_view revolute, std::size_t joint) const {
  return joint < prismatic_.size() && prismatic_[joint] ? prismatic_si(revolute) : std::string(revolute);
}

std::string JointMeasures::common_si(std::string_view revolute) const {
  const bool all = !prismatic_.empty() && std::ranges::find(prismatic_, false) == prismatic_.end();
  return all ? prismatic_si(revolute) : std::string(revolute);
}

std::shared_ptr<const Elements> JointMeasures::elements(std::string_view revolute, std::size_t size) const {
  const std::size_t n = names_.size();
  if (n == 0 || size % n != 0) return nullptr;
  Elements all;
  if (size == n) all.names = names_;
  const bool differ = prismatic_si(revolute) != revolute &&
                      std::ranges::count(prismatic_, prismatic_.front()) != static_cast<std::ptrdiff_t>(n);
  for (std::size_t i = 0; differ && i < size; ++i) all.si.push_back(si(revolute, i % n));
  return std::make_shared<const Elements>(std::move(all));
}

Variables::Declared JointVariables::declare(Role role, std::string name, Reals storage, std::string_view si,
                                            std::string description, bool prismatic_differs) {
  std::string measure = prismatic_differs ? measures_.common_si(si) : std::string(si);
  std::shared_ptr<const Elements> elements = measures_.elements(prismatic_differs ? si : "1", storage.size());
  const auto declared = [&]() -> Declared {
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
  };
  return declared().elements(std::move(elements));
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
