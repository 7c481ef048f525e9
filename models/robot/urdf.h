#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// What load_urdf makes of links whose inertia no rigid body can have (missing, zero, negative, triangle inequality violated).
enum class Unphysical { kError, kWarn };

struct UrdfOptions {
  Unphysical unphysical = Unphysical::kError;
  std::string tip;  // only the chain from the root to this link; "" for the whole tree
};

/// Reads a URDF. Joints come depth-first, at each branch in the order of the file; frames in the order of the file's links, or
/// from the root to the tip. A limit of ±inf or ±1.7976931348623157e308, and an effort or velocity limit of 0, is no limit.
/// Meshes are not opened. Links that carry a moving mass must have a physical inertia; others (the base, frames without mass)
/// need none. Mimic, floating and planar joints are errors. Throws Error `file:line: link 'x': …`. With Unphysical::kWarn such
/// links are kept as they are and told of in `warnings`, like everything else that a reader of the file might have meant
/// differently. Nothing is printed.
RobotModel load_urdf(const std::filesystem::path& file, const UrdfOptions& options = {},
                     std::vector<std::string>* warnings = nullptr);
RobotModel parse_urdf(std::string_view xml, const std::string& place, const UrdfOptions& options = {},
                      std::vector<std::string>* warnings = nullptr);

/// Writes `robot` as a URDF that loads back to the same model to the last bit, all but its history: composite bodies as links,
/// other frames as massless links rigid on them. Two extensions, which other readers ignore: a rotation that no roll, pitch and
/// yaw give to the last bit is added as <origin R="…"/> (row by row), and a gravity other than (0, 0, −9.81) as <gravity
/// xyz="…"/>. Throws Error for a model that no URDF can carry: doubled names, joints that are not depth-first, a body without
/// its frame.
std::string to_urdf(const RobotModel& robot);

}  // namespace cotwin::robot
