#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::contact_world {
namespace {

/// Softness of redundant rows, relative to the mobility that their bodies would have without constraints. Also used for rows
/// whose mobility held axes reduce to almost nothing; other rows have no such softness.
constexpr double kRegular = 1e-9;

double regular(double A, double free) { return std::max(0.0, kRegular * free - 1e-3 * A); }

/// J M⁻¹ Jᵀ of a row for free bodies: an upper bound of its value with joints.
double free_inverse_inertia(std::span<const RigidBody> bodies, int a, int b, const Vector3d& d, const Vector3d& m,
                            const Vector3d& p) {
  double sum = 0;
  for (const int i : {a, b}) {
    if (i >= 0) sum += bodies[index(i)].mobility(d, m, p);
  }
  return sum;
}

/// The same for a gear.
double free_inverse_inertia(std::span<const RigidBody> bodies, const GearParts& gear) {
  double sum = 0;
  for (const GearPart& part : gear) sum += free_inverse_inertia(bodies, part.body, -1, part.d, part.m, part.p);
  return sum;
}

/// Velocity of b relative to a in a row; bodies below 0 are at rest.
struct Relative {
  Relative(std::span<const RigidBody> bodies, int a, int b, const Vector3d& p) {
    if (b >= 0) {
      const RigidBody& body = bodies[index(b)];
      v += body.v + body.w.cross(p - body.p);
      w += body.w;
    }
    if (a >= 0) {
      const RigidBody& body = bodies[index(a)];
      v -= body.v + body.w.cross(p - body.p);
      w -= body.w;
    }
  }
  Vector3d v = Vector3d::Zero(), w = Vector3d::Zero();
};

/// Computes target and softness of a soft contact: x = (target − u) / softness.
void soften(ConeRow& row, double A_nn) {
  SoftContact& law = row.law;
  const double least = 1e-12 / std::max(A_nn, 1e-12);
  row.swing = law.h * law.h * law.stiffness * A_nn;
  if (row.spring == ConeRow::Spring::kGiven) {
    row.softness = 1 / std::max(row.damper, least);
    row.target = row.push * row.softness;
    return;
  }
  if (!row.linearised) {
    const bool calm = row.u * row.u + law.stiffness * A_nn * law.gap * law.gap < row.slow * row.slow;
    const bool settles = calm && law.gap <= 0 && row.swing > kUnresolved;
    law.conserves = law.conserves && !settles && law.damping * law.damping * A_nn < 4 * kDamped * law.stiffness;
    law.theta = std::max(0.0, 1 - kUnresolved / row.swing);
    row.u = law.solve(row.u, A_nn);
    row.linearised = true;
  }
  row.softness = 1 / std::max(-law.slope(row.u), least);
  row.target = row.u + law.impulse(row.u) * row.softness;
}

}  // namespace

Rows::Rows(std::span<const RigidBody> bodies, const Forest& forest) : slice_of_body_(bodies.size(), -1) {
  int offset = 0;
  const auto add_slice = [&](int size) {
    slices_.push_back({offset, size});
    offset += std::max(2, size + size % 2);  // keeps pairs aligned; a tree without freedom has a place, too
  };
  for (const Forest::Tree& tree : forest.trees()) add_slice(tree.end_freedom - tree.first_freedom);
  trees_ = static_cast<int>(slices_.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!bodies[b].dynamic()) continue;
    const int tree = forest.tree_of(static_cast<int>(b));
    slice_of_body_[b] = tree >= 0 ? tree : static_cast<int>(slices_.size());
    if (tree < 0) add_slice(6);
  }
  for (std::vector<double>* z : {&z_, &z_start_, &z_before_, &z_path_}) z->resize(index(offset));
  latest_.resize(index(offset), -1);
  users_.resize(index(offset), {0, 0});
  place_.resize(index(offset));
  parent_.resize(slices_.size());
  island_of_slice_.resize(slices_.size());
  island_slices_.resize(slices_.size());
}

void Rows::reserve(std::size_t cones, std::size_t boxes, std::size_t gears) {
  std::size_t widest = 6;
  for (const Slice& slice : slices_) widest = std::max(widest, index(slice.size));
  cones_.reserve(cones);
  cores_.reserve(cones);
  boxes_.reserve(boxes);
  gears_.reserve(gears);
  gears_before_.reserve(gears);
  sorted_boxes_.reserve(boxes);
  holding_.reserve(std::min(cones + boxes, kRowsOfMoving), z_.size());
  before_holding_.reserve(kRowsOfMoving);
  y_.reserve(2 * (widest + 1) * (3 * cones + boxes));
  islands_.reserve(slices_.size());
  reserve_pivoting(cones, boxes);
}

