// Detection of joints that part and of energy that no work explains.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

/// Joints within these bounds are assembled.
constexpr double kAssembledGap = 1e-4, kAssembledAngle = 1e-3;  // m, rad (m for a prismatic joint's limits)

/// Largest tilt of an assembled joint, and the growth of gap or tilt of one that started apart.
constexpr double kLargestTilt = 0.1;  // rad
constexpr double kGrowth = 1.5;

/// Joints that hold (Impl::joints_hold) have smaller gaps than this.
constexpr double kCertainGap = 1e-4;  // m

/// Joints that start apart must come nearer by 1 % at least once in this number of steps.
constexpr double kStalledSteps = 200;
constexpr double kNearer = 0.99;

/// In soft contacts deeper than this, relative to the smaller body, normals jump and the springs' energy with them.
constexpr double kDeep = 0.05;

/// Larger shares of gained energy are taken back from free bodies.
constexpr double kTakenBack = 1e-3;

/// Bodies that overlap by more than this are named in messages.
constexpr double kNamedOverlap = 1e-3;  // m

double tilt(const Joint& joint) { return std::acos(std::clamp(joint.alignment(), -1.0, 1.0)); }

}  // namespace

/// Takes a state that was set from outside. The energy that this added is work.
void World::Impl::begin_guard() {
  for (std::size_t j = 0; j < joints.size() && guard.moved; ++j) {
    if (!joints[j].has_axis()) continue;
    joints[j].measure();
    dq[j] = joints[j].speed(bodies);
  }
  guard.counts = std::all_of(carriers.begin(), carriers.end(),
                             [&](int b) { return bodies[index(b)].v.isZero(0) && bodies[index(b)].w.isZero(0); });
  if (guard.moved || guard.refreshed) measure_energies();
  if (guard.replaced) find_deep();
  for (Account& one : guard.accounts) {
    one.work = one.passive = one.placed = one.lifted = one.moved = one.jumps = 0;
    one.stored = one.elastic;
    one.buried = one.buried || (guard.replaced && one.deep);
  }
  if (!guard.moved) return;
  guard.moved = false;
  for (Account& one : guard.accounts) {
    if (!guard.begun) one.highest = one.lowest = one.potential = one.height;
    one.highest = std::max(one.highest + one.height - one.potential, one.total() - one.excess);
    one.lowest += one.height - one.potential;
    one.energy = one.total();
    one.potential = one.height;
  }
  guard.begun = true;
  guard.start_gap = guard.start_tilt = 0;
  guard.assembling = !assembled();
  if (!guard.assembling) return;
  guard.start_gap = largest_gap();
  for (const Joint& joint : joints) guard.start_tilt = std::max(guard.start_tilt, tilt(joint));
  guard.nearest = guard.start_gap;
  guard.stalled = 0;
}

bool World::Impl::assembled() {
  for (const Joint& joint : joints) {
    if (joint.gap() > kAssembledGap || tilt(joint) > kAssembledAngle) return false;
    if (joint.has_axis() && !(joint.q >= joint.q_min - kAssembledAngle && joint.q <= joint.q_max + kAssembledAngle))
      return false;
  }
  return std::all_of(scene.gears.begin(), scene.gears.end(),
                     [&](const scene::Gear& gear) { return std::abs(gear_error(gear)) <= kAssembledAngle; });
}

double World::Impl::largest_gap() const {
  double gap = 0;
  for (const Joint& joint : joints) gap = std::max(gap, joint.gap());
  return gap;
}

/// Accounts that touch in this step are judged together, so that errors which one contact makes and another one takes back are no gain.
void World::Impl::join_accounts() {
  std::vector<Account>& accounts = guard.accounts;
  for (std::size_t i = 0; i < accounts.size(); ++i) {
    accounts[i].root = i;
    accounts[i].grounded = accounts[i].held = false;
    accounts[i].all = {};
  }
  for (const Contact& touch : touches) {
    const int a = account_of[index(touch.point.body_a)], b = account_of[index(touch.point.body_b)];
    if (a == b || (touch.sum.isZero(0) && touch.impact.isZero(0))) continue;
    if (a < 0 || b < 0) {
      const RigidBody& ground = bodies[index(a < 0 ? touch.point.body_a : touch.point.body_b)];
      Account& one = accounts[index(std::max(a, b))];
      const bool rigid = touch.stiffness == scene::kInfinity && ground.motion == scene::Motion::kStatic;
      (rigid ? one.grounded : one.held) = true;
      continue;
    }
    accounts[index(a)].held = accounts[index(b)].held = true;
    const std::size_t one = root_of(index(a)), other = root_of(index(b));
    accounts[std::max(one, other)].root = std::min(one, other);
  }
}

