#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// The position stage repeats until the joints' errors at the end of the step are below the tolerance, at most kPasses times.
constexpr double kJointTolerance = 2e-10;  // m, rad
constexpr int kPasses = 12;
constexpr double kDiverging = 4;       // times the first error
constexpr double kPredictable = 1e-5;  // m, rad: errors below are used to predict those of the next steps
constexpr double kSureToHold = 1e-5;   // m, rad: joints with smaller errors need no check

/// Largest numbers of iterations for held axes: in total, of these with simultaneous changes, and with contact impulses.
constexpr int kLockRounds = 60, kSimultaneousRounds = 8, kContactRounds = 6;

/// The same where contacts may yield: each halves the interval of a velocity at least.
constexpr int kYieldingRounds = 40;

/// Points of successive steps within this distance, relative to the pair's size, are the same, whatever their features.
constexpr double kSamePlace = 0.02;

}  // namespace

// ---- The phases of a step

void World::Impl::step(double h) {
  rest = kSlow * h * scene.gravity.norm();
  status.iterations = 0;
  status.residual = 0;
  status.degenerate = 0;
  status.extended = 0;
  status.unsolved = 0;
  status.impacts = 0;
  status.swing = 0;
  guard.refreshed = stale;
  guard.replaced = stale && !restored;
  if (stale) {
    for (Joint& joint : joints) joint.place(bodies);
    for (Forest::Tree& tree : forest.trees()) {
      if (!restored) tree.loops.jump();
    }
    refresh(h, 0);
  }

  for (Contact& touch : touches) {
    touch.sum.setZero();
    touch.impact.setZero();
    touch.distant = false;
  }
  begin_guard();
  begin_latches();
  begin_inertias();
  advance.clear();
  if (find_fast(h)) find_distant_points(h);
  resolve_impacts(h);
  if (status.impacts > 0 && find_fast(h)) find_distant_points(h);
  begin_stage();
  kick(h / 2);
  solve(Stage::kPosition, h);
  account_position_stage(h);
  drift(h);
  for (Forest::Tree& tree : forest.trees()) tree.loops.advance();
  refresh(h, h);
  yield(h);
  begin_inertias();
  apply_lost_springs();  // reads the points before those of separate()
  separate(h);
  if (advance.any()) find_distant_points(h);
  begin_stage();
  kick(h / 2);
  solve(Stage::kVelocity, h);
  account_velocity_stage(h);
  sum_yielding(h);
  publish(h);
  advance_latches(h);
  end_guard();

  for (Wrench& F : applied) F.setZero();
  for (Axis& axis : axes) axis.tau = axis.stiffness = axis.damping = axis.rate = axis.spring = 0;
}

void World::Impl::refresh(double h, double drifted) {
  for (Forest::Tree& tree : forest.trees()) forest.place(tree, bodies, joints);
  if (!restored) set_margin(h);
  detect();
  match(drifted);
  prepared = false;
  stale = restored = false;
}

void World::Impl::kick(double half) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    RigidBody& body = bodies[b];
    if (!body.dynamic()) continue;
    body.v += half * scene.gravity;
    const Wrench& F = applied[b];
    if (F.isZero(0)) continue;
    const Vector3d moment = F.tail<3>() + (body.R * body.X_PB.p).cross(F.head<3>());
    body.apply_impulse(half * F.head<3>(), half * moment);
  }
}

void World::Impl::publish(double h) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].motion == scene::Motion::kStatic) continue;
    twists[b] = bodies[b].twist();
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].has_axis()) continue;
    joints[j].measure();
    const double speed = joints[j].speed(bodies);
    account_axis(j, q[j], status.impacts > 0 ? axes[j].start : dq[j], speed, h);
    q[j] = joints[j].q;
    dq[j] = speed;
  }
  points.clear();
  forces.clear();
  for (std::size_t t = 0; t < touches.size(); ++t) {
    points.push_back(touches[t].point);
    forces.push_back((touches[t].impact + touches[t].sum) / h);
    if (t >= options.contacts) {  // not part of the state
      touches[t].impulse.setZero();
      touches[t].travel.known = touches[t].travel.goes_on = false;
    }
  }
}

