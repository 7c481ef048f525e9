#include <set>
#include <utility>

#include "components/unit/joint_settings.h"
#include "components/unit/settings.h"
#include "models/robot/urdf.h"
#include "models/scene/cell.h"
#include "models/scene/sdf.h"
#include "models/scene/urdf_shapes.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin {

namespace fs = std::filesystem;

scene::Cell Settings::cell() {
  scene::Cell cell;
  std::vector<std::string> found;
  if (const std::string name = text("scene"); name != "none" && !name.empty()) {
    const bool is_path = name.find('/') != std::string::npos || fs::path(name).has_extension();
    const fs::path path = file(is_path ? name : "scenes/" + name + "/scene.sdf", " (another scene: --set scene=PATH.sdf)");
    cell.scene = scene::load(path, &found);
  } else {
    cell.scene.name = "none";
  }

  robot::UrdfOptions options;
  if (choice("unphysical") == "warn") options.unphysical = robot::Unphysical::kWarn;
  const auto place = [&](const std::string& name, const fs::path& urdf) {
    robot::UrdfOptions own = options;
    take_joint_settings("unit:" + unit_, name, text("lock"), text("passive"), own);
    scene::PlacedRobot robot{name, robot::load_urdf(urdf, own, &found), {}};
    robot.shapes = scene::shapes_of_urdf(urdf, robot.model, &found);
    cell.robots.push_back(std::move(robot));
  };
  // Settings of the source have priority over those of the scenario for all units.
  const bool one_given = query_.contains("robot");
  if (one_given && query_.contains("robots")) {
    throw Error("unit:" + unit_,
                "robot=" + text("robot") + " and robots=" + text("robots") + ", expected one of the two settings");
  }
  const std::string several = one_given ? "" : text("robots"), one = text("robot");
  if (!several.empty()) {
    std::set<std::string> names;
    for (const std::string_view entry : text::split(several, ',')) {
      const std::size_t colon = entry.find(':');
      if (colon == std::string_view::npos || colon == 0 || colon + 1 == entry.size()) {
        throw Error("unit:" + unit_, "robots=" + several + ", expected name:robot,name:robot as in left:lwr4,right:panda.urdf");
      }
      const std::string name(entry.substr(0, colon));
      if (!names.insert(name).second) throw Error("unit:" + unit_, "robots=" + several + ": '" + name + "' stands there twice");
      place(name, robot_file(std::string(entry.substr(colon + 1)), " (another robot: robots=" + name + ":PATH.urdf)"));
    }
    check_joint_settings("unit:" + unit_, names, text("lock"), text("passive"));
  } else if (!one.empty()) {
    place("", robot_file());
  }
  for (std::string& warning : found) warn(std::move(warning));
  cell_ = std::make_shared<const scene::Cell>(std::move(cell));
  return *cell_;
}

}  // namespace cotwin
