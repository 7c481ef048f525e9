#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// Reads the <collision> elements of a URDF's links as shapes of the bodies that load_urdf() makes of the links: first the
/// base's, then each body's, in its frame. Supports boxes, spheres, cylinders, capsules (in newer URDFs), and meshes (.stl,
/// .obj, .dae) as their hulls. A mesh package://p/x is searched as x and p/x in the URDF's folder and every folder above. Links that
/// `robot` does not have (a chain to a tip) are ignored. Shapes that cannot be read or have a
/// length of 0 are ignored with a warning. Throws Error
/// for invalid XML and invalid numbers.
std::vector<std::vector<Shape>> shapes_of_urdf(const std::filesystem::path& file, const robot::RobotModel& robot,
                                               std::vector<std::string>* warnings = nullptr);

/// The same of the file with enclosing shapes beside a URDF: hulls.urdf beside robot.urdf, NAME_hulls.urdf beside NAME.urdf. Of links that it
/// does not have, and where there is no such file, the shapes are those of shapes_of_urdf().
std::vector<std::vector<Shape>> hulls_of_urdf(const std::filesystem::path& file, const robot::RobotModel& robot,
                                              std::vector<std::string>* warnings = nullptr);

/// The <collision> shapes of a tool whose joints are all fixed, with its root link at X_BA of the body that carries it. Throws Error as
/// shapes_of_urdf(), and for a tool with joints that move.
std::vector<Shape> shapes_of_tool(const std::filesystem::path& file, const Pose& X_BA,
                                  std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::scene
