// Detection of joints that part and of energy that no work explains.
#include "components/contact_world/engine/guard.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
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

/// Bodies that overlap by less only touch.
constexpr double kTouching = 1e-5;  // m

/// Bodies that overlap by more than this are named in messages.
constexpr double kNamedOverlap = 1e-3;  // m

/// Gains below the energy of this height and this speed of all bodies are no error.
constexpr double kSmallHeight = 0.01, kSmallSpeed = 0.1;  // m, m/s
constexpr double kSmallEnergy = 1e-6;                     // J
constexpr double kSmallShare = 0.1;                       // of it, added to the energy that gains are relative to

double tilt(const Joint& joint) { return std::acos(std::clamp(joint.alignment(), -1.0, 1.0)); }

}  // namespace

// ---- Accounts

/// Bodies that exchange energy other than through contacts share an account.
void World::Impl::open_accounts() {
  std::vector<std::size_t> root(bodies.size());
  std::iota(root.begin(), root.end(), 0U);
  const auto find = [&](std::size_t b) {
    while (root[b] != b) b = root[b];
    return b;
  };
  const auto connect = [&](int a, int b) {
    if (!is_dynamic(a) || !is_dynamic(b)) return;
    const std::size_t one = find(index(a)), other = find(index(b));
    root[std::max(one, other)] = std::min(one, other);
  };
  const auto moved = [&](const Joint& joint) { return is_dynamic(joint.child) ? joint.child : joint.parent; };
  for (const Joint& joint : joints) connect(joint.parent, joint.child);
  for (const Latch& latch : latches) connect(latch.joint.parent, latch.joint.child);
  for (const scene::Gear& gear : scene.gears) connect(moved(joints[index(gear.leader)]), moved(joints[index(gear.follower)]));
  account_of.assign(bodies.size(), -1);
  int count = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].dynamic()) account_of[b] = find(b) == b ? count++ : account_of[find(b)];
  }
  guard.accounts.resize(index(count));
  set_small_energies();
}

void World::Impl::set_small_energies() {
  for (Account& one : guard.accounts) one.small = kSmallEnergy;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (Account* one = account(static_cast<int>(b)))
      one->small += bodies[b].mass * (scene.gravity.norm() * kSmallHeight + kSmallSpeed * kSmallSpeed / 2);
  }
}

/// Account of a body, or null if it is not dynamic.
Account* World::Impl::account(int body) {
  const int i = body >= 0 ? account_of[index(body)] : -1;
  return i >= 0 ? &guard.accounts[index(i)] : nullptr;
}

/// Account of a joint, or null if it moves no dynamic body.
Account* World::Impl::account_of_joint(std::size_t joint) {
  Account* one = account(joints[joint].child);
  return one != nullptr ? one : account(joints[joint].parent);
}

/// Calls f(account, share) for each of two bodies that has an account: they share equally.
template <class F>
void World::Impl::divide(int a, int b, const F& f) {
  Account *of_a = account(a), *of_b = account(b);
  const double share = of_a != nullptr && of_b != nullptr ? 0.5 : 1;
  if (of_a != nullptr) f(*of_a, share);
  if (of_b != nullptr) f(*of_b, share);
}

/// Accounts for an impulse on b that does the work `at_b` there, and whose reaction does −at_a on a.
void World::Impl::exchange(int a, int b, double at_a, double at_b) {
  Account *of_a = account(a), *of_b = account(b);
  if (of_a != nullptr && of_b != nullptr) {
    of_a->passive += (at_b - at_a) / 2;
    of_b->passive += (at_b - at_a) / 2;
    of_a->work -= (at_a + at_b) / 2;
    of_b->work += (at_a + at_b) / 2;
  } else if (Account* one = of_a != nullptr ? of_a : of_b) {
    one->passive += at_b - at_a;
  }
}

