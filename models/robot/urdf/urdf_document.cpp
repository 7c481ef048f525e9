#include "models/robot/urdf/urdf_document.h"

#include <tinyxml2.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <set>

#include "models/foundation/formats/xml.h"
#include "models/foundation/formats/xml_reason.h"
#include "models/foundation/formats/xml_text.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/units.h"
#include "models/robot/urdf/urdf_words.h"

namespace cotwin::robot {

const double kNoLimit = 1e15;

namespace {

using tinyxml2::XMLElement;
using Names = std::initializer_list<std::string_view>;

/// More than any realistic robot has; urdfdom frees a chain of links by recursion.
constexpr std::size_t kMostLinks = 2000;
/// More than any element has; the time of tinyxml2 grows with the square of their number.
constexpr std::size_t kMostAttributes = 1000;
constexpr double kUnitQuaternion = 1e-3;  // tolerance of the length

bool contains(const Names& names, std::string_view name) { return std::find(names.begin(), names.end(), name) != names.end(); }

std::vector<std::string_view> words(std::string_view s) {
  const std::string_view blanks = " \t\r\n";
  std::vector<std::string_view> found;
  for (std::size_t begin = s.find_first_not_of(blanks); begin != std::string_view::npos;) {
    const std::size_t end = std::min(s.find_first_of(blanks, begin), s.size());
    found.push_back(s.substr(begin, end - begin));
    begin = s.find_first_not_of(blanks, end);
  }
  return found;
}

constexpr const char* kExpand = "expand it first: xacro FILE > robot.urdf (ROS package xacro, or pip install xacro)";

/// Finds elements of xacro.
class XacroFinder : public tinyxml2::XMLVisitor {
 public:
  int line = 0;
  bool VisitEnter(const XMLElement& element, const tinyxml2::XMLAttribute*) override {
    if (line == 0 && std::string_view(element.Name()).substr(0, 6) == "xacro:") line = element.GetLineNum();
    return line == 0;
  }
};

class Reader {
 public:
  explicit Reader(const std::string& place) { document_.place = place; }

  UrdfDocument read(std::string_view xml);

 private:
  [[noreturn]] void fail(int line, const std::string& what) const {
    throw Error(document_.at(line), (owner_.empty() ? "" : owner_ + ": ") + what);
  }

  void keep_attributes(XMLElement& element, const Names& names);
  void keep_measured(XMLElement& element, const Names& names);
  void keep_children(XMLElement& element, const Names& names, const Names& others = {});
  void tell_unknown(const XMLElement& element, const std::string& name, int line, bool is_attribute,
                    const std::vector<std::string>& known);
  XMLElement* child(XMLElement& element, const char* name) const { return element.FirstChildElement(name); }
  XMLElement& required(XMLElement& element, const char* name) const;
  std::string name_in(const XMLElement& element, const char* attribute) const;
  double number(std::string_view word, const XMLElement& element, const char* attribute) const;
  double real(XMLElement& element, const char* attribute) const;
  std::vector<double> reals(XMLElement& element, const char* attribute, std::size_t count) const;
  Eigen::Vector3d vector(XMLElement& element, const char* attribute) const;
  Pose origin(XMLElement& parent);
  void limits(XMLElement& element, UrdfDocument::Joint& joint);

  /// Names a link or joint in messages, if its name is one.
  void begin(const XMLElement& element) {
    const char* const name = element.Attribute("name");
    owner_ = name != nullptr && is_urdf_name(name) && std::string_view(name).find('$') == std::string_view::npos
                 ? std::string(element.Name()) + " '" + name + "'"
                 : "";
  }
  void refuse(int line, const std::string& what) {
    document_.refused.push_back({line, (owner_.empty() ? "" : owner_ + ": ") + what});
  }
  void read_link(XMLElement& element);
  void read_joint(XMLElement& element);

