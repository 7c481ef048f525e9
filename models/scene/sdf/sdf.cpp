#include "models/scene/sdf/sdf.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/scene/sdf/sdf_reader.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace sdf {

using xml::Element;

static std::string read_sdf(const fs::path& file) { return text::read_file(file, "an SDF file", 16'000'000); }

Reader::Document Reader::open(std::string_view text, const fs::path& file) const {
  Document document{xml::parse(text, file.string()), file.parent_path()};
  const Element& root = document.root;
  if (root.name != "sdf" || !root.space.empty()) throw Error(root.place, "<" + root.name + ">, expected <sdf>");
  const std::string& version = xml::text(root, "version");
  const std::vector<std::string_view> parts = text::split(version, '.');
  const auto minor = parts.size() == 2 && parts[0] == "1" ? text::parse_integer(parts[1]) : std::nullopt;
  if (!minor || *minor < 5 || *minor > 12) throw Error(root.place, "SDF version '" + version + "', expected 1.5 … 1.12");
  sdf::check_attributes(root, warn());
  return document;
}

void Reader::name(Scope& scope, const Element& element, const std::string& fallback) {
  const std::string& own = xml::text(element, "name");
  if (own.empty() || own.find("::") != std::string::npos || own.rfind("__", 0) == 0 || own == "world") {
    throw Error(element.place, "'" + own + "' is an invalid name for a <" + element.name + ">");
  }
  Scope::Frame frame{element.place, fallback, xml::text(element, "attached_to", ""), {}, kNoBody, kNoJoint, false};
  if (const Element* pose = only(element, "pose")) {
    frame.X = sdf::pose(*pose);
    frame.relative_to = xml::text(*pose, "relative_to", frame.relative_to);
  }
  if (!scope.frames.emplace(own, std::move(frame)).second)
    throw Error(element.place, "duplicate name '" + own + "' in " + scope.place);
}

std::string Reader::known(const Scope& scope, const std::string& name) const {
  std::vector<std::string> names;
  for (const auto& [known, frame] : scope.frames) names.push_back(known);
  return xml::unknown("a link, joint, frame or model here", name, names);
}

/// X_W of the frame with this name in a scope.
Pose Reader::pose_of(Scope& scope, const std::string& name, const std::string& place) const {
  if (name.empty() || name == "__model__") return scope.X_W;
  if (name == "world") return {};
  if (const std::size_t inner = name.find("::"); inner != std::string::npos) {
    const auto model = scope.models.find(name.substr(0, inner));
    if (model == scope.models.end()) throw Error(place, "'" + name + "': no model '" + name.substr(0, inner) + "' before it");
    return pose_of(*model->second, name.substr(inner + 2), place);
  }
  const auto found = scope.frames.find(name);
  if (found == scope.frames.end()) throw Error(place, known(scope, name));
  Scope::Frame& frame = found->second;
  if (frame.busy) throw Error(frame.place, "the pose of '" + name + "' depends on itself");
  frame.busy = true;
  const Pose X_W = pose_of(scope, frame.relative_to, frame.place) * frame.X;
  frame.busy = false;
  return X_W;
}

int Reader::body_of(const Scope& scope, const std::string& name, const std::string& place, int depth) const {
  if (name == "world") return kWorld;
  if (depth > 100) throw Error(place, "the frame '" + name + "' is attached to itself");
  if (const std::size_t inner = name.find("::"); inner != std::string::npos) {
    const auto model = scope.models.find(name.substr(0, inner));
    if (model == scope.models.end()) throw Error(place, known(scope, name.substr(0, inner)));
    return body_of(*model->second, name.substr(inner + 2), place, depth + 1);
  }
  const auto found = scope.frames.find(name);
  if (found == scope.frames.end()) throw Error(place, known(scope, name));
  const Scope::Frame& frame = found->second;
  if (frame.body != kNoBody) return frame.body;
  if (!frame.attached_to.empty()) return body_of(scope, frame.attached_to, place, depth + 1);
  throw Error(place, "'" + name + "' is neither a link nor a frame attached to a link");
}

