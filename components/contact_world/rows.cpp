#include "components/contact_world/rows.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::contact_world {
namespace {

/// Rows that others imply, or that held axes leave next to nothing to move, get as softness this share of what they could move
/// if nothing held their bodies; the others none.
constexpr double kRegular = 1e-9;

/// A tangents' impulse so near to the cone slips; ways so near to each other are one; following goes so far at most.
constexpr double kRounding = 1e-12, kParallel = 1e-10, kFarthestShare = 100;

/// Of zᵀz: a change of z whose square is below it is followed only where that square, an energy, is of no account (J).
constexpr double kResolved = 1e-16, kNoAccount = 1e-13;

/// N.s: friction below it is none, and its shift would leave the range of numbers.
constexpr double kNoImpulse = 1e-100;

double regular(double A, double free) { return std::max(0.0, kRegular * free - 1e-3 * A); }

std::size_t index(int i) { return static_cast<std::size_t>(i); }

double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/// J M⁻¹ Jᵀ of a row if its bodies were free: never less than what joints leave of it.
double free_inverse_inertia(std::span<const RigidBody> bodies, int a, int b, const Vector3d& d, const Vector3d& m,
                            const Vector3d& p) {
  double sum = 0;
  for (const int i : {a, b}) {
    if (i < 0 || !bodies[index(i)].dynamic()) continue;
    const RigidBody& body = bodies[index(i)];
    const Vector3d moment = body.R.transpose() * (m + (p - body.p).cross(d));
    sum += body.inverse_mass * d.squaredNorm() + body.inverse_moments.dot(moment.cwiseAbs2());
  }
  return sum;
}

/// Of a row, velocity of b against a; bodies below 0 stand still.
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

/// A spring and a damper over half a step: x = −h/2 (k (gap + θ h u) + d u). With θ = 0 Verlet's, which keeps energy but needs
/// h ω < 2; the stiffer the contact against the inertia behind it, the more implicit.
void soften(ConeRow& row, double A_nn, double h) {
  const double stiffness = h * h * row.stiffness * A_nn;  // (h ω)²
  const double theta = std::max(0.0, 1 - 0.5 / stiffness);
  const double c = std::max(h / 2 * (theta * h * row.stiffness + row.damping), 1e-12 / std::max(A_nn, 1e-12));
  row.softness = 1 / c;
  row.target = -h / 2 * row.stiffness * row.gap / c;
}

/// All arrays that are read by pairs begin where a pair may, and every side and slice in them has an even number of numbers.
using Pair = double __attribute__((vector_size(16), may_alias));
static_assert(__STDCPP_DEFAULT_NEW_ALIGNMENT__ >= alignof(Pair));

double sum(const Pair& parts) { return parts[0] + parts[1]; }

/// Sums of three rows, each in two parts.
struct Sums {
  Pair n{}, s{}, t{};
};

/// sums += (three rows of y) z for one side of `kSize` coordinates, 6 or none.
template <int kSize>
void add_velocity(const double* y, const double* z, Sums& sums) {
  if constexpr (kSize == 6) {
    const auto* Y = reinterpret_cast<const Pair*>(y);
    const auto* Z = reinterpret_cast<const Pair*>(z);
    const Pair z0 = Z[0], z1 = Z[1], z2 = Z[2];
    sums.n += Y[0] * z0 + Y[1] * z1 + Y[2] * z2;
    sums.s += Y[3] * z0 + Y[4] * z1 + Y[5] * z2;
    sums.t += Y[6] * z0 + Y[7] * z1 + Y[8] * z2;
  }
}

template <int kSize>
void add_impulse(const double* y, double n, double s, double t, double* z) {
  if constexpr (kSize == 6) {
    const auto* Y = reinterpret_cast<const Pair*>(y);
    auto* Z = reinterpret_cast<Pair*>(z);
    for (int i = 0; i < 3; ++i) Z[i] += n * Y[i] + s * Y[3 + i] + t * Y[6 + i];
  }
}

}  // namespace

Rows::Rows(std::span<const RigidBody> bodies, const Forest& forest) : slice_of_body_(bodies.size(), -1) {
  int offset = 0;
  const auto add_slice = [&](int size) {
    slices_.push_back({offset, size});
    offset += size + size % 2;  // pairs stay aligned
  };
  for (const Forest::Tree& tree : forest.trees()) add_slice(tree.end_freedom - tree.first_freedom);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!bodies[b].dynamic()) continue;
    const int tree = forest.tree_of(static_cast<int>(b));
    slice_of_body_[b] = tree >= 0 ? tree : static_cast<int>(slices_.size());
    if (tree < 0) add_slice(6);
  }
  for (std::vector<double>* z : {&z_, &z_before_, &z_way_}) z->resize(index(offset));
  latest_.resize(index(offset), -1);
  users_.resize(index(offset), {0, 0});
  parent_.resize(slices_.size());
  island_of_slice_.resize(slices_.size());
  island_slices_.resize(slices_.size());
}

