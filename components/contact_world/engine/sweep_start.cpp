// With which impulses sweeps begin, and how the first one shares a new load.
#include <algorithm>
#include <cmath>
#include <utility>

#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {

/// Applies the changes of x before the sweeps to the coordinates.
void Rows::apply_start(const Island& island) {
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    const BoxRow& row = boxes_[i];
    const double gained = row.x - row.applied;
    if (gained == 0) continue;
    for (const Side& side : row.side) apply_impulse(y_.data() + side.y, side, gained);
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) std::copy_n(cones_[cores_[i].row].x, 3, cores_[i].x);
  apply_impulses(island);
}

/// Applies the changes of the contacts' x to the coordinates.
void Rows::apply_impulses(const Island& island) {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    double gained[3];
    for (int k = 0; k < 3; ++k) gained[k] = core.x[k] - cones_[core.row].applied[k];
    apply_impulse(core, gained);
  }
}

/// Scales the changes of x before the sweeps to the best share in 0 … 1, measured by the energy of the velocities against the
/// targets: then no sweep adds energy to what the step started with, however far the start is from the solution. Islands of
/// contacts keep a start that is better than none.
void Rows::scale_start(const Island& island) {
  const bool contacts_only = island.first_box == island.end_box;
  double along = 0, square = 0;
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    const BoxRow& row = boxes_[i];
    const double gained = row.x - row.applied;
    along += gained * (row.u - row.target + row.softness * row.applied);
    square += row.softness * gained * gained;
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const ConeRow& row = cones_[core.row];
    for (int k = 0; k < 3; ++k) along += (core.x[k] - row.applied[k]) * core.b[k];
    const double gained = core.x[0] - row.applied[0];
    along += gained * core.softness * row.applied[0];
    square += core.softness * gained * gained;
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; ++i) square += z_[index(i)] * z_[index(i)];
  }
  if (!((contacts_only ? square / 2 : square) > -along)) return;
  const double share = std::max(0.0, -along / square);
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    BoxRow& row = boxes_[i];
    row.x = row.applied + share * (row.x - row.applied);
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    const ConeRow& row = cones_[core.row];
    for (int k = 0; k < 3; ++k) core.x[k] = row.applied[k] + share * (core.x[k] - row.applied[k]);
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; ++i) z_[index(i)] *= share;
  }
}

/// A sweep in which the points of two bodies share the normal load where there are m > 2 of them: the first takes 1/m of it, the next 1/(m − 1) of
/// the rest … Otherwise the first one would bear it alone where joints let its body only slide, and redundant points keep the impulses that they
/// were given first.
double Rows::share(const Island& island) {
  double residual = 0;
  for (std::size_t first = island.first_cone, last = first; first < island.end_cone; first = last) {
    const ConeRow& row = cones_[cores_[first].row];
    const auto same = [&](const Core& core) { return cones_[core.row].a == row.a && cones_[core.row].b == row.b; };
    while (last < island.end_cone && same(cores_[last])) ++last;
    for (std::size_t i = first; i < last; ++i) {
      Core& core = cores_[i];
      if (last - first <= 2) {
        residual = std::max(residual, solve_any(core));
        continue;
      }
      const double part = 1.0 / static_cast<double>(last - i);
      const double whole = std::exchange(core.inverse_nn, part * core.inverse_nn);
      residual = std::max(residual, solve_any(core) / part);
      core.inverse_nn = whole;
    }
  }
  return residual;
}

}  // namespace cotwin::contact_world
