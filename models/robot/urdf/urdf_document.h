#pragma once
#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/urdf/urdf_name.h"

namespace cotwin::robot {

/// The text of a URDF, checked before urdfdom reads it: urdfdom reports no lines and accepts duplicate elements, second parents
/// and separate cycles. `cleaned` does not contain what is not needed (shapes, materials, transmissions, extensions).
struct UrdfDocument {
  struct UrdfLink {
    std::size_t order = 0;  // in the file
    int line = 0;
    int inertial_line = 0;  // 0: no <inertial>
    Pose X_LI;              // <inertial><origin>; urdfdom converts it to a quaternion, which changes the last bits
  };
  struct Joint {
    std::size_t order = 0;
    int line = 0;
    std::string name, parent, child;
    std::string type;  // revolute, continuous, prismatic or fixed
    Pose X_PJ;
    Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // of unit length
    std::string mimic;                                // joint that this one follows; "": none
    int mimic_line = 0;
    double multiplier = 1, offset = 0;
    bool passive = false;
    std::string negative;               // the limit that is negative and must not be; "": none
    double acceleration = 0, jerk = 0;  // limits (URDF 1.2), the smaller one of acceleration and deceleration; 0: none
    int limit_line = 0;

    bool moves() const { return type != "fixed"; }
  };

  std::string place;    // of the file, for messages
  std::string cleaned;  // for urdfdom: links with <inertial>, joints; numbers in one notation, ±inf as ±kNoLimit
  std::vector<std::string> links_in_order;  // as in the file
  std::map<std::string, UrdfLink> links;
  std::map<std::string, Joint> joints;
  std::optional<Eigen::Vector3d> gravity;  // <gravity xyz="…"/> in <robot>: an extension, see to_urdf
  bool is_si = false;                      // <si/> in <robot>, an extension: units.h does not look for other units of measure
  double largest_angle = 0;                // of all rpy, as written
  int largest_angle_line = 0;
  std::vector<std::string> warnings;  // what could be read differently, and words that are not read
  struct Refused {
    int line = 0;
    std::string what;
    std::string units = {};  // UrdfUnits that the word names, if they are those of all such numbers
  };
  std::vector<Refused> refused;  // words without which the machine is another one, see urdf_words.h

  std::string at(int line) const { return place + ":" + std::to_string(line); }
};

/// Limits of at least this magnitude mean no limit: readers of URDF such as urdfdom do not accept infinity, and files contain
/// 1e16, 3.4e38 or 1.8e308 instead. All other numbers must be smaller, because their products could overflow.
extern const double kNoLimit;

/// How a joint with <mimic> moves: q = multiplier · q_leader + offset, with `leader` at the end of the chain of mimics.
struct Following {
  std::string leader;  // ""; the joint stands still at `offset`
  double multiplier = 0;
  double offset = 0;
};

/// The mimics of `document` by name. `locked`: position of joints that do not move, rad or m. Adds to `warnings` what stands
/// still because of its leader or multiplier. Throws Error `place:line: joint 'x': …` for an unknown leader and for a cycle, and
/// for a locked joint that is unknown, fixed or a mimic at another position than its leader's gives.
std::map<std::string, Following> follow_mimics(const UrdfDocument& document, const std::map<std::string, double>& locked,
                                               std::vector<std::string>* warnings);

/// Fixed-axis roll, pitch, yaw of R. Roll is computed from R without yaw, so that the three agree with R near a pitch of ±90°
/// too.
Eigen::Vector3d rpy_of(const Eigen::Matrix3d& R);

/// The child link of a joint in the parent link, at the position q.
Pose origin_at(const UrdfDocument::Joint& joint, double q);

/// Throws Error `place:line: link 'x': …`.
UrdfDocument read_urdf_document(std::string_view xml, const std::string& place);

/// Throws Error unless there is one root, one parent for every other link, and no cycle. Called by read_urdf_document.
void check_urdf_tree(const UrdfDocument& document);

}  // namespace cotwin::robot
