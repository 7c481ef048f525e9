// Impacts of rigid contacts with restitution: changes of velocity at the start of a step, before forces and constraints act.
//
// Impacts follow one another in rounds. In each round the pairs of bodies that meet first strike at the same time; all points
// of a pair strike together. For a point that approaches with u⁻ < 0, the normal impulse x and the friction obey
//   u⁺ + e u⁻ ≥ 0 ⟂ x ≥ 0      Newton's law, after Moreau for several points
// and Coulomb's law with u⁺. Other points with restitution are free in the round: if they approach after it, they strike in the
// next one. So a blow moves through a row of bodies as it does for small gaps. Points without restitution at rest support the
// bodies in the same round.
//
// The work of the impulses is Σ x (u⁻ + u⁺) / 2: zero without friction at e = 1, otherwise negative. With friction, Newton's law
// can create energy [Kane, Levinson 1985]. Such a solution x₁ is moved towards x₂ = (1 + e) x_c, where x_c solves the same problem
// with e = 0, until its work is not positive. The work of x₂ is not positive for any contacts with friction, and its normal
// velocity at a single point is that of Newton's law, too.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Points that meet within this share of the step strike at the same time. Closer points are in contact.
constexpr double kSameTime = 1e-3;
constexpr double kContact = 5e-6;  // m

/// Approaches below this share of the first one are at rest.
constexpr double kSlowest = 1e-7;

/// Rounds of impacts in a step: at least, and per point. After them, all points of the bodies concerned strike together.
constexpr int kLeastRounds = 500, kRoundsPerPoint = 4, kRoundsTogether = 20;

/// Sweeps before pivoting, or of islands that are too large for pivoting, and the residual relative to the fastest approach.
constexpr int kSweeps = 50;
constexpr double kTolerance = 1e-12;
constexpr int kImpactLockRounds = 6;

/// Duration of an impact, relative to the step: finite forces of motors, dampers and friction in joints have no effect.
constexpr double kDuration = 1e-6;

/// Work of a round, relative to the energy that it exchanges, that counts as rounding.
constexpr double kRoundingWork = 1e-10;

/// Calls f(k, d, m, p, a, b, x, i) for every direction of every row: k counts all, i is the island.
template <class F>
void each_direction(Rows& rows, const F& f) {
  std::size_t k = 0;
  for (BoxRow& row : rows.boxes()) f(k++, row.d, row.m, row.p, row.a, row.b, row.x, index(row.island));
  for (ConeRow& row : rows.cones()) {
    for (int c = 0; c < 3; ++c) {
      f(k++, Vector3d(row.d.col(c)), Vector3d(Vector3d::Zero()), row.p, row.a, row.b, row.x[c], index(row.island));
    }
  }
}

void measure(std::span<const RigidBody> bodies, Rows& rows, std::vector<double>& u) {
  u.resize(rows.boxes().size() + 3 * rows.cones().size());
  each_direction(
      rows, [&](std::size_t k, const Vector3d& d, const Vector3d& m, const Vector3d& p, int a, int b, double, std::size_t) {
        double speed = 0;
        if (b >= 0) {
          const RigidBody& body = bodies[index(b)];
          speed += d.dot(body.v + body.w.cross(p - body.p)) + m.dot(body.w);
        }
        if (a >= 0) {
          const RigidBody& body = bodies[index(a)];
          speed -= d.dot(body.v + body.w.cross(p - body.p)) + m.dot(body.w);
        }
        u[k] = speed;
      });
}

}  // namespace

void World::Impl::reserve_impacts(std::size_t contacts) {
  const std::size_t directions = loose.size() * kJointRows + 3 * contacts;
  for (auto* v : {&impacts.u_start, &impacts.x, &impacts.u, &impacts.x_plastic, &impacts.u_plastic}) v->reserve(directions);
  impacts.first.resize(bodies.size());
  impacts.struck.resize(bodies.size());
  impacts.carried.resize(bodies.size());
  impacts.islands.reserve(bodies.size());
}

void World::Impl::resolve_impacts(double h) {
  if (!find_impacts(h)) return;
  begin_impacts();
  const int most = kLeastRounds + kRoundsPerPoint * static_cast<int>(touches.size());
  for (int round = 0; round < most + kRoundsTogether; ++round) {
    if (!begin_round(h)) break;
    if (round < most) {
      find_supports(h);
    } else {
      find_all_struck(h);
    }
    solve_impacts(h, round < most);
    end_round();
    ++status.impacts;
  }
  begin_inertias();
  prepared = false;
  for (std::size_t j = 0; j < joints.size(); ++j) axes[j].start = joints[j].has_axis() ? joints[j].speed(bodies) : 0;
  account_impacts();
}

