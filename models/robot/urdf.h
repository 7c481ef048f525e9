#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Treatment of links with unphysical inertia (missing, zero, negative, triangle inequality violated).
enum class Unphysical { kError, kWarn };

struct UrdfOptions {
  Unphysical unphysical = Unphysical::kError;
  std::string tip;  // only the chain from the root to this link; "": the whole tree
};

/// Reads a URDF. Joints are in depth-first order, at each branch in the order of the file; frames in the order of the file's
/// links, or from the root to the tip. A limit of ±inf or ±1.7976931348623157e308, and an effort or velocity limit of 0, mean
/// no limit. Meshes are not opened. Links that carry a moving mass must have a physical inertia, others (the base, frames
/// without mass) need none. Mimic, floating and planar joints are errors. Throws Error `file:line: link 'x': …`.
/// Unphysical::kWarn keeps such links and adds them to `warnings`, like everything else that could be interpreted differently.
/// Prints nothing.
RobotModel load_urdf(const std::filesystem::path& file, const UrdfOptions& options = {},
                     std::vector<std::string>* warnings = nullptr);
RobotModel parse_urdf(std::string_view xml, const std::string& place, const UrdfOptions& options = {},
                      std::vector<std::string>* warnings = nullptr);

/// Writes `robot` as a URDF that loads as the same model to the last bit, except for its history: composite bodies as links,
/// other frames as massless links fixed to them. Two extensions, which other readers ignore: <origin R="…"/> (row by row) for
/// rotations that roll, pitch and yaw do not represent to the last bit, and <gravity xyz="…"/> for gravity other than (0, 0,
/// −9.81). Throws Error for a model that a URDF cannot represent: duplicate names, joints that are not depth-first, a body
/// without its frame.
std::string to_urdf(const RobotModel& robot);

}  // namespace cotwin::robot
