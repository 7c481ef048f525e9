#include <tinyxml2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/units.h"
#include "models/robot/urdf/urdf.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::robot {

Eigen::Vector3d rpy_of(const Eigen::Matrix3d& R) {
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double s = std::sin(yaw), c = std::cos(yaw);
  return {std::atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1)), std::atan2(-R(2, 0), c * R(0, 0) + s * R(1, 0)),
          yaw};
}

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

class Writer {
 public:
  explicit Writer(const RobotModel& robot) : robot_(robot) {}
  std::string write();

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error("robot '" + robot_.name + "'", what); }
  std::string number(double value) const {
    if (!std::isfinite(value)) fail("a number is not finite, which a URDF cannot represent");
    return text::to_text(value + 0.0);  // converts −0 to 0
  }
  std::string numbers(const double* values, std::size_t count) const {
    std::string all;
    for (std::size_t i = 0; i < count; ++i) {
      if (i > 0) all += ' ';
      all += number(values[i]);
    }
    return all;
  }
  void attribute(const char* name, const std::string& value) { printer_.PushAttribute(name, value.c_str()); }
  void leaf(const char* name, const char* key, const std::string& value);
  void limit(const char* name, double value) { attribute(name, number(std::clamp(value, -kNoLimit, kNoLimit))); }

  void check() const;
  std::string name_of_body(int body) const {
    return body < 0 ? robot_.base.name : robot_.bodies[static_cast<std::size_t>(body)].name;
  }
  bool is_body(const Frame& frame) const { return frame.name == name_of_body(frame.body); }
  void origin(const Pose& X);
  void link(const Frame& frame);
  void joint(int body);
  void fixed_joint(const Frame& frame);

  const RobotModel& robot_;
  std::set<std::string> joint_names_;
  tinyxml2::XMLPrinter printer_;
};

void Writer::leaf(const char* name, const char* key, const std::string& value) {
  printer_.OpenElement(name);
  attribute(key, value);
  printer_.CloseElement();
}

void Writer::check() const {
  std::set<std::string> links, joints;
  const auto check_name = [&](const std::string& name) {
    if (!is_urdf_name(name)) fail("'" + name + "' is not a valid name in a URDF");
  };
  check_name(robot_.name);
  for (const Frame& frame : robot_.frames) {
    check_name(frame.name);
    if (!links.insert(frame.name).second) fail("two frames have the name '" + frame.name + "', which a URDF cannot represent");
  }
  for (int body = -1; body < robot_.body_count(); ++body) {
    const bool has_frame = std::any_of(robot_.frames.begin(), robot_.frames.end(), [&](const Frame& frame) {
      return frame.body == body && frame.name == name_of_body(body) && frame.X_BF == Pose{};
    });
    if (!has_frame) fail("body '" + name_of_body(body) + "' has no frame of its name at its origin, which a URDF requires");
  }
  const std::vector<int> order = robot_.depth_first();
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Joint& joint = robot_.joint_of(order[k]);
    check_name(joint.name);
    if (!joints.insert(joint.name).second) fail("two joints have the name '" + joint.name + "', which a URDF cannot represent");
    if (!(joint.dq_max > 0 && joint.tau_max > 0))
      fail("joint '" + joint.name + "' has a limit of 0, which means no limit in a URDF");
    int ancestor = k == 0 ? -1 : order[k - 1];
    while (ancestor >= 0 && ancestor != joint.parent) ancestor = robot_.joint_of(ancestor).parent;
    if (ancestor != joint.parent) fail("joint '" + joint.name + "' is not in depth-first order, as a URDF requires");
  }
}

void Writer::origin(const Pose& X) {
  if (!is_rotation(X.R)) fail("the orientation of a frame is not a rotation");
  printer_.OpenElement("origin");
  attribute("xyz", numbers(X.p.data(), 3));
  const Vector3d rpy = rpy_of(X.R);
  attribute("rpy", numbers(rpy.data(), 3));
  if (rotation_from_rpy(rpy[0], rpy[1], rpy[2]) != X.R) {
    const Matrix3d by_rows = X.R.transpose();
    attribute("R", numbers(by_rows.data(), 9));
  }
  printer_.CloseElement();
}