void World::Impl::measure_energies() {
  for (Account& one : guard.accounts) one.motion = one.elastic = one.height = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Account* one = account(static_cast<int>(b));
    if (one == nullptr) continue;
    one->motion += bodies[b].kinetic_energy();
    one->height -= bodies[b].mass * scene.gravity.dot(bodies[b].p);
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    Account* one = axes[j].inertia > 0 || joints[j].stiffness > 0 ? account_of_joint(j) : nullptr;
    if (one == nullptr) continue;
    const double speed = joints[j].speed(bodies), extension = joints[j].q - joints[j].q_spring;
    one->motion += (axes[j].inertia * speed * speed + joints[j].stiffness * extension * extension) / 2;
  }
  for (const Contact& touch : touches) {
    const double stored = touch.stored() / 2;
    if (stored == 0) continue;
    divide(touch.point.body_a, touch.point.body_b, [&](Account& one, double share) {
      one.motion += share * stored;
      one.elastic += share * stored;
    });
  }
}

/// Adds the work of driven bodies by the contacts' impulses on b.
template <class F>
void World::Impl::add_driven_work(const F& impulse_of, double Account::*sum) {
  if (!has_driven) return;
  for (const Contact& touch : touches) {
    const Vector3d impulse = impulse_of(touch);
    const auto along = [&](int body) {
      const RigidBody& one = bodies[index(body)];
      if (one.motion != scene::Motion::kDriven) return 0.0;
      return impulse.dot(one.v + one.w.cross(touch.point.p_W - one.p));
    };
    const double work = along(touch.point.body_a) - along(touch.point.body_b);
    divide(touch.point.body_a, touch.point.body_b, [&](Account& one, double share) { one.*sum += share * work; });
  }
}

/// Before impacts.
void World::Impl::begin_impacts() {
  measure_energies();
  for (Account& one : guard.accounts) one.before = one.motion;
}

/// After impacts: each account loses of what they lose in all by the energy that it exchanged.
void World::Impl::account_impacts() {
  measure_energies();
  // account_position_stage() has the work of driven bodies
  add_driven_work([](const Contact& touch) { return touch.impact; }, &Account::before);
  double lost = 0, exchanged = 0;
  for (const Account& one : guard.accounts) {
    lost += one.before - one.motion;
    exchanged += std::abs(one.before - one.motion);
  }
  for (Account& one : guard.accounts) {
    const double change = one.motion - one.before;
    if (change == 0) continue;
    const double part = std::abs(change) / exchanged * lost;
    one.passive -= part;
    one.work += change + part;
  }
}

void World::Impl::find_deep() {
  for (Account& one : guard.accounts) one.deep = false;
  for (const Contact& touch : touches) {
    if (touch.stiffness < scene::kInfinity || touch.point.gap >= -kTouching) continue;
    divide(touch.point.body_a, touch.point.body_b, [](Account& one, double) { one.deep = true; });
  }
}

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

/// Stores the bodies' motion before forces and impulses act.
void World::Impl::begin_stage() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].motion != scene::Motion::kStatic) starts[b] = {bodies[b].p, bodies[b].v, bodies[b].w};
  }
}

/// Impulse of limits, friction and motor of a joint in the last solution.
double World::Impl::axis_impulse(std::size_t joint) {
  const std::array<double, kJointRows>& x = joint_x[joint];
  double sum = 0;
  for (int row = kSpringRow + 1; row < kGearRow; ++row) sum += x[index(row)];
  const int f = forest.freedom_of(static_cast<int>(joint));
  if (f >= 0 && !laws[joint].empty()) sum += laws[joint].impulse(forest.freedoms()[index(f)]);
  return sum;
}