// ---- Contacts

void World::Impl::reserve(std::size_t contacts) {
  capacity = contacts;
  const std::size_t boxes = loose.size() * kJointRows + scene.gears.size() + 6 * latches.size() + (torsional ? contacts : 0);
  row_origin.reserve(boxes);
  rows.reserve(contacts, boxes, scene.gears.size());
  touches.reserve(contacts);
  touches_before.reserve(contacts);
  points.reserve(contacts);
  forces.reserve(contacts);
  reserve_impacts(contacts);
}

void World::Impl::detect() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].motion != scene::Motion::kStatic) poses[b] = bodies[b].pose();
  }
  detector.detect(poses, margin);
  update_points();
}

void World::Impl::update_points() {
  std::swap(touches, touches_before);
  touches.clear();
  if (detector.points().size() > capacity) {
    reserve(std::max(2 * capacity, detector.points().size()));
    ++status.grown;
  }
  for (const ContactPoint& point : detector.points()) {
    if (!bodies[index(point.body_a)].dynamic() && !bodies[index(point.body_b)].dynamic()) continue;
    const scene::Material& a = *materials[index(point.body_a)][index(point.shape_a)];
    const scene::Material& b = *materials[index(point.body_b)][index(point.shape_b)];
    Contact touch;
    touch.point = point;
    set_friction(touch, a, b);
    touch.restitution = std::max(a.restitution, b.restitution);
    set_spring(touch);
    touches.push_back(touch);
  }
  status.contacts = touches.size();
}

/// Measures how the point travels, or keeps what is known if nothing has moved. A point whose features mean another place than before jumps.
void World::Impl::follow(Contact& touch, const Contact& before, double drifted) const {
  constexpr double kSame = 0.25;  // of the travel, the largest change in a step
  if (drifted == 0) {
    touch.travel = before.travel;
    return;
  }
  if (fast(touch.point.body_a, touch.point.body_b, drifted)) return;
  const Vector3d travel = (touch.point.p_W - before.point.p_W) / drifted;
  touch.travel.known = true;
  touch.travel.a = travel - bodies[index(touch.point.body_a)].v;
  touch.travel.b = travel - bodies[index(touch.point.body_b)].v;
  const auto alike = [&](const Vector3d& now, const Vector3d& then) {
    return (now - then).norm() <= kSame * now.norm() + rest;
  };
  touch.travel.goes_on =
      before.travel.known && alike(touch.travel.a, before.travel.a) && alike(touch.travel.b, before.travel.b);
  if (!touch.travel.goes_on) return;
  touch.travel.change_a = touch.travel.a - before.travel.a;
  touch.travel.change_b = touch.travel.b - before.travel.b;
}

