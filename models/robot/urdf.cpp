#include "models/robot/urdf.h"

#include <console_bridge/console.h>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <thread>

#include "models/robot/urdf_document.h"
#include "models/support/error.h"
#include "models/support/file.h"
#include "models/support/text.h"

namespace cotwin::robot {

namespace {

using Eigen::Vector3d;

/// Collects the messages of urdfdom. The handler is global; messages of other threads are forwarded to the previous handler.
class Capture final : public console_bridge::OutputHandler {
 public:
  Capture() : before_(console_bridge::getOutputHandler()) { console_bridge::useOutputHandler(this); }
  ~Capture() override { console_bridge::useOutputHandler(before_); }
  Capture(const Capture&) = delete;
  Capture& operator=(const Capture&) = delete;

  void log(const std::string& text, console_bridge::LogLevel level, const char* file, int line) override {
    if (std::this_thread::get_id() == thread_) {
      text_ += (text_.empty() ? "" : "; ") + text;
    } else if (before_ != nullptr) {
      before_->log(text, level, file, line);
    }
  }
  const std::string& text() const { return text_; }

 private:
  console_bridge::OutputHandler* const before_;
  const std::thread::id thread_ = std::this_thread::get_id();
  std::string text_;
};

urdf::ModelInterfaceSharedPtr parse_with_urdfdom(const UrdfDocument& document) {
  static std::mutex one_capture_at_a_time;
  const std::lock_guard lock(one_capture_at_a_time);
  const Capture capture;
  urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(document.cleaned);
  if (model == nullptr) throw Error(document.place, "urdfdom rejects the file: " + capture.text());
  return model;
}

/// Converts a limit of the cleaned text.
double or_infinity(double limit) {
  return std::abs(limit) >= kNoLimit ? std::copysign(std::numeric_limits<double>::infinity(), limit) : limit;
}

Vector3d unit_axis(const urdf::Vector3& xyz) {
  const Vector3d axis(xyz.x, xyz.y, xyz.z);
  const double kRounding = 8 * std::numeric_limits<double>::epsilon();  // keeps the bits of a unit vector written by to_urdf
  return std::abs(axis.squaredNorm() - 1) <= kRounding ? axis : axis.stableNormalized();
}

class Builder {
 public:
  Builder(const UrdfDocument& document, const urdf::ModelInterface& urdf, const UrdfOptions& options,
          std::vector<std::string>* warnings)
      : document_(document), urdf_(urdf), options_(options), warnings_(warnings) {}

  RobotModel build();

 private:
  struct Place {
    int body;
    Pose X_BL;
  };

  void choose_links();
  void visit(const urdf::Link& link, const Place& place);
  Place move(const urdf::Joint& joint, const Place& parent);
  Inertia inertia_of(const urdf::Link& link) const;
  void check_masses();
  std::string at(const std::string& link) const {
    return document_.at(document_.links.at(link).line) + ": link '" + link + "'";
  }
  void warn(const std::string& text) const {
    if (warnings_ != nullptr) warnings_->push_back(text);
  }
  void complain(const std::string& place, const std::string& what) const {
    if (options_.unphysical == Unphysical::kError) throw Error(place, what);
    warn(place + ": " + what + "; kept unchanged");
  }

