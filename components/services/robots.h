#pragma once
#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "models/cloud/tree.h"
#include "models/energetics/books.h"
#include "models/robot/body_parts.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/robot_model.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/scene.h"

namespace cotwin::services {

/// What a file with data of a robot tells about them.
struct Provenance {
  std::string sources, assumed;    // texts; models/foundation/support/assumed.h
  std::vector<std::string> given;  // names of the parameters that the file has
  bool has(std::string_view name) const { return std::ranges::find(given, name) != given.end(); }
};

/// What a drive_train.ssv beside a URDF tells, see components/drive_train. What it does not have is the start value of the unit.
struct DriveData : robot::DriveParameters, Provenance {
  using robot::DriveParameters::DriveParameters;
  std::vector<std::size_t> without_B;  // joints of the file, from 0, whose motors it gives no inertia
};

/// What an energy.ssv beside a URDF tells, see components/energy.
struct EnergyData : Provenance {
  energetics::DriveLosses losses;
  energetics::Current current = energetics::Current::kDc;
  energetics::DcLink link;
  energetics::Supply supply;
  energetics::Standby standby;
};

/// The files with data of a robot that may stand beside its URDF.
inline constexpr const char *kDrivesFile = "drive_train.ssv", *kComplianceFile = "compliance.ssv", *kEnergyFile = "energy.ssv";
inline constexpr std::array<const char*, 3> kDataFiles = {kDrivesFile, kComplianceFile, kEnergyFile};

/// A robot with the data beside its URDF.
struct Robot {
  std::string name;
  std::filesystem::path urdf;  // empty: the model is not from a file
  robot::RobotModel model;
  Inertia base;                    // of the model's base without what locked joints add
  std::vector<std::string> notes;  // what the URDF reader warned of
  /// The joints of the model among the `file_joints` joints of the file, from 0; not set for a model that is not from a file.
  std::vector<std::size_t> joints_kept;
  std::size_t file_joints = 0;
  std::optional<DriveData> drives;     // drive_train.ssv
  std::optional<EnergyData> energy;    // energy.ssv
  std::vector<robot::BodyPart> parts;  // of persons

  /// The joints that have a motor whose inertia is not given, or given as 0.
  std::vector<std::size_t> unknown_motors() const;
};

/// Reads a URDF, and drive_train.ssv and energy.ssv in its folder, whatever the URDF's name.
/// Values per joint may be one for all joints, one per joint in one text, or single elements "K[3]"; of joints that are locked
/// nothing is left out, so the files count the joints of the unlocked robot. Values must be in the units of measure of
/// docs/reference (N.m/rad, for prismatic joints N/m). Throws Error, also for a name that the unit does not have.
Robot load_robot(const std::filesystem::path& urdf, const std::string& name, robot::UrdfOptions options = {});

/// Robots by name from folders, read once and again when a file has changed. Thread-safe.
class Robots {
 public:
  /// A robot is FOLDER/NAME/robot.urdf or FOLDER/NAME.urdf. The first folder that has it counts. `fallback`: robot of requests that
  /// name none; a path to a URDF, if it is one, or a name; "": none. `paths`: names may also be paths to URDF files. `people`: table
  /// of body parts; "": people/iso_ts_15066.csv beside one of the folders, if there is one. `options`: of all URDFs.
  explicit Robots(std::vector<std::filesystem::path> folders, std::string fallback = "", bool paths = false,
                  std::filesystem::path people = {}, robot::UrdfOptions options = {});

  /// Throws Error for a name with other characters than letters, digits, '_', '-' and '.', and for an unknown one, with the closest
  /// known name.
  std::shared_ptr<const Robot> find(const std::string& name, const std::map<std::string, double>& locked = {});
  /// All files that answers about a robot depend on, whether they are there or not: its URDF, kDataFiles beside it, and the table of
  /// body parts if there is one. Throws as find does.
  std::vector<std::filesystem::path> files_of(const std::string& name) const;
  /// The scene NAME: scenes/NAME/scene.sdf or scenes/NAME.sdf beside one of the folders; a path to an SDF file, if paths are allowed. `notes`: what
  /// its reader warned of. Throws Error.
  scene::Scene scene(const std::string& name, std::vector<std::string>& notes) const;
  /// The point cloud NAME: scenes/NAME/scene.pcd or scenes/NAME.pcd beside one of the folders; a path to a file, if paths are allowed. Read once and
  /// again when it has changed. Throws Error.
  std::shared_ptr<const cloud::Obstacle> cloud(const std::string& name, std::vector<std::string>& notes);
  /// The tool NAME: tools/NAME.urdf beside one of the folders; a path to a URDF, if paths are allowed: its mass and frames as the attachment
  /// `as`, and its shapes at X_BA of the body that carries it. Both throw Error.
  robot::Attachment tool(const std::string& name, const std::string& as) const;
  std::vector<scene::Shape> tool_shapes(const std::string& name, const Pose& X_BA, std::vector<std::string>& notes) const;
  /// All names in the folders, sorted.
  std::vector<std::string> names() const;
  const std::string& fallback() const { return fallback_; }

 private:
  using Times = std::vector<std::optional<std::filesystem::file_time_type>>;
  struct Kept {
    Times times;  // of files_of
    std::shared_ptr<const Robot> robot;
  };
  std::filesystem::path urdf_of(const std::string& name) const;
  std::filesystem::path tool_file(const std::string& name) const;

  std::vector<std::filesystem::path> folders_;
  std::string fallback_;
  bool paths_;
  std::filesystem::path people_;  // "": none
  robot::UrdfOptions options_;
  std::mutex mutex_;
  std::map<std::string, Kept> kept_;
  struct KeptCloud {
    std::filesystem::file_time_type time;
    std::shared_ptr<const cloud::Obstacle> cloud;
  };
  std::map<std::filesystem::path, KeptCloud> clouds_;
};

}  // namespace cotwin::services
