// Impulses that hold an island at rest, if there are any.
//
// Coulomb's law can have several solutions: a card house stands in one and slides apart in another; a part stays between two pads if their points
// share its weight, and turns out of them if one end bears it all. Each satisfies the law to rounding. Bodies at rest stay there if they can, with
// impulses that are as far from the friction cones as can be.
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {

/// Whether all points were at rest before the forces of the stage acted, as far as a solver keeps them there, and none slid.
bool Rows::stands(const Island& island, double enough, double rest) const {
  if (rest == 0 || island.first_cone == island.end_cone || rows_of(island) > kRowsOfMoving) return false;
  const double slow = std::min(kPoorResidual * rest, kPoorCreep);
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const ConeRow& row = cones_[cores_[i].row];
    if (!(row.speed <= (row.slid ? enough : slow))) return false;
  }
  return true;
}

/// Velocity of a contact against its targets, with the normal impulse x_n.
Vector3d Rows::velocity_of(const Core& core, double x_n) const {
  Vector3d w(core.b[0] + core.softness * x_n, core.b[1], core.b[2]);
  for (const Side& side : core.side) {
    for (int k = 0; k < 3; ++k) w[k] += velocity(y_.data() + side.y + index(k * side.size), side);
  }
  return w;
}

/// Largest velocity, against their targets, of contacts of the solution that do not open faster than `still`, m/s.
double Rows::slip(const Island& island, double still) const {
  double largest = 0;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const double load = cones_[cores_[i].row].x[0];
    const Vector3d w = velocity_of(cores_[i], load);
    if (load <= 0 && w[0] > still) continue;
    largest = std::max({largest, std::abs(w[0]), cores_[i].mu > 0 ? std::hypot(w[1], w[2]) : 0});
  }
  return largest;
}

/// Replaces the solution of an island that stands, but would slip, by one that holds it with a residual of at most `enough`, if there is one
/// in which the touching points keep touching and rows at their bounds stay there.
void Rows::hold_if_slips(const Island& island, double still, double enough, double rest, Outcome& outcome) {
  if (!stands(island, enough, rest) || !(slip(island, still) > still)) return;
  int coordinates = 0;
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    place_[index(slice.offset)] = coordinates;
    coordinates += slice.size;
  }
  if (coordinates > CentralImpulses::kMostCoordinates) return;
  const auto parts = [&](const Side* sides, CentralImpulses::Block& block) {
    for (int s = 0; s < 2; ++s) block.part[s] = {y_.data() + sides[s].y, place_[index(sides[s].offset)], sides[s].size};
  };
  holding_.clear();
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    const BoxRow& row = boxes_[i];
    if (row.x <= row.lo || row.x >= row.hi) continue;
    CentralImpulses::Block block;
    block.count = 1;
    block.softness = row.softness;
    block.lo = row.lo;
    block.hi = row.hi;
    block.x[0] = row.x;
    block.w[0] = row.u + row.softness * row.x - row.target;
    for (const Side& side : row.side) block.w[0] += velocity(y_.data() + side.y, side);
    parts(row.side, block);
    holding_.add(block);
  }
  const auto apart = [&](const Core& core) { return cones_[core.row].x[0] <= 0 && core.target < -enough; };
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    if (apart(core)) continue;
    CentralImpulses::Block block;
    block.softness = core.softness;
    block.x = Eigen::Map<const Vector3d>(cones_[core.row].x);
    block.w = velocity_of(core, block.x[0]);
    block.mu = core.mu;
    if (core.mu == 0) {
      block.count = 1;
      block.x.tail<2>().setZero();
      block.w.tail<2>().setZero();
    }
    parts(core.side, block);
    holding_.add(block);
  }
  if (!holding_.solve(coordinates, enough / 2)) return;

  const CentralImpulses::Block* next = holding_.blocks().data();
  before_holding_.clear();
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    BoxRow& row = boxes_[i];
    before_holding_.push_back(row.x);
    if (row.x > row.lo && row.x < row.hi) row.x = next++->x[0];
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    ConeRow& row = cones_[cores_[i].row];
    before_holding_.insert(before_holding_.end(), row.x, row.x + 3);
    if (!apart(cores_[i])) std::copy_n(next++->x.data(), 3, row.x);
  }
  clear_changes(island);
  apply_start(island);
  double residual = slip(island, enough);
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    const BoxRow& row = boxes_[i];
    double w = row.u + row.softness * row.x - row.target;
    for (const Side& side : row.side) w += velocity(y_.data() + side.y, side);
    residual = std::max(residual, std::abs(std::clamp(row.x - w * row.inverse_A, row.lo, row.hi) - row.x) * row.A);
  }
  if (residual <= enough) {
    outcome.residual = residual;
    outcome.unsolved = 0;
    return;
  }
  const double* then = before_holding_.data();
  for (std::size_t i = island.first_box; i < island.end_box; ++i) boxes_[i].x = *then++;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i, then += 3) std::copy_n(then, 3, cones_[cores_[i].row].x);
  clear_changes(island);
  apply_start(island);
}

}  // namespace cotwin::contact_world
