// Sweeps over the rows of rows.h and their acceleration.
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/solvers/numbers.h"

namespace cotwin::contact_world {
namespace {

/// Relative distance from the cone below which a tangent impulse slips; parallel directions; largest extrapolation.
constexpr double kRounding = 1e-12, kParallel = 1e-10, kFarthestShare = 100;

/// Growth of the residual that ends the acceleration: changes of the size of rounding errors are extrapolated, and z does not belong to x any more.
constexpr double kDiverges = 100;

/// Changes of z with a smaller square, relative to zᵀz, are extrapolated only if that square is a negligible energy (J).
constexpr double kResolved = 1e-16, kNegligible = 1e-13;

/// Energy that accelerated sweeps may add, relative to that which they exchange.
constexpr double kRoundingGain = 1e-9;

/// Bound of the work along targets, relative to that of a contact alone: contacts carry one another.
constexpr double kShareOfTargets = 4;

/// Islands at rest: most contacts, factors of the number of sweeps in total and before pivots, and residual that ends the additional
/// ones, relative to the speed of rest.
constexpr std::size_t kContactsAtRest = 200;
constexpr int kFactorAtRest = 50, kFactorBeforePivots = 5;
constexpr double kConvergedAtRest = 1e-4;

/// The same as a speed for long steps, in which bodies creep as far as in short ones, m/s.
constexpr double kConvergedCreep = 2e-6;

/// Residual that ends additional sweeps over limits, motors and friction of joints, which cost little: rad/s, m/s.
constexpr double kConvergedAxes = 1e-6;

/// Pivots after sweeps begin close to the solution, or do not end.
constexpr Rows::Pivots kPivotsAtRest{100, 3, 30}, kPivotsOfMoving{12, 0.2, 6}, kPivotsOfLarge{30, 0, 4};

/// N.s: smaller friction counts as zero; its shift would overflow.
constexpr double kZeroImpulse = 1e-100;

/// Arrays that are read by pairs are aligned for pairs; each side and slice has an even number of elements.
using DoublePair = double __attribute__((vector_size(16), may_alias));
static_assert(__STDCPP_DEFAULT_NEW_ALIGNMENT__ >= alignof(DoublePair));

double sum(const DoublePair& parts) { return parts[0] + parts[1]; }

/// Velocities of three rows, each in two partial sums.
struct Sums {
  DoublePair n{}, s{}, t{};
};

/// sums += (three rows of y) z for one side of `kSize` coordinates, 6 or 0.
template <int kSize>
void add_velocity(const double* y, const double* z, Sums& sums) {
  if constexpr (kSize == 6) {
    const auto* Y = reinterpret_cast<const DoublePair*>(y);
    const auto* Z = reinterpret_cast<const DoublePair*>(z);
    const DoublePair z0 = Z[0], z1 = Z[1], z2 = Z[2];
    sums.n += Y[0] * z0 + Y[1] * z1 + Y[2] * z2;
    sums.s += Y[3] * z0 + Y[4] * z1 + Y[5] * z2;
    sums.t += Y[6] * z0 + Y[7] * z1 + Y[8] * z2;
  }
}

template <int kSize>
void add_impulse(const double* y, double n, double s, double t, double* z) {
  if constexpr (kSize == 6) {
    const auto* Y = reinterpret_cast<const DoublePair*>(y);
    auto* Z = reinterpret_cast<DoublePair*>(z);
    for (int i = 0; i < 3; ++i) Z[i] += n * Y[i] + s * Y[3 + i] + t * Y[6 + i];
  }
}

}  // namespace

double Rows::velocity(const double* y, const Side& side) const { return dot(y, z_.data() + side.offset, side.size); }

void Rows::apply_impulse(const double* y, const Side& side, double x) {
  double* z = z_.data() + side.offset;
  for (int i = 0; i < side.size; ++i) z[i] += x * y[i];
}

void Rows::apply_impulse(const Core& core, const double* change) {
  for (const Side& side : core.side) {
    if (side.size == 6) {
      add_impulse<6>(y_.data() + side.y, change[0], change[1], change[2], z_.data() + side.offset);
    } else {
      for (int k = 0; k < 3; ++k) apply_impulse(y_.data() + side.y + index(k * side.size), side, change[k]);
    }
  }
}

/// Solves one row; returns the change of velocity that it required.
double Rows::solve(BoxRow& row) {
  double u = row.u + row.softness * row.x - row.target;
  for (const Side& side : row.side) u += velocity(y_.data() + side.y, side);
  const double x = std::clamp(row.x - u * row.inverse_A, row.lo, row.hi);
  const double change = x - row.x;
  if (change == 0) return 0;
  row.x = x;
  for (const Side& side : row.side) apply_impulse(y_.data() + side.y, side, change);
  return std::abs(change) * row.A;
}

// Solves the normal first, then the tangents exactly for the new normal impulse: inside the circle if possible, otherwise
// (A_t + shift) x_t = −b on the circle, with one Newton step for the shift from its last value.
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
  if (radius > kZeroImpulse) {
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
    apply_impulse(core, core.change);
  } else {
    add_impulse<kSizeA>(y_a, change_n, change_1, change_2, z_a);
    add_impulse<kSizeB>(y_b, change_n, change_1, change_2, z_b);
  }
  const double tangents = std::max(std::abs(change_1) * core.A_11, std::abs(change_2) * core.A_22);
  return std::max(std::abs(change_n) * core.A_nn, tangents);
}