  struct Unread {
    int line = 0, count = 0;
    std::string more = {};
  };
  void note(int line, const std::string& what, const std::string& more = "") {
    Unread& unread = unread_[what];
    if (unread.count++ == 0) unread.line = line;
    if (unread.more.empty()) unread.more = more;
  }
  UrdfDocument document_;
  std::string_view xml_;
  std::string owner_;                    // "link 'x'", for messages
  std::vector<std::string> attributes_;  // that the element has which was looked at last
  std::map<std::string, Unread> unread_;
  std::map<std::string, std::set<std::string>> units_;  // of "mass" and "inertia", see urdf_units()
};

/// Tells of an attribute or child that is not read. Names with a prefix, such as drake:acceleration, are of others.
void Reader::tell_unknown(const XMLElement& element, const std::string& name, int line, bool is_attribute,
                          const std::vector<std::string>& known) {
  if (name.find(':') != std::string::npos || name == "xmlns") return;
  const std::string owner = element.Name();
  const std::string near = text::closest(name, known);
  const std::string what = "'" + name + (is_attribute ? "' as an attribute of <" : "' in <") + owner + "> is not read";
  const std::string meant = near.empty()   ? ""
                            : near == name ? ", expected it as an attribute"
                                           : ", did you mean '" + near + "'?";
  const bool given =
      !near.empty() && (element.Attribute(near.c_str()) != nullptr || element.FirstChildElement(near.c_str()) != nullptr);
  const bool misspelled = !near.empty() && (!given || near == name) && owner != "robot" && owner != "link" &&
                          !words::says_nothing(element, name, near);
  const std::string reason = misspelled ? meant : words::why_refused(element, name, is_attribute);
  if (!reason.empty()) {
    refuse(line, what + reason);
  } else {
    note(line, what + meant, words::name_in_drives(element, name));
  }
}

/// Removes all other attributes.
void Reader::keep_attributes(XMLElement& element, const Names& names) {
  attributes_.assign(names.begin(), names.end());
  std::erase(attributes_, "R");  // no person writes it
  std::vector<std::string> foreign;
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string_view value = a->Value();
    if (!contains(names, a->Name())) {
      foreign.emplace_back(a->Name());
    } else if (value.find("${") != std::string_view::npos || value.find("$(") != std::string_view::npos) {
      fail(a->GetLineNum(), "'" + std::string(value) + "' is an expression of xacro, expected a URDF; " + kExpand);
    }
  }
  for (const std::string& name : foreign) {
    tell_unknown(element, name, element.GetLineNum(), true, attributes_);
    element.DeleteAttribute(name.c_str());
  }
}

/// Removes all children and other attributes of a mass or an inertia, whose unit may be the only fault.
void Reader::keep_measured(XMLElement& element, const Names& names) {
  const std::size_t refused = document_.refused.size();
  const char* const unit = element.Attribute(element.Attribute("unit") != nullptr ? "unit" : "units");
  const bool is_foreign = unit != nullptr && !is_si_unit(unit);
  units_[element.Name()].insert(is_foreign ? unit : "");
  keep_attributes(element, names);
  if (is_foreign && document_.refused.size() == refused + 1) document_.refused.back().units = element.Name();
  keep_children(element, {});
}

/// Removes all other children; `others` are read by others or not needed. Comes after keep_attributes(): a child may be meant as an attribute.
void Reader::keep_children(XMLElement& element, const Names& names, const Names& others) {
  std::set<std::string_view> seen;
  for (tinyxml2::XMLNode* node = element.FirstChild(); node != nullptr;) {
    tinyxml2::XMLNode* const next = node->NextSibling();
    XMLElement* const inner = node->ToElement();
    if (const tinyxml2::XMLText* const written = node->ToText(); written != nullptr && !text::trim(written->Value()).empty()) {
      const std::string what = std::string("text in <") + element.Name() + "> is not read";
      words::is_not_zero(written->Value()) ? refuse(node->GetLineNum(), what + ", expected attributes")
                                           : note(node->GetLineNum(), what);
    }
    if (inner == nullptr || !contains(names, inner->Name())) {
      if (inner != nullptr && !contains(others, inner->Name()))
        tell_unknown(element, inner->Name(), inner->GetLineNum(), false,
                     names.size() > 0 ? std::vector<std::string>(names.begin(), names.end()) : attributes_);
      element.DeleteChild(node);
    } else if (!seen.insert(inner->Name()).second) {
      fail(inner->GetLineNum(), std::string("<") + inner->Name() + "> more than once");
    }
    node = next;
  }
}

XMLElement& Reader::required(XMLElement& element, const char* name) const {
  XMLElement* const found = child(element, name);
  if (found == nullptr) fail(element.GetLineNum(), std::string("<") + element.Name() + "> without <" + name + ">");
  return *found;
}

std::string Reader::name_in(const XMLElement& element, const char* attribute) const {
  const char* const name = element.Attribute(attribute);
  if (name == nullptr) fail(element.GetLineNum(), std::string("<") + element.Name() + "> without '" + attribute + "'");
  if (!is_urdf_name(name)) {
    if (const std::string why = xml::why_not_utf8(name, xml_); !why.empty())
      fail(element.GetLineNum(), std::string("'") + attribute + "' of <" + element.Name() + ">: " + why);
    fail(element.GetLineNum(),
         std::string("'") + attribute + "' of <" + element.Name() + "> is empty, long or not plain text, expected a name");
  }
  return name;
}

double Reader::number(std::string_view word, const XMLElement& element, const char* attribute) const {
  const std::optional<double> value = text::parse_real(word);
  if (!value || std::isnan(*value)) {
    fail(element.GetLineNum(),
         std::string(attribute) + " '" + std::string(word) + "' of <" + element.Name() + ">, expected a number");
  }
  return *value;
}

/// Returns a finite number and rewrites it in the notation for urdfdom.
double Reader::real(XMLElement& element, const char* attribute) const { return reals(element, attribute, 1)[0]; }

std::vector<double> Reader::reals(XMLElement& element, const char* attribute, std::size_t count) const {
  const char* const written = element.Attribute(attribute);
  if (written == nullptr) fail(element.GetLineNum(), std::string("<") + element.Name() + "> without '" + attribute + "'");
  const std::vector<std::string_view> parts = words(written);
  if (parts.size() != count) {
    fail(element.GetLineNum(), std::string(attribute) + " of <" + element.Name() + "> has " + std::to_string(parts.size()) +
                                   " numbers, expected " + std::to_string(count));
  }
  std::vector<double> values;
  std::string spelled;
  for (const std::string_view part : parts) {
    values.push_back(number(part, element, attribute));
    if (std::abs(values.back()) >= kNoLimit) {  // products of larger numbers may overflow
      fail(element.GetLineNum(),
           std::string(attribute) + " '" + std::string(part) + "' of <" + element.Name() + ">, expected " +
               (std::isinf(values.back()) ? "a finite number" : "a magnitude below " + text::to_text(kNoLimit)));
    }
    if (!spelled.empty()) spelled += ' ';
    spelled += text::to_text(values.back());
  }
  element.SetAttribute(attribute, spelled.c_str());
  return values;
}

Eigen::Vector3d Reader::vector(XMLElement& element, const char* attribute) const {
  const std::vector<double> v = reals(element, attribute, 3);
  return {v[0], v[1], v[2]};
}

/// <origin>: xyz, rpy or (URDF 1.2) quat_xyzw, and R, which to_urdf adds if roll, pitch and yaw do not give the rotation to the last bit.
Pose Reader::origin(XMLElement& parent) {
  XMLElement* const element = child(parent, "origin");
  if (element == nullptr) return {};
  keep_attributes(*element, {"xyz", "rpy", "quat_xyzw", "R"});
  keep_children(*element, {});
  Pose X;
  if (element->Attribute("xyz") != nullptr) X.p = vector(*element, "xyz");
  if (element->Attribute("rpy") != nullptr) {
    const Eigen::Vector3d rpy = vector(*element, "rpy");
    if (const double largest = rpy.cwiseAbs().maxCoeff(); largest > document_.largest_angle) {
      document_.largest_angle = largest;
      document_.largest_angle_line = element->GetLineNum();
    }
    X.R = rotation_from_rpy(rpy[0], rpy[1], rpy[2]);
  }
  if (element->Attribute("quat_xyzw") != nullptr) {
    const std::vector<double> Q = reals(*element, "quat_xyzw", 4);
    if (element->Attribute("rpy") != nullptr)
      fail(element->GetLineNum(), "quat_xyzw of <origin> beside rpy, expected one of them");
    const Eigen::Quaterniond turned(Q[3], Q[0], Q[1], Q[2]);
    if (!(std::abs(turned.norm() - 1) < kUnitQuaternion))
      fail(element->GetLineNum(), "quat_xyzw of <origin> has the length " + text::to_text(turned.norm(), 6) + ", expected 1");
    X.R = turned.normalized().toRotationMatrix();
    element->DeleteAttribute("quat_xyzw");  // urdfdom's poses are not used
  }
  if (element->Attribute("R") != nullptr) {
    const std::vector<double> R = reals(*element, "R", 9);
    const Eigen::Matrix3d exact = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data());
    const double kAlike = 1e-7;  // above the tolerance of is_rotation; a larger difference means that one of the two was edited
    if (!is_rotation(exact)) fail(element->GetLineNum(), "R of <origin> is not a rotation matrix");
    if (!exact.isApprox(X.R, kAlike)) fail(element->GetLineNum(), "R and rpy of <origin> are different rotations");
    X.R = exact;
    element->DeleteAttribute("R");
  }
  return X;
}

