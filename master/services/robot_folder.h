#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "components/services/robots.h"
#include "fmu/archive/archive.h"

namespace cotwin::master {

/// The folder of a robot as units read it: robot.urdf and <unit>.ssv beside it. It is the robot's own folder where that has this form;
/// else a temporary one with the model as it is in the services: of a URDF with another name, with locked joints, or without its
/// drives.
class RobotFolder {
 public:
  /// `rigid`: drive_train.ssv and compliance.ssv are left out. Throws Error for a robot that is not from a file, and for parameter sets
  /// that cannot be read or that describe the bodies of a robot with locked joints.
  RobotFolder(const services::Robot& robot, bool rigid);
  const std::filesystem::path& urdf() const { return urdf_; }
  bool has(const std::string& file) const;
  /// The message of an error with the robot's own folder in place of the temporary one.
  std::string in_own_folder(std::string message) const;

 private:
  std::filesystem::path own_, urdf_;
  std::optional<fmu::TemporaryFolder> copy_;
};

}  // namespace cotwin::master