/// Returns the change of velocity that the contact required.
double Rows::solve_any(Core& core) {
  const int a = core.side[0].size, b = core.side[1].size;
  if (a == 6 && b == 6) return solve<6, 6>(core);
  if (a == 0 && b == 6) return solve<0, 6>(core);
  if (a == 6 && b == 0) return solve<6, 0>(core);
  return solve<-1, -1>(core);
}

void Rows::begin_acceleration(const Island& island) {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    std::fill_n(core.change, 4, 0.0);
    std::fill_n(core.path, 4, 0.0);
    core.x[3] = core.b[3] = 0;
    const double radius = core.mu * core.x[0], square = core.x[1] * core.x[1] + core.x[2] * core.x[2];
    const bool sticks = core.x[0] > core.lo && (square == 0 || square < radius * radius * (1 - kRounding));
    core.hold = sticks ? Hold::kSticks : core.x[0] > core.lo ? Hold::kSlips : Hold::kOpen;
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    std::copy_n(z_.begin() + slice.offset, slice.size, z_before_.begin() + slice.offset);
    std::fill_n(z_path_.begin() + slice.offset, slice.size, 0.0);
  }
}

double Rows::squared_change(const Island& island) const {
  DoublePair squares[2] = {};  // independent sums shorten the dependency chain
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const auto* change = reinterpret_cast<const DoublePair*>(cores_[i].change);
    for (int k = 0; k < 2; ++k) squares[k] += change[k] * change[k];
  }
  return sum(squares[0] + squares[1]);
}

/// Steps along the last sweep's change d and the previous path p that minimise ½ xᵀAx + bᵀx, with xᵀAx from zᵀz and the
/// softness, while no contact changes its state. Bounded by the first contact that opens, because there may be no minimum along
/// redundant contacts.
Rows::Shares Rows::optimal_shares(const Island& island) const {
  DoublePair dd{}, dp{}, pp{}, zz{}, along_d{}, along_p{};  // products of d, p, z and the gradient
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const auto *b = reinterpret_cast<const DoublePair*>(core.b), *d = reinterpret_cast<const DoublePair*>(core.change),
               *p = reinterpret_cast<const DoublePair*>(core.path);
    along_d += b[0] * d[0] + b[1] * d[1];
    along_p += b[0] * p[0] + b[1] * p[1];
    if (core.softness == 0) continue;
    const double soft_d = core.softness * core.change[0], soft_p = core.softness * core.path[0];
    along_d[0] += core.x[0] * soft_d;
    along_p[0] += core.x[0] * soft_p;
    dd[0] += core.change[0] * soft_d;
    dp[0] += core.change[0] * soft_p;
    pp[0] += core.path[0] * soft_p;
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; i += 2) {
      const DoublePair z = *reinterpret_cast<const DoublePair*>(&z_[index(i)]),
                       p = *reinterpret_cast<const DoublePair*>(&z_path_[index(i)]);
      const DoublePair d = z - *reinterpret_cast<const DoublePair*>(&z_before_[index(i)]);
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
  const double determinant = D * P - M * M, least = D > kNegligible ? kResolved * sum(zz) : 0;
  if (determinant > std::max(kParallel * D, least) * P) {
    shares = {(p * M - d * P) / determinant, (d * M - p * D) / determinant};
  } else if (D > least) {
    shares.of_change = -d / D;
  }
  if (!(std::abs(shares.of_change) < kFarthestShare)) return {};
  double part = 1;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const double step = shares.of_change * core.change[0] + shares.of_path * core.path[0];
    if (core.x[0] + part * step < core.lo) part = (core.lo - core.x[0]) / step;
  }
  return {part * shares.of_change, part * shares.of_path};
}

