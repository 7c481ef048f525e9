#pragma once
#include <string>

#include "models/robot/urdf/urdf.h"

namespace cotwin {

/// Adds to `options` the entries of the settings `lock` and `passive` for a robot: those whose names begin with `robot` and a
/// slash, or all where `robot` is "". Throws Error `place: lock=…` for an entry that is not joint:position.
void read_joint_settings(const std::string& place, const std::string& robot, const std::string& lock,
                         const std::string& passive, robot::UrdfOptions& options);

/// Throws Error for an entry of the settings that names a robot not in `robots`, of a unit with several robots.
void check_joint_settings(const std::string& place, const std::set<std::string>& robots, const std::string& lock,
                          const std::string& passive);

}  // namespace cotwin