/// Index of the first axis of the joint with this name.
int Reader::joint_of(const Scope& scope, const std::string& name, const std::string& place) const {
  if (const std::size_t inner = name.find("::"); inner != std::string::npos) {
    const auto model = scope.models.find(name.substr(0, inner));
    if (model == scope.models.end()) throw Error(place, known(scope, name.substr(0, inner)));
    return joint_of(*model->second, name.substr(inner + 2), place);
  }
  const auto found = scope.frames.find(name);
  if (found == scope.frames.end() || found->second.joint == kNoJoint)
    throw Error(place, "'" + name + "' is no joint here, expected a joint with an axis");
  return found->second.joint;
}

void Reader::read_links(const Element& model, Scope& scope, const Inherited& from) {
  const auto is_link = [](const Element& e) { return e.name == "link" && e.space.empty(); };
  const bool several = std::count_if(model.children.begin(), model.children.end(), is_link) > 1;
  std::vector<int> bodies;
  for (const Element& element : model.children) {
    if (!is_link(element)) continue;
    std::uint32_t mask = kAllBits;
    Body body = sdf::read_link(element, from.is_static, from.folder, mask, warn());
    if (mask != kAllBits) masks_[static_cast<int>(scene_.bodies.size())] = mask;
    const std::string& name = xml::text(element, "name");
    body.name = several ? scope.prefix + name : scope.prefix.substr(0, scope.prefix.size() - 1);
    body.X_WB = pose_of(scope, name, element.place);
    bodies.push_back(static_cast<int>(scene_.bodies.size()));
    scope.frames.at(name).body = bodies.back();
    scene_.bodies.push_back(std::move(body));
  }
  if (sdf::boolean(model, "self_collide", false)) return;
  for (const int a : bodies) {
    for (const int b : bodies) {
      if (a < b && !from.is_static) scene_.no_contact.emplace_back(a, b);
    }
  }
}

void Reader::read_axis(const Element& element, Joint& joint, Scope& scope, const Pose& X_WJ) {
  sdf::check_children(element, {"xyz", "limit", "dynamics", "mimic", "use_parent_model_frame"}, {}, {}, warn());
  const Element& xyz = sdf::required(element, "xyz");
  Eigen::Vector3d axis = sdf::vector(xyz);
  const double length = axis.norm();
  if (!(length > 1e-6)) throw Error(xyz.place, "<xyz> of length " + text::to_text(length, 6) + ", expected a direction");
  if (std::abs(length - 1) > 1e-3) warn()(xyz.place, "axis of length " + text::to_text(length, 6) + " is normalised");
  axis /= length;
  std::string in = xml::text(xyz, "expressed_in", "");
  if (const Element* old = only(element, "use_parent_model_frame"); old != nullptr && sdf::boolean(*old)) {  // until SDF 1.6
    if (!in.empty()) throw Error(old->place, "<use_parent_model_frame> beside expressed_in, expected one of them");
    in = "__model__";
  }
  if (!in.empty()) axis = X_WJ.R.transpose() * (pose_of(scope, in, xyz.place).R * axis);
  joint.axis = axis.normalized();
  if (const Element* limit = only(element, "limit")) {
    sdf::check_children(*limit, {"lower", "upper", "effort", "velocity"}, {}, {}, warn());
    joint.q_min = sdf::limit(*limit, "lower", -kInfinity);
    joint.q_max = sdf::limit(*limit, "upper", kInfinity);
    for (const char* name : {"effort", "velocity"})  // negative: none
      if (const double most = sdf::limit(*limit, name, kInfinity); most >= 0 && most < kInfinity)
        warn()(limit->place, "<" + std::string(name) + "> in <limit> is ignored");
  }
  if (const Element* dynamics = only(element, "dynamics")) {
    sdf::check_children(*dynamics, {"damping", "friction", "spring_stiffness", "spring_reference"}, {}, {}, warn());
    joint.stiffness = sdf::number(*dynamics, "spring_stiffness", 0);
    joint.q_spring = sdf::number(*dynamics, "spring_reference", 0);
    joint.damping = sdf::number(*dynamics, "damping", 0);
    joint.friction = sdf::number(*dynamics, "friction", 0);
  }
}

/// m/rad. SDF 1.10: <screw_thread_pitch>, m per turn, right-handed; before: <thread_pitch>, rad/m, left-handed.
double Reader::read_pitch(const Element& element) const {
  if (const Element* pitch = only(element, "screw_thread_pitch")) return sdf::number(*pitch) / (2 * M_PI);
  const Element* old = only(element, "thread_pitch");
  if (old == nullptr) throw Error(element.place, "a screw without <screw_thread_pitch>");
  const double turn = sdf::number(*old);
  if (turn == 0) throw Error(old->place, "<thread_pitch> 0 rad/m, expected another value, or <screw_thread_pitch>");
  return -1 / turn;
}