void Rows::reserve(std::size_t cones, std::size_t boxes, bool pivoting) {
  std::size_t widest = 6;
  for (const Slice& slice : slices_) widest = std::max(widest, index(slice.size));
  cones_.reserve(cones);
  cores_.reserve(cones);
  boxes_.reserve(boxes);
  sorted_boxes_.reserve(boxes);
  y_.reserve(2 * (widest + 1) * (3 * cones + boxes));
  islands_.reserve(slices_.size());
  if (pivoting) reserve_pivoting(cones, boxes);
}

void Rows::Outcome::add(const Outcome& other) {
  iterations = std::max(iterations, other.iterations);
  residual = std::max(residual, other.residual);
  degenerate += other.degenerate;
}

void Rows::clear() {
  boxes_.clear();
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

// Islands in the order of their lowest slice, rows in the order in which they came: a function of the rows alone.
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
    forest.respond(tree, forest.node_of(body), {d[0], d[1], d[2], moment[0], moment[1], moment[2]}, sign, y);
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

/// Of a cone whose bodies no joint holds: both sides and A at once. The columns of d are orthonormal.
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
  core.A_nn = inverse_mass + A(0, 0);
  core.A_n1 = A(0, 1);
  core.A_n2 = A(0, 2);
  core.A_11 = inverse_mass + A(1, 1);
  core.A_12 = A(1, 2);
  core.A_22 = inverse_mass + A(2, 2);
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

/// What a cone takes from its row.
void Rows::load(Core& core, double h) {
  ConeRow& row = cones_[core.row];
  if (row.soft) soften(row, core.A_nn, h);
  core.target = row.target;
  core.softness = row.softness + core.regular;
  core.inverse_nn = 1 / (core.A_nn + core.softness);
  core.mu = core.moves ? row.mu : 0;  // where nothing can move, nothing rubs
  core.lo = row.lo;
  core.shift = 0;
  std::copy(row.x, row.x + 3, core.x);
}

void Rows::prepare(std::span<const RigidBody> bodies, const Forest& forest, double h) {
  find_islands();
  assembled_ = false;
  y_.clear();
  for (BoxRow& row : boxes_) {
    make_sides(row.a, row.b, 1, row.side);
    const bool together = row.a >= 0 && row.b >= 0 && slice_of(row.a) == slice_of(row.b);
    const Side& side_b = row.side[together ? 0 : 1];
    if (slice_of(row.a) >= 0) make_side(bodies, forest, row.a, row.d, row.m, row.p, -1, y_.data() + row.side[0].y);
    if (slice_of(row.b) >= 0) make_side(bodies, forest, row.b, row.d, row.m, row.p, 1, y_.data() + side_b.y);
    row.A = 0;
    for (const Side& side : row.side) row.A += dot(y_.data() + side.y, y_.data() + side.y, side.size);
    const double free = free_inverse_inertia(bodies, row.a, row.b, row.d, row.m, row.p);
    row.softness += regular(row.A, free);
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
    const double ridge = 1e-12 * (core.A_11 + core.A_22);  // their block may have rank one
    core.A_11 += ridge;
    core.A_22 += ridge;
    const double inverse = 1 / (core.A_11 * core.A_22 - core.A_12 * core.A_12);
    core.inverse_11 = core.A_22 * inverse;
    core.inverse_12 = -core.A_12 * inverse;
    core.inverse_22 = core.A_11 * inverse;
    load(core, h);
  }
}

bool Rows::update(double h) {
  const bool had_boxes = !islands_.empty() && islands_.back().end_box > 0;
  if (had_boxes || !boxes_.empty() || cores_.size() != cones_.size()) return false;
  for (const Core& core : cores_) {
    if (cones_[core.row].point != core.point) return false;
  }
  for (Core& core : cores_) load(core, h);
  return true;
}

void Rows::measure(std::span<const RigidBody> bodies) {
  std::fill(z_.begin(), z_.end(), 0.0);
  for (BoxRow& row : boxes_) {
    const Relative relative(bodies, row.a, row.b, row.p);
    row.u = row.d.dot(relative.v) + row.m.dot(relative.w);
  }
  for (Core& core : cores_) {
    const ConeRow& row = cones_[core.row];
    const Relative relative(bodies, row.a, row.b, row.p);
    for (int k = 0; k < 3; ++k) core.b[k] = row.d.col(k).dot(relative.v);
    core.b[0] -= core.target;
  }
}

double Rows::velocity(const double* y, const Side& side) const { return dot(y, z_.data() + side.offset, side.size); }

void Rows::push(const double* y, const Side& side, double x) {
  double* z = z_.data() + side.offset;
  for (int i = 0; i < side.size; ++i) z[i] += x * y[i];
}

void Rows::push(const Core& core, const double* change) {
  for (const Side& side : core.side) {
    if (side.size == 6) {
      add_impulse<6>(y_.data() + side.y, change[0], change[1], change[2], z_.data() + side.offset);
    } else {
      for (int k = 0; k < 3; ++k) push(y_.data() + side.y + index(k * side.size), side, change[k]);
    }
  }
}

/// The change of velocity that the row asked for.
double Rows::solve(BoxRow& row) {
  double u = row.u + row.softness * row.x - row.target;
  for (const Side& side : row.side) u += velocity(y_.data() + side.y, side);
  const double x = std::clamp(row.x - u * row.inverse_A, row.lo, row.hi);
  const double change = x - row.x;
  if (change == 0) return 0;
  row.x = x;
  for (const Side& side : row.side) push(y_.data() + side.y, side, change);
  return std::abs(change) * row.A;
}

// The normal first, then the tangents with what the normal's change does to them, exactly: inside the circle where it lets
// them, else (A_t + shift) x_t = −b on the circle, by one step of Newton's iteration for the shift from where it was last.
template <int kSizeA, int kSizeB>
double Rows::solve(Core& core) {
  double w[3] = {core.b[0], core.b[1], core.b[2]};
  const double *y_a = y_.data() + core.side[0].y, *y_b = y_.data() + core.side[1].y;
  double *z_a = z_.data() + core.side[0].offset, *z_b = z_.data() + core.side[1].offset;
  if constexpr (kSizeA < 0) {
    for (const Side& side : core.side) {
      for (int k = 0; k < 3; ++k) w[k] += velocity(y_.data() + side.y + index(k * side.size), side);
    }
  } else {
    Sums sums;
    add_velocity<kSizeA>(y_a, z_a, sums);
    add_velocity<kSizeB>(y_b, z_b, sums);
    w[0] += sum(sums.n);
    w[1] += sum(sums.s);
    w[2] += sum(sums.t);
  }

  const double x_n = std::max(core.lo, core.x[0] - (w[0] + core.softness * core.x[0]) * core.inverse_nn);
  const double change_n = x_n - core.x[0];
  const double radius = core.mu * std::max(x_n, 0.0);
  double x1 = 0, x2 = 0;
  Hold hold = x_n > core.lo ? Hold::kSticks : Hold::kOpen;
  if (radius > kNoImpulse) {
    const double w1 = w[1] + core.A_n1 * change_n, w2 = w[2] + core.A_n2 * change_n;
    x1 = core.x[1] - (core.inverse_11 * w1 + core.inverse_12 * w2);
    x2 = core.x[2] - (core.inverse_12 * w1 + core.inverse_22 * w2);
    double square = x1 * x1 + x2 * x2;
    if (square > radius * radius) {
      const double b1 = w1 - core.A_11 * core.x[1] - core.A_12 * core.x[2];
      const double b2 = w2 - core.A_12 * core.x[1] - core.A_22 * core.x[2];
      double a11 = core.A_11, a22 = core.A_22, inverse = 1 / (a11 * a22 - core.A_12 * core.A_12);
      for (int k = 0; k < 2; ++k) {
        if (k == 1 || core.shift > 0) {
          a11 = core.A_11 + core.shift;
          a22 = core.A_22 + core.shift;
          inverse = 1 / (a11 * a22 - core.A_12 * core.A_12);
          x1 = (core.A_12 * b2 - a22 * b1) * inverse;
          x2 = (core.A_12 * b1 - a11 * b2) * inverse;
          square = x1 * x1 + x2 * x2;
        }
        // d|x|²/dshift = −2 xᵀ (A + shift)⁻¹ x; Newton on 1/|x| = 1/radius.
        const double slope = (a22 * x1 * x1 - 2 * core.A_12 * x1 * x2 + a11 * x2 * x2) * inverse;
        if (k == 0 && slope > 0) core.shift = std::max(0.0, core.shift + (std::sqrt(square) / radius - 1) * square / slope);
      }
      const double scale = radius / std::sqrt(square);
      x1 *= scale;
      x2 *= scale;
      hold = Hold::kSlips;
    } else {
      core.shift = 0;
    }
  }
  const double change_1 = x1 - core.x[1], change_2 = x2 - core.x[2];
  core.x[0] = x_n;
  core.x[1] = x1;
  core.x[2] = x2;
  core.change[0] = change_n;
  core.change[1] = change_1;
  core.change[2] = change_2;
  linear_ = linear_ && hold == core.hold && hold != Hold::kSlips;
  core.hold = hold;

  if constexpr (kSizeA < 0) {
    push(core, core.change);
  } else {
    add_impulse<kSizeA>(y_a, change_n, change_1, change_2, z_a);
    add_impulse<kSizeB>(y_b, change_n, change_1, change_2, z_b);
  }
  const double tangents = std::max(std::abs(change_1) * core.A_11, std::abs(change_2) * core.A_22);
  return std::max(std::abs(change_n) * core.A_nn, tangents);
}

/// The change of velocity that the contact asked for.
double Rows::solve_any(Core& core) {
  const int a = core.side[0].size, b = core.side[1].size;
  if (a == 6 && b == 6) return solve<6, 6>(core);
  if (a == 0 && b == 6) return solve<0, 6>(core);
  if (a == 6 && b == 0) return solve<6, 0>(core);
  return solve<-1, -1>(core);
}

/// Brings what x has gained before the sweeps to the coordinates.
void Rows::start(const Island& island) {
  for (std::size_t i = island.first_box; i < island.end_box; ++i) {
    const BoxRow& row = boxes_[i];
    const double gained = row.x - row.applied;
    if (gained == 0) continue;
    for (const Side& side : row.side) push(y_.data() + side.y, side, gained);
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    const ConeRow& row = cones_[core.row];
    double gained[3];
    for (int k = 0; k < 3; ++k) {
      core.x[k] = row.x[k];
      gained[k] = row.x[k] - row.applied[k];
    }
    push(core, gained);
  }
}

void Rows::begin_following(const Island& island) {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    std::fill_n(core.change, 4, 0.0);
    std::fill_n(core.way, 4, 0.0);
    core.x[3] = core.b[3] = 0;
    const double radius = core.mu * core.x[0], square = core.x[1] * core.x[1] + core.x[2] * core.x[2];
    const bool sticks = core.x[0] > core.lo && (square == 0 || square < radius * radius * (1 - kRounding));
    core.hold = sticks ? Hold::kSticks : core.x[0] > core.lo ? Hold::kSlips : Hold::kOpen;
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    std::copy_n(z_.begin() + slice.offset, slice.size, z_before_.begin() + slice.offset);
    std::fill_n(z_way_.begin() + slice.offset, slice.size, 0.0);
  }
}