/// Returns whether a point with restitution strikes, and prepares the first round.
bool World::Impl::find_impacts(double h) {
  double fastest = 0;
  const double slow = kSlow * h * scene.gravity.norm();
  impacts.slow = slow;
  for (Contact& touch : touches) {
    if (touch.restitution == 0 || touch.stiffness < kInfinity) continue;
    touch.approach = normal_velocity(touch);
    if (strikes(touch, h)) fastest = std::max(fastest, -touch.approach);
  }
  if (fastest == 0) return false;
  impacts.slow = std::max(slow, kSlowest * fastest);
  impacts.tolerance = kTolerance * fastest;
  for (Contact& touch : touches) touch.approach = normal_velocity(touch);
  std::fill(impacts.struck.begin(), impacts.struck.end(), 0);
  return true;
}

/// Whether two bodies approach fast and would penetrate in this step.
bool World::Impl::strikes(const Contact& touch, double h) const {
  const double slack = kSlow * h * h * scene.gravity.norm();  // gravity accelerates them in the step
  const double slow = weightless(h) ? std::max(impacts.slow, rest_of(pressed_before(touch), h)) : impacts.slow;
  return !touch.distant && touch.stiffness == kInfinity && touch.approach < -slow &&
         touch.point.gap + h * touch.approach <= slack;
}

/// Chooses the points of the pairs of bodies that meet before either body meets another. Returns whether there are any.
bool World::Impl::begin_round(double h) {
  const auto takes_part = [&](const Contact& touch) {
    const bool concerned =
        touch.restitution > 0 || impacts.struck[index(touch.point.body_a)] || impacts.struck[index(touch.point.body_b)];
    return concerned && strikes(touch, h);
  };
  const auto time = [](const Contact& touch) { return touch.point.gap <= kContact ? 0 : touch.point.gap / -touch.approach; };
  bool any = false;
  for (Contact& touch : touches) {
    touch.role = takes_part(touch) ? ImpactRole::kStrikes : ImpactRole::kNone;
    if (touch.role == ImpactRole::kNone) continue;
    if (!any) std::fill(impacts.first.begin(), impacts.first.end(), kInfinity);
    any = true;
    for (const int body : {touch.point.body_a, touch.point.body_b}) {
      if (bodies[index(body)].dynamic()) impacts.first[index(body)] = std::min(impacts.first[index(body)], time(touch));
    }
  }
  for (std::size_t begin = 0, end = 0; any && begin < touches.size(); begin = end) {
    const ContactPoint& pair = touches[begin].point;
    double first = kInfinity;
    for (; end < touches.size() && touches[end].point.body_a == pair.body_a && touches[end].point.body_b == pair.body_b;
         ++end) {
      if (touches[end].role != ImpactRole::kNone) first = std::min(first, time(touches[end]));
    }
    const double others = std::min(impacts.first[index(pair.body_a)], impacts.first[index(pair.body_b)]);
    if (first <= others + kSameTime * h) continue;
    for (std::size_t t = begin; t < end; ++t) touches[t].role = ImpactRole::kNone;
  }
  return any;
}

/// Finds the points without restitution that carry the bodies of the round, directly or through other bodies.
void World::Impl::find_supports(double h) {
  const double closed = kContact + kSlow * h * h * scene.gravity.norm();
  std::vector<char>& carried = impacts.carried;
  std::fill(carried.begin(), carried.end(), 0);
  bool grows = false;
  const auto add = [&](int body) {
    if (body < 0 || !bodies[index(body)].dynamic() || carried[index(body)]) return;
    carried[index(body)] = 1;
    grows = true;
  };
  const auto is_carried = [&](int body) { return body >= 0 && carried[index(body)]; };
  for (const Contact& touch : touches) {
    if (touch.role == ImpactRole::kNone) continue;
    add(touch.point.body_a);
    add(touch.point.body_b);
  }
  while (grows) {
    grows = false;
    for (const Joint& joint : joints) {
      if (!is_carried(joint.parent) && !is_carried(joint.child)) continue;
      add(joint.parent);
      add(joint.child);
    }
    for (Contact& touch : touches) {
      if (touch.role != ImpactRole::kNone || touch.restitution > 0 || touch.stiffness < kInfinity) continue;
      if (touch.point.gap > closed || std::abs(touch.approach) > impacts.slow) continue;
      if (!is_carried(touch.point.body_a) && !is_carried(touch.point.body_b)) continue;
      touch.role = ImpactRole::kSupports;
      add(touch.point.body_a);
      add(touch.point.body_b);
    }
  }
}

