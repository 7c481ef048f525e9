#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::robot {
namespace {

using UrdfJoint = UrdfDocument::Joint;

std::string place_of(const UrdfDocument& document, const UrdfJoint& joint, int line) {
  return document.at(line) + ": joint '" + joint.name + "'";
}

/// The joint `name`. Throws Error with the closest name.
const UrdfJoint& find(const UrdfDocument& document, const std::string& name, const std::string& place,
                      const std::string& what) {
  const auto found = document.joints.find(name);
  if (found != document.joints.end()) return found->second;
  std::vector<std::string> names;
  for (const auto& [other, joint] : document.joints) names.push_back(other);
  const std::string close = text::closest(name, names);
  throw Error(place,
              what + ", expected a joint of the file" + (close.empty() ? std::string() : "; did you mean '" + close + "'?"));
}

/// `joint` in terms of the joint at the end of its chain of mimics.
Following follow(const UrdfDocument& document, const UrdfJoint& joint, const std::map<std::string, double>& locked,
                 std::vector<std::string>* warnings) {
  const std::string place = place_of(document, joint, joint.mimic_line);
  const auto stand = [&](double q, const std::string& why) {
    if (warnings != nullptr) warnings->push_back(place + ": stands still at " + text::to_text(q) + ", because " + why);
    return Following{"", 0, q};
  };
  double rate = 1, offset = 0;  // q = rate · q_leader + offset
  const UrdfJoint* leader = &joint;
  std::set<std::string> passed;
  while (!leader->mimic.empty() && leader->moves()) {
    if (!passed.insert(leader->name).second) {
      throw Error(place, joint.mimic == joint.name
                             ? "mimics itself, expected another joint"
                             : "mimics itself through '" + joint.mimic + "', expected a joint of its own");
    }
    offset += rate * leader->offset;
    rate *= leader->multiplier;
    leader = &find(document, leader->mimic, place_of(document, *leader, leader->mimic_line), "mimics '" + leader->mimic + "'");
  }
  if (!(std::abs(rate) < kNoLimit && std::abs(offset) < kNoLimit)) {
    throw Error(place, "follows '" + leader->name + "' with the multiplier " + text::to_text(rate) + " and the offset " +
                           text::to_text(offset) + ", expected magnitudes below " + text::to_text(kNoLimit));
  }
  if (!leader->moves()) return stand(offset, "it mimics '" + leader->name + "', which is fixed");
  if (rate == 0) return stand(offset, "the multiplier of its <mimic> is 0");
  if (const auto at = locked.find(leader->name); at != locked.end()) return {"", 0, rate * at->second + offset};
  return {leader->name, rate, offset};
}

}  // namespace

Pose origin_at(const UrdfJoint& joint, double q) {
  if (q == 0) return joint.X_PJ;
  if (joint.type == "prismatic") return joint.X_PJ * Pose{Eigen::Matrix3d::Identity(), q * joint.axis};
  return joint.X_PJ * Pose{Eigen::AngleAxisd(q, joint.axis).toRotationMatrix(), Eigen::Vector3d::Zero()};
}

std::map<std::string, Following> follow_mimics(const UrdfDocument& document, const std::map<std::string, double>& locked,
                                               std::vector<std::string>* warnings) {
  std::map<std::string, Following> mimics;
  for (const auto& [name, joint] : document.joints) {
    if (joint.mimic.empty()) continue;
    if (joint.moves()) {
      mimics.emplace(name, follow(document, joint, locked, warnings));
    } else if (warnings != nullptr) {
      warnings->push_back(place_of(document, joint, joint.mimic_line) + ": <mimic> of a fixed joint has no effect");
    }
  }
  for (const auto& [name, q] : locked) {
    const UrdfJoint& joint = find(document, name, document.place, "no joint '" + name + "' to lock");
    const std::string place = place_of(document, joint, joint.line);
    if (!(std::abs(q) < kNoLimit)) {
      throw Error(place, "locked at " + text::to_text(q) + ", expected a magnitude below " + text::to_text(kNoLimit));
    }
    if (!joint.moves()) throw Error(place, "is fixed and cannot be locked, expected a joint that moves");
    const auto mimic = mimics.find(name);
    if (mimic == mimics.end()) continue;
    const Following& following = mimic->second;
    if (!following.leader.empty()) throw Error(place, "mimics '" + following.leader + "', expected that joint to be locked");
    if (following.offset != q) {
      throw Error(place, "locked at " + text::to_text(q) + ", but its <mimic> keeps it at " + text::to_text(following.offset));
    }
  }
  return mimics;
}

}  // namespace cotwin::robot