/// Adds a joint of two axes as two hinges with a light cross between them: the first turns with the parent, the second with the
/// child. The cross has 10⁻⁶ of the child's mass and inertia.
void Reader::join_by_cross(Joint& first, Joint& second, const Pose& X_WJ) {
  const Body& child = scene_.bodies[static_cast<std::size_t>(first.child)];
  constexpr double kLight = 1e-6;
  const bool moves = child.motion == Motion::kDynamic;
  Body cross;
  cross.name = first.name + ".cross";
  cross.X_WB = X_WJ;
  cross.inertia.mass = moves ? kLight * child.inertia.mass : kLight;
  const double moment = moves ? kLight * child.inertia.I_CC.trace() / 3 : kLight;
  cross.inertia.I_CC = moment * Eigen::Matrix3d::Identity();
  if (first.parent >= 0) scene_.no_contact.emplace_back(first.parent, first.child);
  const auto index = static_cast<int>(scene_.bodies.size());
  first.child = second.parent = index;
  first.X_CJ = second.X_PJ = Pose{};
  scene_.bodies.push_back(std::move(cross));
  scene_.joints.push_back(std::move(first));
  scene_.joints.push_back(std::move(second));
}

/// q_follower = multiplier (q_leader − reference) + offset. Call when all joints of the scope have been read.
void Reader::read_mimics(const Element& element, const Scope& scope) {
  const auto second = [](const std::string& axis) { return axis == "axis2" ? 1 : 0; };
  for (const char* axis : {"axis", "axis2"}) {
    const Element* of = only(element, axis);
    const Element* mimic = of != nullptr ? only(*of, "mimic") : nullptr;
    if (mimic == nullptr) continue;
    sdf::check_children(*mimic, {"multiplier", "offset", "reference"}, {}, {}, warn());
    const std::string& leader_axis = xml::text(*mimic, "axis", "axis");
    Gear gear;
    gear.leader = joint_of(scope, xml::text(*mimic, "joint"), mimic->place) + second(leader_axis);
    gear.follower = joint_of(scope, xml::text(element, "name"), mimic->place) + second(axis);
    gear.ratio = sdf::number(*mimic, "multiplier", 1);
    gear.offset = sdf::number(*mimic, "offset", 0) - gear.ratio * sdf::number(*mimic, "reference", 0);
    const auto has_one = [&](int j) {
      return j < static_cast<int>(scene_.joints.size()) &&
             (scene_.joints[static_cast<std::size_t>(j)].type == JointType::kRevolute ||
              scene_.joints[static_cast<std::size_t>(j)].type == JointType::kPrismatic);
    };
    if (gear.leader == gear.follower || !has_one(gear.leader) || !has_one(gear.follower))
      throw Error(mimic->place, "<mimic> between these joints, expected two different hinges or prismatic joints");
    scene_.gears.push_back(gear);
  }
}

/// The hinge between two bodies about an axis. `sign`: of its angle against that of `link` from `reference` about the axis.
int Reader::find_hinge(int reference, int link, const Eigen::Vector3d& axis_W, double& sign, const Element& gearbox) const {
  for (std::size_t j = 0; j < scene_.joints.size(); ++j) {
    const Joint& joint = scene_.joints[j];
    const bool forth = joint.parent == reference && joint.child == link;
    if (joint.type != JointType::kRevolute || !(forth || (joint.parent == link && joint.child == reference))) continue;
    const Body& child = scene_.bodies[static_cast<std::size_t>(joint.child)];
    const double along = axis_W.dot(child.X_WB.R * (joint.X_CJ.R * joint.axis));
    constexpr double kParallel = 0.999;
    if (std::abs(along) < kParallel) continue;
    sign = (along > 0) == forth ? 1 : -1;
    return static_cast<int>(j);
  }
  throw Error(gearbox.place,
              "no hinge about the axis between the gearbox's reference body and its parent or child, expected both");
}