/// <limit>: writes values beyond ±kNoLimit, which mean no limit, as ±kNoLimit.
void Reader::limits(XMLElement& element, UrdfDocument::Joint& joint) {
  XMLElement* const limit = child(element, "limit");
  if (limit == nullptr) {
    if (joint.type != "continuous") fail(element.GetLineNum(), "a " + joint.type + " joint needs a <limit>");
    return;
  }
  joint.limit_line = limit->GetLineNum();
  keep_attributes(*limit, {"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"});
  keep_children(*limit, {});
  for (const char* attribute : {"acceleration", "deceleration", "jerk"}) {
    if (limit->Attribute(attribute) == nullptr) continue;
    const double value = number(limit->Attribute(attribute), *limit, attribute);
    if (value < 0) joint.negative = attribute;
    double& to = attribute == std::string_view("jerk") ? joint.jerk : joint.acceleration;
    if (value > 0 && value < kNoLimit) to = to > 0 ? std::min(to, value) : value;
    limit->DeleteAttribute(attribute);  // urdfdom does not know it
  }
  const auto value_of = [&](const char* attribute, double missing) {
    const char* const written = limit->Attribute(attribute);
    const double value = written == nullptr ? missing : number(written, *limit, attribute);
    limit->SetAttribute(attribute, text::to_text(std::clamp(value, -kNoLimit, kNoLimit)).c_str());
    return value;
  };
  for (const char* attribute : {"effort", "velocity"}) {
    if (limit->Attribute(attribute) == nullptr) fail(limit->GetLineNum(), std::string("<limit> without '") + attribute + "'");
    if (value_of(attribute, 0) < 0) joint.negative = attribute;
  }
  const double lower = value_of("lower", 0), upper = value_of("upper", 0);  // default of URDF: 0
  if (lower > upper || lower >= kNoLimit || upper <= -kNoLimit) {
    fail(limit->GetLineNum(),
         "lower limit " + text::to_text(lower) + ", upper limit " + text::to_text(upper) + ", expected a range");
  }
}