/// Lets all near points of the bodies that have been struck strike together.
void World::Impl::find_all_struck(double h) {
  for (Contact& touch : touches) {
    const bool concerned = impacts.struck[index(touch.point.body_a)] || impacts.struck[index(touch.point.body_b)];
    const bool near = touch.point.gap <= kContact + h * std::abs(touch.approach);
    if (concerned && near && !touch.distant && touch.stiffness == kInfinity) touch.role = ImpactRole::kStrikes;
  }
}

/// Collects the rows of the round, with the targets of Newton's law or of an impact without restitution.
void World::Impl::collect_impacts(double h, bool newton) {
  rows.clear();
  row_origin.clear();
  for (const LooseJoint& one : loose) collect_joint(one, Stage::kVelocity, kDuration * h);
  for (BoxRow& row : rows.boxes()) {
    const RowOrigin& origin = row_origin[index(row.origin)];
    row.x = 0;
    if (origin.row == kSpringRow) row.target = joints[index(origin.joint)].speed(bodies);  // of the axis' inertia
  }
  for (std::size_t t = 0; t < touches.size(); ++t) {
    const Contact& touch = touches[t];
    if (touch.role == ImpactRole::kNone) continue;
    ConeRow row = contact_row(t);
    if (newton) {
      if (touch.role == ImpactRole::kSupports) {
        row.target = std::min(0.0, -touch.approach);
      } else {
        row.target = touch.restitution > 0 ? -touch.restitution * touch.approach : std::min(0.0, -touch.point.gap / h);
      }
    }
    rows.add(row);
  }
}

/// Solves and applies the collected rows, alternately with the trees as in solve_rows().
void World::Impl::apply_impact_rows() {
  for (int round = 0; round < kImpactLockRounds; ++round) {
    if (round > 0) rows.prepare(bodies, forest);
    rows.measure(bodies);
    rows.pivot(kSweeps, impacts.tolerance, 0);
    rows.apply(bodies, forest);
    if (!solve_trees()) break;
  }
}

/// Moves the impulses of the rows to `x`.
void World::Impl::set_impact_rows(std::span<const double> x) {
  rows.prepare(bodies, forest);
  rows.measure(bodies);
  each_direction(rows, [&](std::size_t k, const Vector3d&, const Vector3d&, const Vector3d&, int, int, double& of_row,
                           std::size_t) { of_row = x[k]; });
  rows.sweep(0, 0, 0);
  rows.apply(bodies, forest);
  solve_trees();
}

void World::Impl::solve_impacts(double h, bool newton) {
  for (Forest::Tree& tree : forest.trees()) {
    forest.load_momenta(tree, bodies);
    forest.clear_beta(tree);
  }
  begin_inertias();
  begin_axes(Stage::kVelocity, kDuration * h);
  solve_trees();
  collect_impacts(h, newton);
  rows.prepare(bodies, forest);
  measure(bodies, rows, impacts.u_start);
  apply_impact_rows();
  measure(bodies, rows, impacts.u);
  limit_energy(newton);
  for (const ConeRow& row : rows.cones()) {
    touches[index(row.point)].impact += row.d * Vector3d(row.x[0], row.x[1], row.x[2]);
  }
}

