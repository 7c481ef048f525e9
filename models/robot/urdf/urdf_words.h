#pragma once
#include <map>
#include <set>
#include <string>
#include <vector>

#include "models/robot/urdf/urdf_document.h"

namespace tinyxml2 {
class XMLElement;
}

/// Words of a URDF that are not read: which of them make another machine of it.
namespace cotwin::robot::words {

/// Whether one of the numbers of a text is not 0.
bool is_not_zero(const char* written);

/// Why an attribute, or a child, of an element that is read is refused though no known word is near, as the end of a sentence; "" if it need not be. Springs
/// of <joint> and <dynamics> that are not 0, units of measure other than SI, numbers of an <origin> that move it, and of a <mimic> other than 0 and 1.
std::string why_refused(const tinyxml2::XMLElement& element, const std::string& name, bool is_attribute);

/// Whether an attribute that was meant to be `meant` says what counts without it: an <origin> that moves nothing, a multiplier of 1, others of 0.
bool says_nothing(const tinyxml2::XMLElement& element, const std::string& name, const std::string& meant);

/// The UrdfUnits in which the named units of all masses and inertias ("mass": "g"; "" in SI or without one) are read; "" if there are none.
std::string urdf_units(const std::map<std::string, std::set<std::string>>& named);

/// What drive_train.ssv calls an attribute of <dynamics>, with its value: "; 0.5 is B in drive_train.ssv"; "" for others, and for 0.
std::string name_in_drives(const tinyxml2::XMLElement& element, const std::string& name);

/// Looks at the elements beside links and joints. What closes a loop of links (<loop_joint>, <constraint>, and in <gazebo> a <joint> that has a
/// parent and a child), springs of joints in <gazebo>, and units of all numbers other than SI are refused. That <gazebo> turns off the gravity of links is a warning: it is a setting of a
/// simulator, and on the machine gravity acts.
void read_others(const std::vector<tinyxml2::XMLElement*>& elements, UrdfDocument& document);

}  // namespace cotwin::robot::words