/// θ_2 = −ratio θ_1: θ_1 of the parent about `axis`, θ_2 of the child about `axis2`, both from the reference body.
void Reader::read_gearbox(const Element& element, Scope& scope) {
  sdf::check_children(element, {"pose", "parent", "child", "axis", "axis2", "gearbox_ratio", "gearbox_reference_body"},
                      {"sensor"}, {}, warn());
  const auto body = [&](const char* name) {
    const Element& link = sdf::required(element, name);
    return body_of(scope, link.content, link.place);
  };
  const int reference = body("gearbox_reference_body");
  const Pose X_WJ = pose_of(scope, xml::text(element, "name"), element.place);
  const Element& first = sdf::required(element, "axis");
  const Element* second = only(element, "axis2");
  const auto direction = [&](const Element& axis) {
    Joint joint;
    read_axis(axis, joint, scope, X_WJ);
    return Eigen::Vector3d(X_WJ.R * joint.axis);
  };
  double leads = 1, follows = 1;
  Gear gear;
  gear.leader = find_hinge(reference, body("parent"), direction(first), leads, element);
  gear.follower = find_hinge(reference, body("child"), direction(second != nullptr ? *second : first), follows, element);
  if (gear.leader == gear.follower) throw Error(element.place, "parent and child are the same, expected two links");
  gear.ratio = -sdf::number(sdf::required(element, "gearbox_ratio")) * leads * follows;
  scene_.gears.push_back(gear);
}

void Reader::read_joint(const Element& element, Scope& scope) {
  sdf::check_children(element, {"pose", "parent", "child", "axis", "axis2", "thread_pitch", "screw_thread_pitch"}, {"sensor"},
                      {}, warn());
  static const std::map<std::string, JointType> kTypes{
      {"revolute", JointType::kRevolute},  {"continuous", JointType::kRevolute}, {"prismatic", JointType::kPrismatic},
      {"ball", JointType::kSpherical},     {"fixed", JointType::kFixed},         {"screw", JointType::kScrew},
      {"universal", JointType::kRevolute}, {"revolute2", JointType::kRevolute}};
  const std::string& type = xml::text(element, "type");
  const auto known_type = kTypes.find(type);
  if (known_type == kTypes.end()) {
    throw Error(element.place,
                "a joint of type '" + type +
                    "', expected revolute, continuous, prismatic, ball, fixed, screw, universal, revolute2 or gearbox");
  }
  if (const Element* const second = only(element, "axis2");
      second != nullptr && !second->children.empty() && type != "universal" && type != "revolute2")
    throw Error(second->place, "<axis2> of a joint of type '" + type + "', which has none, expected universal or revolute2");
  Joint joint;
  const std::string& own = xml::text(element, "name");
  joint.name = scope.prefix + own;
  scope.frames.at(own).joint = static_cast<int>(scene_.joints.size());
  joint.type = known_type->second;
  const Element& parent = sdf::required(element, "parent");
  const Element& child = sdf::required(element, "child");
  joint.parent = body_of(scope, parent.content, parent.place);
  joint.child = body_of(scope, child.content, child.place);
  if (joint.child == kWorld) throw Error(child.place, "the world is the child, expected it as the parent");
  const Pose X_WJ = pose_of(scope, own, element.place);
  const auto seen_from = [&](int body) {
    return body == kWorld ? X_WJ : scene_.bodies[static_cast<std::size_t>(body)].X_WB.inverse() * X_WJ;
  };
  joint.X_PJ = seen_from(joint.parent);
  joint.X_CJ = seen_from(joint.child);
  const bool moves_along = joint.type != JointType::kSpherical && joint.type != JointType::kFixed;
  if (moves_along) read_axis(sdf::required(element, "axis"), joint, scope, X_WJ);
  if (joint.type == JointType::kScrew) joint.pitch = read_pitch(element);
  if (type == "universal" || type == "revolute2") {
    Joint second = joint;
    second.name += ".axis2";
    second.q_min = -kInfinity;
    second.q_max = kInfinity;
    second.friction = second.damping = second.stiffness = second.q_spring = 0;
    read_axis(sdf::required(element, "axis2"), second, scope, X_WJ);
    if (second.axis.cross(joint.axis).norm() < 1e-3)
      throw Error(element.place, "<axis> and <axis2> are parallel, expected two directions");
    join_by_cross(joint, second, X_WJ);
    return;
  }
  if (type == "continuous") joint.q_min = -kInfinity, joint.q_max = kInfinity;
  scene_.joints.push_back(std::move(joint));
}

