#pragma once
#include <string>
#include <string_view>

#include "models/robot/changes/attachment.h"

namespace cotwin::robot {

/// Reads a tool from a URDF whose joints are all fixed. The root link becomes the frame A of the attachment `name`, the inertias
/// of all links are added up in it, and the other links are its further frames, with their names of the file. The attachment is
/// not mounted yet: `parent` is empty and X_PA is the identity. Throws Error `file:line: …` for a malformed file, and `file: …`
/// for a joint that moves or an inertia that no body has. A tool without mass is allowed.
Attachment parse_tool(std::string_view xml, const std::string& place, const std::string& name);

}  // namespace cotwin::robot