/// Extrapolates x and z by shares of the last sweep's change and of the previous path.
void Rows::extrapolate(const Island& island, Shares shares) {
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    Core& core = cores_[i];
    auto *x = reinterpret_cast<DoublePair*>(core.x), *path = reinterpret_cast<DoublePair*>(core.path);
    const auto* change = reinterpret_cast<const DoublePair*>(core.change);
    for (int k = 0; k < 2; ++k) {
      const DoublePair step = shares.of_change * change[k] + shares.of_path * path[k];
      x[k] += step;
      path[k] = step + change[k];
    }
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    for (int i = slice.offset; i < slice.offset + slice.size; i += 2) {
      auto *z = reinterpret_cast<DoublePair*>(&z_[index(i)]), *path = reinterpret_cast<DoublePair*>(&z_path_[index(i)]);
      auto* before = reinterpret_cast<DoublePair*>(&z_before_[index(i)]);
      const DoublePair change = *z - *before, step = shares.of_change * change + shares.of_path * *path;
      *z += step;
      *path = step + change;
      *before = *z;
    }
  }
}

// If the island has contacts only, the sweeps are the gradient of a conjugate gradient method, which distributes load through a
// pile in far fewer sweeps. While no contact opens, closes or slips, it is linear: each sweep is followed by the optimal step
// in the plane of its change and the previous path. Otherwise it is nonlinear [Silcowitz, Niebe, Erleben 2010] and restarts
// when the changes grow. The last sweep is not extrapolated, so that x stays within its bounds.
Rows::Outcome Rows::sweep(const Island& island, const Effort& effort, bool accelerate) {
  double square_before = 0, least = kInfinity;  // residual since contacts last changed their state
  if (accelerate) begin_acceleration(island);
  Outcome outcome;
  for (std::size_t i = island.first_box; i < island.end_box; ++i) outcome.degenerate += boxes_[i].redundant;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) outcome.degenerate += cores_[i].redundant;
  for (int k = 0; k < effort.most; ++k) {
    double residual = 0;
    linear_ = true;
    if (k == 0) {
      for (std::size_t i = island.first_box; i < island.end_box; ++i) residual = std::max(residual, solve(boxes_[i]));
      residual = std::max(residual, share(island));
    } else if (k % 2 == 0) {
      for (std::size_t i = island.first_box; i < island.end_box; ++i) residual = std::max(residual, solve(boxes_[i]));
      for (std::size_t i = island.first_cone; i < island.end_cone; ++i) residual = std::max(residual, solve_any(cores_[i]));
    } else {
      for (std::size_t i = island.end_cone; i > island.first_cone; --i) residual = std::max(residual, solve_any(cores_[i - 1]));
      for (std::size_t i = island.end_box; i > island.first_box; --i) residual = std::max(residual, solve(boxes_[i - 1]));
    }
    outcome.iterations = k + 1;
    outcome.residual = residual;
    if (residual <= (k < effort.least ? effort.tolerance : effort.tolerance_at_rest)) break;
    if (!accelerate || k + 1 == effort.most) continue;
    least = linear_ ? std::min(least, residual) : residual;
    if (residual > kDiverges * least) {
      accelerate = false;
      clear_changes(island);
      apply_impulses(island);
      continue;
    }
    const double square = linear_ ? 0 : squared_change(island);
    extrapolate(island, linear_ ? optimal_shares(island) : Shares{0, square < square_before ? square / square_before : 0});
    square_before = square;
  }
  outcome.extended = outcome.iterations > effort.least;
  return outcome;
}