void Reader::read_include(const Element& include, Scope& scope, const Inherited& from) {
  constexpr int kDeepest = 16;
  if (from.depth >= kDeepest) throw Error(include.place, "includes nested more than " + std::to_string(kDeepest) + " deep");
  sdf::check_children(include, {"uri", "name", "pose", "static"}, {}, {}, warn());
  if (xml::boolean(include, "merge", false))
    throw Error(include.place,
                "<include merge=\"true\"> is not supported, expected an include without it, whose parts are NAME::PART");
  if (const Element* frame = only(include, "placement_frame"); frame != nullptr && !frame->content.empty())
    throw Error(frame->place,
                "<placement_frame> " + frame->content + " is not supported, expected the pose of the model itself");
  const fs::path file = sdf::find_file(sdf::required(include, "uri"), from.folder);
  const std::string text = read_sdf(file);
  const Document document = open(text, file);
  const Element* model = only(document.root, "model");
  const Element& content = model != nullptr ? *model : sdf::required(document.root, "world");
  const Element* renamed = only(include, "name");
  const std::string name = renamed != nullptr ? renamed->content : xml::text(content, "name");

  Scope::Frame frame{include.place, "", "", {}, kNoBody, kNoJoint, false};
  const Element* pose = only(include, "pose");
  if (pose != nullptr) {
    frame.X = sdf::pose(*pose);
    frame.relative_to = xml::text(*pose, "relative_to", "");
  } else if (const Element* own = model != nullptr ? only(content, "pose") : nullptr) {
    frame.X = sdf::pose(*own);
  }
  if (name.empty() || !scope.frames.emplace(name, frame).second)
    throw Error(include.place, "duplicate name '" + name + "' in " + scope.place);
  auto inner = std::make_unique<Scope>();
  inner->place = content.place;
  inner->prefix = scope.prefix + name + ".";
  inner->X_W = pose_of(scope, name, include.place);
  const Element* fixed = only(include, "static");
  const Inherited inherited{from.is_static || (fixed != nullptr && sdf::boolean(*fixed)), from.depth + 1, document.folder};
  if (model != nullptr) {
    read_model(content, *inner, inherited);
  } else {
    inner->is_world = true;
    read_world(content, *inner, inherited);
  }
  scope.models.emplace(name, std::move(inner));
}

/// Reads names first, then poses and bodies; nested models before joints, which may refer to their parts.
void Reader::read_parts(const Element& element, Scope& scope, const Inherited& from) {
  for (const Element& c : element.children) {
    if (!c.space.empty()) continue;
    if (c.name == "link" || c.name == "frame" || c.name == "model") {
      name(scope, c, c.name == "frame" ? xml::text(c, "attached_to", "") : "");
    } else if (c.name == "joint") {
      name(scope, c, sdf::required(c, "child").content);
    }
  }
  if (!scope.is_world) read_links(element, scope, from);
  for (const Element& c : element.children) {
    if (!c.space.empty()) continue;
    if (c.name == "include") read_include(c, scope, from);
    if (c.name != "model") continue;
    const std::string& own = xml::text(c, "name");
    auto inner = std::make_unique<Scope>();
    inner->place = c.place;
    inner->prefix = scope.prefix + own + ".";
    inner->X_W = pose_of(scope, own, c.place);
    read_model(c, *inner, {from.is_static, from.depth, from.folder});
    scope.models.emplace(own, std::move(inner));
  }
  for (const Element& c : element.children) {
    if (c.space.empty() && c.name == "frame") read_frame(element, c, scope);
  }
  const auto is_gearbox = [](const Element& c) { return xml::text(c, "type", "") == "gearbox"; };
  for (const Element& c : element.children) {
    if (c.space.empty() && c.name == "joint" && !is_gearbox(c)) read_joint(c, scope);
  }
  for (const Element& c : element.children) {
    if (!c.space.empty() || c.name != "joint") continue;
    if (is_gearbox(c)) {
      read_gearbox(c, scope);
    } else {
      read_mimics(c, scope);
    }
  }
}

