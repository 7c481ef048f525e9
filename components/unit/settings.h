#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/setting_list.h"
#include "models/foundation/support/error.h"

namespace cotwin::robot {
struct RobotModel;
}
namespace cotwin::scene {
struct Cell;
}

namespace cotwin {

class FileStore;

/// A required setting is missing.
class MissingSetting : public Error {
 public:
  using Error::Error;
};

/// The values from which a unit is constructed: the settings of its source, `unit:drive_train?robot=lwr4`, the scenario's
/// defaults for all units, and the folders with named data. Settings choose the layout (number of joints) and the method; all
/// else is a parameter.
class Settings {
 public:
  /// `unit`: name of the unit, for messages; `query`: "a=1&b=x" with %-escapes, or ""; `defaults`: those of the scenario;
  /// `folders`: searched in this order for relative paths and robots/…; `models`: keeps what is read, of any run with these folders.
  Settings(std::string unit, std::string_view query, std::map<std::string, std::string> defaults,
           std::vector<std::filesystem::path> folders, std::shared_ptr<FileStore> models = nullptr);

  /// Sets the list of the unit's settings. construct() calls it before a value is read. Throws Error with the closest name if
  /// the query has a setting that is not in the list.
  void declare(SettingList list);
  const SettingList& list() const { return list_; }

  /// The value of the setting `key`: from the query, else the scenario's default for all units, else the declared default.
  /// Throws Error for a value that is not allowed, a missing required value and a setting that was not declared.
  std::string text(const std::string& key);
  long long integer(const std::string& key);
  bool boolean(const std::string& key);
  std::string choice(const std::string& key);
  /// The same for settings with a fallback_rule: `fallback` is the result of the rule.
  long long integer(const std::string& key, long long fallback);
  bool boolean(const std::string& key, bool fallback);
  /// The value of the setting in the query or the scenario, if it is given.
  std::optional<std::string> given(const std::string& key) const;

  /// Whether the unit uses the masses of its robot, or only names and limits.
  enum class Masses { kUsed, kUnused };
  /// The robot of the setting `robot`, with the joints of `lock` locked and those of `passive` without a motor. If masses are
  /// used, an inertia that no body can have is an Error or, with another `unphysical`, a warning. There are two definitions, chosen at link time: robot_from_urdf.cpp beside this file reads
  /// robot_file(); an exported unit uses the robot that was packed with it, without XML (fmu/).
  robot::RobotModel robot(Masses masses = Masses::kUsed);
  /// The last result of robot(); nullptr if it was not called.
  const std::shared_ptr<const robot::RobotModel>& robot_used() const { return robot_; }
  /// Sets the robot that robot() returns in an exported unit.
  void set_robot(std::shared_ptr<const robot::RobotModel> robot) { robot_ = std::move(robot); }

  /// The scene that the setting `scene` names (models/scenes/<name>/scene.sdf, a path to an SDF file, or none), and in it the
  /// robots of the setting `robots`, left:lwr4,right:panda.urdf, or else the robot of `robot`, if given, without a name. Two
  /// definitions, as for robot().
  scene::Cell cell();
  /// The last result of cell(), nullptr if it was not called; and the cell that cell() returns in an exported unit.
  const std::shared_ptr<const scene::Cell>& cell_used() const { return cell_; }
  void set_cell(std::shared_ptr<const scene::Cell> cell) { cell_ = std::move(cell); }

  /// The robots of the last cell(), or else the robot of the last robot().
  std::vector<std::shared_ptr<const robot::RobotModel>> robots_used() const;

  /// The URDF file of the robot in the setting `key`: a path, or the name of a robot, whose robots/<name>/robot.urdf is
  /// searched. Throws Error that lists the searched places.
  std::filesystem::path robot_file(const std::string& key = "robot");
  /// The same for `robot` itself; `hint` as below.
  std::filesystem::path robot_file(const std::string& robot, const std::string& hint);
  /// The file `name`: absolute, or relative to the first folder that has it. Throws Error as above, with `hint` after the name
  /// of the file.
  std::filesystem::path file(const std::string& name, const std::string& hint = "") const;
  /// The file of the setting `scene`; empty for none. Throws Error as above.
  std::filesystem::path scene_file();

  /// The same for a file that is the value of a setting, or part of it, after a comma or a colon, as in slaves=EK1100,door:EL1004.bin. An
  /// exported unit takes it along.
  std::filesystem::path data_file(const std::string& name);
  struct DataFile {
    std::string name;  // in the setting
    std::filesystem::path path;
  };
  /// The results of data_file().
  const std::vector<DataFile>& data_files() const { return data_files_; }
  /// Replaces the names of such files in query(), from their names to new ones.
  void rename_data_files(const std::map<std::string, std::string>& names);

  /// Adds a warning, shown once after loading.
  void warn(std::string message) { warnings_.push_back(std::move(message)); }
  const std::vector<std::string>& warnings() const { return warnings_; }
  const std::string& unit() const { return unit_; }
  FileStore* models() const { return models_.get(); }  // may be nullptr
  /// The given settings and the used defaults of the scenario as a query, "link_side=inside&robot=lwr4", in alphabetical order.
  std::string query() const;
  /// The results of robot_file(). The folder of a robot may have a file <unit>.ssv with start values.
  const std::vector<std::filesystem::path>& robot_files() const { return robot_files_; }
  /// Keys of the defaults that were used.
  const std::vector<std::string>& defaults_used() const { return defaults_used_; }
  /// Throws Error if the query has a setting without effect: the unit did not read it because of another setting.
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
  std::shared_ptr<FileStore> models_;
  std::vector<std::string> asked_;
  std::vector<std::string> defaults_used_;
  std::vector<std::string> warnings_;
  std::vector<std::filesystem::path> robot_files_;
  std::vector<DataFile> data_files_;
  std::shared_ptr<const robot::RobotModel> robot_;
  std::shared_ptr<const scene::Cell> cell_;
};

/// Returns `text` with %, &, = and control characters as %-escapes, for a name or value in a query.
std::string escape_setting(std::string_view text);

}  // namespace cotwin