void Reader::read_link(XMLElement& element) {
  begin(element);
  keep_attributes(element, {"name"});
  keep_children(element, {"inertial"}, {"visual", "collision"});
  owner_.clear();
  const std::string name = name_in(element, "name");
  owner_ = "link '" + name + "'";
  UrdfDocument::UrdfLink link;
  link.order = document_.links_in_order.size();
  link.line = element.GetLineNum();
  if (const auto other = document_.links.find(name); other != document_.links.end()) {
    fail(link.line, "already defined in line " + std::to_string(other->second.line));
  }
  if (link.order == kMostLinks) fail(link.line, "more than " + std::to_string(kMostLinks) + " links");
  if (XMLElement* const inertial = child(element, "inertial")) {
    keep_attributes(*inertial, {});
    keep_children(*inertial, {"origin", "mass", "inertia"});
    link.inertial_line = inertial->GetLineNum();
    link.X_LI = origin(*inertial);
    XMLElement& mass = required(*inertial, "mass");
    keep_measured(mass, {"value"});
    real(mass, "value");
    XMLElement& inertia = required(*inertial, "inertia");
    keep_measured(inertia, {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"});
    for (const char* moment : {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}) real(inertia, moment);
  }
  document_.links.emplace(name, link);
  document_.links_in_order.push_back(name);
}

void Reader::read_joint(XMLElement& element) {
  begin(element);
  keep_attributes(element, {"name", "type"});
  keep_children(element, {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "passive"});
  owner_.clear();
  const std::string name = name_in(element, "name");
  owner_ = "joint '" + name + "'";
  UrdfDocument::Joint joint;
  joint.name = name;
  joint.order = document_.joints.size();
  joint.line = element.GetLineNum();
  if (const auto other = document_.joints.find(name); other != document_.joints.end()) {
    fail(joint.line, "already defined in line " + std::to_string(other->second.line));
  }
  const std::string type = name_in(element, "type");
  if (!contains({"revolute", "continuous", "prismatic", "fixed"}, type)) {
    fail(joint.line, "type '" + type + "', expected revolute, continuous, prismatic or fixed");
  }
  joint.type = type;
  if (XMLElement* const mimic = child(element, "mimic")) {
    keep_attributes(*mimic, {"joint", "multiplier", "offset"});
    joint.mimic = name_in(*mimic, "joint");
    joint.mimic_line = mimic->GetLineNum();
    if (mimic->Attribute("multiplier") != nullptr) joint.multiplier = real(*mimic, "multiplier");
    if (mimic->Attribute("offset") != nullptr) joint.offset = real(*mimic, "offset");
    keep_children(*mimic, {});
    element.DeleteChild(mimic);
  }
  if (XMLElement* const passive = child(element, "passive")) {
    joint.passive = true;
    element.DeleteChild(passive);
  }
  for (const char* end : {"parent", "child"}) {
    XMLElement& link = required(element, end);
    keep_attributes(link, {"link"});
    keep_children(link, {});
    (end == std::string_view("parent") ? joint.parent : joint.child) = name_in(link, "link");
  }
  joint.X_PJ = origin(element);
  if (type == "fixed") {
    keep_children(element, {"origin", "parent", "child"}, {"axis", "limit", "dynamics"});
  } else {
    if (XMLElement* const axis = child(element, "axis")) {
      keep_attributes(*axis, {"xyz"});
      keep_children(*axis, {});
      const Eigen::Vector3d written = vector(*axis, "xyz");
      const double length = written.stableNorm();
      if (!(length > 1e-6 && std::isfinite(length))) {
        fail(axis->GetLineNum(), "axis of length " + text::to_text(length) + ", expected a unit vector");
      }
      const double kRounding = 8 * std::numeric_limits<double>::epsilon();  // keeps the bits of a unit vector of to_urdf
      joint.axis = std::abs(written.squaredNorm() - 1) <= kRounding ? written : written.stableNormalized();
    }
    limits(element, joint);
    if (XMLElement* const dynamics = child(element, "dynamics")) {
      keep_attributes(*dynamics, {"damping", "friction"});
      keep_children(*dynamics, {});
      for (const char* attribute : {"damping", "friction"}) {
        if (dynamics->Attribute(attribute) != nullptr && real(*dynamics, attribute) < 0) {
          fail(dynamics->GetLineNum(), std::string(attribute) + " of <dynamics> is negative");
        }
      }
      if (dynamics->FirstAttribute() == nullptr) element.DeleteChild(dynamics);  // urdfdom requires one of the two
    }
  }
  document_.joints.emplace(name, joint);
}

UrdfDocument Reader::read(std::string_view xml) {
  xml_ = xml;
  const std::string& place = document_.place;
  if (text::trim(xml).empty()) throw Error(place, "empty, expected a URDF");
  if (xml.find('\0') != std::string_view::npos) throw Error(place, xml::why_not_utf8(xml, xml));
  if (const std::size_t crowded = xml::first_tag_with_more_attributes(xml, kMostAttributes);
      crowded != std::string_view::npos) {
    const auto line = std::count(xml.begin(), xml.begin() + static_cast<std::ptrdiff_t>(crowded), '\n') + 1;
    throw Error(document_.at(static_cast<int>(line)),
                "an element with more than " + std::to_string(kMostAttributes) + " attributes, expected a URDF");
  }
  tinyxml2::XMLDocument parsed;
  if (parsed.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS) {
    throw Error(document_.at(parsed.ErrorLineNum()), "not well-formed XML: " + xml::reason(parsed));
  }
  XMLElement* const robot = parsed.RootElement();
  if (robot == nullptr) throw Error(place, "no XML element, expected <robot>");
  if (std::string_view(robot->Name()) != "robot") {
    throw Error(document_.at(robot->GetLineNum()), std::string("root element <") + robot->Name() + ">, expected <robot>");
  }
  XacroFinder xacro;
  parsed.Accept(&xacro);
  if (xacro.line != 0) throw Error(document_.at(xacro.line), std::string("an element of xacro, expected a URDF; ") + kExpand);

  keep_attributes(*robot, {"name", "version"});
  const char* const version = robot->Attribute("version");
  if (version != nullptr && (version == std::string_view("1.1") || version == std::string_view("1.2")))
    robot->DeleteAttribute("version");  // urdfdom refuses others than 1.0
  if (robot->Attribute("name") == nullptr) {
    const std::string stem = std::filesystem::path(place).stem().string();
    const std::string name = is_urdf_name(stem) ? stem : "robot";
    robot->SetAttribute("name", name.c_str());
    document_.warnings.push_back(document_.at(robot->GetLineNum()) + ": <robot> without 'name', called '" + name + "'");
  }
  name_in(*robot, "name");
  std::vector<XMLElement*> others;
  for (tinyxml2::XMLNode* node = robot->FirstChild(); node != nullptr;) {
    tinyxml2::XMLNode* const next = node->NextSibling();
    XMLElement* const element = node->ToElement();
    const std::string_view kind = element == nullptr ? "" : element->Name();
    if (kind == "link") {
      read_link(*element);
    } else if (kind == "joint") {
      read_joint(*element);
    } else if (element != nullptr) {
      owner_.clear();
      if (kind == "gravity" && element->Attribute("xyz") != nullptr) document_.gravity = vector(*element, "xyz");
      if (kind == "si") document_.is_si = true;
      others.push_back(element);  // may refer to links and joints that follow
      if (kind != "gravity" && kind != "si" && kind != "gazebo" && !text::closest(kind, {"link", "joint", "gazebo"}).empty())
        tell_unknown(*robot, std::string(kind), element->GetLineNum(), false, {"link", "joint", "gazebo"});
    } else {
      robot->DeleteChild(node);
    }
    node = next;
  }
  owner_.clear();
  if (document_.links.empty()) fail(robot->GetLineNum(), "a robot without links");
  words::read_others(others, document_);
  for (XMLElement* const other : others) robot->DeleteChild(other);
  const std::string units = words::urdf_units(units_);
  for (UrdfDocument::Refused& word : document_.refused)
    if (!word.units.empty()) word.units = units;
  for (const auto& [what, unread] : unread_)
    document_.warnings.push_back(document_.at(unread.line) + ": " + what +
                                 (unread.count > 1 ? " (" + std::to_string(unread.count) + " times)" : "") + unread.more);
  check_urdf_tree(document_);
  tinyxml2::XMLPrinter printer(nullptr, true);
  robot->Accept(&printer);
  document_.cleaned = printer.CStr();
  return std::move(document_);
}

}  // namespace

UrdfDocument read_urdf_document(std::string_view xml, const std::string& place) { return Reader(place).read(xml); }

}  // namespace cotwin::robot
