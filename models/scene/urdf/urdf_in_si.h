#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/robot/urdf/units.h"

namespace cotwin::scene {

/// The text of a URDF with all its numbers in SI, given that they are in `units`: origins, shapes, masses and inertias, limits of position
/// and speed, mimics. Effort limits and <dynamics> stay as they are. Meshes are scaled with the lengths, and named by absolute paths where
/// they are found, so that the text can be written anywhere. The mark <si/> is added (see load_urdf). The attributes `unit` of numbers in `units`
/// are removed; where "si" says otherwise than they do, a note tells it. Throws Error for invalid XML and numbers, for other units than "si" of a
/// file with that mark, and for numbers that the file names in SI and `units` do not; other faults are left to the readers and to robot::check_units.
std::string urdf_in_si(const std::filesystem::path& file, const robot::UrdfUnits& units,
                       std::vector<std::string>* notes = nullptr);

}  // namespace cotwin::scene
