#pragma once
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Treatment of links with unphysical inertia (missing, zero, negative, triangle inequality violated). kEstimate replaces it as
/// estimate.h describes.
enum class Unphysical { kError, kWarn, kEstimate };

/// The error of an unphysical inertia or a negative limit, which kEstimate cures.
class UnphysicalValue : public Error {
 public:
  using Error::Error;
};

struct UrdfOptions {
  Unphysical unphysical = Unphysical::kError;
  std::string tip;                            // only the chain from the root to this link; "": the whole tree
  std::map<std::string, double> locked = {};  // joints that stand still, by name, at these positions (rad, m)
  std::set<std::string> passive = {};         // names of joints without a motor
  bool ignore_words = false;                  // words without which the machine is another one are warnings
};

/// Takes the word of the setting `unphysical`: error, warn (which ignores words, too) or estimate.
void take_unphysical(std::string_view word, UrdfOptions& options);

/// Reads a URDF. Joints are in depth-first order, at each branch in the order of the file; frames in the order of the file's
/// links, or from the root to the tip. A limit of ±inf or ±1.7976931348623157e308, and an effort or velocity limit of 0, mean
/// no limit. Meshes are not opened. Links that carry a moving mass must have a physical inertia, others (the base, frames
/// without mass) need none.
///
/// Joints with <mimic> become RobotModel::mimics of the joint at the end of their chain of mimics. The leader takes over their
/// damping (times the multiplier squared) and friction (times its magnitude). Its limits hold for the group; those of the mimics
/// are not used. Locked joints, mimics of them and mimics with the multiplier 0 are read as fixed at their position, which
/// merges their bodies. <passive/> in a joint, an extension, means the same as an entry in `passive`.
///
/// Floating and planar joints, mimics of an unknown joint, of themselves or of a joint outside the chain, and xacro files are
/// errors. Throws Error `file:line: link 'x': …`. Unphysical::kWarn keeps links without a physical inertia and adds them to
/// `warnings`, like everything else that could be interpreted differently; with it and with kEstimate negative limits of effort
/// and speed mean no limit. An inertia is judged with all links that are fixed to it: a point mass is one. Words without which the machine is
/// another one (urdf_words.h) are errors whatever `unphysical` is. Prints nothing.
///
/// load_urdf throws Error if the numbers look like other units of measure than SI (units.h) and the file has no <si/>.
RobotModel load_urdf(const std::filesystem::path& file, const UrdfOptions& options = {},
                     std::vector<std::string>* warnings = nullptr);
RobotModel parse_urdf(std::string_view xml, const std::string& place, const UrdfOptions& options = {},
                      std::vector<std::string>* warnings = nullptr);

/// Writes `robot` as a URDF that loads as the same model to the last bit, except for its history and `locked`: composite bodies as links,
/// other frames as massless links fixed to them. Extensions, which other readers ignore: <origin R="…"/> (row by row) for
/// rotations that roll, pitch and yaw do not represent to the last bit, <gravity xyz="…"/> for gravity other than (0, 0,
/// −9.81), <passive/> for joints without a motor, and <si/> for numbers that units.h would not expect. Throws Error for a model that a URDF cannot represent: duplicate names, joints that are not depth-first, a body
/// without its frame.
std::string to_urdf(const RobotModel& robot);

}  // namespace cotwin::robot
