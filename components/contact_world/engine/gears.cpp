// Joints that gears couple: one row each, between the rates of the two joints.
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

/// Largest error at the start, m or rad; relative to positions above 1.
constexpr double kLargestError = 1e-6;

/// ratio · q̇ of a joint.
void add_rate(const Joint& joint, double ratio, GearPart& of_parent, GearPart& of_child) {
  const Vector3d along = ratio * joint.axis();
  const bool turns = joint.turns();
  for (GearPart* part : {&of_parent, &of_child}) {
    const double sign = part == &of_child ? 1 : -1;
    part->body = part == &of_child ? joint.child : joint.parent;
    (turns ? part->m : part->d) = sign * along;
    part->p = joint.p_child;
  }
}

}  // namespace

void World::Impl::check_gears() const {
  std::vector<char> follows(joints.size(), 0);
  for (const scene::Gear& gear : scene.gears) {
    for (const int joint : {gear.leader, gear.follower}) {
      if (joint >= 0 && joint < static_cast<int>(joints.size()) && joints[index(joint)].has_axis()) continue;
      throw Error("gear of joint " + std::to_string(joint), "is no revolute or prismatic joint, expected one");
    }
    const std::string place = "joint " + scene.joints[index(gear.follower)].name;
    if (gear.leader == gear.follower || follows[index(gear.follower)])
      throw Error(place, "follows itself or two joints, expected one other joint");
    follows[index(gear.follower)] = 1;
    if (!std::isfinite(gear.ratio) || !std::isfinite(gear.offset))
      throw Error(place, "follows with a ratio or offset that is not finite");
    for (const int joint : {gear.leader, gear.follower}) {
      if (forest.freedom_of(joint) < 0)
        throw Error("joint " + scene.joints[index(joint)].name,
                    "of a gear closes a loop or moves nothing, expected a joint of a tree");
    }
    const double start = joints[index(gear.follower)].q, expected = gear.ratio * joints[index(gear.leader)].q + gear.offset;
    if (!(std::abs(start - expected) <= kLargestError * std::max(1.0, std::abs(start)))) {
      throw Error(place, "starts at " + text::to_text(start) + ", expected " + text::to_text(expected) +
                             " by the gear from joint " + scene.joints[index(gear.leader)].name);
    }
  }
}

/// q_follower − ratio q_leader − offset
double World::Impl::gear_error(const scene::Gear& gear) {
  Joint &leader = joints[index(gear.leader)], &follower = joints[index(gear.follower)];
  leader.measure();
  follower.measure();
  return follower.q - gear.ratio * leader.q - gear.offset;
}

void World::Impl::collect_gear(const scene::Gear& gear, Stage stage, double h) {
  const Joint &leader = joints[index(gear.leader)], &follower = joints[index(gear.follower)];
  GearParts parts;
  add_rate(leader, -gear.ratio, parts[0], parts[1]);
  add_rate(follower, 1, parts[2], parts[3]);
  const auto moving = [&](const Joint& joint) {
    return joint.child >= 0 && bodies[index(joint.child)].dynamic() ? joint.child : joint.parent;
  };
  BoxRow row;
  row.a = moving(leader);
  row.b = moving(follower);
  if (stage == Stage::kPosition) row.target = -gear_error(gear) / h;
  row.x = joint_x[index(gear.follower)][kGearRow];
  row_origin.push_back({gear.follower, kGearRow});
  rows.add(row, parts);
}

}  // namespace cotwin::contact_world
