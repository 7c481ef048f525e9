#include <algorithm>
#include <cmath>
#include <utility>

#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {
namespace {

/// Softness, relative to their mobility, of tangents that joints allow to move along one direction only: across it, rounding
/// would drive friction to its cone.
constexpr double kAcross = 1e-9;

constexpr Rows::Pivots kPivots{100, 3, 30};

using Two [[gnu::vector_size(16)]] = double;
using AlignedPair [[gnu::may_alias]] = Two;
using TwoInPlace [[gnu::aligned(8), gnu::may_alias]] = Two;

/// A (3 x 3, rows `stride` apart) += a bᵀ for sides a and b of three rows with six elements each.
void add_products_of_six(const double* a, const double* b, double* A, std::size_t stride) {
  const auto* B = reinterpret_cast<const AlignedPair*>(b);
  for (int i = 0; i < 3; ++i) {
    const auto* row = reinterpret_cast<const AlignedPair*>(a + 6 * i);
    const Two a0 = row[0], a1 = row[1], a2 = row[2];
    const Two s0 = a0 * B[0] + a1 * B[1] + a2 * B[2];
    const Two s1 = a0 * B[3] + a1 * B[4] + a2 * B[5];
    const Two s2 = a0 * B[6] + a1 * B[7] + a2 * B[8];
    TwoInPlace* sums = reinterpret_cast<TwoInPlace*>(A);  // auto would drop its alignment
    *sums += Two{s0[0], s1[0]} + Two{s0[1], s1[1]};
    A[2] += s2[0] + s2[1];
    A += stride;
  }
}

}  // namespace

void Rows::reserve_pivoting(std::size_t cones, std::size_t boxes) {
  const std::size_t n = std::min(3 * cones + boxes, kRowsToPivot);
  dantzig_.reserve(static_cast<int>(n), static_cast<int>(n / 3));
  A_.reserve(n * n);
  for (std::vector<double>* v : {&x_, &b_, &lo_, &hi_, &w_, &diagonal_}) v->reserve(n);
  friction_.reserve(n / 3);
  profile_.reserve(n);
  pairs_.reserve(n);
  before_.reserve(2 * n);
}

Rows::Outcome Rows::pivot(int iterations, double tolerance, double rest) {
  Outcome all;
  for (const Island& island : islands_) {
    const double slow = rest_of(island, rest);
    const std::size_t few_rows = slow > 0 ? kRowsOfSmall : kRowsToPivot;  // impacts and what nothing presses know no rest
    const bool few = rows_of(island) <= few_rows && !at_rest(island, slow);
    all.add(few ? pivot(island, iterations, tolerance, slow) : sweep(island, iterations, tolerance, slow, Residual::kNone));
  }
  return all;
}

// A = Y Yᵀ of the island's rows: one block for each two boxes or cones with a common body or tree.
void Rows::assemble(const Island& island) {
  if (assembled_) return;
  assembled_ = islands_.size() == 1;
  ++version_;
  const std::size_t boxes = island.end_box - island.first_box, items = boxes + island.end_cone - island.first_cone;
  const auto rows_of = [&](std::size_t item) { return item < boxes ? 1 : 3; };
  const auto first_row = [&](std::size_t item) { return item < boxes ? item : boxes + 3 * (item - boxes); };
  const auto sides_of = [&](std::size_t item) {
    return std::span(item < boxes ? boxes_[island.first_box + item].side : cores_[island.first_cone + item - boxes].side);
  };
  const std::size_t n = first_row(items);
  if (A_.size() < n * n) A_.resize(n * n);
  profile_.resize(n);
  before_.resize(2 * items);
  for (std::size_t item = 0; item < items; ++item) {
    const auto begin = static_cast<int>(first_row(item));
    for (const Side& side : sides_of(item)) {
      if (side.size == 0) continue;
      RowProfile& users = users_[index(side.offset)];
      users = {users.end == 0 ? begin : users.begin, begin + rows_of(item)};
    }
  }
  for (std::size_t item = 0; item < items; ++item) {
    const std::size_t i = first_row(item);
    RowProfile own{static_cast<int>(i), static_cast<int>(i) + rows_of(item)};
    for (const Side& side : sides_of(item)) {
      if (side.size == 0) continue;
      const RowProfile& users = users_[index(side.offset)];
      own = {std::min(own.begin, users.begin), std::max(own.end, users.end)};
    }
    for (std::size_t k = i; k < i + index(rows_of(item)); ++k) {
      profile_[k] = own;
      std::fill(A_.data() + k * n + own.begin, A_.data() + k * n + own.end, 0.0);
    }
    for (std::size_t s = 0; s < 2; ++s) {
      const Side& side = sides_of(item)[s];
      if (side.size == 0) continue;
      before_[2 * item + s] = std::exchange(latest_[index(side.offset)], static_cast<int>(2 * item + s));
      for (int other = latest_[index(side.offset)]; other >= 0; other = before_[index(other)]) {
        const std::size_t partner = index(other) / 2;
        add_block(side, rows_of(item), sides_of(partner)[index(other) % 2], rows_of(partner),
                  A_.data() + i * n + first_row(partner), n);
      }
    }
  }
  for (std::size_t item = 0; item < items; ++item) {
    for (const Side& side : sides_of(item)) {
      if (side.size == 0) continue;
      users_[index(side.offset)] = {0, 0};
      latest_[index(side.offset)] = -1;
    }
  }
  diagonal_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {  // mirror the blocks left of the diagonal
    for (std::size_t j = index(profile_[i].begin); j < i; ++j) A_[j * n + i] = A_[i * n + j];
    diagonal_[i] = A_[i * n + i];
  }
}