double Rows::square_of_changes(const Island& island) const {
  Pair squares[2] = {};  // side by side, for sums wait for each other
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const auto* change = reinterpret_cast<const Pair*>(cores_[i].change);
    for (int k = 0; k < 2; ++k) squares[k] += change[k] * change[k];
  }
  return sum(squares[0] + squares[1]);
}

/// How much further along the last sweep's change d and the way p the least of ½ xᵀAx + bᵀx is, xᵀAx being zᵀz and the
/// softness': of a plane, where no contact changes its state. Not farther than to where a contact opens, for along redundant
/// contacts there may be no least.
Rows::Shares Rows::best_shares(const Island& island) const {
  Pair dd{}, dp{}, pp{}, zz{}, along_d{}, along_p{};  // products of d, p, z and the gradient
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const auto *b = reinterpret_cast<const Pair*>(core.b), *d = reinterpret_cast<const Pair*>(core.change),
               *p = reinterpret_cast<const Pair*>(core.way);
    along_d += b[0] * d[0] + b[1] * d[1];
    along_p += b[0] * p[0] + b[1] * p[1];
    if (core.softness == 0) continue;
    const double soft_d = core.softness * core.change[0], soft_p = core.softness * core.way[0];
    along_d[0] += core.x[0] * soft_d;
    along_p[0] += core.x[0] * soft_p;
    dd[0] += core.change[0] * soft_d;
    dp[0] += core.change[0] * soft_p;
    pp[0] += core.way[0] * soft_p;
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; i += 2) {
      const Pair z = *reinterpret_cast<const Pair*>(&z_[index(i)]), p = *reinterpret_cast<const Pair*>(&z_way_[index(i)]);
      const Pair d = z - *reinterpret_cast<const Pair*>(&z_before_[index(i)]);
      dd += d * d;
      dp += d * p;
      pp += p * p;
      zz += z * z;
      along_d += z * d;
      along_p += z * p;
    }
  }
  const double D = sum(dd), M = sum(dp), P = sum(pp), d = sum(along_d), p = sum(along_p);
  Shares shares;
  const double determinant = D * P - M * M, least = D > kNoAccount ? kResolved * sum(zz) : 0;
  if (determinant > std::max(kParallel * D, least) * P) {
    shares = {(p * M - d * P) / determinant, (d * M - p * D) / determinant};
  } else if (D > least) {
    shares.of_change = -d / D;
  }
  if (!(std::abs(shares.of_change) < kFarthestShare)) return {};
  double part = 1;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const double step = shares.of_change * core.change[0] + shares.of_way * core.way[0];
    if (core.x[0] + part * step < core.lo) part = (core.lo - core.x[0]) / step;
  }
  return {part * shares.of_change, part * shares.of_way};
}

