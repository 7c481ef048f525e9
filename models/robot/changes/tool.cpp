#include "models/robot/changes/tool.h"

#include "models/foundation/support/error.h"
#include "models/robot/urdf/units.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::robot {

Attachment parse_tool(std::string_view xml, const std::string& place, const std::string& name) {
  const RobotModel tool = parse_urdf(xml, place);
  if (const auto found = suspect_units(tool); !found.empty())
    throw Error(place, found.front().what + ", expected m and kg (" + found.front().units + "?)");
  if (tool.body_count() > 0)
    throw Error(place, "joint '" + tool.joint_of(0).name + "' of a tool moves, expected only fixed joints");
  Attachment part;
  part.name = name;
  part.inertia = tool.base.inertia;
  if (!part.inertia.is_nothing()) {
    if (const std::string why = part.inertia.unphysical(); !why.empty()) throw Error(place, "the tool has " + why);
  }
  for (const Frame& frame : tool.frames) {
    if (frame.name != tool.base.name) part.further.push_back({frame.name, frame.X_BF});
  }
  return part;
}

}  // namespace cotwin::robot