std::size_t World::Impl::root_of(std::size_t account) const {
  while (guard.accounts[account].root != account) account = guard.accounts[account].root;
  return account;
}

/// Slows a free body down that has more energy than ever came to it and stands on rigid ground, as discs do that roll fast on their edge. In any scale
/// its velocity satisfies the conditions of its contacts. Elsewhere, momentum or somebody's work would be lost.
void World::Impl::take_back_gains() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Account* one = account(static_cast<int>(b));
    if (one == nullptr || one->bodies > 1 || frozen[b] || !one->grounded || one->held || one->buried) continue;
    const double back = std::min(one->excess, one->net - kTakenBack * (one->had() + one->small));
    if (!(back > 0 && back < one->motion)) continue;
    const double scale = std::sqrt(1 - back / one->motion);
    bodies[b].v *= scale;
    bodies[b].L *= scale;
    bodies[b].update_spin();
    twists[b] = bodies[b].twist();
    one->energy -= back;
    one->net -= back;
    one->share *= 1 - back / one->excess;
    one->excess -= back;
  }
}

void World::Impl::end_guard() {
  for (const Contact& touch : touches) {
    if (touch.stiffness == scene::kInfinity || touch.without_effect || touch.point.gap > 0) continue;
    const double size = std::min(bodies[index(touch.point.body_a)].radius, bodies[index(touch.point.body_b)].radius);
    const bool jumps = touch.jumped && -touch.point.gap > kDeep * size;
    divide(touch.point.body_a, touch.point.body_b, [&](Account& one, double share) {
      if (!touch.matched) one.placed += share * touch.stored() / 2;  // a manifold's new point has energy at once
      if (jumps) one.jumps += share * touch.stored();
    });
  }
  measure_energies();
  if (std::any_of(guard.accounts.begin(), guard.accounts.end(), [](const Account& one) { return one.buried; })) find_deep();
  join_accounts();
  const auto together = [&](const Account& one) -> Together& {
    return guard.accounts[root_of(static_cast<std::size_t>(&one - guard.accounts.data()))].all;
  };
  for (const Account& one : guard.accounts) one.add_lifts(together(one));
  for (Account& one : guard.accounts) one.judge(together(one));
  for (Account& one : guard.accounts)
    one.end_step(together(one), guard.counts && !guard.assembling && !std::exchange(one.left_out, false));
  take_back_gains();
  for (Account& one : guard.accounts) {
    if (one.share <= one.largest_share) continue;
    one.largest_share = one.share;
    one.gained = one.excess;
  }
  if (!guard.assembling) return;
  const double gap = largest_gap();
  if (gap < kNearer * guard.nearest) {
    guard.nearest = gap;
    guard.stalled = 0;
  } else {
    ++guard.stalled;
  }
  if (!assembled()) return;
  guard.assembling = false;
  guard.start_gap = guard.start_tilt = 0;
}

/// Index of the joint with the largest gap.
std::size_t World::Impl::widest_joint() const {
  const auto wider = [](const Joint& a, const Joint& b) { return a.gap() < b.gap(); };
  return static_cast<std::size_t>(std::max_element(joints.begin(), joints.end(), wider) - joints.begin());
}

/// The body of an account with the largest kinetic energy.
std::size_t World::Impl::fastest(std::size_t account) const {
  std::size_t found = 0;
  double most = -1;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (account_of[b] != static_cast<int>(account) || bodies[b].kinetic_energy() <= most) continue;
    most = bodies[b].kinetic_energy();
    found = b;
  }
  return found;
}

