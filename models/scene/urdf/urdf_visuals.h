#pragma once
#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/robot_model.h"

namespace cotwin::scene {

enum class VisualType { kBox, kSphere, kCylinder, kCapsule, kMesh };

/// A visible piece of a robot's body, in its own frame S.
struct Visual {
  VisualType type = VisualType::kBox;
  Eigen::Vector3d size =
      Eigen::Vector3d::Zero();  // m; box: edge lengths; sphere: (radius, –, –); cylinder, capsule about S's z:
                                // (radius, length without the caps, –); mesh: factors on its coordinates
  std::filesystem::path mesh = {};
  std::optional<std::array<double, 4>> colour = {};  // red, green, blue, opacity, 0 to 1
  Pose X_BS = {};                                    // in the body's frame
};

/// Reads the <visual> elements of a URDF's links: first the base's, then those of each body that load_urdf() makes of the links. Colours are
/// those of <material>, also of materials that are defined at the root. Links that `robot` does not have are ignored; pieces that
/// cannot be read are ignored with a warning. Meshes are found as those of shapes_of_urdf() and not opened. Throws Error for invalid XML.
std::vector<std::vector<Visual>> visuals_of_urdf(const std::filesystem::path& file, const robot::RobotModel& robot,
                                                 std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::scene
