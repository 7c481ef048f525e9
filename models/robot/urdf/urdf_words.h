#pragma once
#include <string>
#include <vector>

#include "models/robot/urdf/urdf_document.h"

namespace tinyxml2 {
class XMLElement;
}

/// Words of a URDF that are not read: which of them make another machine of it.
namespace cotwin::robot::words {

/// Why an attribute, or a child, of an element that is read is refused though no known word is near, as the end of a sentence; "" if it need not be. Springs
/// of <joint> and <dynamics> that are not 0, units of measure other than SI, and numbers of an <origin> that are not 0.
std::string why_refused(const tinyxml2::XMLElement& element, const std::string& name, bool is_attribute);

/// What drive_train.ssv calls an attribute of <dynamics>, with its value: "; 0.5 is B in drive_train.ssv"; "" for others, and for 0.
std::string name_in_drives(const tinyxml2::XMLElement& element, const std::string& name);

/// Looks at the elements beside links and joints. What closes a loop of links (<loop_joint>, <constraint>, and in <gazebo> a <joint> that has a
/// parent and a child) and springs of joints in <gazebo> are refused. That <gazebo> turns off the gravity of links is a warning: it is a setting of a
/// simulator, and on the machine gravity acts.
void read_others(const std::vector<tinyxml2::XMLElement*>& elements, UrdfDocument& document);

}  // namespace cotwin::robot::words
