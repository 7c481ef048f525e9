#include "models/robot/urdf/urdf_words.h"

#include <tinyxml2.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <utility>

#include "models/foundation/support/text.h"
#include "models/robot/urdf/units.h"

namespace cotwin::robot::words {

namespace {

constexpr const char* kSprings = ": springs of joints are read from an SDF file in a contact world (scene=FILE.sdf)";

using tinyxml2::XMLElement;

bool has(std::string_view name, std::string_view part) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::search(name.begin(), name.end(), part.begin(), part.end(), [&](char a, char b) { return lower(a) == b; }) !=
         name.end();
}

bool is_spring(std::string_view name) {
  return has(name, "stiffness") || (has(name, "spring") && !has(name, "reference") && !has(name, "damp"));
}

/// Whether one of the numbers of a text is not 0.
bool is_not_zero(const char* written) {
  if (written == nullptr) return false;
  std::string blanks(written);
  std::ranges::replace_if(
      blanks, [](char c) { return c == '\t' || c == '\n' || c == '\r'; }, ' ');
  return std::ranges::any_of(text::split(blanks, ' '),
                             [](std::string_view word) { return text::parse_real(word).value_or(0) != 0; });
}

/// Whether an element with the name of a spring, or one in it, has a number that is not 0 and of no damper.
bool is_stiff(const XMLElement& element) {
  const auto counts = [](const char* name) { return !has(name, "reference") && !has(name, "damp"); };
  if (is_not_zero(element.GetText())) return true;
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next())
    if (counts(a->Name()) && is_not_zero(a->Value())) return true;
  for (const XMLElement* inner = element.FirstChildElement(); inner != nullptr; inner = inner->NextSiblingElement())
    if (counts(inner->Name()) && is_stiff(*inner)) return true;
  return false;
}

/// Whether numbers of an <origin> leave its frame where it is: zeros, or a quaternion of no rotation.
bool is_neutral(const char* written) {
  const std::string_view numbers = text::trim(written);
  return !is_not_zero(written) || numbers == "0 0 0 1" || numbers == "1 0 0 0";
}

/// What closes a loop of links in an element beside links and joints.
const XMLElement* loop_in(const XMLElement& element) {
  std::string_view kind = element.Name();
  kind = kind.substr(kind.find(':') + 1);
  const XMLElement* closing = kind == "loop_joint" || kind == "constraint" ? &element : nullptr;
  if (kind == "gazebo")
    for (const XMLElement* joint = element.FirstChildElement("joint"); joint != nullptr;
         joint = joint->NextSiblingElement("joint"))
      if (joint->FirstChildElement("parent") != nullptr && joint->FirstChildElement("child") != nullptr) closing = joint;
  return closing;
}

bool turns_off_gravity(const XMLElement& gazebo) {
  const auto is = [&](const char* name, bool value) {
    const XMLElement* const inner = gazebo.FirstChildElement(name);
    return inner != nullptr && inner->GetText() != nullptr && text::parse_boolean(inner->GetText()) == value;
  };
  return is("gravity", false) || is("turnGravityOff", true);
}

}  // namespace

std::string why_refused(const XMLElement& element, const std::string& name, bool is_attribute) {
  const std::string_view owner = element.Name();
  const XMLElement* const inner = is_attribute ? nullptr : element.FirstChildElement(name.c_str());
  const char* const written = is_attribute ? element.Attribute(name.c_str()) : inner != nullptr ? inner->GetText() : nullptr;
  if ((owner == "joint" || owner == "dynamics") && is_spring(name) &&
      (inner != nullptr ? is_stiff(*inner) : is_not_zero(written)))
    return kSprings;
  if ((name == "unit" || name == "units") && written != nullptr && !is_si_unit(written))
    return ": '" + std::string(written) + "' is no unit of SI";
  if (owner == "origin" && is_attribute && !is_neutral(written)) return ", and it moves the frame";
  return "";
}

std::string name_in_drives(const XMLElement& element, const std::string& name) {
  constexpr std::array<std::pair<std::string_view, const char*>, 7> kNames = {{{"armature", "B"},
                                                                               {"coulomb_friction", "tau_C"},
                                                                               {"mu_coulomb", "tau_C"},
                                                                               {"static_friction", "tau_S"},
                                                                               {"mu_viscous", "sigma2"},
                                                                               {"K", "K"},
                                                                               {"D", "D"}}};
  const auto found = std::ranges::find(kNames, name, &std::pair<std::string_view, const char*>::first);
  const char* const written = element.Attribute(name.c_str());
  if (std::string_view(element.Name()) != "dynamics" || found == kNames.end() || !is_not_zero(written)) return "";
  return "; " + std::string(written) + " is " + found->second + " in drive_train.ssv";
}

void read_others(const std::vector<XMLElement*>& elements, UrdfDocument& document) {
  std::set<std::string> weightless;
  int line = 0;
  for (const XMLElement* const element : elements) {
    if (const XMLElement* const closing = loop_in(*element)) {
      const char* const name = closing->Attribute("name");
      document.refused.push_back(
          {closing->GetLineNum(),
           std::string("<") + closing->Name() + ">" + (name != nullptr ? " '" + std::string(name) + "'" : "") +
               " closes a loop of links, which a URDF's tree cannot have: expected the mechanism as an SDF file in a "
               "contact world (scene=FILE.sdf), whose joints may close loops"});
    }
    const char* const written = element->Attribute("reference");
    if (element->Name() != std::string_view("gazebo") || written == nullptr) continue;
    const std::string reference = written;
    if (const auto joint = document.joints.find(reference); joint != document.joints.end() && joint->second.moves())
      for (const XMLElement* inner = element->FirstChildElement(); inner != nullptr; inner = inner->NextSiblingElement())
        if (is_spring(inner->Name()) && is_not_zero(inner->GetText()))
          document.refused.push_back(
              {inner->GetLineNum(), "joint '" + reference + "': '" + inner->Name() + "' in <gazebo> is not read" + kSprings});
    if (!document.links.contains(reference) || !turns_off_gravity(*element)) continue;
    if (weightless.empty()) line = element->GetLineNum();
    weightless.insert(reference);
  }
  if (weightless.empty()) return;
  document.warnings.push_back(document.at(line) + ": <gazebo> turns off gravity for " +
                              text::counted(static_cast<std::int64_t>(weightless.size()), "link") +
                              "; it acts on all of them here, as on the machine");
}

}  // namespace cotwin::robot::words
