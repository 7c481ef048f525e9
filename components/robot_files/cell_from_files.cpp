#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "components/robot_files/joint_settings.h"
#include "components/robot_files/robot_files.h"
#include "components/unit/settings.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_store.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/cell.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin {

namespace fs = std::filesystem;

namespace {

/// Adds the shapes of the tools in the setting `tools` to the bodies that will carry them. A robot without the frame of a tool
/// does not get it.
void add_tools(const std::string& setting, scene::PlacedRobot& placed, const std::function<fs::path(const std::string&)>& find,
               std::vector<std::string>& warnings) {
  std::map<std::string, robot::Frame> frames;
  for (const robot::Frame& frame : placed.model.frames) frames[frame.name] = frame;
  for (const std::string_view item : text::split(setting, ';')) {
    if (text::trim(item).empty()) continue;
    const std::vector<std::string_view> parts = text::split(item, '|');
    std::vector<double> numbers;
    if (parts.size() == 5) {
      for (const std::size_t part : {2, 3}) {
        for (const std::string_view number : text::split(parts[part], ' ')) {
          if (number.empty()) continue;
          numbers.push_back(text::parse_real(number).value_or(std::numeric_limits<double>::quiet_NaN()));
        }
      }
    }
    if (numbers.size() != 6 || !std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); }))
      throw Error("tools=" + setting, "'" + std::string(item) + "', expected name|frame|x y z|roll pitch yaw|URDF");
    const std::string name(parts[0]);
    const auto parent = frames.find(std::string(parts[1]));
    if (parent == frames.end()) continue;
    const fs::path file = find(std::string(parts[4]));
    const robot::RobotModel tool = robot::load_urdf(file);
    const int body = parent->second.body;
    const Pose X_PA{rotation_from_rpy(numbers[3], numbers[4], numbers[5]), {numbers[0], numbers[1], numbers[2]}};
    const Pose X_BA = parent->second.X_BF * X_PA;
    for (const robot::Frame& frame : tool.frames) {
      const std::string& on_robot = frame.name == tool.base.name ? name : frame.name;
      frames[on_robot] = {on_robot, body, X_BA * frame.X_BF};
    }
    for (scene::Shape& shape : scene::shapes_of_tool(file, X_BA, &warnings)) {
      shape.tool = name;
      placed.shapes[static_cast<std::size_t>(body + 1)].push_back(std::move(shape));
    }
  }
}

/// A robot of a cell, and how its file is read.
struct RobotRequest {
  std::string name;
  fs::path urdf;
  std::string shapes;  // the choice of the setting
  robot::UrdfOptions options;
};

scene::PlacedRobot read_robot(const RobotRequest& request, const std::string& tools,
                              const std::function<fs::path(const std::string&)>& find, std::vector<std::string>& warnings) {
  scene::PlacedRobot placed{request.name, robot::load_urdf(request.urdf, request.options, &warnings), {}};
  if (request.shapes == "none") {
    placed.shapes.resize(placed.model.bodies.size() + 1);
  } else {
    placed.shapes =
        (request.shapes == "hulls" ? scene::hulls_of_urdf : scene::shapes_of_urdf)(request.urdf, placed.model, &warnings);
  }
  add_tools(tools, placed, find, warnings);
  return placed;
}

}  // namespace

scene::Cell Settings::cell() {
  const fs::path scene_file = this->scene_file();
  const std::string tools = text("tools"), reaction = choice("unphysical");
  std::vector<RobotRequest> requests;
  std::string key = kCellKey + text::joined({scene_file.string(), tools, reaction}, "\n");
  const auto place = [&](const std::string& name, const fs::path& urdf) {
    RobotRequest request{name, urdf, choice("robot_shapes"), {}};
    robot::take_unphysical(reaction, request.options);
    read_joint_settings("unit:" + unit_, name, text("lock"), text("passive"), request.options);
    key += "\n" + text::joined({name, urdf.string(), request.shapes, text("lock"), text("passive")}, "\n");
    requests.push_back(std::move(request));
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
  const auto found = read_once<FoundCell>(models_.get(), key, [&] {
    FoundCell made;
    if (scene_file.empty()) {
      made.cell.scene.name = "none";
    } else {
      made.cell.scene = scene::load(scene_file, &made.warnings);
    }
    const auto find = [this](const std::string& tool) { return file(tool); };
    for (const RobotRequest& request : requests) made.cell.robots.push_back(read_robot(request, tools, find, made.warnings));
    return made;
  });
  for (const std::string& warning : found->warnings) warn(warning);
  cell_ = {found, &found->cell};
  return *cell_;
}

}  // namespace cotwin