void Rows::Outcome::add(const Outcome& of_island) {
  iterations = std::max(iterations, of_island.iterations);
  residual = std::max(residual, of_island.residual);
  degenerate += of_island.degenerate;
  extended += of_island.extended;
  unsolved += of_island.unsolved;
}

void Rows::clear() {
  std::swap(boxes_, sorted_boxes_);  // input of update()
  std::swap(gears_, gears_before_);
  boxes_.clear();
  gears_.clear();
  cones_.clear();
}

int Rows::root(int slice) {
  while (parent_[index(slice)] != slice) {
    parent_[index(slice)] = parent_[index(parent_[index(slice)])];
    slice = parent_[index(slice)];
  }
  return slice;
}

void Rows::join(int body_a, int body_b) {
  const int a = slice_of(body_a), b = slice_of(body_b);
  if (a < 0 || b < 0) return;
  const int x = root(a), y = root(b);
  parent_[index(std::max(x, y))] = std::min(x, y);
}

// Islands in the order of their lowest slice, rows in the order of addition: depends on the rows alone.
void Rows::find_islands() {
  for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = static_cast<int>(i);
  for (const BoxRow& row : boxes_) join(row.a, row.b);
  for (const ConeRow& row : cones_) join(row.a, row.b);
  std::fill(island_of_slice_.begin(), island_of_slice_.end(), -1);
  islands_.clear();
  const auto count = [&](auto& rows, auto field) {
    for (auto& row : rows) {
      const int slice = slice_of(row.a) >= 0 ? slice_of(row.a) : slice_of(row.b);
      int& island = island_of_slice_[index(root(slice))];
      if (island < 0) {
        island = static_cast<int>(islands_.size());
        islands_.emplace_back();
      }
      row.island = island;
      ++(islands_[index(island)].*field);
    }
  };
  count(boxes_, &Island::end_box);
  count(cones_, &Island::end_cone);
  const auto island_of = [&](std::size_t slice) { return island_of_slice_[index(root(static_cast<int>(slice)))]; };
  for (std::size_t s = 0; s < slices_.size(); ++s) {
    if (island_of(s) >= 0) ++islands_[index(island_of(s))].end_slice;
  }
  std::size_t boxes = 0, cones = 0, slices = 0;
  for (Island& island : islands_) {
    island.first_box = boxes;
    boxes += std::exchange(island.end_box, boxes);
    island.first_cone = cones;
    cones += std::exchange(island.end_cone, cones);
    island.first_slice = slices;
    slices += std::exchange(island.end_slice, slices);
  }
  for (std::size_t s = 0; s < slices_.size(); ++s) {
    if (island_of(s) >= 0) island_slices_[islands_[index(island_of(s))].end_slice++] = static_cast<int>(s);
  }
  sorted_boxes_.resize(boxes_.size());
  cores_.resize(cones_.size());
  for (const BoxRow& row : boxes_) sorted_boxes_[islands_[index(row.island)].end_box++] = row;
  for (std::size_t i = 0; i < cones_.size(); ++i) cores_[islands_[index(cones_[i].island)].end_cone++].row = i;
  std::swap(boxes_, sorted_boxes_);
}

void Rows::make_side(std::span<const RigidBody> bodies, const Forest& forest, int body, const Vector3d& d, const Vector3d& m,
                     const Vector3d& p, double sign, double* y) const {
  const int t = forest.tree_of(body);
  if (t >= 0) {
    const Forest::Tree& tree = forest.trees()[index(t)];
    const Vector3d moment = m + (p - tree.O).cross(d);
    forest.add_response(tree, forest.node_of(body), {d[0], d[1], d[2], moment[0], moment[1], moment[2]}, sign, y);
    return;
  }
  const RigidBody& b = bodies[index(body)];
  const Vector3d moment = b.R.transpose() * (m + (p - b.p).cross(d));
  for (int i = 0; i < 3; ++i) {
    y[i] += sign * b.inverse_root_mass * d[i];
    y[3 + i] += sign * b.inverse_root_moments[i] * moment[i];
  }
}

