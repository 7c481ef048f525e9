#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/setting_list.h"
#include "models/support/error.h"

namespace cotwin::robot {
struct RobotModel;
}
namespace cotwin::scene {
struct Cell;
}

namespace cotwin {

/// A setting that the unit needs is not given.
class MissingSetting : public Error {
 public:
  using Error::Error;
};

/// What a unit is built from before it has variables: the settings that its source gives, `unit:drive_train?robot=lwr4`, the
/// scenario's defaults for settings that several units share, and the folders where named data lie. Settings decide the layout
/// (how many joints) and the method; whatever can be a parameter is one.
class Settings {
 public:
  /// `unit`: the unit's name, for messages; `query`: "a=1&b=x" with %-escapes, "" for none; `defaults`: the scenario's;
  /// `folders`: where relative paths and robots/… are looked up, in this order.
  Settings(std::string unit, std::string_view query, std::map<std::string, std::string> defaults,
           std::vector<std::filesystem::path> folders);

  /// The settings that the unit has. To be called before a value is read; construct() does it. Throws Error if the query has
  /// another one, naming the closest.
  void declare(SettingList list);
  const SettingList& list() const { return list_; }

  /// The value of the setting `key`: from the query, else the scenario's default for all units, else the declared default.
  /// Throws Error for a value that is not allowed, one that is required and missing, and a setting that was not declared.
  std::string text(const std::string& key);
  long long integer(const std::string& key);
  bool boolean(const std::string& key);
  std::string choice(const std::string& key);
  /// The same of settings with a fallback_rule: `fallback` is what the rule gives.
  long long integer(const std::string& key, long long fallback);
  bool boolean(const std::string& key, bool fallback);
  /// The value of the setting as the query or the scenario gives it.
  std::optional<std::string> given(const std::string& key) const;

  /// Whether a unit uses the masses of its robot, or only its names and limits.
  enum class Masses { kUsed, kUnused };
  /// The robot that the setting `robot` names. Where masses are used, links whose inertia no body can have are an Error or,
  /// with the setting unphysical=warn, a warning. The definition is chosen by what a program links: robot_from_urdf.cpp beside
  /// this file reads robot_file(); an exported unit has only the robot that was packed with it, and needs no XML (fmu/).
  robot::RobotModel robot(Masses masses = Masses::kUsed);
  /// The robot as robot() last gave it, nullptr if it was not asked for.
  const std::shared_ptr<const robot::RobotModel>& robot_used() const { return robot_; }
  /// The robot that robot() gives in an exported unit.
  void set_robot(std::shared_ptr<const robot::RobotModel> robot) { robot_ = std::move(robot); }

  /// The scene that the setting `scene` names (models/scenes/<name>/scene.sdf, a path to an SDF file, or none), and in it the
  /// robots of the setting `robots`, left:lwr4,right:panda.urdf, or else the one of `robot` without a name, if there is one.
  /// Defined as robot() is.
  scene::Cell cell();
  /// The cell as cell() last gave it, nullptr if it was not asked for; and what it gives in an exported unit.
  const std::shared_ptr<const scene::Cell>& cell_used() const { return cell_; }
  void set_cell(std::shared_ptr<const scene::Cell> cell) { cell_ = std::move(cell); }

  /// The URDF of the robot that `key` names: a path to a file, or a robot's name, for which robots/<name>/robot.urdf is
  /// looked up. Throws Error that lists where it looked.
  std::filesystem::path robot_file(const std::string& key = "robot");
  /// The same for a robot that is named by `robot` itself; `hint` as below.
  std::filesystem::path robot_file(const std::string& robot, const std::string& hint);
  /// The file that `name` means: absolute, or relative to the first of the folders that has it. Throws Error as above,
  /// with `hint` after the file's name.
  std::filesystem::path file(const std::string& name, const std::string& hint = "") const;

  /// Something the user should know of, shown once after loading.
  void warn(std::string message) { warnings_.push_back(std::move(message)); }
  const std::vector<std::string>& warnings() const { return warnings_; }
  const std::string& unit() const { return unit_; }
  /// The settings given and the defaults used, as a query again, "link=inside&robot=lwr4", in alphabetical order.
  std::string query() const;
  /// Files given to the unit by robot_file(), the first folder of which may hold <unit>.ssv with start values.
  const std::vector<std::filesystem::path>& robot_files() const { return robot_files_; }
  /// Keys of the defaults that text() was asked for.
  const std::vector<std::string>& defaults_used() const { return defaults_used_; }
  /// Throws Error if the query has a setting that the unit did not read because of another setting.
  void check_all_used() const;

 private:
  const Setting& declared(const std::string& key, Setting::Kind kind) const;
  const std::string* lookup(const std::string& key);
  std::string value(const std::string& key, Setting::Kind kind, const std::string* fallback = nullptr);
  [[noreturn]] void fail_missing(const std::string& key) const;
  [[noreturn]] void refuse(const std::string& key, const std::string& value, const std::string& expected) const;

  std::string unit_;
  SettingList list_;
  std::map<std::string, std::string> query_;
  std::map<std::string, std::string> defaults_;
  std::vector<std::filesystem::path> folders_;
  std::vector<std::string> asked_;
  std::vector<std::string> defaults_used_;
  std::vector<std::string> warnings_;
  std::vector<std::filesystem::path> robot_files_;
  std::shared_ptr<const robot::RobotModel> robot_;
  std::shared_ptr<const scene::Cell> cell_;
};

/// `text` as a setting's name or value in a query: %, &, = and control characters as %-escapes.
std::string escape_setting(std::string_view text);

}  // namespace cotwin