/// Work of gravity, of applied wrenches, and of contacts on the relative motion of their bodies, and the impulses on the axes of joints. The arms are those of the stage's start,
/// because bodies with joints have moved since.
void World::Impl::account_stage(Stage stage, double h) {
  const auto mean = [&](int body, const Vector3d& p) -> Vector3d {
    const RigidBody& now = bodies[index(body)];
    const Start& start = starts[index(body)];
    return (start.v + now.v + (start.w + now.w).cross(p - start.p)) / 2;
  };
  for (const ConeRow& row : rows.cones()) {
    const Contact& touch = touches[index(row.point)];
    if (touch.impulse.isZero(0)) continue;
    const Vector3d& p = touch.point.p_W;
    const auto [a, b] = std::pair(touch.point.body_a, touch.point.body_b);
    exchange(a, b, touch.impulse.dot(mean(a, p)), touch.impulse.dot(mean(b, p)));
  }
  const auto mean_spin = [&](int body) -> Vector3d {
    return body < 0 ? Vector3d(Vector3d::Zero()) : Vector3d((starts[index(body)].w + bodies[index(body)].w) / 2);
  };
  for (const BoxRow& row : rows.boxes()) {
    const RowOrigin& origin = row_origin[index(row.origin)];
    if (origin.joint >= 0 || origin.latch >= 0) continue;
    exchange(row.a, row.b, row.x * row.m.dot(mean_spin(row.a)), row.x * row.m.dot(mean_spin(row.b)));
  }
  account_latches();
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const RigidBody& body = bodies[b];
    if (!body.dynamic()) continue;
    const Vector3d way = h / 4 * (starts[b].v + body.v);
    Account& one = *account(static_cast<int>(b));
    one.passive += body.mass * scene.gravity.dot(way);
    const Wrench& F = applied[b];
    if (F.isZero(0)) continue;
    const Vector3d turn = h / 4 * (starts[b].w + body.w);
    one.work += F.head<3>().dot(way + turn.cross(body.R * body.X_PB.p)) + F.tail<3>().dot(turn);
  }
  for (std::size_t j = 0; j < joints.size(); ++j) axes[j].passive[stage == Stage::kPosition ? 0 : 1] = axis_impulse(j);
}

/// Work of the contacts' position correction, which lifts bodies, of driven bodies and of applied wrenches; called after the
/// position stage.
void World::Impl::account_position_stage(double h) {
  account_stage(Stage::kPosition, h);
  // An upper bound: the force of the whole step is at most twice that of its first half.
  for (const ConeRow& row : rows.cones()) {
    if (row.lift > 0) divide(row.a, row.b, [&](Account& one, double share) { one.lifted += share * 2 * row.x[0] * row.lift; });
  }
  add_driven_work([](const Contact& touch) -> Vector3d { return touch.impact + touch.sum; }, &Account::work);
}

void World::Impl::account_velocity_stage(double h) {
  account_stage(Stage::kVelocity, h);
  add_driven_work([](const Contact& touch) { return touch.impulse; }, &Account::work);
}