void Writer::link(const Frame& frame) {
  printer_.OpenElement("link");
  attribute("name", frame.name);
  const Inertia& body = frame.body < 0 ? robot_.base.inertia : robot_.bodies[static_cast<std::size_t>(frame.body)].inertia;
  if (is_body(frame) && !body.is_nothing()) {
    printer_.OpenElement("inertial");
    origin({Matrix3d::Identity(), body.p_LC});
    leaf("mass", "value", number(body.mass));
    printer_.OpenElement("inertia");
    const std::array<const char*, 6> names = {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"};
    const Matrix3d& I = body.I_CC;
    const std::array<double, 6> moments = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
    for (std::size_t i = 0; i < names.size(); ++i) attribute(names[i], number(moments[i]));
    printer_.CloseElement();
    printer_.CloseElement();
  }
  printer_.CloseElement();
}

void Writer::joint(int body) {
  const Joint& joint = robot_.joint_of(body);
  const bool is_prismatic = joint.type == JointType::kPrismatic;
  const bool is_free = std::isinf(joint.q_min) && std::isinf(joint.q_max);
  joint_names_.insert(joint.name);
  printer_.OpenElement("joint");
  attribute("name", joint.name);
  attribute("type", is_prismatic ? "prismatic" : is_free ? "continuous" : "revolute");
  leaf("parent", "link", name_of_body(joint.parent));
  leaf("child", "link", name_of_body(body));
  origin(joint.X_PJ);
  leaf("axis", "xyz", numbers(joint.axis.data(), 3));
  printer_.OpenElement("limit");
  if (is_prismatic || !is_free) {
    limit("lower", joint.q_min);
    limit("upper", joint.q_max);
  }
  limit("effort", joint.tau_max);
  limit("velocity", joint.dq_max);
  if (std::isfinite(joint.ddq_max)) limit("acceleration", joint.ddq_max);
  if (std::isfinite(joint.dddq_max)) limit("jerk", joint.dddq_max);
  printer_.CloseElement();
  if (joint.damping != 0 || joint.friction != 0) {
    printer_.OpenElement("dynamics");
    attribute("damping", number(joint.damping));
    attribute("friction", number(joint.friction));
    printer_.CloseElement();
  }
  if (body >= robot_.n()) {
    const Mimic& mimic = robot_.mimics[static_cast<std::size_t>(body - robot_.n())];
    printer_.OpenElement("mimic");
    attribute("joint", robot_.joints[static_cast<std::size_t>(mimic.leader)].name);
    attribute("multiplier", number(mimic.multiplier));
    attribute("offset", number(mimic.offset));
    printer_.CloseElement();
  }
  if (joint.passive) {
    printer_.OpenElement("passive");
    printer_.CloseElement();
  }
  printer_.CloseElement();
}

void Writer::fixed_joint(const Frame& frame) {
  std::string name = frame.name + "_fixed";
  while (!joint_names_.insert(name).second) name += "_";
  printer_.OpenElement("joint");
  attribute("name", name);
  attribute("type", "fixed");
  leaf("parent", "link", name_of_body(frame.body));
  leaf("child", "link", frame.name);
  origin(frame.X_BF);
  printer_.CloseElement();
}

std::string Writer::write() {
  check();
  printer_.PushHeader(false, true);
  printer_.OpenElement("robot");
  attribute("name", robot_.name);
  if (!suspect_units(robot_).empty()) {
    printer_.OpenElement("si");
    printer_.CloseElement();
  }
  if (robot_.gravity != RobotModel{}.gravity) leaf("gravity", "xyz", numbers(robot_.gravity.data(), 3));
  for (const Frame& frame : robot_.frames) link(frame);
  for (const int body : robot_.depth_first()) joint(body);
  for (const Frame& frame : robot_.frames) {
    if (!is_body(frame)) fixed_joint(frame);
  }
  printer_.CloseElement();
  return std::string(printer_.CStr()) + "\n";
}

}  // namespace

std::string to_urdf(const RobotModel& robot) { return Writer(robot).write(); }

}  // namespace cotwin::robot
