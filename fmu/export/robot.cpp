// Robot and cell of an exported unit come from its package. Replaces components/robot_files/robot_from_urdf.cpp and
// cell_from_files.cpp.
#include "components/unit/settings.h"
#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

namespace cotwin {

robot::RobotModel Settings::robot(Masses) {
  if (robot_ == nullptr) throw Error("unit:" + unit_, "needs a robot, but none was packed with it");
  return *robot_;
}

scene::Cell Settings::cell() {
  if (cell_ == nullptr) throw Error("unit:" + unit_, "needs a scene, but none was packed with it");
  return *cell_;
}

}  // namespace cotwin
