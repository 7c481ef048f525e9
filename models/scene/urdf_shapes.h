#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// The <collision> elements of a URDF's links as shapes of the bodies that load_urdf made of them: first the base's, then each
/// body's, in its frame. Boxes, spheres, cylinders, capsules (as newer URDFs have them), and meshes (.stl, .obj) as their
/// hulls; a mesh is looked for at its name and, for package://p/x, as x and p/x beside the URDF's folder and each folder above.
/// Links that `robot` does not have (a chain to a tip) are left out. What cannot be read is left out with a warning: a robot
/// moves without its shapes, too. Throws Error for shapes that are not even XML or numbers.
std::vector<std::vector<Shape>> shapes_of_urdf(const std::filesystem::path& file, const robot::RobotModel& robot,
                                               std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::scene