// Matches the points of two steps; both lists are sorted by pair. Points with equal features are the same; if features swap, as
// for aligned faces, the nearest unmatched point is taken.
void World::Impl::match(double drifted) {
  const auto pair = [](const Contact& t) {
    return std::make_tuple(t.point.body_a, t.point.body_b, t.point.shape_a, t.point.shape_b);
  };
  const auto take = [&](Contact& touch, Contact& before) {
    touch.impulse = before.impulse;
    touch.impact = before.impact;
    touch.sum = before.sum;
    touch.push = before.push;
    touch.share = before.share;
    touch.conserves = before.conserves;
    touch.gap_before = before.gap;
    touch.matched = before.matched = true;
    touch.jumped = touch.point.n_W.dot(before.point.n_W) < kJump || (drifted == 0 && before.jumped);
    if (touch.point.id == before.point.id) follow(touch, before, drifted);
  };
  const auto common = [&](int body_a, int body_b) {
    const RigidBody &a = bodies[index(body_a)], &b = bodies[index(body_b)];
    if (a.motion == scene::Motion::kStatic || b.motion == scene::Motion::kStatic) return Vector3d(Vector3d::Zero());
    return a.inverse_mass < b.inverse_mass ? a.v : b.v;
  };
  for (Contact& before : touches_before) before.matched = false;
  std::size_t begin = 0, first = 0;
  while (first < touches.size()) {
    const Vector3d moved = drifted * common(touches[first].point.body_a, touches[first].point.body_b);
    const auto key = pair(touches[first]);
    std::size_t end = first + 1;
    while (end < touches.size() && pair(touches[end]) == key) ++end;
    while (begin < touches_before.size() && pair(touches_before[begin]) < key) ++begin;
    std::size_t end_before = begin;
    while (end_before < touches_before.size() && pair(touches_before[end_before]) == key) ++end_before;

    std::size_t left = end_before - begin;
    for (std::size_t i = first; i < end && left > 0; ++i) {
      for (std::size_t t = begin; t < end_before; ++t) {
        if (touches_before[t].matched || touches_before[t].point.id != touches[i].point.id) continue;
        take(touches[i], touches_before[t]);
        --left;
        break;
      }
    }
    const double reach =
        kSamePlace * (bodies[index(touches[first].point.body_a)].radius + bodies[index(touches[first].point.body_b)].radius);
    for (std::size_t i = first; i < end && left > 0; ++i) {
      if (touches[i].matched) continue;
      Contact* nearest = nullptr;
      double distance = reach * reach;
      for (std::size_t t = begin; t < end_before; ++t) {
        if (touches_before[t].matched) continue;
        const double d = (touches_before[t].point.p_W + moved - touches[i].point.p_W).squaredNorm();
        if (d >= distance) continue;
        distance = d;
        nearest = &touches_before[t];
      }
      if (nearest == nullptr) continue;
      take(touches[i], *nearest);
      --left;
    }
    first = end;
    begin = end_before;
  }
}

double World::Impl::normal_velocity(const Contact& touch) const {
  const RigidBody& a = bodies[index(touch.point.body_a)];
  const RigidBody& b = bodies[index(touch.point.body_b)];
  const Vector3d& p = touch.point.p_W;
  return touch.point.n_W.dot(b.v + b.w.cross(p - b.p) - a.v - a.w.cross(p - a.p));
}

// ---- The two solutions of a step

void World::Impl::solve(Stage stage, double h) {
  if (stage == Stage::kPosition) {
    for (Joint& joint : joints) joint.begin_step();
  }
  drive_loose_joints(stage, h);
  apply_soft_latches(stage);
  for (Forest::Tree& tree : forest.trees()) {
    forest.load_momenta(tree, bodies);
    if (stage == Stage::kPosition) {
      forest.predict_beta(tree, bodies, joints, h);
    } else {
      forest.clear_beta(tree);
    }
  }
  begin_axes(stage, h);
  solve_trees();
  collect_rows(stage, h);
  if (prepared) prepared = rows.update();
  solve_rows();
  if (stage == Stage::kPosition) satisfy_joints(h);
  store_impulses();
  if (stage == Stage::kVelocity) return;
  store_spring_impulses();
  store_spring_torques(h);
}

/// Sets the momentum of the axes' inertias from the joint speed at the start of the stage.
void World::Impl::begin_inertias() {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    axes[j].momentum = axes[j].inertia > 0 ? axes[j].inertia * joints[j].speed(bodies) : 0;
  }
}

/// Applies the drive of joints outside the trees as impulses on both bodies.
void World::Impl::drive_loose_joints(Stage stage, double h) {
  const auto apply_impulse = [&](int body, const Vector3d& impulse, const Vector3d& moment, const Vector3d& p) {
    if (body < 0 || !bodies[index(body)].dynamic()) return;
    RigidBody& b = bodies[index(body)];
    b.apply_impulse(impulse, moment + (p - b.p).cross(impulse));
  };
  for (const LooseJoint& one : loose) {
    const Joint& joint = joints[index(one.joint)];
    if (forest.freedom_of(one.joint) >= 0 || !joint.has_axis()) continue;
    const double tau = AxisDrive(joint, axes[index(one.joint)], stage, h).tau;
    if (tau == 0) continue;
    const bool turns = joint.turns();
    const Vector3d impulse = turns ? Vector3d::Zero() : Vector3d(tau * joint.axis());
    const Vector3d moment = turns ? Vector3d(tau * joint.axis()) : Vector3d::Zero();
    apply_impulse(joint.child, impulse, moment, joint.p_child);
    apply_impulse(joint.parent, -impulse, -moment, joint.p_child);
  }
}