void Rows::make_sides(int a, int b, std::size_t rows, Side* sides) {
  const int slices[2] = {slice_of(a), slice_of(b)};
  for (int s = 0; s < 2; ++s) {
    Side& side = sides[s];
    side = {};
    if (slices[s] < 0 || (s == 1 && slices[1] == slices[0])) continue;
    side.offset = slices_[index(slices[s])].offset;
    side.size = slices_[index(slices[s])].size;
    side.y = y_.size();
    const std::size_t numbers = rows * index(side.size);
    y_.resize(y_.size() + numbers + numbers % 2, 0.0);
  }
}

/// Computes both sides and A of a cone between bodies without joints. The columns of d are orthogonal, the first is a unit vector.
void Rows::make_free_sides(std::span<const RigidBody> bodies, const ConeRow& row, Core& core) {
  double inverse_mass = 0;
  Matrix3d A = Matrix3d::Zero();
  for (int s = 0; s < 2; ++s) {
    const int body = s == 0 ? row.a : row.b;
    core.side[s] = {};
    if (slice_of(body) < 0) continue;
    const RigidBody& b = bodies[index(body)];
    core.side[s] = {slices_[index(slice_of(body))].offset, 6, y_.size()};
    y_.resize(y_.size() + 18);
    double* y = y_.data() + core.side[s].y;
    const Vector3d r = row.p - b.p;
    const double sign = s == 0 ? -1 : 1, root = sign * b.inverse_root_mass;
    Matrix3d moments;
    for (int k = 0; k < 3; ++k) {
      const Vector3d moment = r.cross(row.d.col(k));
      for (int i = 0; i < 3; ++i) {
        moments(i, k) = sign * b.inverse_root_moments[i] * b.R.col(i).dot(moment);
        y[6 * k + i] = root * row.d(i, k);
        y[6 * k + 3 + i] = moments(i, k);
      }
    }
    inverse_mass += b.inverse_mass;
    for (int k = 0; k < 3; ++k) {
      for (int l = k; l < 3; ++l) A(k, l) += moments.col(k).dot(moments.col(l));
    }
  }
  const auto square = [&](Eigen::Index k) {  // 1 to the bit for isotropic friction
    const double s = row.d.col(k).squaredNorm();
    return std::abs(s - 1) < 1e-12 ? 1 : s;
  };
  core.A_nn = inverse_mass + A(0, 0);
  core.A_n1 = A(0, 1);
  core.A_n2 = A(0, 2);
  core.A_11 = inverse_mass * square(1) + A(1, 1);
  core.A_12 = A(1, 2);
  core.A_22 = inverse_mass * square(2) + A(2, 2);
  core.regular = 0;
  core.redundant = false;
}

void Rows::make_sides(std::span<const RigidBody> bodies, const Forest& forest, const ConeRow& row, Core& core) {
  make_sides(row.a, row.b, 3, core.side);
  const bool together = row.a >= 0 && row.b >= 0 && slice_of(row.a) == slice_of(row.b);
  const Vector3d none = Vector3d::Zero();
  for (int s = 0; s < 2; ++s) {
    const int body = s == 0 ? row.a : row.b;
    if (slice_of(body) < 0) continue;
    const Side& side = core.side[together ? 0 : s];
    for (int k = 0; k < 3; ++k)
      make_side(bodies, forest, body, row.d.col(k), none, row.p, s == 0 ? -1 : 1, y_.data() + side.y + index(k * side.size));
  }
  double A[6] = {};
  for (const Side& side : core.side) {
    const double* n = y_.data() + side.y;
    const double *t1 = n + side.size, *t2 = t1 + side.size;
    A[0] += dot(n, n, side.size);
    A[1] += dot(n, t1, side.size);
    A[2] += dot(n, t2, side.size);
    A[3] += dot(t1, t1, side.size);
    A[4] += dot(t1, t2, side.size);
    A[5] += dot(t2, t2, side.size);
  }
  core.A_nn = A[0];
  core.A_n1 = A[1];
  core.A_n2 = A[2];
  core.A_11 = A[3];
  core.A_12 = A[4];
  core.A_22 = A[5];
  const double free = free_inverse_inertia(bodies, row.a, row.b, row.d.col(0), none, row.p);
  core.regular = regular(core.A_nn, free);
  core.redundant = core.A_nn < kRegular * free;
  const double tangents = regular(core.A_11 + core.A_22, free);
  core.A_11 += tangents;
  core.A_22 += tangents;
  core.moves = A[0] + A[3] + A[5] > 0;
}

