// The robot of an exported unit, in place of components/unit/robot_from_urdf.cpp.
#include "components/unit/settings.h"
#include "models/robot/robot_model.h"
#include "models/text/error.h"

namespace cotwin {

robot::RobotModel Settings::robot(Masses) {
  if (robot_ == nullptr) throw Error("unit:" + unit_, "needs a robot, but none was packed with it");
  return *robot_;
}

}  // namespace cotwin
