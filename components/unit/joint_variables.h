#pragma once
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "components/unit/variables.h"
#include "models/foundation/support/parameter_table.h"

namespace cotwin::robot {
class BodyParameters;
struct RobotModel;
}  // namespace cotwin::robot

namespace cotwin {

/// Units of measure of the joint quantities of a robot. A port is a vector with one unit of measure. If all joints are
/// prismatic, it is that of prismatic joints (m, N), else that of revolute joints (rad, N.m). If both kinds of joints occur,
/// the description names the prismatic joints and their unit of measure.
class JointMeasures {
 public:
  /// Without a robot (nullptr), the joints are revolute.
  explicit JointMeasures(const robot::RobotModel* robot);
  /// The unit of measure to be declared, from that of a revolute joint: "N.m.s/rad" becomes "N.s/m" for prismatic joints.
  std::string si(std::string_view revolute) const;
  std::string description(std::string_view revolute, std::string text) const;

 private:
  bool prismatic_ = false;       // all joints
  std::string prismatic_among_;  // "joint 3", "joints 1, 3": prismatic joints beside revolute ones; else empty
};

/// Declares real variables that hold values of the joints, with units of measure given for revolute joints.
class JointVariables {
 public:
  JointVariables(Variables& variables, const JointMeasures& measures) : variables_(variables), measures_(measures) {}
  using Declared = Variables::Declared;
  using Reals = std::span<double>;

  Declared input(std::string name, Reals storage, std::string_view si, std::string description) {
    return declare(Role::kInput, std::move(name), storage, si, std::move(description));
  }
  Declared output(std::string name, Reals storage, std::string_view si, std::string description) {
    return declare(Role::kOutput, std::move(name), storage, si, std::move(description));
  }
  Declared parameter(std::string name, Reals storage, std::string_view si, std::string description) {
    return declare(Role::kParameter, std::move(name), storage, si, std::move(description));
  }
  Declared parameter(std::string name, double& storage, std::string_view si, std::string description) {
    return parameter(std::move(name), Reals(&storage, 1), si, std::move(description));
  }
  Declared state(std::string name, Reals storage, std::string_view si, std::string description) {
    return declare(Role::kState, std::move(name), storage, si, std::move(description));
  }

  /// The parameter of a row: a tunable if the row says so and `tunable` is set, else fixed. `addition` follows the description.
  template <class Struct, class RowStruct>
  Declared parameter(Struct& parameters, const ParameterRow<RowStruct>& row, bool tunable = true, const char* addition = "") {
    const Role role = tunable && row.mutability != Mutability::kFixed ? Role::kTunable : Role::kParameter;
    Declared declared =
        declare(role, row.name, parameters.*row.values, row.si, std::string(row.description) + addition, row.prismatic_differs);
    return row.min > -row.kNoLimit ? declared.range(row.min, row.max) : declared;
  }
  /// The state `<name>_in_force`: the value of a tunable that is followed smoothly.
  template <class Struct, class RowStruct>
  Declared in_force(Struct& parameters, const ParameterRow<RowStruct>& row, const char* addition = "") {
    const std::string name = row.name;
    return declare(Role::kState, name + "_in_force", parameters.*row.values, row.si,
                   name + " on its way to the tunable" + addition, row.prismatic_differs);
  }

 private:
  Declared declare(Role role, std::string name, Reals storage, std::string_view si, std::string description,
                   bool prismatic_differs = true);

  Variables& variables_;
  const JointMeasures& measures_;
};

/// Declares the inertial parameters of a robot's bodies, as tunables or as fixed parameters, and the state `bodies` of those in
/// force.
/// `prefix`: of the names, for one of several robots.
void declare_bodies(Variables& variables, robot::BodyParameters& bodies, bool tunable, const std::string& prefix = "");

}  // namespace cotwin
