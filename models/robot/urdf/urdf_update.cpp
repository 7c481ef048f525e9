#include "models/robot/urdf/urdf_update.h"

#include <tinyxml2.h>

#include <map>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::robot {

namespace {

using tinyxml2::XMLElement;

std::string numbers(const Eigen::Vector3d& v) {
  return text::to_text(v.x()) + " " + text::to_text(v.y()) + " " + text::to_text(v.z());
}

void write_inertial(XMLElement& link, const Inertia& inertia) {
  while (XMLElement* old = link.FirstChildElement("inertial")) link.DeleteChild(old);
  tinyxml2::XMLDocument& document = *link.GetDocument();
  XMLElement* inertial = document.NewElement("inertial");
  link.InsertFirstChild(inertial);
  XMLElement* origin = inertial->InsertNewChildElement("origin");
  origin->SetAttribute("xyz", numbers(inertia.p_LC).c_str());
  origin->SetAttribute("rpy", "0 0 0");
  inertial->InsertNewChildElement("mass")->SetAttribute("value", text::to_text(inertia.mass).c_str());
  XMLElement* moments = inertial->InsertNewChildElement("inertia");
  const Eigen::Matrix3d& I = inertia.I_CC;
  const auto moment = [&](const char* name, int i, int j) { moments->SetAttribute(name, text::to_text(I(i, j)).c_str()); };
  moment("ixx", 0, 0);
  moment("ixy", 0, 1);
  moment("ixz", 0, 2);
  moment("iyy", 1, 1);
  moment("iyz", 1, 2);
  moment("izz", 2, 2);
}

void write_dynamics(XMLElement& joint, double damping, double friction) {
  XMLElement* dynamics = joint.FirstChildElement("dynamics");
  if (dynamics == nullptr) dynamics = joint.InsertNewChildElement("dynamics");
  dynamics->SetAttribute("damping", text::to_text(damping).c_str());
  dynamics->SetAttribute("friction", text::to_text(friction).c_str());
}

/// Makes `joint` a fixed one that places its child at X_PC.
void fix(XMLElement& joint, const Pose& X_PC) {
  joint.SetAttribute("type", "fixed");
  for (const char* name : {"origin", "axis", "limit", "dynamics", "mimic", "passive"}) {
    while (XMLElement* old = joint.FirstChildElement(name)) joint.DeleteChild(old);
  }
  XMLElement* origin = joint.InsertNewChildElement("origin");
  const Eigen::Vector3d rpy = rpy_of(X_PC.R);
  origin->SetAttribute("xyz", numbers(X_PC.p).c_str());
  origin->SetAttribute("rpy", numbers(rpy).c_str());
  if (rotation_from_rpy(rpy.x(), rpy.y(), rpy.z()) == X_PC.R) return;
  std::string rows;
  for (int r = 0; r < 3; ++r) rows += (r > 0 ? " " : "") + numbers(X_PC.R.row(r).transpose());
  origin->SetAttribute("R", rows.c_str());
}

}  // namespace

std::string updated_urdf(std::string_view xml, const std::string& place, const RobotModel& robot) {
  UrdfOptions options;
  options.unphysical = Unphysical::kWarn;
  options.ignore_words = true;
  options.locked = robot.locked;
  std::vector<std::string> ignored;
  const RobotModel written = parse_urdf(xml, place, options, &ignored);
  tinyxml2::XMLDocument document;
  document.Parse(xml.data(), xml.size());
  std::map<std::string, XMLElement*> links, joints;
  XMLElement* root = document.FirstChildElement("robot");
  for (XMLElement* link = root->FirstChildElement("link"); link != nullptr; link = link->NextSiblingElement("link")) {
    links[link->Attribute("name")] = link;
  }
  for (XMLElement* joint = root->FirstChildElement("joint"); joint != nullptr; joint = joint->NextSiblingElement("joint")) {
    joints[joint->Attribute("name")] = joint;
  }
  for (std::size_t i = 0; i < robot.bodies.size(); ++i) {
    const Body& body = robot.bodies[i];
    if (i >= written.bodies.size() || written.bodies[i].name != body.name) {
      throw Error(place,
                  "has no link '" + body.name + "' as body " + std::to_string(i + 1) + ", expected the robot's own URDF");
    }
    if (i < robot.joints.size()) {
      const Joint &now = robot.joints[i], &then = written.joints[i];
      if (now.passive && !then.passive) joints.at(now.name)->InsertNewChildElement("passive");
      if (now.damping != then.damping || now.friction != then.friction) {
        write_dynamics(*joints.at(now.name), now.damping, now.friction);
        for (const Mimic& mimic : written.mimics) {  // its share is in that of the leader
          if (mimic.leader == static_cast<int>(i)) write_dynamics(*joints.at(mimic.joint.name), 0, 0);
        }
      }
    }
    if (written.bodies[i].inertia == body.inertia) continue;
    write_inertial(*links.at(body.name), body.inertia);
    for (const Frame& frame : written.frames) {
      if (frame.body != static_cast<int>(i) || frame.name == body.name) continue;
      XMLElement& rigid = *links.at(frame.name);
      while (XMLElement* old = rigid.FirstChildElement("inertial")) rigid.DeleteChild(old);
    }
  }
  if (!robot.locked.empty()) {
    const UrdfDocument urdf = read_urdf_document(xml, place);
    for (const auto& [name, position] : robot.locked) fix(*joints.at(name), origin_at(urdf.joints.at(name), position));
  }
  tinyxml2::XMLPrinter printer;
  document.Print(&printer);
  return printer.CStr();
}

}  // namespace cotwin::robot