/// Copies the row of a cone into its core and derives softness and bounds.
void Rows::load_row(Core& core) {
  ConeRow& row = cones_[core.row];
  if (row.spring != ConeRow::Spring::kNone) soften(row, core.A_nn);
  core.target = row.target;
  core.softness = row.softness + core.regular;
  core.inverse_nn = 1 / (core.A_nn + core.softness);
  core.mu = core.moves ? row.mu : 0;  // no friction without mobility
  core.lo = row.lo;
  core.shift = 0;
  std::copy(row.x, row.x + 3, core.x);
}

void Rows::make_gear_sides(std::span<const RigidBody> bodies, const Forest& forest, const BoxRow& row) {
  for (const GearPart& part : gears_[index(row.gear)]) {
    const int slice = slice_of(part.body);
    if (slice < 0) continue;
    const Side& side = row.side[slice == slice_of(row.a) ? 0 : 1];
    make_side(bodies, forest, part.body, part.d, part.m, part.p, 1, y_.data() + side.y);
  }
}

void Rows::prepare(std::span<const RigidBody> bodies, const Forest& forest) {
  find_islands();
  assembled_ = false;
  y_.clear();
  for (BoxRow& row : boxes_) {
    make_sides(row.a, row.b, 1, row.side);
    const bool together = row.a >= 0 && row.b >= 0 && slice_of(row.a) == slice_of(row.b);
    const Side& side_b = row.side[together ? 0 : 1];
    if (row.gear >= 0) {
      make_gear_sides(bodies, forest, row);
    } else {
      if (slice_of(row.a) >= 0) make_side(bodies, forest, row.a, row.d, row.m, row.p, -1, y_.data() + row.side[0].y);
      if (slice_of(row.b) >= 0) make_side(bodies, forest, row.b, row.d, row.m, row.p, 1, y_.data() + side_b.y);
    }
    row.A = 0;
    for (const Side& side : row.side) row.A += dot(y_.data() + side.y, y_.data() + side.y, side.size);
    const double free = row.gear >= 0 ? free_inverse_inertia(bodies, gears_[index(row.gear)])
                                      : free_inverse_inertia(bodies, row.a, row.b, row.d, row.m, row.p);
    row.regular = regular(row.A, free);
    row.softness += row.regular;
    row.redundant = row.A < kRegular * free;
    row.inverse_A = 1 / (row.A + row.softness);
  }
  const auto in_tree = [&](int body) { return body >= 0 && forest.tree_of(body) >= 0; };
  for (Core& core : cores_) {
    const ConeRow& row = cones_[core.row];
    core.point = row.point;
    core.moves = true;
    if (in_tree(row.a) || in_tree(row.b)) {
      make_sides(bodies, forest, row, core);
    } else {
      make_free_sides(bodies, row, core);
    }
    const double ridge = 1e-12 * (core.A_11 + core.A_22);  // the tangents' block may have rank one
    core.A_11 += ridge;
    core.A_22 += ridge;
    const double trace = core.A_11 + core.A_22, determinant = core.A_11 * core.A_22 - core.A_12 * core.A_12;
    // Across the only mobile direction, rounding would drive the impulse to the cone: it keeps its value there.
    core.one_way = determinant < kRegular * trace * trace;
    const double inverse = 1 / (core.one_way ? trace * trace : determinant);
    core.inverse_11 = (core.one_way ? core.A_11 : core.A_22) * inverse;
    core.inverse_12 = (core.one_way ? core.A_12 : -core.A_12) * inverse;
    core.inverse_22 = (core.one_way ? core.A_22 : core.A_11) * inverse;
    load_row(core);
  }
}

