// Impulses that hold an island at rest, if there are any.
//
// Coulomb's law can have several solutions: a card house stands in one and slides apart in another, and both satisfy it to rounding. Bodies at
// rest stay there if they can. Whether they can is a convex problem: minimise the kinetic energy ½ |v|² after the step over all impulses in the
// friction cones. If its minimum is zero, nothing slips, and the impulses satisfy Coulomb's law as well. Otherwise its friction opens gaps
// (it is the associated law, μ |u_t| is added to u_n), and the result is not used.
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {
namespace {

/// Sweeps: at first, most in total, and after those. Their number doubles while the residual falls below this share of that before.
constexpr int kFirst = 250, kMost = 4000, kChecking = 2;
constexpr double kFalls = 0.7;

/// Residual of these sweeps, relative to the one that is enough afterwards.
constexpr double kFiner = 0.1;

/// Slip of the result, relative to the residual that is enough, that counts as none.
constexpr double kSame = 10;

}  // namespace

/// Moves a contact's impulse against the gradient w and back into the cone. Returns the change of velocity that the contact required.
double Rows::push_into_cone(Core& core) {
  double w[3] = {core.b[0] + core.softness * core.x[0], core.b[1], core.b[2]};
  for (const Side& side : core.side) {
    for (int k = 0; k < 3; ++k) w[k] += velocity(y_.data() + side.y + index(k * side.size), side);
  }
  const double stiffest =
      std::max({core.A_nn + core.softness + std::abs(core.A_n1) + std::abs(core.A_n2),
                core.A_11 + std::abs(core.A_n1) + std::abs(core.A_12), core.A_22 + std::abs(core.A_n2) + std::abs(core.A_12)});
  if (!(stiffest > 0)) return 0;
  double n = core.x[0] - w[0] / stiffest, t1 = core.x[1] - w[1] / stiffest, t2 = core.x[2] - w[2] / stiffest;
  const double t = std::hypot(t1, t2), mu = core.mu;
  Hold hold = Hold::kSticks;
  if (t > mu * n || n < 0) {
    const double on_cone = std::max(0.0, (n + mu * t) / (1 + mu * mu));
    const double share = t > 0 ? mu * on_cone / t : 0;
    hold = on_cone > 0 ? Hold::kSlips : Hold::kOpen;
    n = on_cone;
    t1 *= share;
    t2 *= share;
  }
  const double x[] = {n, t1, t2};
  double largest = 0;
  for (int k = 0; k < 3; ++k) {
    core.change[k] = x[k] - core.x[k];
    core.x[k] = x[k];
    largest = std::max(largest, std::abs(core.change[k]) * stiffest);
  }
  linear_ = linear_ && hold == core.hold && hold != Hold::kSlips;
  core.hold = hold;
  apply_impulse(core, core.change);
  return largest;
}

/// Whether a loaded contact of the solution moves faster than this against its targets.
bool Rows::slips(const Island& island, double speed) const {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    if (!(cones_[core.row].x[0] > 0)) continue;
    for (int k = 0; k < 3; ++k) {
      double w = core.b[k];
      for (const Side& side : core.side) w += velocity(y_.data() + side.y + index(k * side.size), side);
      if (std::abs(w) > speed) return true;
    }
  }
  return false;
}

/// Replaces the solution of an island at rest by one that holds it with a residual of at most `enough`, if that is found.
void Rows::hold(const Island& island, double enough, Outcome& outcome) {
  clear_changes(island);
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];  // with the impulses of the last sweep
    core.x[0] = std::max(core.x[0], 0.0);
    const double* applied = cones_[core.row].applied;
    const double gained[] = {core.x[0] - applied[0], core.x[1] - applied[1], core.x[2] - applied[2]};
    apply_impulse(core, gained);
  }
  holding_ = true;
  double before = kInfinity;
  for (int sweeps = kFirst; sweeps <= kMost; sweeps *= 2) {
    const Outcome some = sweep(island, {sweeps, sweeps, kFiner * enough, kFiner * enough}, true);
    outcome.iterations += some.iterations;
    if (some.residual <= kFiner * enough || some.residual > kFalls * before) break;
    before = some.residual;
  }
  holding_ = false;
  const Outcome checked = sweep(island, {kChecking, kChecking, 0, 0}, false);
  outcome.iterations += checked.iterations;
  if (checked.residual <= enough && !slips(island, kSame * enough)) {
    outcome.residual = checked.residual;
    for (std::size_t i = island.first_cone; i < island.end_cone; ++i) std::copy_n(cores_[i].x, 3, cones_[cores_[i].row].x);
  } else {
    clear_changes(island);
    apply_start(island);
  }
}

}  // namespace cotwin::contact_world