void World::Impl::begin_axes(Stage stage, double h) {
  laws.clear();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    laws.emplace_back();
    const int f = forest.freedom_of(static_cast<int>(j));
    if (f < 0) continue;
    Forest::Freedom& freedom = forest.freedoms()[index(f)];
    const AxisDrive drive(joints[j], axes[j], stage, h);
    const bool was_locked = freedom.locked;
    const double softness = freedom.softness;
    freedom.softness = drive.softness;
    freedom.locked = false;
    freedom.tau = drive.tau;
    drives[j] = drive.tau;
    if (options.method == Method::kTree) {
      laws[j] = AxisLaw(joints[j], axes[j], stage, h);
      if (!laws[j].empty()) laws[j].begin(axes[j], freedom, drive.tau);
    }
    if (freedom.locked == was_locked && freedom.softness == softness) continue;
    Forest::Tree& tree = forest.trees()[index(
        forest.tree_of(joints[j].child >= 0 && forest.tree_of(joints[j].child) >= 0 ? joints[j].child : joints[j].parent))];
    tree.factored = false;
  }
}

/// Solves a tree and determines which axes are held. Returns whether that has changed.
bool World::Impl::settle(Forest::Tree& tree) {
  bool changed = false;
  for (int round = 0; round < kLockRounds; ++round) {
    if (!tree.factored) {
      forest.factor(tree);
      prepared = false;
    }
    forest.solve(tree, bodies);
    bool moved = false;
    for (int n = tree.first; n < tree.end; ++n) {
      const Forest::Node& node = forest.nodes()[index(n)];
      if (node.joint < 0 || laws[index(node.joint)].empty()) continue;
      Forest::Freedom& freedom = forest.freedoms()[index(node.first)];
      if (!laws[index(node.joint)].move(axes[index(node.joint)], freedom, drives[index(node.joint)])) continue;
      moved = true;
      if (round >= kSimultaneousRounds) break;  // one at a time, the lowest first, cannot cycle [Murty 1974]
    }
    if (!moved) break;
    tree.factored = false;
    changed = true;
  }
  forest.store(tree, bodies);
  return changed;
}

bool World::Impl::solve_trees() {
  bool changed = false;
  for (Forest::Tree& tree : forest.trees()) changed = settle(tree) || changed;
  return changed;
}

/// Solves rows and trees alternately: contact impulses depend on the held axes and change them.
void World::Impl::solve_rows() {
  if (rows.empty()) return;
  const int rounds = dents.empty() ? kContactRounds : kYieldingRounds;
  for (int round = 0; round < rounds; ++round) {
    if (!prepared) rows.prepare(bodies, forest);
    prepared = true;
    rows.measure(bodies);
    const bool exact = options.method == Method::kDantzig || has_stiff_springs();
    const Rows::Outcome outcome = exact ? rows.pivot(options.iterations, options.tolerance, rest)
                                        : rows.sweep(options.iterations, options.tolerance, rest);
    status.iterations = std::max(status.iterations, outcome.iterations);
    status.residual = round == 0 ? std::max(status.residual, outcome.residual) : outcome.residual;
    status.degenerate = std::max(status.degenerate, outcome.degenerate);
    status.extended = std::max(status.extended, outcome.extended);
    status.unsolved = round == 0 ? std::max(status.unsolved, outcome.unsolved) : outcome.unsolved;
    rows.apply(bodies, forest);
    const bool moved = solve_trees(), curved = linearise_springs();
    if (!moved && !curved) break;
    prepared = false;
  }
}