/// `A` points at the block's first element.
void Rows::add_block(const Side& left, int rows, const Side& right, int columns, double* A, std::size_t stride) const {
  const double *a = y_.data() + left.y, *b = y_.data() + right.y;
  if (left.size == 6 && rows == 3 && columns == 3) return add_products_of_six(a, b, A, stride);
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      A[index(i) * stride + index(j)] += dot(a + index(i * left.size), b + index(j * right.size), left.size);
    }
  }
}

// Returns whether two bodies without impulses between them would close several of their contacts.
bool Rows::newly_loaded(const Island& island) const {
  for (std::size_t i = island.first_cone, next = i; i < island.end_cone; i = next) {
    const ConeRow& first = cones_[cores_[i].row];
    int closing = 0;
    bool loaded = false;
    for (; next < island.end_cone; ++next) {
      const ConeRow& row = cones_[cores_[next].row];
      if (row.a != first.a || row.b != first.b) break;
      loaded = loaded || row.x[0] > 0;
      closing += cores_[next].b[0] < 0;
    }
    if (!loaded && closing > 1) return true;
  }
  return false;
}

// Solves the island as a boxed problem. From zero, pivoting would load as few contacts as possible, for example two opposite
// corners of a box, where rounding tips it. Sweeps first distribute a new load over all contacts.
Rows::Outcome Rows::pivot(const Island& island, int iterations, double tolerance, double rest) {
  int sweeps = 0;
  if (newly_loaded(island)) {
    sweeps = sweep_only(island, {iterations, iterations, tolerance, tolerance}).iterations;
    clear_changes(island);
  }
  Outcome outcome;
  const double acceptable = rest > 0 ? kExactResidual * rest : kInfinity;
  if (!pivot_from_start(island, kPivots, acceptable, outcome)) {  // friction that pivoting does not resolve
    const int pivots = outcome.iterations;
    outcome = sweep_only(island, effort(island, iterations, tolerance, false, rest));
    outcome.iterations += pivots;
    outcome.extended = 1;
  }
  outcome.unsolved = unsolved(outcome.residual, tolerance, false, rest);
  outcome.iterations += sweeps;
  const double enough = effort(island, iterations, tolerance, true, rest).tolerance_at_rest;
  hold_if_slips(island, outcome.extended > 0 ? std::min(outcome.residual, enough) : enough, enough, rest, outcome);
  return outcome;
}

