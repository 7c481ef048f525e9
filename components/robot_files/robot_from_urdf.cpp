#include <utility>

#include "components/robot_files/joint_settings.h"
#include "components/robot_files/robot_files.h"
#include "components/unit/settings.h"
#include "models/foundation/support/file_store.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin {

robot::RobotModel Settings::robot(Masses masses) {
  robot::UrdfOptions options;
  const std::string reaction = choice("unphysical"), locked = text("lock"), passive = text("passive");
  robot::take_unphysical(reaction, options);
  if (masses == Masses::kUnused) options.unphysical = robot::Unphysical::kWarn;
  read_joint_settings("unit:" + unit_, "", locked, passive, options);
  const std::filesystem::path file = robot_file();
  const std::string key =
      kRobotKey + text::joined({file.string(), reaction, masses == Masses::kUnused ? "unused" : "", locked, passive}, "\n");
  const auto found = read_once<FoundRobot>(models_.get(), key, [&] {
    FoundRobot made;
    made.model = robot::load_urdf(file, options, &made.warnings);
    return made;
  });
  robot_ = {found, &found->model};
  if (masses == Masses::kUsed) {
    for (const std::string& warning : found->warnings) warn(warning);
  }
  return *robot_;
}

}  // namespace cotwin
