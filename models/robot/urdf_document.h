#pragma once
#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "models/mechanics/pose.h"

namespace cotwin::robot {

/// The text of a URDF, checked before urdfdom reads it: urdfdom reports no lines and accepts duplicate elements, second parents
/// and separate cycles. `cleaned` does not contain what is not needed (shapes, materials, transmissions, extensions).
struct UrdfDocument {
  struct Link {
    std::size_t order = 0;  // in the file
    int line = 0;
    int inertial_line = 0;  // 0: no <inertial>
    Pose X_LI;              // <inertial><origin>; urdfdom converts it to a quaternion, which changes the last bits
  };
  struct Joint {
    std::size_t order = 0;
    int line = 0;
    std::string name, parent, child;
    Pose X_PJ;
  };

  std::string place;    // of the file, for messages
  std::string cleaned;  // for urdfdom: links with <inertial>, joints; numbers in one notation, ±inf as ±kNoLimit
  std::vector<std::string> links_in_order;  // as in the file
  std::map<std::string, Link> links;
  std::map<std::string, Joint> joints;
  std::optional<Eigen::Vector3d> gravity;  // <gravity xyz="…"/> in <robot>: an extension, see to_urdf

  std::string at(int line) const { return place + ":" + std::to_string(line); }
};

/// Limits of at least this magnitude mean no limit: readers of URDF such as urdfdom do not accept infinity, and files contain
/// 1e16, 3.4e38 or 1.8e308 instead. All other numbers must be smaller, because their products could overflow.
extern const double kNoLimit;

/// Whether a link or joint can have this name: 1 to 1000 bytes of UTF-8 without control characters.
bool is_urdf_name(std::string_view name);

/// Throws Error `place:line: link 'x': …`.
UrdfDocument read_urdf_document(std::string_view xml, const std::string& place);

/// Throws Error unless there is one root, one parent for every other link, and no cycle. Called by read_urdf_document.
void check_urdf_tree(const UrdfDocument& document);

}  // namespace cotwin::robot