/// Speed below which the island's contacts are at rest.
double Rows::rest_of(const Island& island, double rest) const {
  for (std::size_t i = island.first_box; i < island.end_box; ++i) rest = std::max(rest, boxes_[i].rest);
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) rest = std::max(rest, cones_[cores_[i].row].rest);
  return rest;
}

/// Whether contacts alone hold the island, which moves at less than `rest` before they act.
bool Rows::at_rest(const Island& island, double rest) const {
  if (rest == 0 || island.first_cone == island.end_cone || island.first_box < island.end_box) return false;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    const double* slide = cones_[core.row].slide;
    const double speeds[] = {core.b[0] + core.target, core.b[1] + slide[0], core.b[2] + slide[1]};
    for (const double speed : speeds) {
      if (!(std::abs(speed) <= rest)) return false;
    }
  }
  return true;
}

/// Whether the residual is larger than the tolerance, what rounding of the speeds explains, and what contacts at rest, or others, may have.
bool Rows::unsolved(double residual, double tolerance, bool rests, double rest) const {
  const double most = rests ? std::min(kPoorResidual * rest, kPoorCreep) : rest;
  return rest > 0 && residual > std::max({tolerance, rounding_, most});
}

/// More sweeps for islands at rest and for those without contacts.
Rows::Effort Rows::effort(const Island& island, int iterations, double tolerance, bool rests, double rest) const {
  Effort effort{iterations, iterations, tolerance, std::max(tolerance, std::min(kConvergedAtRest * rest, kConvergedCreep))};
  const std::size_t contacts = island.end_cone - island.first_cone, boxes = island.end_box - island.first_box;
  if (contacts == 0 && boxes <= kContactsAtRest) {
    effort.most = kFactorAtRest * iterations;
    effort.tolerance_at_rest = std::max(tolerance, kConvergedAxes);
  } else if (rests && contacts <= kContactsAtRest) {
    effort.most = kFactorAtRest * iterations;
  }
  return effort;
}

// Accelerated sweeps can diverge along redundant contacts that slip; plain sweeps from the same start replace them.
Rows::Outcome Rows::sweep_only(const Island& island, const Effort& effort) {
  apply_start(island);
  if (effort.most > 0) scale_start(island);
  const bool accelerate = island.first_box == island.end_box && island.end_cone - island.first_cone > 1;
  Outcome outcome = sweep(island, effort, accelerate);
  if (accelerate && effort.most > 0 && adds_energy(island)) {
    clear_changes(island);
    apply_start(island);
    scale_start(island);
    outcome = sweep(island, effort, false);
  }
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    std::copy(cores_[i].x, cores_[i].x + 3, cones_[cores_[i].row].x);
  }
  return outcome;
}