/// Keeps a frame that moves with a link or stands in the world; without attached_to it is on the first link of its model.
void Reader::read_frame(const Element& parent, const Element& element, Scope& scope) {
  const std::string& name = xml::text(element, "name");
  std::string on = xml::text(element, "attached_to", scope.is_world ? "world" : "");
  if (on.empty()) {
    const auto is_link = [](const Element& c) { return c.name == "link" && c.space.empty(); };
    const auto link = std::ranges::find_if(parent.children, is_link);
    if (link != parent.children.end()) on = xml::text(*link, "name");
  }
  int body = kWorld;
  try {
    body = body_of(scope, on, element.place);
  } catch (const Error&) {
    return;  // it is on a joint or on a model
  }
  const Pose X_WF = pose_of(scope, name, element.place);
  const Pose X_BF = body == kWorld ? X_WF : scene_.bodies[static_cast<std::size_t>(body)].X_WB.inverse() * X_WF;
  scene_.frames.push_back({scope.prefix + name, body, X_BF});
}

void Reader::read_model(const Element& model, Scope& scope, const Inherited& from) {
  if (const std::string frame = xml::text(model, "placement_frame", ""); !frame.empty()) {
    throw Error(model.place, "placement_frame=\"" + frame + "\", expected the pose of the model itself");
  }
  sdf::check_children(model, {"static", "pose", "self_collide", "link", "joint", "frame", "model", "include"},
                      {"allow_auto_disable"}, {}, warn());
  Inherited own = from;
  own.is_static = from.is_static || sdf::boolean(model, "static", false);
  read_parts(model, scope, own);
}

void Reader::read_world(const Element& world, Scope& scope, const Inherited& from) {
  sdf::check_children(world, {"gravity", "model", "include", "frame", "joint", "physics"}, {"light", "scene", "gui"}, {},
                      warn());
  for (const Element& c : world.children)
    if (c.space.empty() && c.name == "physics" && !(c.children.size() == 1 && only(c, "gravity") != nullptr))
      warn()(c.place,
             "<physics> in <world> is ignored" + std::string(only(c, "gravity") != nullptr ? " but for its gravity" : ""));
  read_parts(world, scope, from);
}

Scene Reader::read(std::string_view text, const fs::path& file) {
  const Document document = open(text, file);
  const Element& root = document.root;
  sdf::check_children(root, {"world", "model"}, {}, {}, warn());
  Scope scope;
  scope.is_world = true;
  scope.place = root.place;
  const Element* world = only(root, "world");
  const Element* model = only(root, "model");
  if ((world == nullptr) == (model == nullptr)) throw Error(root.place, "expected one <world> or one <model> in <sdf>");
  scene_.name = xml::text(world != nullptr ? *world : *model, "name");
  const Inherited outside{false, 0, document.folder};
  scene_.gravity = {0, 0, -9.8};  // default of SDF
  if (world != nullptr) {
    const Element* gravity = only(*world, "gravity");
    for (const Element& c : world->children) {  // until SDF 1.5
      const Element* old = c.space.empty() && c.name == "physics" ? only(c, "gravity") : nullptr;
      if (old != nullptr && gravity != nullptr) warn()(old->place, "<gravity> in <physics> is ignored beside another one");
      if (gravity == nullptr) gravity = old;
    }
    if (gravity != nullptr) scene_.gravity = sdf::vector(*gravity);
    scope.place = world->place;
    read_world(*world, scope, outside);
  } else {
    read_parts(root, scope, outside);
  }
  const auto mask_of = [&](int body) {
    const auto found = masks_.find(body);
    return found != masks_.end() ? found->second : kAllBits;
  };
  for (const auto& [body, mask] : masks_) {
    for (int other = 0; other < static_cast<int>(scene_.bodies.size()); ++other)
      if (other != body && (mask & mask_of(other)) == 0 && !(masks_.contains(other) && other < body))
        scene_.no_contact.emplace_back(std::min(body, other), std::max(body, other));
  }
  try {
    check(scene_);
  } catch (const Error& e) {
    throw Error(file.string(), e.what());
  }
  return std::move(scene_);
}

}  // namespace sdf

Scene parse_sdf(std::string_view xml, const fs::path& place, std::vector<std::string>* warnings) {
  return sdf::Reader(warnings).read(xml, place);
}

Scene load(const fs::path& file, std::vector<std::string>* warnings) { return parse_sdf(sdf::read_sdf(file), file, warnings); }

}  // namespace cotwin::scene