/// Drifts the bodies with joints and repeats with corrected impulses until the joints are satisfied at the new poses (chord
/// iteration: directions and inertias of the start of the step).
void World::Impl::satisfy_joints(double h) {
  const auto each = [&](const auto& f) {
    for (std::size_t i = 0; i < linked.size(); ++i) f(places[i], bodies[index(linked[i])]);
  };
  each([](Place& place, const RigidBody& body) { place = {body.p, body.Q, body.R, body.v, body.w, body.L}; });
  double first = 0, largest = 0;
  for (int pass = 1;; ++pass) {
    each([&](Place&, RigidBody& body) { body.drift(h); });
    largest = 0;
    for (std::size_t j = 0; j < joints.size(); ++j) {
      joints[j].place(bodies);
      if (in_loops[j] || !forest.contains(static_cast<int>(j))) continue;
      const Motion6 e = joints[j].error();
      largest = std::max({largest, e.linear.cwiseAbs().maxCoeff(), e.angular.cwiseAbs().maxCoeff()});
    }
    for (Forest::Tree& tree : forest.trees()) largest = std::max(largest, tree.loops.measure(joints, h));
    for (const scene::Gear& gear : scene.gears) largest = std::max(largest, std::abs(gear_error(gear)));
    if (!(largest > kJointTolerance) || pass == kPasses) break;
    if (pass == 1) first = largest;
    const bool diverges = !(largest <= kDiverging * first + kDiverging * kJointTolerance);

    each([](const Place& place, RigidBody& body) {
      body.p = place.p;
      body.Q = place.Q;
      body.R = place.R;
      body.v = place.v;
      body.w = place.w;
      body.L = place.L;
    });
    if (diverges) {  // too fast for this step size: use the directions at the start of the step only
      for (Forest::Tree& tree : forest.trees()) forest.restart_beta(tree);
      pass = kPasses - 1;
    } else {
      for (Forest::Tree& tree : forest.trees()) forest.correct_beta(tree, joints, h);
    }
    for (BoxRow& row : rows.boxes()) {
      if (row_origin[index(row.origin)].row == kGearRow) row.target -= gear_error(scene.gears[index(row.gear)]) / h;
    }
    if (solve_trees()) prepared = false;
    solve_rows();
    each([](Place& place, const RigidBody& body) {
      place.v = body.v;
      place.w = body.w;
      place.L = body.L;
    });
  }
  joints_hold = !has_whole_joints && largest <= kSureToHold;
  for (const Joint& joint : joints) joints_hold = joints_hold && !joint.far();
  for (Forest::Tree& tree : forest.trees()) {
    if (largest <= kPredictable) {
      forest.store_beta(tree, joints, h);
    } else {
      forest.clear_history(tree);
    }
  }
}

void World::Impl::store_impulses() {
  for (Contact& touch : touches) touch.impulse.setZero();
  for (const ConeRow& row : rows.cones()) {
    Contact& touch = touches[index(row.point)];
    touch.impulse = row.d * Vector3d(row.x[0], row.x[1], row.x[2]);
    touch.sum += touch.impulse;
  }
  for (const LooseJoint& one : loose) joint_x[index(one.joint)].fill(0);
  for (const scene::Gear& gear : scene.gears) joint_x[index(gear.follower)][kGearRow] = 0;
  for (const BoxRow& row : rows.boxes()) {
    const RowOrigin& origin = row_origin[index(row.origin)];
    if (origin.latch >= 0) store_latch_row(row, latches[index(origin.latch)]);
    if (origin.joint < 0) continue;  // spin of a contact, latch
    joint_x[index(origin.joint)][index(origin.row)] = row.x;
  }
}

void World::Impl::store_spring_torques(double h) {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    Axis& axis = axes[j];
    const double stiffness = joints[j].stiffness;
    if (axis.stiffness == 0 && stiffness == 0) continue;
    const int f = forest.freedom_of(static_cast<int>(j));
    const double s = f >= 0 ? forest.freedoms()[index(f)].s : joints[j].speed(bodies);
    axis.spring = axis.stiffness * h / 2 * (axis.rate - s) - stiffness * h / 2 * s;
  }
}

}  // namespace cotwin::contact_world