/// Work of drive, motor, limits, friction and damper of a joint in a step from position q_0 and speed s_0 to the joint's present position and
/// speed s_1. The joint's own spring does no work: its energy is part of E.
void World::Impl::account_axis(std::size_t joint, double q_0, double s_0, double s_1, double h) {
  Account* one = account_of_joint(joint);
  if (one == nullptr) return;
  const Axis& axis = axes[joint];
  const double s = (joints[joint].q - q_0) / h, damping = h / 2 * joints[joint].damping;
  const auto work = [&](double first, double second) { return first * (s_0 + s) / 2 + second * (s + s_1) / 2; };
  one->passive -= work(damping * s, damping * s_1);
  const double others = work(axis.passive[0], axis.passive[1]);
  (axis.motor_torque > 0 ? one->work : one->passive) += others;
  if (axis.tau == 0 && axis.stiffness == 0 && axis.damping == 0) return;
  const double constant = axis.tau + axis.stiffness * h / 2 * (axis.rate - s);
  one->work += work(h / 2 * (constant + axis.damping * (axis.rate - s)), h / 2 * (constant + axis.damping * (axis.rate - s_1)));
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

/// Adds what corrections of depth have lifted to that of all that touch.
void Account::add_lifts(Together& all) const {
  all.lifted += lifted;
  all.higher += std::max(0.0, height - potential) + std::max(0.0, elastic - stored);
}

/// Judges the step by itself, and adds to the sums of all that touch.
void Account::judge(Together& all) {
  // Corrections of depth lift bodies and press others together. The velocity stage takes their speed back, so they explain no
  // motion: impulses that bodies without room exert on one another have no bound.
  const double raised = moved + (all.lifted > 0 ? lifted * std::min(1.0, all.higher / all.lifted) : 0);
  // Without what gravity and the soft contacts' springs have stored. Errors of one solution that the next one takes back are no gain.
  const double balance = passive + height - potential + elastic - stored - placed - raised;
  loss = std::max(0.0, -balance - owed);
  gain = total() - energy - work - placed - (buried ? raised : 0);
  net += gain;
  all.more += gain;
  all.balance += balance;
  all.owed += owed;
  all.raised += buried ? 0 : raised;
  all.lost += lost;
  all.loss += loss;
  all.excess += excess;
  all.had += had();
  all.small += small;
  gain = std::max(0.0, gain + loss);
  all.gain += gain;
  owed = std::max(0.0, owed + balance);
  all.owing += owed;
  buried = buried && deep;
}

/// Takes its part of what all that touch have gained. `counts`: all of their work is known.
void Account::end_step(const Together& all, bool counts) {
  const double loss_of_all = std::max(0.0, -all.balance - all.owed);
  if (all.owing > 0) owed *= std::max(0.0, all.balance + all.owed) / all.owing;
  if (all.loss > 0) lost += loss / all.loss * loss_of_all;
  // What has sunk in gives up height for speed and loses that in the contact, and is no higher when it has been lifted.
  const double lost_by_all = all.lost + loss_of_all, given_back = std::min(all.raised, lost_by_all);
  if (lost_by_all > 0) lost *= 1 - given_back / lost_by_all;
  const double gain_of_all = all.more + loss_of_all - given_back;
  if (gain_of_all <= 0) {
    jumped = std::max(0.0, jumped + gain_of_all);
    gain = all.excess > 0 ? excess / all.excess * gain_of_all : 0;
  } else {
    gain *= gain_of_all / all.gain;
  }
  // Jumps may give the energy of their springs and no more than there was before, in all steps together.
  if (gain > 0 && jumps > 0) {
    const double explained = std::clamp(jumps + had() + small - jumped, 0.0, gain);
    jumped += explained;
    gain -= explained;
  }
  if (counts && gain > 0) {
    excess += gain;
    share += gain / (all.had + kSmallShare * all.small);
  } else if (counts && excess > 0) {
    const double left = std::max(0.0, excess + gain);
    share *= left / excess;
    excess = left;
  }
  energy = total();
  potential = height;
  highest = std::max(highest, energy - excess);
  lowest = std::min(lowest, potential);
}

/// Slows a free body down that has more energy than ever came to it and stands on rigid ground, as discs do that roll fast on their edge. In any scale
/// its velocity satisfies the conditions of its contacts. Elsewhere, momentum or somebody's work would be lost.
void World::Impl::take_back_gains() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Account* one = account(static_cast<int>(b));
    if (one == nullptr || frozen[b] || !one->grounded || one->held) continue;
    const double back = one->net - kTakenBack * (one->had() + one->small);
    if (!(back > 0 && back < one->motion)) continue;
    const double scale = std::sqrt(1 - back / one->motion);
    bodies[b].v *= scale;
    bodies[b].L *= scale;
    bodies[b].update_spin();
    twists[b] = bodies[b].twist();
    one->energy -= back;
    one->net -= back;
    const double left = std::max(0.0, one->excess - back);
    if (one->excess > 0) one->share *= left / one->excess;
    one->excess = left;
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
  for (Account& one : guard.accounts) one.end_step(together(one), guard.counts && !guard.assembling);
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