/// Lets x and z go on by shares of the last sweep's change and of their way before it.
void Rows::follow(const Island& island, Shares shares) {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    auto *x = reinterpret_cast<Pair*>(core.x), *way = reinterpret_cast<Pair*>(core.way);
    const auto* change = reinterpret_cast<const Pair*>(core.change);
    for (int k = 0; k < 2; ++k) {
      const Pair step = shares.of_change * change[k] + shares.of_way * way[k];
      x[k] += step;
      way[k] = step + change[k];
    }
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; i += 2) {
      auto *z = reinterpret_cast<Pair*>(&z_[index(i)]), *way = reinterpret_cast<Pair*>(&z_way_[index(i)]);
      auto* before = reinterpret_cast<Pair*>(&z_before_[index(i)]);
      const Pair change = *z - *before, step = shares.of_change * change + shares.of_way * *way;
      *z += step;
      *way = step + change;
      *before = *z;
    }
  }
}

// Where contacts are all there is, the sweeps are the gradient of a conjugate gradient method: load finds its way through a
// pile in far fewer of them. Where no contact opens, closes or slips it is a linear one, and each sweep is followed to the best
// place in the plane of its change and the way before; else a nonlinear one [Silcowitz, Niebe, Erleben 2010], which starts anew
// where the changes grow. The last sweep is not followed, so that x is within its bounds.
Rows::Outcome Rows::sweep(const Island& island, int iterations, double tolerance) {
  start(island);
  const bool follows = island.first_box == island.end_box && island.end_cone - island.first_cone > 1;
  double square_before = 0;
  if (follows) begin_following(island);
  Outcome outcome;
  for (std::size_t i = island.first_box; i < island.end_box; ++i) outcome.degenerate += boxes_[i].redundant;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) outcome.degenerate += cores_[i].redundant;
  for (int k = 0; k < iterations; ++k) {
    double residual = 0;
    linear_ = true;
    if (k % 2 == 0) {
      for (std::size_t i = island.first_box; i < island.end_box; ++i) residual = std::max(residual, solve(boxes_[i]));
      for (std::size_t i = island.first_cone; i < island.end_cone; ++i) residual = std::max(residual, solve_any(cores_[i]));
    } else {
      for (std::size_t i = island.end_cone; i > island.first_cone; --i) residual = std::max(residual, solve_any(cores_[i - 1]));
      for (std::size_t i = island.end_box; i > island.first_box; --i) residual = std::max(residual, solve(boxes_[i - 1]));
    }
    outcome.iterations = k + 1;
    outcome.residual = residual;
    if (residual <= tolerance) break;
    if (!follows || k + 1 == iterations) continue;
    const double square = linear_ ? 0 : square_of_changes(island);
    follow(island, linear_ ? best_shares(island) : Shares{0, square < square_before ? square / square_before : 0});
    square_before = square;
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    std::copy(cores_[i].x, cores_[i].x + 3, cones_[cores_[i].row].x);
  }
  return outcome;
}

Rows::Outcome Rows::sweep(int iterations, double tolerance) {
  Outcome all;
  for (const Island& island : islands_) all.add(sweep(island, iterations, tolerance));
  return all;
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
    forest.push(forest.trees()[index(t)], forest.nodes()[index(forest.node_of(body))], impulse, moment, p);
  };
  for (BoxRow& row : boxes_) {
    const double gained = row.x - row.applied;
    row.applied = row.x;
    if (gained == 0) continue;
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
