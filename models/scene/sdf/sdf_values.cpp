#include "models/scene/sdf/sdf_values.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/units.h"

namespace cotwin::scene::sdf {

const xml::Element* only(const xml::Element& element, const char* name, const char* space) {
  const xml::Element* found = nullptr;
  for (const xml::Element& c : element.children) {
    if (c.name != name || c.space != space) continue;
    if (found != nullptr) throw Error(c.place, "<" + c.name + "> twice in <" + element.name + ">");
    found = &c;
  }
  return found;
}

const xml::Element& required(const xml::Element& element, const char* name, const char* space) {
  if (const xml::Element* found = only(element, name, space)) return *found;
  throw Error(element.place, "<" + element.name + "> without <" + name + ">");
}

constexpr double kLargest = 1e20;  // products of larger numbers may overflow; 1e16 means "no limit" in SDF

std::vector<double> numbers(const xml::Element& element, std::size_t count) {
  std::vector<double> found;
  std::string blanks_alike = element.content;
  for (char& c : blanks_alike) {
    if (c == '\t' || c == '\n' || c == '\r') c = ' ';
  }
  for (const std::string_view word : text::split(blanks_alike, ' ')) {
    if (word.empty()) continue;
    const std::optional<double> value = text::parse_real(word);
    if (!value || !(std::abs(*value) <= kLargest)) {
      const bool large = value && std::isfinite(*value);
      throw Error(element.place,
                  "<" + element.name + ">: '" + std::string(word) + "', expected " +
                      (large ? "a magnitude of " + text::to_text(kLargest) + " at most" : std::string("a finite number")));
    }
    found.push_back(*value);
  }
  if (found.size() != count) {
    throw Error(element.place,
                "<" + element.name + "> of " + std::to_string(found.size()) + " numbers, expected " + std::to_string(count));
  }
  return found;
}

double number(const xml::Element& element) { return numbers(element, 1)[0]; }

double limit(const xml::Element& parent, const char* name, double none) {
  constexpr double kNone = 1e16;
  const xml::Element* found = only(parent, name);
  if (found == nullptr) return none;
  const std::optional<double> infinite = text::parse_real(found->content);
  if (infinite && std::isinf(*infinite) && *infinite == none) return none;
  const double value = number(*found);
  return std::abs(value) >= kNone && (value > 0) == (none > 0) ? none : value;
}

Eigen::Vector3d vector(const xml::Element& element) {
  const std::vector<double> v = numbers(element, 3);
  return {v[0], v[1], v[2]};
}

bool boolean(const xml::Element& element) {
  if (const std::optional<bool> truth = text::parse_boolean(element.content)) return *truth;
  throw Error(element.place, "<" + element.name + ">: '" + element.content + "', expected true or false");
}

double number(const xml::Element& parent, const char* name, double fallback) {
  const xml::Element* found = only(parent, name);
  return found != nullptr ? number(*found) : fallback;
}

bool boolean(const xml::Element& parent, const char* name, bool fallback) {
  const xml::Element* found = only(parent, name);
  return found != nullptr ? boolean(*found) : fallback;
}

Pose pose(const xml::Element& element) {
  if (element.content.empty()) return {};
  const bool quaternion = xml::choice<bool>(element, "rotation_format", {{"euler_rpy", false}, {"quat_xyzw", true}}, false);
  Pose X;
  if (quaternion) {
    const std::vector<double> v = numbers(element, 7);
    const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
    if (!(std::abs(q.norm() - 1) < 1e-6))
      throw Error(element.place, "<pose>: a quaternion of length " + text::to_text(q.norm(), 6) + ", expected 1");
    X.p = {v[0], v[1], v[2]};
    X.R = q.normalized().toRotationMatrix();
    return X;
  }
  const std::vector<double> v = numbers(element, 6);
  const double unit = xml::boolean(element, "degrees", false) ? M_PI / 180 : 1;
  X.p = {v[0], v[1], v[2]};
  X.R = rotation_from_rpy(unit * v[3], unit * v[4], unit * v[5]);
  return X;
}

Pose own_pose(const xml::Element& parent) {
  const xml::Element* found = only(parent, "pose");
  if (found == nullptr) return {};
  if (const std::string to = xml::text(*found, "relative_to", ""); !to.empty()) {
    throw Error(found->place, "<pose relative_to=\"" + to + "\"> in <" + parent.name + ">, expected it relative to its link");
  }
  return pose(*found);
}

void check_children(const xml::Element& element, Names understood, Names silent, Names ours, const Warn& warn) {
  const auto among = [](Names names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const xml::Element& c : element.children) {
    if (c.space == kSpace) {
      if (!among(ours, c.name))
        throw Error(c.place,
                    xml::unknown("an element of '" + element.name + "' in " + kSpace, c.name, {ours.begin(), ours.end()}));
    } else if (c.space.empty() && !among(understood, c.name) && !among(silent, c.name)) {
      warn(c.place, "<" + c.name + "> in <" + element.name + "> is ignored");
    }
  }
}

void check_attributes(const xml::Element& element, const Warn& warn) {
  static const std::map<std::string, std::vector<std::string>> kRead{
      {"sdf", {"version"}},        {"world", {"name"}},       {"model", {"name", "canonical_link", "placement_frame"}},
      {"include", {"merge"}},      {"link", {"name"}},        {"frame", {"name", "attached_to"}},
      {"joint", {"name", "type"}}, {"collision", {"name"}},   {"pose", {"relative_to", "degrees", "rotation_format", "frame"}},
      {"inertial", {"auto"}},      {"xyz", {"expressed_in"}}, {"mimic", {"joint", "axis"}}};
  static const std::set<std::string> kOthers{
      "visual",  "light",   "sensor",          "plugin",     "gui",  "scene",
      "physics", "gripper", "projector",       "audio_sink", "road", "audio_source",
      "state",   "battery", "population",      "atmosphere", "wind", "spherical_coordinates",
      "texture", "blend",   "particle_emitter"};
  if (!element.space.empty() || kOthers.contains(element.name)) return;
  for (const char* name : {"unit", "units"})
    if (const std::string& unit = xml::text(element, name, ""); !robot::is_si_unit(unit))
      throw Error(element.place, "'" + std::string(name) + "' of <" + element.name + "> is '" + unit +
                                     "', expected numbers in SI, and no unit");
  const auto read = kRead.find(element.name);
  xml::check_attributes(element, read != kRead.end() ? read->second : std::vector<std::string>{},
                        [&](const std::string& place, const std::string& what) { warn(place, what + "; it is ignored"); });
  if (element.name == "pose" && !xml::text(element, "frame", "").empty())
    warn(element.place, "<pose frame=\"" + xml::text(element, "frame", "") +
                            "\">: the frame is not read, the pose is as without it; "
                            "expected relative_to (SDF 1.7)");
  for (const xml::Element& c : element.children) check_attributes(c, warn);
}

}  // namespace cotwin::scene::sdf