// Pivots, from where the sweeps have come to, islands at rest whose sweeps do not converge (they stand or fall by friction), small ones that sweeps
// leave far from their laws (bodies of very different mass), and with Residual::kNone all that are not too large. Where pivoting does not end,
// islands at rest are swept further, and others keep the result of the sweeps.
Rows::Outcome Rows::sweep_or_pivot(const Island& island, int iterations, double tolerance, double rest, Residual allowed) {
  const bool rests = at_rest(island, rest);
  const Effort most = effort(island, iterations, tolerance, rests, rest);
  Effort some = most;
  some.most = std::min(most.most, kFactorBeforePivots * iterations);
  Outcome outcome = sweep_only(island, some);
  outcome.unsolved = unsolved(outcome.residual, tolerance, rests, rest);
  const bool more = most.most > some.most, exact = allowed == Residual::kNone;
  double enough = most.tolerance_at_rest;
  if (!more) enough = exact ? std::max(tolerance, kExactResidual * rest) : kPoorResidual * rest;
  if (outcome.residual <= enough) return outcome;
  const std::size_t most_rows = exact ? kRowsOfMoving : rest > 0 ? kRowsOfSmall : 0;
  if (!more && rows_of(island) > most_rows) {
    outcome.extended = exact;
    return outcome;
  }
  const int sweeps = outcome.iterations;
  clear_changes(island);
  Outcome pivoted;
  const bool large = rows_of(island) > kRowsOfMoving;
  const Pivots limits = !more ? kPivotsOfMoving : large ? kPivotsOfLarge : kPivotsAtRest;
  if (pivot_from_start(island, limits, outcome.residual, pivoted)) {
    outcome = pivoted;
  } else if (more && !large) {
    outcome = sweep_only(island, most);
  } else {
    apply_start(island);
    outcome.extended = exact;
    return outcome;
  }
  outcome.iterations += sweeps;
  outcome.extended = 1;
  outcome.unsolved = unsolved(outcome.residual, tolerance, rests, rest);
  return outcome;
}

Rows::Outcome Rows::sweep(const Island& island, int iterations, double tolerance, double rest, Residual allowed) {
  Outcome outcome = sweep_or_pivot(island, iterations, tolerance, rest, allowed);
  const double enough = effort(island, iterations, tolerance, true, rest).tolerance_at_rest;
  const auto sticks = [](const Core& core) { return core.hold == Hold::kSticks; };
  if (outcome.extended == 0 && outcome.residual <= enough &&
      std::all_of(cores_.begin() + static_cast<std::ptrdiff_t>(island.first_cone),
                  cores_.begin() + static_cast<std::ptrdiff_t>(island.end_cone), sticks))
    return outcome;
  hold_if_slips(island, enough, enough, rest, outcome);
  return outcome;
}

/// Returns whether the sweeps added kinetic energy that no target and no spring accounts for. Islands with trees count as fine:
/// the energy of their freedoms is not known here.
bool Rows::adds_energy(const Island& island) const {
  double gain = 0, exchanged = 0, allowed = 0;
  for (std::size_t i = island.first_cone; i < island.end_cone; ++i) {
    const Core& core = cores_[i];
    if (core.softness > core.regular) return false;
    if (core.target > 0) allowed += kShareOfTargets * (std::abs(core.b[0]) + core.target) * core.target * core.inverse_nn;
    const double* slide = cones_[core.row].slide;
    const double across = std::abs(slide[0]) + std::abs(slide[1]);
    allowed +=
        kShareOfTargets * (std::abs(core.b[1]) + std::abs(core.b[2]) + across) * across * (core.inverse_11 + core.inverse_22);
  }
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const int which = island_slices_[s];
    if (which < trees_) return false;
    const Slice& slice = slices_[index(which)];
    for (int i = slice.offset; i < slice.offset + slice.size; ++i) {
      const double z = z_[index(i)], z_0 = z_start_[index(i)];
      gain += z * (z_0 + z / 2);
      exchanged += std::abs(z * z_0) + z * z;
    }
  }
  return !(gain <= allowed + kRoundingGain * exchanged);
}

void Rows::clear_changes(const Island& island) {
  for (std::size_t s = island.first_slice; s < island.end_slice; ++s) {
    const Slice& slice = slices_[index(island_slices_[s])];
    std::fill_n(z_.begin() + slice.offset, slice.size, 0.0);
  }
}

Rows::Outcome Rows::sweep(int iterations, double tolerance, double rest) {
  Outcome all;
  for (const Island& island : islands_) {
    bool exact = false;
    for (std::size_t i = island.first_box; i < island.end_box; ++i) exact = exact || boxes_[i].exact;
    exact = exact && rows_of(island) <= kRowsToPivot;
    const double slow = rest_of(island, rest);
    all.add(exact ? pivot(island, iterations, tolerance, slow)
                  : sweep(island, iterations, tolerance, slow, Residual::kOfMovingContacts));
  }
  return all;
}

}  // namespace cotwin::contact_world
