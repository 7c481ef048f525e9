// The accounts of energy, and the work that is booked in them.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Bodies that overlap by less only touch.
constexpr double kTouching = 1e-5;  // m

/// Gains below the energy of this height and this speed of all bodies are no error.
constexpr double kSmallHeight = 0.01, kSmallSpeed = 0.1;  // m, m/s
constexpr double kSmallEnergy = 1e-6;                     // J

}  // namespace

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
  for (const int i : account_of) {
    if (i >= 0) ++guard.accounts[index(i)].bodies;
  }
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

/// Books the work of gravity, of applied wrenches and of contacts, and stores the impulses on the axes of joints. The arms are those of the stage's start,
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

}  // namespace cotwin::contact_world
