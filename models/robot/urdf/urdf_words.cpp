#include "models/robot/urdf/urdf_words.h"

#include <tinyxml2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "models/foundation/support/error.h"
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

std::vector<double> numbers_in(const char* written) {
  std::string blanks(written != nullptr ? written : "");
  std::ranges::replace_if(
      blanks, [](char c) { return c == '\t' || c == '\n' || c == '\r'; }, ' ');
  std::vector<double> numbers;
  for (const std::string_view word : text::split(blanks, ' '))
    if (const std::optional<double> number = text::parse_real(word)) numbers.push_back(*number);
  return numbers;
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

/// Whether an attribute of an <origin> leaves its frame where it is: zeros, a quaternion of no rotation, a factor of 1, or a name.
bool moves_nothing(const std::string& name, const char* written) {
  const std::vector<double> numbers = numbers_in(written);
  if (has(name, "scale")) return std::ranges::all_of(numbers, [](double factor) { return factor == 1; });
  const std::size_t w = numbers.size() != 4 ? numbers.size() : has(name, "wxyz") ? 0 : 3;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    if (i == w ? std::abs(numbers[i]) != 1 : numbers[i] != 0) return name == "id";
  return true;
}

/// The spring of a joint in an element of <gazebo>: its name and line. Stops and surfaces have stiffnesses of their own.
std::optional<std::pair<std::string, int>> spring_in(const XMLElement& element) {
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next())
    if (is_spring(a->Name()) && is_not_zero(a->Value())) return {{a->Name(), element.GetLineNum()}};
  for (const XMLElement* inner = element.FirstChildElement(); inner != nullptr; inner = inner->NextSiblingElement()) {
    const std::string_view name = inner->Name();
    if (name == "limit" || name == "contact" || name == "surface" || name == "sensor") continue;
    if (is_spring(name) && is_stiff(*inner)) return {{inner->Name(), inner->GetLineNum()}};
    if (auto found = spring_in(*inner)) return found;
  }
  return std::nullopt;
}

/// A unit of measure other than SI in an element for the units of all numbers, as an attribute or as its text; "" if there is none.
std::string foreign_unit(const XMLElement& element) {
  std::vector<const char*> words{element.GetText() != nullptr ? element.GetText() : ""};
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) words.push_back(a->Value());
  const auto found = std::ranges::find_if(words, [](const char* word) { return !is_si_unit(word); });
  return found != words.end() ? *found : "";
}

/// What closes a loop of links in an element beside links and joints.
const XMLElement* loop_in(const XMLElement& element) {
  std::string_view kind = element.Name();
  kind = kind.substr(kind.find(':') + 1);
  const XMLElement* closing = has(kind, "loop") || kind == "constraint" ? &element : nullptr;
  if (kind == "gazebo")
    for (const XMLElement* joint = element.FirstChildElement("joint"); joint != nullptr;
         joint = joint->NextSiblingElement("joint"))
      if (joint->FirstChildElement("parent") != nullptr && joint->FirstChildElement("child") != nullptr) closing = joint;
  return closing;
}

bool turns_off_gravity(const XMLElement& gazebo) {
  const auto is = [&](const char* name, std::string_view word, double number) {
    const XMLElement* const inner = gazebo.FirstChildElement(name);
    const std::string_view written = text::trim(inner != nullptr && inner->GetText() != nullptr ? inner->GetText() : "");
    return (written.size() == word.size() && has(written, word)) || text::parse_real(written) == number;
  };
  return is("gravity", "false", 0) || is("turnGravityOff", "true", 1);
}

}  // namespace

bool is_not_zero(const char* written) {
  return std::ranges::any_of(numbers_in(written), [](double number) { return number != 0; });
}

std::string why_refused(const XMLElement& element, const std::string& name, bool is_attribute) {
  const std::string_view owner = element.Name();
  const XMLElement* const inner = is_attribute ? nullptr : element.FirstChildElement(name.c_str());
  const char* const written = is_attribute ? element.Attribute(name.c_str()) : inner != nullptr ? inner->GetText() : nullptr;
  if ((owner == "joint" || owner == "dynamics") && is_spring(name) &&
      (inner != nullptr ? is_stiff(*inner) : is_not_zero(written)))
    return kSprings;
  if (has(name, "unit") && written != nullptr && !is_si_unit(written))
    return ": '" + std::string(written) + "' is no unit of SI";
  if (owner == "origin" && is_attribute && !moves_nothing(name, written)) return ", and it moves the frame";
  if (owner == "mimic" && is_attribute &&
      std::ranges::any_of(numbers_in(written), [](double number) { return number != 0 && number != 1; }))
    return ", and it moves the joint";
  return "";
}

bool says_nothing(const XMLElement& element, const std::string& name, const std::string& meant) {
  const std::string_view owner = element.Name();
  const char* const written = element.Attribute(name.c_str());
  if (written == nullptr || meant == name) return false;
  if (owner == "origin") return moves_nothing(name, written);
  return (owner == "mimic" || owner == "dynamics") && text::parse_real(written) == (meant == "multiplier" ? 1 : 0);
}

std::string urdf_units(const std::map<std::string, std::set<std::string>>& named) {
  std::string units;
  for (const auto& [quantity, words] : named) {
    if (words.size() != 1) return "";
    const std::string& word = *words.begin();
    text::append(units, quantity + "=" + (!word.empty() ? word : quantity == "mass" ? "kg" : "kg.m2"), ",");
  }
  try {
    return parse_urdf_units(units, "").text;
  } catch (const Error&) {  // a unit that is not known
    return "";
  }
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
    if (const std::string unit = has(element->Name(), "unit") ? foreign_unit(*element) : ""; !unit.empty())
      document.refused.push_back({element->GetLineNum(), std::string("'") + element->Name() + "' in <robot> is not read: '" +
                                                             unit + "' is no unit of SI"});
    const char* const written = element->Attribute("reference");
    if (element->Name() != std::string_view("gazebo") || written == nullptr) continue;
    const std::string reference(text::trim(written));
    if (const auto joint = document.joints.find(reference); joint != document.joints.end() && joint->second.moves())
      if (const auto spring = spring_in(*element))
        document.refused.push_back(
            {spring->second, "joint '" + reference + "': '" + spring->first + "' in <gazebo> is not read" + kSprings});
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
