#pragma once
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/formats/xml.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// Functions shared by the readers of SDF elements.
namespace cotwin::scene::sdf {

inline constexpr const char* kSpace = "urn:cotwin:scene:1";  // of cotwin's own elements

using Names = std::initializer_list<const char*>;
using Warn = std::function<void(const std::string& place, const std::string& what)>;

/// The only child of this name (and namespace), nullptr if there is none. Throws Error for more than one.
const xml::Element* only(const xml::Element& element, const char* name, const char* space = "");
/// As only(). Throws Error if there is none.
const xml::Element& required(const xml::Element& element, const char* name, const char* space = "");

/// Content of an element. Throws Error if it is invalid or not finite.
double number(const xml::Element& element);
/// The same of a child; it may be infinite. `none` if there is no child, and for what means no limit in SDF: a magnitude of 10¹⁶ or more.
double limit(const xml::Element& parent, const char* name, double none);
std::vector<double> numbers(const xml::Element& element, std::size_t count);
Eigen::Vector3d vector(const xml::Element& element);
bool boolean(const xml::Element& element);
double number(const xml::Element& parent, const char* name, double fallback);
bool boolean(const xml::Element& parent, const char* name, bool fallback);

/// <pose>: x y z roll pitch yaw, or with rotation_format="quat_xyzw" x y z qx qy qz qw.
Pose pose(const xml::Element& element);
/// Pose in the child <pose> of `parent`; identity if there is none. Throws Error if it is relative to a frame other than the
/// parent's.
Pose own_pose(const xml::Element& parent);

/// Warns of every child that is neither in `understood` nor in `silent` (irrelevant for contacts). Throws Error for children of
/// cotwin's namespace that are not in `ours`.
void check_children(const xml::Element& element, Names understood, Names silent, Names ours, const Warn& warn);
/// Warns of attributes that are not read, of an element and of those inside it that are read.
void check_attributes(const xml::Element& element, const Warn& warn);

}  // namespace cotwin::scene::sdf
