#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/support/parameter_set.h"

namespace cotwin {

/// A kind of unit: the row of the generated table through which a concrete unit enters.
struct UnitType {
  const char* name;     // "drive_train"
  const char* summary;  // one sentence
  std::unique_ptr<Unit> (*make)(Settings&);
  void (*declare_settings)(SettingList&) = nullptr;  // nullptr: it has none
};

/// The settings that units of this type have.
inline SettingList settings_of(const UnitType& type) {
  SettingList list;
  if (type.declare_settings != nullptr) type.declare_settings(list);
  return list;
}
/// The row of the unit `name`. Throws Error that names the closest.
const UnitType& find_type(std::string_view name, std::span<const UnitType> types);
/// Declares the settings of `type` to `settings` and constructs the unit. Its variables are not declared yet.
inline std::unique_ptr<Unit> construct(const UnitType& type, Settings& settings) {
  settings.declare(settings_of(type));
  return type.make(settings);
}

/// All units of this build, in the order of components/CMakeLists.txt. Defined in the generated unit_table.cpp.
std::span<const UnitType> unit_types();

/// A unit with its declared variables.
struct Instance {
  std::unique_ptr<Unit> unit;
  Variables variables;
  std::vector<std::string> warnings;
  std::vector<std::string> given;  // names of the variables whose start values a file beside the robot gives
};

/// Builds the unit that `source` names, "unit:drive_train?robot=lwr4": constructs it, declares its variables, and gives them
/// the start values of the file <unit>.ssv beside the robot's URDF, where there is one. Throws Error for an unknown unit or
/// setting. `defaults_used`, if given, receives the names of those `defaults` that the unit asked for.
Instance make_unit(const std::string& source, const std::map<std::string, std::string>& defaults,
                   const std::vector<std::filesystem::path>& folders, std::span<const UnitType> types,
                   std::vector<std::string>* defaults_used = nullptr);

/// The same from settings, which name the unit and can be asked afterwards what was used.
Instance make_unit(Settings& settings, std::span<const UnitType> types);

/// The two parts of a source, "unit:drive_train?robot=lwr4" → {"drive_train", "robot=lwr4"}. Throws Error for anything else.
struct UnitSource {
  std::string unit;
  std::string query;
};
UnitSource parse_unit_source(const std::string& source);

/// Writes the values of `set` into the parameters, inputs and states they name ("K", "K[2]"), converting units of measure.
/// Throws Error at the value's place for a name, kind, size or measure that does not fit.
void apply(const ParameterSet& set, const Variables& variables);

}  // namespace cotwin