  const UrdfDocument& document_;
  const urdf::ModelInterface& urdf_;
  const UrdfOptions& options_;
  std::vector<std::string>* const warnings_;
  RobotModel robot_;
  std::vector<std::string> chosen_;      // links of the model: in the order of the file, or from the root to the tip
  std::map<std::string, Place> placed_;  // by link
};

void Builder::choose_links() {
  if (options_.tip.empty()) {
    chosen_ = document_.links_in_order;
    return;
  }
  if (document_.links.count(options_.tip) == 0) {
    const std::string close = text::closest(options_.tip, document_.links_in_order);
    throw Error(document_.place, "no link '" + options_.tip + "' for the tip" +
                                     (close.empty() ? std::string() : ", did you mean '" + close + "'?"));
  }
  for (auto link = urdf_.getLink(options_.tip); link != nullptr; link = link->getParent()) chosen_.push_back(link->name);
  std::reverse(chosen_.begin(), chosen_.end());
  double left_out = 0;
  std::string names;
  for (const std::string& name : document_.links_in_order) {
    const urdf::LinkConstSharedPtr link = urdf_.getLink(name);
    if (link->inertial == nullptr || std::find(chosen_.begin(), chosen_.end(), name) != chosen_.end()) continue;
    left_out += link->inertial->mass;
    names += (names.empty() ? "'" : ", '") + name + "'";
  }
  if (names.empty()) return;
  warn(document_.place + ": the chain to '" + options_.tip + "' omits " + text::to_text(left_out, 6) + " kg: " + names);
}

/// In the link's own frame; zero without <inertial>.
Inertia Builder::inertia_of(const urdf::Link& link) const {
  if (link.inertial == nullptr) return {};
  const urdf::Inertial& i = *link.inertial;
  Inertia inertia{i.mass, Vector3d::Zero(), {}};
  inertia.I_CC << i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz;
  return inertia.seen_from(document_.links.at(link.name).X_LI);
}

Builder::Place Builder::move(const urdf::Joint& joint, const Place& parent) {
  const UrdfDocument::Joint& written = document_.joints.at(joint.name);
  const Pose X_BJ = parent.X_BL * written.X_PJ;
  if (joint.type == urdf::Joint::FIXED) return {parent.body, X_BJ};
  const std::string place = document_.at(written.line) + ": joint '" + joint.name + "'";
  Joint moved;
  moved.name = joint.name;
  moved.type = joint.type == urdf::Joint::PRISMATIC ? JointType::kPrismatic : JointType::kRevolute;
  moved.parent = parent.body;
  moved.X_PJ = X_BJ;
  moved.axis = unit_axis(joint.axis);
  const double length = Vector3d(joint.axis.x, joint.axis.y, joint.axis.z).stableNorm();
  if (std::abs(length - 1) > 1e-3) warn(place + ": axis of length " + text::to_text(length, 6) + " is normalised");
  if (joint.limits != nullptr) {
    if (joint.type != urdf::Joint::CONTINUOUS) {
      moved.q_min = or_infinity(joint.limits->lower);
      moved.q_max = or_infinity(joint.limits->upper);
      if (moved.q_min == moved.q_max)
        warn(place + ": lower and upper limit are both " + text::to_text(moved.q_min) + "; the joint cannot move");
    }
    const auto limit_of = [&](double value, const char* what) {  // 0 means "unknown" in many files
      if (value > 0) return or_infinity(value);
      warn(place + ": " + what + " limit 0 is read as no limit");
      return std::numeric_limits<double>::infinity();
    };
    moved.dq_max = limit_of(joint.limits->velocity, "velocity");
    moved.tau_max = limit_of(joint.limits->effort, "effort");
  }
  if (joint.dynamics != nullptr) {
    moved.damping = joint.dynamics->damping;
    moved.friction = joint.dynamics->friction;
  }
  robot_.joints.push_back(moved);
  robot_.bodies.push_back({joint.child_link_name, {}});
  return {robot_.n() - 1, {}};
}

/// Adds the link to the body that it is fixed to.
void Builder::visit(const urdf::Link& link, const Place& place) {
  if (!place.X_BL.p.allFinite()) throw Error(at(link.name), "the position of its frame is not finite");
  placed_[link.name] = place;
  const Inertia inertia = inertia_of(link);
  Inertia& body = place.body < 0 ? robot_.base.inertia : robot_.bodies[static_cast<std::size_t>(place.body)].inertia;
  body = body + inertia.seen_from(place.X_BL);
  if (inertia.is_nothing()) return;
  const std::string why = inertia.unphysical();
  if (why.empty()) return;
  if (place.body < 0) {
    warn(at(link.name) + ": " + why + "; it does not move, so no torque depends on it");
  } else {
    complain(document_.at(document_.links.at(link.name).inertial_line) + ": link '" + link.name + "'", why);
  }
}

void Builder::check_masses() {
  for (int i = -1; i < robot_.n(); ++i) {
    const Body& body = i < 0 ? robot_.base : robot_.bodies[static_cast<std::size_t>(i)];
    if (!std::isfinite(body.inertia.mass) || !body.inertia.p_LC.allFinite() || !body.inertia.I_CC.allFinite()) {
      throw Error(at(body.name), "its inertia with all links fixed to it is not finite");
    }
    if (i < 0 || body.inertia.mass != 0) continue;
    std::string names;
    for (const std::string& name : chosen_) {
      if (placed_.at(name).body == i) names += (names.empty() ? "'" : ", '") + name + "'";
    }
    complain(at(body.name),
             "joint '" + robot_.joints[static_cast<std::size_t>(i)].name + "' moves no mass (" + names + "), expected > 0 kg");
  }
}

RobotModel Builder::build() {
  robot_.name = urdf_.getName();
  if (document_.gravity) robot_.gravity = *document_.gravity;
  choose_links();
  std::vector<std::string> links = chosen_;
  std::sort(links.begin(), links.end());
  const urdf::LinkConstSharedPtr root = urdf_.getRoot();
  robot_.base.name = root->name;

  struct Step {
    const urdf::Link* link;
    const urdf::Joint* joint;  // its moving joint; nullptr for the root
  };
  std::vector<Step> next{{root.get(), nullptr}};
  while (!next.empty()) {
    const auto [link, joint] = next.back();
    next.pop_back();
    visit(*link, joint == nullptr ? Place{-1, {}} : move(*joint, placed_.at(joint->parent_link_name)));
    std::vector<const urdf::Joint*> joints;
    for (const urdf::JointSharedPtr& child : link->child_joints) {
      if (std::binary_search(links.begin(), links.end(), child->child_link_name)) joints.push_back(child.get());
    }
    // Reverse order: the first of the file must be on top of the stack.
    std::sort(joints.begin(), joints.end(), [&](const urdf::Joint* a, const urdf::Joint* b) {
      return document_.joints.at(a->name).order > document_.joints.at(b->name).order;
    });
    for (const urdf::Joint* child : joints) next.push_back({urdf_.getLink(child->child_link_name).get(), child});
  }
  for (const std::string& name : chosen_) robot_.frames.push_back({name, placed_.at(name).body, placed_.at(name).X_BL});
  check_masses();
  return std::move(robot_);
}

}  // namespace

RobotModel parse_urdf(std::string_view xml, const std::string& place, const UrdfOptions& options,
                      std::vector<std::string>* warnings) {
  const UrdfDocument document = read_urdf_document(xml, place);
  const urdf::ModelInterfaceSharedPtr urdf = parse_with_urdfdom(document);
  return Builder(document, *urdf, options, warnings).build();
}

RobotModel load_urdf(const std::filesystem::path& file, const UrdfOptions& options, std::vector<std::string>* warnings) {
  constexpr std::uint64_t kLargest = 16'000'000;  // bytes; larger than any realistic robot
  return parse_urdf(text::read_file(file, "a URDF", kLargest), file.string(), options, warnings);
}

}  // namespace cotwin::robot
