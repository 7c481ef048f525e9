#include "models/collision/nearest.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "models/collision/gjk.h"

namespace cotwin::collision {

using Eigen::Vector3d;

namespace {

/// Two distances are the same up to this share of the size.
constexpr double kSameDistance = 1e-12;

Distance along(const Separation& s, double round_a, double round_b) {
  const double d = s.gap - round_a - round_b;
  const Vector3d p_b = s.p_b - round_b * s.n;
  return {d, s.n, p_b - d * s.n, p_b};
}

/// s with points of the cores that face each other along s.n: what is farthest along n of one of them, or those that are nearest when the cores are
/// moved apart, which also show a better direction.
Separation with_points(const Placed& a, const Placed& b, const Separation& start) {
  constexpr int kRounds = 8;
  constexpr double kOn = 1e-11, kNear = 1e-10;  // of the size: points on the surfaces, and gaps that are nearly the largest
  const double size = size_of(a, b), apart = std::max(start.gap, 1e-5 * size);
  Separation s = start, best = start;
  double least = scene::kInfinity;
  for (int round = 0; round < kRounds && least > kOn * size; ++round) {
    const Vector3d shift = s.n * (apart - s.gap);
    double upper = 0;
    const Separation found = gjk(a, {b.convex, b.R, b.p + shift}, s.n, scene::kInfinity, upper);
    for (const Vector3d& p_b : {Vector3d(found.p_b - shift), support(b, -s.n), Vector3d(support(a, s.n) + s.gap * s.n)}) {
      const double off = std::max(std::abs(of_point(a, p_b - s.gap * s.n).gap), std::abs(of_point(b, p_b).gap));
      if (off < least) least = off, best = {s.n, s.gap, p_b};
      if (least <= kOn * size) break;
    }
    s = {found.n, gap_along(a, b, found.n), Vector3d::Zero()};
    if (s.gap < start.gap - kNear * size) break;
  }
  return best;
}

/// Newton's method for a direction of the largest gap, where that is smooth; uphill also where it is no maximum (Dauphin et al. 2014, saddle-free).
Separation ascend(const Placed& a, const Placed& b, Separation s) {
  constexpr int kRounds = 30;
  constexpr double kStep = 1e-4, kLargest = 0.3;  // rad: of the differences, of the steps
  const double size = size_of(a, b), rounding = 1e-15 * size;
  const auto farthest = [&](const Vector3d& n) { return Vector3d(support(b, -n) - support(a, n)); };
  double steepness = scene::kInfinity;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix<double, 3, 2> across, change;
    across.col(0) = s.n.unitOrthogonal();
    across.col(1) = s.n.cross(across.col(0));
    Eigen::Vector2d slope = across.transpose() * farthest(s.n);
    for (int k = 0; k < 2; ++k) {
      const Vector3d step = kStep * across.col(k), after = farthest(s.n + step), before = farthest(s.n - step);
      change.col(k) = (after - before) / (2 * kStep);
      // On a ridge, as beside the middle of a segment, where another end becomes the farthest.
      if (std::abs(across.col(k).dot(after - before)) > 10 * kStep * size) slope[k] = across.col(k).dot(after + before) / 2;
    }
    if (!(slope.norm() < steepness || round == 0)) break;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> curvature;
    curvature.computeDirect(across.transpose() * change - s.gap * Eigen::Matrix2d::Identity());
    const Eigen::Vector2d curved = curvature.eigenvalues().cwiseAbs().cwiseMax(1e-6 * std::abs(s.gap) + rounding);
    Vector3d step = across * (curvature.eigenvectors() * (curvature.eigenvectors().transpose() * slope).cwiseQuotient(curved));
    step *= std::min(1.0, kLargest / step.norm());
    bool better = false;
    for (int halving = 0; halving < 8 && !better; ++halving, step /= 2) {
      const Vector3d n = (s.n + step).normalized();
      const double gap = gap_along(a, b, n);
      better = gap > s.gap + rounding;
      if (better || (halving == 0 && gap >= s.gap - rounding)) {
        steepness = better ? scene::kInfinity : slope.norm();
        s.n = n;
        s.gap = gap;
        break;
      }
    }
    if (!better && !(steepness < scene::kInfinity)) break;
  }
  return s;
}

/// The largest gap of cores that overlap, of those that are found from several directions.
Separation deepest(const Placed& a, const Placed& b, const Separation& start, Feature& scratch) {
  constexpr std::size_t kStarts = 4;
  constexpr int kDirections = 64;
  std::array<Separation, kStarts + 2> starts;
  starts.fill(start);
  const auto consider = [&](const Vector3d& direction) {
    const double length = direction.norm();
    if (!(length > 1e-9)) return;
    Separation s{direction / length, 0, Vector3d::Zero()};
    s.gap = gap_along(a, b, s.n);
    // In the place of the worst one, or of one that is near to it.
    std::size_t place = 0;
    for (std::size_t k = 1; k < kStarts; ++k) {
      if (starts[k].gap < starts[place].gap) place = k;
    }
    for (std::size_t k = 0; k < kStarts; ++k) {
      if (starts[k].n.dot(s.n) > 0.9) place = k;
    }
    if (s.gap > starts[place].gap) starts[place] = s;
  };
  const bool flat = a.convex->core == Core::kPolytope && b.convex->core == Core::kPolytope;  // best_guess() tries all faces
  for (int i = 0; i < 3 && !flat; ++i) {
    for (const double side : {-1.0, 1.0}) {
      consider(side * a.R.col(i));
      consider(side * b.R.col(i));
      for (int j = 0; j < 3; ++j) consider(side * a.R.col(i).cross(b.R.col(j)));
    }
  }
  constexpr double kTurn = 2.399963229728653;
  for (const Placed* piece : {&a, &b}) {
    if (piece->convex->core != Core::kSegment && piece->convex->core != Core::kCylinder) continue;
    for (int k = 0; k < kDirections / 4; ++k) consider(piece->R * Vector3d(std::cos(kTurn * k), std::sin(kTurn * k), 0));
  }
  for (int k = 0; k < kDirections && !flat; ++k) {  // on a spiral
    const double z = 1 - (2 * k + 1.0) / kDirections, r = std::sqrt(1 - z * z), turn = kTurn * k;
    consider({r * std::cos(turn), r * std::sin(turn), z});
  }
  starts[kStarts] = best_guess(a, b, scene::kInfinity);
  starts[kStarts + 1] = expand(a, b, start);
  Separation best = start;
  for (const Separation& one : std::span(starts).subspan(flat ? kStarts : 0)) {
    bool certain = false;
    const Separation found = refine(a, b, climb(a, b, ascend(a, b, one)), certain, scratch);
    if (found.gap > best.gap) best = found;
  }
  return best;
}

/// Of cores without a closed form.
Separation of_cores(const Placed& a, const Placed& b, double most, Feature& scratch) {
  const Vector3d offset = b.p - a.p;
  double upper = 0;
  const double size = size_of(a, b);
  const double enough = most + kSameDistance * (size + std::abs(most));
  Separation s = gjk(a, b, offset.norm() > 0 ? Vector3d(offset.normalized()) : Vector3d::UnitZ(), enough, upper);
  if (s.gap > enough) return s;
  if (s.gap > 0) {
    if (upper - s.gap <= kSameDistance * size) return s;
    bool certain = false;
    const Separation refined = refine(a, b, s, certain, scratch);
    if (certain) return refined;
    return with_points(a, b, refined.gap > s.gap ? refined : s);
  }
  // They intersect, or nearly so.
  if (!few_edges(a, b)) return with_points(a, b, deepest(a, b, s, scratch));
  const Separation axes = along_axes(a, b, scene::kInfinity);
  return with_points(a, b, axes.gap > s.gap ? axes : s);
}

Distance ordered(const Placed& a, const Placed& b, double most, Feature& scratch) {
  const double round_a = a.convex->round, round_b = b.convex->round;
  Separation s;
  if (closed_form(a, b, s) && std::abs(s.gap) < scene::kInfinity) return along(s, round_a, round_b);  // false for NaN
  if (b.convex->core == Core::kPlane) return {};
  return along(of_cores(a, b, most + round_a + round_b, scratch), round_a, round_b);
}

}  // namespace

