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
#include "models/foundation/formats/parameter_set.h"

namespace cotwin {

/// A kind of unit: a row of the generated table of units.
struct UnitType {
  const char* name;     // "drive_train"
  const char* summary;  // one sentence
  std::unique_ptr<Unit> (*make)(Settings&);
  void (*declare_settings)(SettingList&) = nullptr;  // nullptr: no settings
};

/// The settings of units of this type.
inline SettingList settings_of(const UnitType& type) {
  SettingList list;
  if (type.declare_settings != nullptr) type.declare_settings(list);
  return list;
}
/// The row of the unit `name`. Throws Error with the closest name if there is none.
const UnitType& find_type(std::string_view name, std::span<const UnitType> types);
/// Declares the settings of `type` to `settings` and constructs the unit. Its variables are not declared yet.
inline std::unique_ptr<Unit> construct(const UnitType& type, Settings& settings) {
  settings.declare(settings_of(type));
  return type.make(settings);
}

/// All units of this build, in the order of components/CMakeLists.txt. Defined in the generated unit_table.cpp.
std::span<const UnitType> unit_types();

/// Beginning of the keys of start values (ParameterSet) in a FileStore.
inline constexpr const char* kValuesKey = "values\n";

/// A unit with its declared variables.
struct Instance {
  std::unique_ptr<Unit> unit;
  Variables variables;
  std::vector<std::string> warnings;
  std::vector<std::string> given;  // names of the variables whose start values a file beside the robot gives
  std::vector<std::shared_ptr<const robot::RobotModel>> robots;  // Settings::robots_used()
};

/// Makes the unit of `source`, "unit:drive_train?robot=lwr4": constructs it, declares its variables and writes the start values
/// of the file <unit>.ssv beside the robot's URDF, if there is one. Throws Error for an unknown unit or setting.
/// `defaults_used`, if given, receives the names of the used `defaults`; `models` as for Settings.
Instance make_unit(const std::string& source, const std::map<std::string, std::string>& defaults,
                   const std::vector<std::filesystem::path>& folders, std::span<const UnitType> types,
                   std::vector<std::string>* defaults_used = nullptr, std::shared_ptr<FileStore> models = nullptr);

/// The same from settings, which have the name of the unit and record which values were used.
Instance make_unit(Settings& settings, std::span<const UnitType> types);

/// The two parts of a source, "unit:drive_train?robot=lwr4" → {"drive_train", "robot=lwr4"}. Throws Error for anything else.
struct UnitSource {
  std::string unit;
  std::string query;
};
UnitSource parse_unit_source(const std::string& source);

/// Writes the values of `set` to the parameters, inputs and states of the same name ("K", "K[2]"), converted to their units of
/// measure. Throws Error with the place of the value for a name, kind, size or unit of measure that does not fit.
void apply(const ParameterSet& set, const Variables& variables);

}  // namespace cotwin
