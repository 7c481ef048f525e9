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

/// Names and units of measure of the joints of a robot: rad and N.m of revolute ones, m and N of prismatic ones.
class JointMeasures {
 public:
  /// Without a robot (nullptr), the joints are revolute and have no names.
  explicit JointMeasures(const robot::RobotModel* robot);
  /// The unit of measure of a joint, counted from 0, from that of a revolute one: "N.m.s/rad" becomes "N.s/m" of a prismatic one.
  std::string si(std::string_view revolute, std::size_t joint) const;
  /// Of a vector with an element per joint, or with so many rows of them; nullptr for other sizes.
  std::shared_ptr<const Elements> elements(std::string_view revolute, std::size_t size) const;
  /// That of all joints if it is the same, or that of revolute ones.
  std::string common_si(std::string_view revolute) const;

 private:
  std::vector<std::string> names_;
  std::vector<bool> prismatic_;
};

/// The unit of measure of a prismatic joint, from that of a revolute one.
std::string prismatic_si(std::string_view revolute);

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