bool Rows::update() {
  if (boxes_.size() != sorted_boxes_.size() || cores_.size() != cones_.size()) return false;
  for (const BoxRow& then : sorted_boxes_) {
    const BoxRow& now = boxes_[index(then.origin)];
    if (now.a != then.a || now.b != then.b || now.d != then.d || now.m != then.m || now.p != then.p) return false;
    if (now.gear != then.gear) return false;
    if (now.gear >= 0 && gears_[index(now.gear)] != gears_before_[index(then.gear)]) return false;
  }
  for (const Core& core : cores_) {
    if (cones_[core.row].point != core.point) return false;
  }
  for (BoxRow& row : sorted_boxes_) {
    const BoxRow& now = boxes_[index(row.origin)];
    row.target = now.target;
    row.softness = now.softness + row.regular;
    row.lo = now.lo;
    row.hi = now.hi;
    row.rest = now.rest;
    row.x = now.x;
    row.applied = now.applied;
    row.inverse_A = 1 / (row.A + row.softness);
  }
  std::swap(boxes_, sorted_boxes_);
  for (Core& core : cores_) load_row(core);
  return true;
}

void Rows::measure(std::span<const RigidBody> bodies) {
  std::fill(z_.begin(), z_.end(), 0.0);
  double fastest = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const RigidBody& body = bodies[b];
    fastest = std::max(fastest, body.v.lpNorm<1>() + body.radius * body.w.lpNorm<1>());
    if (slice_of_body_[b] < trees_) continue;
    double* z = z_start_.data() + slices_[index(slice_of_body_[b])].offset;
    const Vector3d spin = body.R.transpose() * body.L;
    for (int i = 0; i < 3; ++i) {
      z[i] = body.mass * body.inverse_root_mass * body.v[i];
      z[3 + i] = body.inverse_root_moments[i] * spin[i];
    }
  }
  rounding_ = kRoundingOfSpeed * fastest;
  for (BoxRow& row : boxes_) {
    if (row.gear >= 0) {
      row.u = 0;
      for (const GearPart& part : gears_[index(row.gear)]) {
        const Relative motion(bodies, -1, part.body, part.p);
        row.u += part.d.dot(motion.v) + part.m.dot(motion.w);
      }
      continue;
    }
    const Relative relative(bodies, row.a, row.b, row.p);
    row.u = row.d.dot(relative.v) + row.m.dot(relative.w);
  }
  for (Core& core : cores_) {
    const ConeRow& row = cones_[core.row];
    const Relative relative(bodies, row.a, row.b, row.p);
    for (int k = 0; k < 3; ++k) core.b[k] = row.d.col(k).dot(relative.v);
    core.b[0] -= core.target;
    for (int k = 0; k < 2; ++k) core.b[k + 1] -= row.slide[k];
  }
}

void Rows::apply(std::span<RigidBody> bodies, Forest& forest) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (slice_of_body_[b] < 0 || forest.tree_of(static_cast<int>(b)) >= 0) continue;
    RigidBody& body = bodies[b];
    const double* z = z_.data() + slices_[index(slice_of_body_[b])].offset;
    const Vector3d linear(z[0], z[1], z[2]), angular(z[3], z[4], z[5]);
    if (linear.isZero(0) && angular.isZero(0)) continue;
    body.v += body.inverse_root_mass * linear;
    body.w += body.R * body.inverse_root_moments.cwiseProduct(angular);
    body.L += body.R * body.root_moments.cwiseProduct(angular);
  }
  const auto onto = [&](int body, const Vector3d& impulse, const Vector3d& moment, const Vector3d& p) {
    const int t = body < 0 ? -1 : forest.tree_of(body);
    if (t < 0) return;
    forest.apply_impulse(forest.trees()[index(t)], forest.nodes()[index(forest.node_of(body))], impulse, moment, p);
  };
  for (BoxRow& row : boxes_) {
    const double gained = row.x - row.applied;
    row.applied = row.x;
    if (gained == 0) continue;
    if (row.gear >= 0) {
      for (const GearPart& part : gears_[index(row.gear)]) onto(part.body, gained * part.d, gained * part.m, part.p);
      continue;
    }
    onto(row.b, gained * row.d, gained * row.m, row.p);
    onto(row.a, -gained * row.d, -gained * row.m, row.p);
  }
  for (ConeRow& row : cones_) {
    const Vector3d impulse = row.d * Vector3d(row.x[0] - row.applied[0], row.x[1] - row.applied[1], row.x[2] - row.applied[2]);
    std::copy(row.x, row.x + 3, row.applied);
    if (impulse.isZero(0)) continue;
    onto(row.b, impulse, Vector3d::Zero(), row.p);
    onto(row.a, -impulse, Vector3d::Zero(), row.p);
  }
}

}  // namespace cotwin::contact_world