bool closed_form(const Placed& a, const Placed& b, Separation& s) {
  if (a.convex->core == Core::kPlane) {
    const Vector3d n = a.R.col(2), lowest = support(b, -n);
    s = {n, n.dot(lowest - a.p), lowest};
    return b.convex->core != Core::kPlane;
  }
  if (a.convex->core == Core::kPoint) {
    s = of_point(b, a.p);
    s.p_b = a.p - s.n * s.gap;
    s.n = -s.n;
    return true;
  }
  if (b.convex->core != Core::kSegment) return false;
  s = between_segments(a.p, a.R.col(2), a.convex->half, b.p, b.R.col(2), b.convex->half);
  return true;
}

bool few_edges(const Placed& a, const Placed& b) {
  constexpr std::size_t kMany = 4000;
  return a.convex->core == Core::kPolytope && b.convex->core == Core::kPolytope &&
         a.convex->polytope.edges.size() * b.convex->polytope.edges.size() < kMany;
}

Distance distance(const Placed& a, const Placed& b, Feature& scratch, double most) {
  if (a.convex->core <= b.convex->core) return ordered(a, b, most, scratch);
  const Distance s = ordered(b, a, most, scratch);
  return {s.d, -s.n, s.p_b, s.p_a, s.on_surfaces};
}

}  // namespace cotwin::collision