/// Pivots from the present impulses of the rows. Returns false and changes nothing but the outcome if pivoting does not end and leaves
/// more than an acceptable residual, m/s.
bool Rows::pivot_from_start(const Island& island, const Pivots& limits, double acceptable, Outcome& outcome) {
  const std::size_t boxes = island.end_box - island.first_box, cones = island.end_cone - island.first_cone;
  const std::size_t n = boxes + 3 * cones;
  assemble(island);
  for (std::vector<double>* v : {&x_, &b_, &lo_, &hi_}) v->resize(n);
  friction_.resize(cones);
  pairs_.assign(n, -1);
  bool changed = false;
  const auto set_diagonal = [&](std::size_t i, double softness) {
    const double now = diagonal_[i] + softness;
    changed = std::exchange(A_[i * (n + 1)], now) != now || changed;
  };
  // b = u − target − A x_applied, so that w = A x + b is the velocity against the target.
  for (std::size_t i = 0; i < boxes; ++i) {
    const BoxRow& row = boxes_[island.first_box + i];
    set_diagonal(i, row.softness);
    x_[i] = row.applied;
    b_[i] = row.u - row.target + row.softness * row.applied;
    lo_[i] = row.lo;
    hi_[i] = row.hi;
  }
  int pair = -1;
  const ConeRow* before = nullptr;
  for (std::size_t c = 0; c < cones; ++c) {
    const Core& core = cores_[island.first_cone + c];
    const ConeRow& row = cones_[core.row];
    const std::size_t i = boxes + 3 * c;
    set_diagonal(i, core.softness);
    const double across = core.one_way ? kAcross * (core.A_11 + core.A_22) : 0;
    for (const std::size_t t : {i + 1, i + 2}) set_diagonal(t, across);
    for (std::size_t k = 0; k < 3; ++k) {
      x_[i + k] = row.applied[k];
      b_[i + k] = core.b[k];
      lo_[i + k] = -kInfinity;
      hi_[i + k] = kInfinity;
    }
    b_[i] += core.softness * row.applied[0];
    for (const std::size_t k : {1u, 2u}) b_[i + k] += across * row.applied[k];
    lo_[i] = 0;
    const auto normal = static_cast<int>(i);
    const bool same = before != nullptr && row.a == before->a && row.b == before->b;
    if (!same) ++pair;
    before = &row;
    std::fill_n(pairs_.begin() + normal, 3, pair);
    if (core.softness > 0) pairs_[i] = -1;
    friction_[c] = {normal, normal + 1, normal + 2, row.mu};
  }
  if (changed) ++version_;
  for (std::size_t j = 0; j < n; ++j) {
    if (x_[j] == 0) continue;
    for (std::size_t i = index(profile_[j].begin); i < index(profile_[j].end); ++i) b_[i] -= A_[j * n + i] * x_[j];
  }
  for (std::size_t i = 0; i < boxes; ++i) x_[i] = boxes_[island.first_box + i].x;
  for (std::size_t c = 0; c < cones; ++c) {
    for (std::size_t k = 0; k < 3; ++k) x_[boxes + 3 * c + k] = cones_[cores_[island.first_cone + c].row].x[k];
  }
  w_.assign(n, 0.0);
  const BoxedProblem problem{static_cast<int>(n), A_.data(), b_.data(), lo_.data(), hi_.data(),
                             friction_,           profile_,  pairs_,    version_};
  dantzig_.limit(limits.least + static_cast<int>(limits.per_row * static_cast<double>(n)), limits.turns);
  const Dantzig::Result result = dantzig_.solve(problem, x_, w_);
  const bool ends =
      result.status == Dantzig::Status::kSolved || (boxes > 0 && result.status == Dantzig::Status::kContradiction);
  outcome.iterations = result.pivots;
  outcome.residual = result.residual;
  outcome.degenerate = result.redundant + result.contradicting;
  if (!ends && result.residual > acceptable) return false;

  for (std::size_t i = 0; i < boxes; ++i) {
    BoxRow& row = boxes_[island.first_box + i];
    row.x = x_[i];
    for (const Side& side : row.side) apply_impulse(y_.data() + side.y, side, row.x - row.applied);
  }
  for (std::size_t c = 0; c < cones; ++c) {
    const Core& core = cores_[island.first_cone + c];
    ConeRow& row = cones_[core.row];
    double gained[3];
    for (std::size_t k = 0; k < 3; ++k) {
      row.x[k] = x_[boxes + 3 * c + k];
      gained[k] = row.x[k] - row.applied[k];
    }
    apply_impulse(core, gained);
  }
  return true;
}

}  // namespace cotwin::contact_world
