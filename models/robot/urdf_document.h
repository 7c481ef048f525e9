#pragma once
#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "models/mechanics/pose.h"

namespace cotwin::robot {

/// A URDF's text, held against the rules before urdfdom reads it: urdfdom names no lines, and lets doubled elements, second
/// parents and separate cycles pass. What it does not need (shapes, materials, transmissions, extensions) is gone from
/// `cleaned`.
struct UrdfDocument {
  struct Link {
    std::size_t order = 0;  // in the file
    int line = 0;
    int inertial_line = 0;  // 0: no <inertial>
    Pose X_LI;              // <inertial><origin>: urdfdom keeps only a quaternion of it, which moves the last bits
  };
  struct Joint {
    std::size_t order = 0;
    int line = 0;
    std::string name, parent, child;
    Pose X_PJ;
  };

  std::string place;    // of the file, for messages
  std::string cleaned;  // for urdfdom: links with <inertial>, joints; numbers spelled alike, ±inf as ±kNoLimit
  std::vector<std::string> links_in_order;  // as in the file
  std::map<std::string, Link> links;
  std::map<std::string, Joint> joints;
  std::optional<Eigen::Vector3d> gravity;  // <gravity xyz="…"/> below <robot>: our extension, see to_urdf

  std::string at(int line) const { return place + ":" + std::to_string(line); }
};

/// Limits of this magnitude or more are no limits: readers of URDF, urdfdom among them, know no infinity, and files have
/// 1e16, 3.4e38 or 1.8e308 instead. No other number may be as large: products of such numbers may overflow.
extern const double kNoLimit;

/// Whether a link or joint can have this name: some text of at most 1000 bytes in UTF-8 without control characters.
bool is_urdf_name(std::string_view name);

/// Throws Error `place:line: link 'x': …`.
UrdfDocument read_urdf_document(std::string_view xml, const std::string& place);

/// One root, one parent for every other link, no cycle, or Error; read_urdf_document has done it.
void check_urdf_tree(const UrdfDocument& document);

}  // namespace cotwin::robot