/// Replaces impulses that create energy, per island.
void World::Impl::limit_energy(bool newton) {
  const std::size_t n = impacts.u.size();
  std::size_t islands = 0;
  impacts.x.resize(n);
  each_direction(rows,
                 [&](std::size_t k, const Vector3d&, const Vector3d&, const Vector3d&, int, int, double x, std::size_t i) {
                   impacts.x[k] = x;
                   islands = std::max(islands, i + 1);
                 });
  impacts.islands.assign(islands, {});
  const auto each = [&](const auto& f) {
    each_direction(rows, [&](std::size_t k, const Vector3d&, const Vector3d&, const Vector3d&, int, int, double& x,
                             std::size_t i) { f(k, x, impacts.islands[i]); });
  };
  each([&](std::size_t k, double x, Impacts::Island& island) {
    island.work += x * (impacts.u_start[k] + impacts.u[k]) / 2;
    island.scale += std::abs(x * impacts.u_start[k]);
  });
  bool creates = !newton;
  for (const Impacts::Island& island : impacts.islands) creates = creates || island.work > kRoundingWork * island.scale;
  if (!creates) return;

  for (const ConeRow& row : rows.cones()) {
    const Contact& touch = touches[index(row.point)];
    if (touch.role == ImpactRole::kStrikes && touch.approach < -impacts.slow) {
      double& e = impacts.islands[index(row.island)].e;
      e = std::min(e, touch.restitution);
    }
  }
  std::vector<double>& x_c = newton ? impacts.x_plastic : impacts.x;
  std::vector<double>& u_c = newton ? impacts.u_plastic : impacts.u;
  if (newton) {
    impacts.x_plastic.assign(n, 0);
    set_impact_rows(impacts.x_plastic);
    for (ConeRow& row : rows.cones()) row.target = 0;
    rows.prepare(bodies, forest);
    apply_impact_rows();
    measure(bodies, rows, u_c);
    each([&](std::size_t k, double x, Impacts::Island&) { x_c[k] = x; });
  }
  // x₂ = s x_c. Where x_c is not exact, s is less than 1 + e, or such that the work is that of an exact solution.
  each([&](std::size_t k, double, Impacts::Island& island) {
    island.linear += x_c[k] * impacts.u_start[k];
    island.square += x_c[k] * (u_c[k] - impacts.u_start[k]);
  });
  for (Impacts::Island& island : impacts.islands) {
    const double exact = island.square > 0 ? std::max(0.0, -island.linear / island.square) : 1;  // 1 without friction
    island.s = newton ? std::min(1 + island.e, 2 * exact) : (1 + island.e) * exact;
  }
  each([&](std::size_t k, double, Impacts::Island& island) {
    x_c[k] *= island.s;
    u_c[k] = impacts.u_start[k] + island.s * (u_c[k] - impacts.u_start[k]);
    island.at_scaled += x_c[k] * (impacts.u_start[k] + u_c[k]) / 2;
    island.slope += (impacts.x[k] - x_c[k]) * u_c[k];
    island.curvature += (impacts.x[k] - x_c[k]) * (impacts.u[k] - u_c[k]);
  });
  // Work of x₂ + λ (x₁ − x₂): at_scaled + slope λ + curvature λ²/2, not positive at λ = 0
  for (Impacts::Island& island : impacts.islands) {
    if (newton && island.work <= kRoundingWork * island.scale) {
      island.share = 1;
    } else if (newton && island.curvature > 0) {
      const double root = island.slope * island.slope - 2 * island.curvature * std::min(0.0, island.at_scaled);
      island.share = std::clamp((std::sqrt(root) - island.slope) / island.curvature, 0.0, 1.0);
    }
  }
  each([&](std::size_t k, double, const Impacts::Island& island) { x_c[k] += island.share * (impacts.x[k] - x_c[k]); });
  set_impact_rows(x_c);
}

/// Measures the points of the bodies that the round has changed.
void World::Impl::end_round() {
  std::vector<char>& struck = impacts.struck;
  std::vector<char>& changed = impacts.carried;
  std::fill(changed.begin(), changed.end(), 0);
  const auto mark = [&](int body) {
    if (body >= 0 && bodies[index(body)].dynamic()) struck[index(body)] = changed[index(body)] = 1;
  };
  for (const Contact& touch : touches) {
    if (touch.role == ImpactRole::kNone) continue;
    mark(touch.point.body_a);
    mark(touch.point.body_b);
  }
  for (bool grows = true; grows;) {
    grows = false;
    for (const Joint& joint : joints) {
      const auto is_open = [&](int body) { return body >= 0 && bodies[index(body)].dynamic() && !changed[index(body)]; };
      const auto is_changed = [&](int body) { return body >= 0 && changed[index(body)]; };
      if (!(is_open(joint.parent) && is_changed(joint.child)) && !(is_open(joint.child) && is_changed(joint.parent))) continue;
      mark(joint.parent);
      mark(joint.child);
      grows = true;
    }
  }
  for (Contact& touch : touches) {
    if (changed[index(touch.point.body_a)] || changed[index(touch.point.body_b)]) touch.approach = normal_velocity(touch);
  }
}

}  // namespace cotwin::contact_world
