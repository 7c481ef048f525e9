#pragma once
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"
#include "models/support/xml.h"

/// What the readers of SDF's elements share.
namespace cotwin::scene::sdf {

inline constexpr const char* kSpace = "urn:cotwin:scene:1";  // of our own elements

using Names = std::initializer_list<const char*>;
using Warn = std::function<void(const std::string& place, const std::string& what)>;

/// The only child of that name (and namespace), nullptr if there is none. Throws Error for two of them.
const xml::Element* only(const xml::Element& element, const char* name, const char* space = "");
/// The same, or Error.
const xml::Element& needed(const xml::Element& element, const char* name, const char* space = "");

/// What stands in an element. Throws Error for anything else, and for numbers that are not finite.
double number(const xml::Element& element);
std::vector<double> numbers(const xml::Element& element, std::size_t count);
Eigen::Vector3d vector(const xml::Element& element);
bool boolean(const xml::Element& element);
double number(const xml::Element& parent, const char* name, double fallback);
bool boolean(const xml::Element& parent, const char* name, bool fallback);

/// <pose>: x y z roll pitch yaw, or with rotation_format="quat_xyzw" x y z qx qy qz qw.
Pose pose(const xml::Element& element);
/// The pose of `parent`'s child <pose>, none is the identity. Of a child that is relative to another frame than its parent's:
/// Error.
Pose own_pose(const xml::Element& parent);

/// Warns of every child that is neither understood nor without meaning for bodies that touch (`silent`); of our namespace's
/// children only `ours` are allowed.
void check_children(const xml::Element& element, Names understood, Names silent, Names ours, const Warn& warn);

}  // namespace cotwin::scene::sdf
