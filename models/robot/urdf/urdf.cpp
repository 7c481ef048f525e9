#include "models/robot/urdf/urdf.h"

#include <console_bridge/console.h>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <thread>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/estimate.h"
#include "models/robot/urdf/units.h"
#include "models/robot/urdf/urdf_document.h"

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

constexpr double kLeastRoom = 1e-9;  // of a limit, rad, rad/s, N·m …: shares of less overflow

/// Converts a limit of the cleaned text.
double or_infinity(double limit) {
  return std::abs(limit) >= kNoLimit ? std::copysign(std::numeric_limits<double>::infinity(), limit) : limit;
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
  void read_limits(Joint& to, const urdf::Joint& joint, const std::string& place) const;
  /// The position of a joint that does not move; nullopt for one that does.
  std::optional<double> position_of(const UrdfDocument::Joint& joint) const;
  void check_passive() const;
  void separate_mimics();
  void join_leader(const Mimic& mimic);
  Inertia inertia_of(const urdf::Link& link) const;
  void check_masses();
  std::string at(const std::string& link) const {
    return document_.at(document_.links.at(link).line) + ": link '" + link + "'";
  }
  void warn(const std::string& text) const {
    if (warnings_ != nullptr) warnings_->push_back(text);
  }
  template <class Fault = Error>
  void complain(const std::string& place, const std::string& what, const std::string& consequence = "") const {
    if (options_.unphysical == Unphysical::kError) throw Fault(place, what);
    warn(place + ": " + what + (consequence.empty() ? "" : "; " + consequence));
  }
  /// Returns what stands in for an inertia that no body can have.
  Inertia replaced(const Inertia& inertia, const std::string& place, const std::string& why) const;
  std::string at_inertial(const std::string& link) const {
    return document_.at(document_.links.at(link).inertial_line) + ": link '" + link + "'";
  }

  const UrdfDocument& document_;
  const urdf::ModelInterface& urdf_;
  const UrdfOptions& options_;
  std::vector<std::string>* const warnings_;
  RobotModel robot_;
  std::vector<std::string> chosen_;      // links of the model: in the order of the file, or from the root to the tip
  std::map<std::string, Place> placed_;  // by link
  std::map<int, std::string> thin_;      // by body: its first link of a mass with moments that are 0
  std::map<std::string, Following> followings_;
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

std::optional<double> Builder::position_of(const UrdfDocument::Joint& joint) const {
  if (!joint.moves()) return 0;
  if (const auto locked = options_.locked.find(joint.name); locked != options_.locked.end()) return locked->second;
  if (const auto mimic = followings_.find(joint.name); mimic != followings_.end() && mimic->second.leader.empty())
    return mimic->second.offset;
  return std::nullopt;
}

void Builder::read_limits(Joint& to, const urdf::Joint& joint, const std::string& place) const {
  if (joint.limits == nullptr) return;
  const urdf::JointLimits& limits = *joint.limits;
  if (joint.type != urdf::Joint::CONTINUOUS && limits.lower == 0 && limits.upper == 0 && limits.effort == 0 &&
      limits.velocity == 0) {
    warn(place + ": all limits are 0, as exporters write where none are known; they are read as no limits");
    return;
  }
  if (joint.type != urdf::Joint::CONTINUOUS) {
    to.q_min = or_infinity(joint.limits->lower);
    to.q_max = or_infinity(joint.limits->upper);
    if (to.q_min == to.q_max)
      warn(place + ": lower and upper limit are both " + text::to_text(to.q_min) + "; the joint cannot move");
  }
  const UrdfDocument::Joint& written = document_.joints.at(joint.name);
  const auto expect_room = [&](double room, const char* what) {
    if (room > 0 && room < kLeastRoom)
      complain(document_.at(written.limit_line) + ": joint '" + joint.name + "'",
               std::string(what) + " of <limit> is " + text::to_text(room) + ", with which nothing can be computed, expected " +
                   text::to_text(kLeastRoom) + " or more, or 0");
  };
  expect_room(to.q_max - to.q_min, "the way from lower to upper");
  expect_room(limits.velocity, "velocity");
  expect_room(limits.effort, "effort");
  expect_room(written.acceleration, "acceleration");
  expect_room(written.jerk, "jerk");
  const auto limit_of = [&](double value, const char* what) {  // 0 means "unknown" in many files
    if (value > 0) return or_infinity(value);
    if (followings_.count(joint.name) == 0)
      warn(place + ": " + what + " limit " + text::to_text(value) + " is read as no limit");  // those of mimics are not used
    return std::numeric_limits<double>::infinity();
  };
  to.dq_max = limit_of(joint.limits->velocity, "velocity");
  if (written.acceleration > 0) to.ddq_max = written.acceleration;
  if (written.jerk > 0) to.dddq_max = written.jerk;
  to.tau_max = limit_of(joint.limits->effort, "effort");
}

Builder::Place Builder::move(const urdf::Joint& joint, const Place& parent) {
  const UrdfDocument::Joint& written = document_.joints.at(joint.name);
  const std::string place = document_.at(written.line) + ": joint '" + joint.name + "'";
  if (!written.negative.empty()) {
    complain(document_.at(written.limit_line) + ": joint '" + joint.name + "'", written.negative + " of <limit> is negative");
  }
  if (const std::optional<double> q = position_of(written)) {
    if (!written.moves()) return {parent.body, parent.X_BL * written.X_PJ};
    robot_.locked.emplace(joint.name, *q);
    if (joint.limits != nullptr && joint.type != urdf::Joint::CONTINUOUS &&
        (*q < joint.limits->lower || *q > joint.limits->upper)) {
      warn(place + ": stands at " + text::to_text(*q) + ", outside its limits " + text::to_text(joint.limits->lower) + " to " +
           text::to_text(joint.limits->upper));
    }
    return {parent.body, parent.X_BL * origin_at(written, *q)};
  }
  const Pose X_BJ = parent.X_BL * written.X_PJ;
  Joint moved;
  moved.name = joint.name;
  moved.type = joint.type == urdf::Joint::PRISMATIC ? JointType::kPrismatic : JointType::kRevolute;
  moved.parent = parent.body;
  moved.X_PJ = X_BJ;
  moved.axis = written.axis;
  moved.passive = written.passive || options_.passive.count(joint.name) != 0;
  const double length = Vector3d(joint.axis.x, joint.axis.y, joint.axis.z).stableNorm();
  if (std::abs(length - 1) > 1e-3) warn(place + ": axis of length " + text::to_text(length, 6) + " is normalised");
  read_limits(moved, joint, place);
  if (joint.dynamics != nullptr) {
    moved.damping = joint.dynamics->damping;
    moved.friction = joint.dynamics->friction;
  }
  robot_.joints.push_back(moved);
  robot_.bodies.push_back({joint.child_link_name, {}});
  return {robot_.n() - 1, {}};
}

void Builder::check_passive() const {
  for (const std::string& name : options_.passive) {
    const auto joint = document_.joints.find(name);
    if (joint == document_.joints.end()) {
      std::vector<std::string> names;
      for (const auto& [other, ignored] : document_.joints) names.push_back(other);
      const std::string close = text::closest(name, names);
      throw Error(document_.place, "no joint '" + name + "' to be passive, expected a joint of the file" +
                                       (close.empty() ? std::string() : "; did you mean '" + close + "'?"));
    }
    const std::string place = document_.at(joint->second.line) + ": joint '" + name + "'";
    if (position_of(joint->second)) throw Error(place, "does not move and cannot be passive, expected a joint that moves");
    if (const auto mimic = followings_.find(name); mimic != followings_.end())
      throw Error(place, "mimics '" + mimic->second.leader + "', expected that joint to be passive");
  }
}

/// Moves the joints that follow others, which build() has entered in depth-first order with the others, to RobotModel::mimics
/// and their bodies to the end.
void Builder::separate_mimics() {
  const std::size_t all = robot_.joints.size();
  std::vector<int> index(all);  // of the body in the RobotModel
  std::map<std::string, int> independent;
  std::vector<Joint> joints;
  std::vector<Body> bodies, following;
  for (std::size_t i = 0; i < all; ++i) {
    if (followings_.count(robot_.joints[i].name) != 0) continue;
    independent.emplace(robot_.joints[i].name, index[i] = static_cast<int>(joints.size()));
    joints.push_back(robot_.joints[i]);
    bodies.push_back(robot_.bodies[i]);
  }
  for (std::size_t i = 0; i < all; ++i) {
    const Joint& joint = robot_.joints[i];
    const auto found = followings_.find(joint.name);
    if (found == followings_.end()) continue;
    const auto leader = independent.find(found->second.leader);
    if (leader == independent.end()) {
      throw Error(document_.at(document_.joints.at(joint.name).mimic_line) + ": joint '" + joint.name + "'",
                  "mimics '" + found->second.leader + "', which is not on the chain to '" + options_.tip +
                      "', expected both joints on it");
    }
    index[i] = static_cast<int>(joints.size() + robot_.mimics.size());
    robot_.mimics.push_back({joint, leader->second, found->second.multiplier, found->second.offset, static_cast<int>(i)});
    following.push_back(robot_.bodies[i]);
  }
  const auto renumber = [&](int& body) {
    if (body >= 0) body = index[static_cast<std::size_t>(body)];
  };
  for (Joint& joint : joints) renumber(joint.parent);
  for (Mimic& mimic : robot_.mimics) renumber(mimic.joint.parent);
  for (auto& [link, place] : placed_) renumber(place.body);
  bodies.insert(bodies.end(), following.begin(), following.end());
  robot_.joints = std::move(joints);
  robot_.bodies = std::move(bodies);
  for (Mimic& mimic : robot_.mimics) {
    join_leader(mimic);
    mimic.joint.damping = mimic.joint.friction = 0;
    mimic.joint.passive = false;
  }
}

/// The power of the friction at both joints is that of the sum at the leader.
void Builder::join_leader(const Mimic& mimic) {
  Joint& leader = robot_.joints[static_cast<std::size_t>(mimic.leader)];
  const Joint& own = mimic.joint;
  leader.damping += mimic.multiplier * mimic.multiplier * own.damping;
  leader.friction += std::abs(mimic.multiplier) * own.friction;
  const double one = mimic.multiplier * leader.q_min + mimic.offset, other = mimic.multiplier * leader.q_max + mimic.offset;
  const double low = std::min(one, other), high = std::max(one, other);
  const double kRounded = 1e-3 * std::max(1.0, std::max(std::abs(own.q_min), std::abs(own.q_max)));  // numbers in files
  if (low < own.q_min - kRounded || high > own.q_max + kRounded) {
    warn(document_.at(document_.joints.at(own.name).mimic_line) + ": joint '" + own.name + "': the limits of its leader '" +
         leader.name + "' move it from " + text::to_text(low, 6) + " to " + text::to_text(high, 6) + "; its own limits " +
         text::to_text(own.q_min, 6) + " to " + text::to_text(own.q_max, 6) + " are not used");
  }
}

Inertia Builder::replaced(const Inertia& inertia, const std::string& place, const std::string& why) const {
  if (options_.unphysical != Unphysical::kEstimate) {
    complain<UnphysicalValue>(place, why, "kept unchanged");
    return inertia;
  }
  const Inertia other = repaired(inertia);
  complain(place, why, other.is_nothing() ? "not used" : "replaced by the closest that a body can have");
  return other;
}

/// Adds the link to the body that it is fixed to. Moments that are 0 are judged there.
void Builder::visit(const urdf::Link& link, const Place& place) {
  if (!place.X_BL.p.allFinite()) throw Error(at(link.name), "the position of its frame is not finite");
  placed_[link.name] = place;
  Inertia inertia = inertia_of(link);
  if (const std::string why = inertia.is_nothing() ? "" : inertia.unphysical(Inertia::Least::kZero); !why.empty()) {
    if (place.body < 0) {
      warn(at(link.name) + ": " + why + "; it does not move, so no torque depends on it");
    } else {
      inertia = replaced(inertia, at_inertial(link.name), why);
    }
  } else if (!inertia.is_nothing() && place.body >= 0 && !inertia.unphysical().empty()) {
    thin_.try_emplace(place.body, link.name);
  }
  Inertia& body = place.body < 0 ? robot_.base.inertia : robot_.bodies[static_cast<std::size_t>(place.body)].inertia;
  body = body + inertia.seen_from(place.X_BL);
}

void Builder::check_masses() {
  std::vector<Inertia> estimates;
  for (int i = -1; i < robot_.body_count(); ++i) {
    const Body& body = i < 0 ? robot_.base : robot_.bodies[static_cast<std::size_t>(i)];
    if (!std::isfinite(body.inertia.mass) || !body.inertia.p_LC.allFinite() || !body.inertia.I_CC.allFinite()) {
      throw Error(at(body.name), "its inertia with all links fixed to it is not finite");
    }
    if (const auto thin = thin_.find(i); thin != thin_.end()) {
      Inertia& whole = robot_.bodies[static_cast<std::size_t>(i)].inertia;
      if (const std::string why = whole.unphysical(); !why.empty()) whole = replaced(whole, at_inertial(thin->second), why);
    }
    if (i < 0 || body.inertia.mass != 0) continue;
    std::string names;
    for (const std::string& name : chosen_) {
      if (placed_.at(name).body == i) names += (names.empty() ? "'" : ", '") + name + "'";
    }
    const std::string why = "joint '" + robot_.joint_of(i).name + "' moves no mass (" + names + "), expected > 0 kg";
    if (options_.unphysical != Unphysical::kEstimate) {
      complain<UnphysicalValue>(at(body.name), why, "kept unchanged");
      continue;
    }
    if (estimates.empty()) estimates = estimated_inertia(robot_);
    const Inertia& estimate = estimates[static_cast<std::size_t>(i)];
    complain(at(body.name), why, "estimated as " + text::to_text(estimate.mass, 3) + " kg, a rod of aluminium");
    robot_.bodies[static_cast<std::size_t>(i)].inertia = estimate;
  }
}

RobotModel Builder::build() {
  robot_.name = urdf_.getName();
  for (const std::string& warning : document_.warnings) warn(warning);
  for (const UrdfDocument::Refused& word : document_.refused) {
    if (options_.ignore_words) {
      warn(document_.at(word.line) + ": " + word.what + "; ignored");
    } else if (!word.units.empty()) {
      throw other_units(document_.at(word.line), {{word.what, word.units}});
    } else {
      throw Error(document_.at(word.line), word.what);
    }
  }
  if (document_.gravity) robot_.gravity = *document_.gravity;
  followings_ = follow_mimics(document_, options_.locked, warnings_);
  check_passive();
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
  if (!followings_.empty()) separate_mimics();
  for (const std::string& name : chosen_) robot_.frames.push_back({name, placed_.at(name).body, placed_.at(name).X_BL});
  check_masses();
  return std::move(robot_);
}

}  // namespace