std::string World::fault(double gap_limit, double energy_limit) const {
  const Impl& w = *impl_;
  const Guard& guard = w.guard;
  const auto name = [&](std::size_t j) { return "joint '" + w.scene.joints[j].name + "'"; };
  if (gap_limit > 0) {
    const double limit = std::max(gap_limit, kGrowth * guard.start_gap);
    const bool holds = w.joints_hold && gap_limit > kCertainGap;
    const double largest_tilt = std::max(kLargestTilt, kGrowth * guard.start_tilt);
    static const double kAligned = std::cos(kLargestTilt);
    const double aligned = guard.start_tilt == 0 ? kAligned : std::cos(std::min(largest_tilt, std::numbers::pi));
    for (std::size_t j = 0; j < w.joints.size() && !holds; ++j) {
      if (w.joints[j].gap() > limit) {
        return name(j) + " has parted by " + text::to_text(w.joints[j].gap(), 4) + " m, expected at most " +
               text::to_text(limit, 4) + " m (joint_gap_limit): use shorter steps";
      }
      if (w.joints[j].alignment() < aligned) {
        return name(j) + " is tilted by " + text::to_text(tilt(w.joints[j]), 4) + " rad, expected at most " +
               text::to_text(largest_tilt, 4) + " rad (joint_gap_limit): use shorter steps";
      }
    }
    if (guard.assembling && guard.stalled > kStalledSteps && guard.nearest > gap_limit) {
      const std::size_t j = w.widest_joint();
      return name(j) + " does not close: its gap remains " + text::to_text(w.joints[j].gap(), 4) + " m, expected at most " +
             text::to_text(gap_limit) + " m (joint_gap_limit): correct the frames of the joints or the start positions";
    }
  }
  if (!(energy_limit > 0)) return {};
  double limit = 0, excess = 0;
  std::size_t worst = 0;
  for (std::size_t i = 0; i < guard.accounts.size(); ++i) {
    const Account& one = guard.accounts[i];
    limit += energy_limit * one.had() + one.small;
    excess += one.excess;
    if (one.excess > guard.accounts[worst].excess) worst = i;
  }
  if (!(excess > limit)) return {};
  std::string where, advice = "use shorter steps";
  const auto deepest = std::min_element(w.points.begin(), w.points.end(),
                                        [](const ContactPoint& a, const ContactPoint& b) { return a.gap < b.gap; });
  if (deepest != w.points.end() && deepest->gap < -kNamedOverlap) {
    const auto body = [&](int index) { return "'" + w.scene.bodies[static_cast<std::size_t>(index)].name + "'"; };
    where = "bodies " + body(deepest->body_a) + " and " + body(deepest->body_b) + " overlap by " +
            text::to_text(-deepest->gap, 4) + " m";
    advice = "start them apart, or " + advice;
  } else if (!w.joints.empty()) {
    const std::size_t j = w.widest_joint();
    where = name(j) + " has the largest gap, " + text::to_text(w.joints[j].gap(), 4) + " m";
    for (const Forest::Tree& tree : w.forest.trees()) {
      if (tree.loops.empty() || !tree.loops.nearly_singular()) continue;
      where = "the loop that " + name(index(tree.loops.rows()[0].joint)) +
              " closes is in a nearly singular position, as are links in line";
      advice = "start it away from there, give the links slack, or let a joint yield: shorter steps do not help";
    }
  } else {
    where = "body '" + w.scene.bodies[w.fastest(worst)].name + "' has gained most";
  }
  return "energy has grown by " + text::to_text(excess, 4) + " J without work (" + where + "), expected at most " +
         text::to_text(limit, 4) + " J (energy_limit): " + advice;
}

void World::add_gain(std::size_t body, double joules) {
  if (Account* one = impl_->account(static_cast<int>(body))) one->add_gain(joules, one->had() + one->small);
}

void World::leave_out(std::size_t body) {
  if (Account* one = impl_->account(static_cast<int>(body))) one->left_out = true;
}

World::Gain World::gain() const {
  Gain gain;
  const Impl& w = *impl_;
  std::size_t worst = 0;
  for (std::size_t i = 0; i < w.guard.accounts.size(); ++i) {
    const Account& one = w.guard.accounts[i];
    gain.joules += one.gained;
    if (one.largest_share <= gain.share) continue;
    gain.share = one.largest_share;
    gain.of_body = one.gained;
    worst = i;
  }
  gain.body = w.fastest(worst);
  return gain;
}

}  // namespace cotwin::contact_world
