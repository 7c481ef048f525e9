#include "models/robot/changes/attachment.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf_name.h"

namespace cotwin::robot {

namespace {

Inertia& inertia_of(RobotModel& robot, int body) {
  return body < 0 ? robot.base.inertia : robot.bodies[static_cast<std::size_t>(body)].inertia;
}

std::string place_of(const RobotModel& robot) { return "robot '" + robot.name + "'"; }

void check_name(const std::string& place, const std::string& name) {
  if (!is_urdf_name(name)) throw Error(place, "'" + name + "' is not a valid name in a URDF");
}

/// Changes are in the order of time; those without a time come first.
void check_time(const RobotModel& robot, const std::string& place, std::optional<double> time) {
  if (time && !std::isfinite(*time)) throw Error(place, "at " + text::to_text(*time) + " s, expected a finite time");
  if (robot.history.empty()) return;
  const Change& last = robot.history.back();
  if (last.time && !(time && *time >= *last.time)) {
    throw Error(place, (time ? "at " + text::to_text(*time) + " s" : std::string("without a time")) +
                           ", expected one not before " + text::to_text(*last.time) + " s, that of '" + last.what + "'");
  }
}

std::string described(const Inertia& inertia, const std::string& frame) {
  const auto number = [](double x) { return text::to_text(x, 6); };
  const Eigen::Vector3d& c = inertia.p_LC;
  return number(inertia.mass) + " kg at (" + number(c[0]) + ", " + number(c[1]) + ", " + number(c[2]) + ") m in " + frame;
}

auto find_frame(const RobotModel& robot, const std::string& name) {
  return std::find_if(robot.frames.begin(), robot.frames.end(), [&](const Frame& frame) { return frame.name == name; });
}

/// The last entry of the history that mounted `name`; nullptr if there is none.
const Change* mounting_of(const RobotModel& robot, const std::string& name) {
  const auto last = std::find_if(robot.history.rbegin(), robot.history.rend(), [&](const Change& change) {
    return change.kind != Change::Kind::kSetInertia && change.frame.name == name;
  });
  return last != robot.history.rend() && last->kind == Change::Kind::kAttach ? &*last : nullptr;
}

Inertia minus(const Inertia& body, const Inertia& part) { return body + Inertia{-part.mass, part.p_LC, -part.I_CC}; }

struct Remainder {
  Inertia inertia;
  bool is_difference = false;  // a part was subtracted: the result may be unphysical
};

/// Inertia of the carrying body without the part of `mounting`. Adds up the initial inertia and the other mounted parts, as if
/// the part had never been mounted; if the body was set (tuned) with the part on it, subtracts the part.
Remainder without(const RobotModel& robot, const Change& mounting) {
  Remainder sum;                       // initial or set inertia
  std::vector<const Change*> mounted;  // on it
  Inertia body;                        // the composite body according to the history
  const auto set = [&](const Inertia& inertia) {
    sum = {inertia};
    body = inertia;
    mounted.clear();
  };
  const auto remove_tool = [&](const Change& part) {
    const auto found =
        std::find_if(mounted.begin(), mounted.end(), [&](const Change* m) { return m->frame.name == part.frame.name; });
    if (found == mounted.end() && part.part.mass != 0) {
      sum = {minus(sum.inertia, part.part), true};
    } else if (found != mounted.end()) {
      mounted.erase(found);
    }
  };
  for (const Change& change : robot.history) {
    if (change.body != mounting.body) continue;
    if (!(change.before == body)) set(change.before);  // initial value, or set without an entry in the history
    switch (change.kind) {
      case Change::Kind::kAttach:
        mounted.push_back(&change);
        break;
      case Change::Kind::kDetach:
        remove_tool(change);
        break;
      case Change::Kind::kSetInertia:
        set(change.after);
        break;
    }
    body = change.after;
  }
  const Inertia& now = mounting.body < 0 ? robot.base.inertia : robot.bodies[static_cast<std::size_t>(mounting.body)].inertia;
  if (!(now == body)) set(now);
  remove_tool(mounting);
  for (const Change* part : mounted) sum.inertia = sum.inertia + part->part;
  return sum;
}

std::ptrdiff_t offset(std::size_t index) { return static_cast<std::ptrdiff_t>(index); }

void insert_frames(RobotModel& robot, const Frame& frame, const std::vector<PartFrame>& further, std::size_t index) {
  auto at = robot.frames.insert(robot.frames.begin() + offset(index), frame);
  for (const PartFrame& next : further) at = robot.frames.insert(at + 1, {next.name, frame.body, frame.X_BF * next.X_AF});
}

}  // namespace

void attach(RobotModel& robot, const Attachment& what, const std::string& reason, std::optional<double> time) {
  const std::string place = place_of(robot) + ", attachment '" + what.name + "'";
  if (what.name.empty()) throw Error(place, "has no name, expected one");
  check_name(place, what.name);
  check_time(robot, place, time);
  if (find_frame(robot, what.name) != robot.frames.end()) throw Error(place, "the robot already has a frame with this name");
  for (std::size_t i = 0; i < what.further.size(); ++i) {
    const PartFrame& frame = what.further[i];
    const auto same = [&](const PartFrame& other) { return other.name == frame.name; };
    const bool twice = std::any_of(what.further.begin(), what.further.begin() + offset(i), same);
    if (frame.name.empty() || frame.name == what.name || twice || find_frame(robot, frame.name) != robot.frames.end())
      throw Error(place, "its frame '" + frame.name + "' has no name of its own, expected one that the robot does not have");
    check_name(place, frame.name);
    if (!frame.X_AF.p.allFinite() || !is_rotation(frame.X_AF.R))
      throw Error(place, "its frame '" + frame.name + "' has no pose: expected a rotation matrix and a finite position");
  }
  const Frame& parent = robot.frame(what.parent);
  if (!what.X_PA.p.allFinite() || !is_rotation(what.X_PA.R)) {
    throw Error(place, "X_PA is not a pose: expected a rotation matrix and a finite position");
  }
  const bool is_frame = what.inertia.is_nothing();
  const bool is_point = what.inertia.mass > 0 && what.inertia.I_CC.isZero(0);
  Change change;
  change.kind = Change::Kind::kAttach;
  change.frame = {what.name, parent.body, parent.X_BF * what.X_PA};
  change.parent = what.parent;
  change.X_PF = what.X_PA;
  change.own = what.inertia;
  change.time = time;
  change.further = what.further;
  change.part = what.inertia.seen_from(change.frame.X_BF);
  change.body = parent.body;
  change.index = robot.frames.size();
  Inertia& body = inertia_of(robot, parent.body);
  change.before = body;
  change.after = body + change.part;
  const std::string why = is_frame   ? ""
                          : is_point ? (body + change.part).unphysical()  // the composite body must be physical
                                     : what.inertia.unphysical();
  if (!why.empty()) throw Error(place, (is_point ? "with this point mass its body has " : "") + why);
  change.what = "attach " + what.name + " to " + what.parent + ": " + described(what.inertia, what.name);
  change.reason = reason;
  body = change.after;
  insert_frames(robot, change.frame, change.further, robot.frames.size());
  robot.history.push_back(change);
}

void detach(RobotModel& robot, const std::string& name, const std::string& reason, std::optional<double> time) {
  const std::string place = place_of(robot);
  const auto frame = find_frame(robot, name);
  if (frame == robot.frames.end()) throw Error(place, "no attachment is named '" + name + "'");
  const Change* const mounting = mounting_of(robot, name);
  if (mounting == nullptr) throw Error(place, "'" + name + "' is a link of the robot or of a part, not attached to it");
  const auto is_of_part = [&](const std::string& parent) {
    return parent == name || std::any_of(mounting->further.begin(), mounting->further.end(),
                                         [&](const PartFrame& further) { return further.name == parent; });
  };
  for (const Frame& other : robot.frames) {
    const Change* const others = mounting_of(robot, other.name);
    if (others != nullptr && is_of_part(others->parent)) {
      throw Error(place, "'" + other.name + "' is mounted on '" + name + "'; detach it first");
    }
  }
  check_time(robot, place, time);
  Change change = *mounting;
  change.kind = Change::Kind::kDetach;
  change.index = static_cast<std::size_t>(frame - robot.frames.begin());
  Inertia& body = inertia_of(robot, change.body);
  change.before = body;
  const Remainder remainder = without(robot, *mounting);
  if (remainder.is_difference) {
    const std::string why = remainder.inertia.unphysical();
    if (!why.empty()) throw Error(place, "without '" + name + "' its body would have " + why);
  }
  change.after = remainder.inertia;
  change.what = "detach " + name + " from " + change.parent + ": " + described(change.own, name);
  change.reason = reason;
  change.time = time;
  body = change.after;
  robot.frames.erase(frame, frame + 1 + offset(change.further.size()));
  robot.history.push_back(change);
}

void set_inertia(RobotModel& robot, int body, const Inertia& inertia, const std::string& reason, std::optional<double> time) {
  if (body < -1 || body >= robot.body_count()) {
    throw Error(place_of(robot),
                "no body " + std::to_string(body) + ", expected -1 (the base) to " + std::to_string(robot.body_count() - 1));
  }
  const std::string& name = body < 0 ? robot.base.name : robot.bodies[static_cast<std::size_t>(body)].name;
  if (const std::string why = inertia.unphysical(); !why.empty()) throw Error(place_of(robot) + ", body '" + name + "'", why);
  check_time(robot, place_of(robot), time);
  Change change;
  change.what = "set inertia of " + name + ": " + described(inertia, name);
  change.reason = reason;
  change.time = time;
  change.body = body;
  change.before = inertia_of(robot, body);
  change.after = inertia;
  inertia_of(robot, body) = inertia;
  robot.history.push_back(change);
}

RobotModel before(const RobotModel& robot, std::size_t change) {
  if (change > robot.history.size()) {
    throw Error(place_of(robot),
                "no change " + std::to_string(change) + ", its history has " + std::to_string(robot.history.size()));
  }
  RobotModel earlier = robot;
  while (earlier.history.size() > change) {
    const Change last = std::move(earlier.history.back());
    earlier.history.pop_back();
    inertia_of(earlier, last.body) = last.before;
    const auto position = earlier.frames.begin() + offset(last.index);
    if (last.kind == Change::Kind::kAttach) {
      earlier.frames.erase(position, position + 1 + offset(last.further.size()));
    } else if (last.kind == Change::Kind::kDetach) {
      insert_frames(earlier, last.frame, last.further, last.index);
    }
  }
  return earlier;
}

std::size_t changes_until(const RobotModel& robot, double time) {
  const auto later = std::find_if(robot.history.begin(), robot.history.end(),
                                  [&](const Change& change) { return change.time && *change.time > time; });
  return static_cast<std::size_t>(later - robot.history.begin());
}

}  // namespace cotwin::robot