namespace {

RobotModel build(const UrdfDocument& document, const UrdfOptions& options, std::vector<std::string>* warnings) {
  const urdf::ModelInterfaceSharedPtr urdf = parse_with_urdfdom(document);
  return Builder(document, *urdf, options, warnings).build();
}

std::vector<UnitSuspicion> suspect_angles(const UrdfDocument& document) {
  if (document.largest_angle <= kLargestPlausibleAngle) return {};
  return {{"rpy has an angle of " + text::to_text(document.largest_angle, 6) + " rad, more than a turn", "rpy=deg"}};
}

}  // namespace

void take_unphysical(std::string_view word, UrdfOptions& options) {
  using enum Unphysical;
  options.unphysical = word == "estimate" ? kEstimate : word == "warn" ? kWarn : kError;
  options.ignore_words = word == "warn";
}

RobotModel parse_urdf(std::string_view xml, const std::string& place, const UrdfOptions& options,
                      std::vector<std::string>* warnings) {
  return build(read_urdf_document(xml, place), options, warnings);
}

RobotModel load_urdf(const std::filesystem::path& file, const UrdfOptions& options, std::vector<std::string>* warnings) {
  constexpr std::uint64_t kLargest = 16'000'000;  // bytes; larger than any realistic robot
  const UrdfDocument document = read_urdf_document(text::read_file(file, "a URDF", kLargest), file.string());
  if (document.is_si) return build(document, options, warnings);
  const std::vector<UnitSuspicion> angles = suspect_angles(document);
  const auto angle_place = [&] { return document.at(document.largest_angle_line); };
  std::optional<RobotModel> robot;
  try {
    robot = build(document, options, warnings);
  } catch (const Error&) {
    if (!angles.empty()) throw other_units(angle_place(), angles);
    throw;
  }
  std::vector<UnitSuspicion> found = suspect_units(*robot);
  const std::string place = angles.empty() ? document.place : angle_place();
  found.insert(found.begin(), angles.begin(), angles.end());
  if (!found.empty()) throw other_units(place, found);
  return *std::move(robot);
}

