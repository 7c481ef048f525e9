// Correction of the depths that a step's linear prediction of the gaps has left.
#include <Eigen/Geometry>
#include <algorithm>
#include <tuple>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Depths that are left to the next position stage, which corrects them by its share per step.
constexpr double kLeft = 5e-5;  // m

/// Gain of depth that starts a correction; in pairs that were deeper than kTooDeep already it is kAccuracy, so that small gains
/// do not add up. kAccuracy is also that of the correction.
constexpr double kTooDeep = 3e-4, kAccuracy = 5e-6;  // m

constexpr int kSeparationPasses = 3;

/// Bodies that move: those of pairs that are too deep and this number of rings of neighbours.
constexpr int kRings = 1;

}  // namespace

/// Sets `allowed` of each point to the depth that its pair of shapes had at the start of the step, at least kLeft; from the
/// second pass on, the points before are those of the previous pass. Returns whether a point has become too deep.
bool World::Impl::allow_depths(int pass) {
  const auto pair = [](const Contact& t) {
    return std::make_tuple(t.point.body_a, t.point.body_b, t.point.shape_a, t.point.shape_b);
  };
  bool too_deep = false;
  std::size_t before = 0;
  for (std::size_t first = 0; first < touches.size();) {
    const auto key = pair(touches[first]);
    while (before < touches_before.size() && pair(touches_before[before]) < key) ++before;
    double depth = kLeft;
    for (; before < touches_before.size() && pair(touches_before[before]) == key; ++before) {
      const Contact& then = touches_before[before];
      depth = std::max(depth, pass == 0 ? -then.point.gap : then.allowed);
    }
    for (; first < touches.size() && pair(touches[first]) == key; ++first) {
      touches[first].allowed = depth;
      const bool rigid = touches[first].stiffness == scene::kInfinity;
      const double limit = depth + (depth < kTooDeep ? kTooDeep : kAccuracy);
      touches[first].too_deep = rigid && -touches[first].point.gap > limit;
      too_deep = too_deep || touches[first].too_deep;
    }
  }
  return too_deep;
}

/// Marks the bodies of pairs that are too deep and those that touch a marked one, kRings times.
void World::Impl::mark_too_deep() {
  std::fill(shifted.begin(), shifted.end(), 0);
  const auto mark = [&](int body, char as) {
    char& ring = shifted[index(body)];
    if (ring == 0 && frozen[index(body)] == 0) ring = as;
  };
  for (const Contact& touch : touches) {
    if (!touch.too_deep) continue;
    mark(touch.point.body_a, 1);
    mark(touch.point.body_b, 1);
  }
  for (char ring = 1; ring < 1 + kRings; ++ring) {
    const auto next = static_cast<char>(ring + 1);
    for (const Contact& touch : touches) {
      if (shifted[index(touch.point.body_a)] == ring) mark(touch.point.body_b, next);
      if (shifted[index(touch.point.body_b)] == ring) mark(touch.point.body_a, next);
    }
  }
}

/// The position stage predicts the gaps linearly. Where bodies turn fast or touch along a new feature, they end the step deeper
/// than at its start. This function moves free bodies apart, without friction, by the least displacement in the metric of their
/// masses that leaves no pair deeper than it was. Velocities are not changed, so that no energy but that of the height is added. Nor are they
/// turned: that would change the energy of their rotation or their angular momentum.
/// Bodies with joints stay where they are, and so do bodies that are not near a pair that is too deep.
void World::Impl::separate(double h) {
  if (!allow_depths(0)) return;
  measure_energies();
  for (Account& one : guard.accounts) one.before = one.total();
  for (int pass = 0; (pass == 0 || (pass < kSeparationPasses && allow_depths(pass))) && move_apart(h);) ++pass;
  measure_energies();
  for (Account& one : guard.accounts) one.moved += std::max(0.0, one.total() - one.before);
}

/// Returns whether there was a body to move.
bool World::Impl::move_apart(double h) {
  mark_too_deep();
  rows.clear();
  for (std::size_t t = 0; t < touches.size(); ++t) {
    const Contact& touch = touches[t];
    ConeRow row;
    row.a = shifted[index(touch.point.body_a)] != 0 ? touch.point.body_a : -1;
    row.b = shifted[index(touch.point.body_b)] != 0 ? touch.point.body_b : -1;
    if ((row.a < 0 && row.b < 0) || touch.stiffness < scene::kInfinity) continue;
    const Vector3d& n = touch.point.n_W;
    Eigen::Index least = 0;
    n.cwiseAbs().minCoeff(&least);
    const Vector3d t1 = n.cross(Vector3d::Unit(least)).normalized();
    row.d << n, t1, n.cross(t1);
    row.p = touch.point.p_W;
    row.target = (-touch.point.gap - touch.allowed) / h;
    row.point = static_cast<int>(t);
    rows.add(row);
  }
  prepared = false;
  if (rows.empty()) return false;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (shifted[b] == 0) continue;
    RigidBody& body = pushed[b] = bodies[b];
    body.v.setZero();
    body.w.setZero();
    body.inverse_moments.setZero();
    body.inverse_root_moments.setZero();
  }
  rows.prepare(pushed, forest);
  rows.measure(pushed);
  rows.sweep(options.iterations, kAccuracy / h, 0);
  rows.apply(pushed, forest);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (shifted[b] == 0) continue;
    bodies[b].p += h * pushed[b].v;
    poses[b] = bodies[b].pose();
  }
  detector.update(poses, margin, shifted);
  update_points();
  match(0);
  return true;
}

}  // namespace cotwin::contact_world
