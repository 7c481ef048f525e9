#include <utility>

#include "components/robot_files/joint_settings.h"
#include "components/unit/settings.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin {

robot::RobotModel Settings::robot(Masses masses) {
  robot::UrdfOptions options;
  std::vector<std::string> found;
  options.unphysical = masses == Masses::kUnused ? robot::Unphysical::kWarn : unphysical_of(choice("unphysical"));
  read_joint_settings("unit:" + unit_, "", text("lock"), text("passive"), options);
  robot_ = std::make_shared<const robot::RobotModel>(robot::load_urdf(robot_file(), options, &found));
  if (masses == Masses::kUsed) {
    for (std::string& warning : found) warn(std::move(warning));
  }
  return *robot_;
}

}  // namespace cotwin