void check_units(std::string_view converted, const std::string& place, const UrdfUnits& units) {
  const UrdfDocument document = read_urdf_document(converted, place);
  UrdfOptions options;
  options.unphysical = Unphysical::kWarn;
  options.ignore_words = true;
  const RobotModel robot = build(document, options, nullptr);
  std::vector<UnitSuspicion> found = suspect_angles(document), left;
  for (UnitSuspicion& one : suspect_units(robot)) found.push_back(std::move(one));
  const double reach = reach_of(robot);
  constexpr double kSmallest = 0.02;  // m
  if (units.length != 1 && reach < kSmallest && reach > 0)
    found.push_back({"the robot reaches " + text::to_text(1e3 * reach, 3) + " mm", "length="});
  for (UnitSuspicion& one : found) {
    const std::string quantity = one.units.substr(0, one.units.find('='));
    if (!units.named.contains(quantity)) {
      left.push_back(std::move(one));
    } else if (!is_si(units, quantity)) {
      throw Error(place, "read with " + units.text + ", " + one.what + ", expected another unit of " + quantity +
                             ", or its unit in SI, which takes it as it is");
    }
  }
  if (left.empty()) return;
  left.insert(left.begin(), UnitSuspicion{"read with " + units.text, units.text});
  throw other_units(place, left);
}

}  // namespace cotwin::robot
