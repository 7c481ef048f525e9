#include "components/contact_world/engine/advance.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "components/contact_world/engine/solvers/numbers.h"
#include "models/collision/body.h"

namespace cotwin::contact_world {
namespace {

using collision::Convex;
using collision::Core;
using collision::Distance;
using collision::distance;
using collision::Placed;

/// Motion in a step beyond which a body is fast: the share of its least half size, between these bounds.
constexpr double kShareOfSize = 0.5;
constexpr double kLeastMotion = 0.01, kMostMotion = 0.05;  // m; contact points of slower bodies exist before the impact

/// Bodies stop at a distance below this one. It is smaller than the gap at which contact points act (fast_bodies.cpp).
constexpr double kStop = 2e-6;  // m

/// Depth that a pair with contact points may gain in a step: of the smaller half size, and at most what separate() accepts.
constexpr double kDeeper = 0.25, kDeepest = 2e-4;  // m

/// Conservative steps of a pair; after the first kExactSteps, a step moves at least kLeastShare of the smaller half size.
constexpr int kSteps = 200, kExactSteps = 50;
constexpr double kLeastShare = 0.02;

/// Rounds in which a body that stops can change the impacts of others.
constexpr int kRounds = 10;

using Piece = collision::Detector::Piece;

Placed place(const RigidBody& body, const Piece& piece, const Vector3d& origin) {
  const Pose X_PC = body.X_PB * piece.convex.X_BC;
  return {&piece.convex, body.R * X_PC.R, body.p - origin + body.R * X_PC.p};
}

bool unbounded(const Convex& c) { return c.core == Core::kPlane || c.core == Core::kHeights; }
double half_size(const Convex& c) { return unbounded(c) ? kInfinity : c.extent.minCoeff() + c.round; }
/// The largest distance of the core from P's origin.
double reach_of(const RigidBody& body, const Convex& c) {
  return unbounded(c) ? kInfinity : (body.X_PB * c.X_BC.p).norm() + c.extent.norm();
}

double distance_from_segment(const Vector3d& p, const Vector3d& start, const Vector3d& displacement) {
  const double square = displacement.squaredNorm();
  const double s = square > 0 ? std::clamp((p - start).dot(displacement) / square, 0.0, 1.0) : 0;
  return (start + s * displacement - p).norm();
}

/// Upper bound of the speed along n of a body's points within `reach` of P, over `duration`.
double speed_along(const RigidBody& body, const Vector3d& n, double reach, double duration) {
  const double turning =
      reach > 0
          ? reach * (n.cross(body.w).norm() +
                     duration * (body.R * body.inverse_moments.cwiseProduct(body.R.transpose() * body.L.cross(body.w))).norm())
          : 0;
  return n.dot(body.v) + turning;
}

}  // namespace

Advance::Advance(std::span<const RigidBody> bodies, std::span<const char> linked, const collision::Detector& detector)
    : pieces_(detector.pieces()),
      detector_(&detector),
      bodies_(bodies.size()),
      fast_(bodies.size(), 0),
      stops_(bodies.size(), 0) {
  std::size_t k = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies_[b];
    double least = kInfinity;
    const std::size_t first = k;
    for (; k < pieces_.size() && pieces_[k].body == static_cast<int>(b); ++k) {
      const Convex& convex = pieces_[k].convex;
      scratch_.corners.reserve(most_corners(convex));
      body.unbounded = body.unbounded || unbounded(convex);
      least = std::min(least, half_size(convex));
    }
    body.pieces = pieces_.subspan(first, k - first);
    refit(b, bodies[b]);
    const bool free = bodies[b].dynamic() && linked[b] == 0 && !body.pieces.empty() && !body.unbounded;
    body.limit = free ? std::clamp(kShareOfSize * least, kLeastMotion, kMostMotion) : kInfinity;
  }
}

void Advance::refit(std::size_t b, const RigidBody& now) {
  bodies_[b].reach = 0;
  for (const Piece& piece : bodies_[b].pieces) bodies_[b].reach = std::max(bodies_[b].reach, reach_of(now, piece.convex));
}

void Advance::clear() {
  if (any_) std::fill(fast_.begin(), fast_.end(), 0);
  any_ = false;
}

bool Advance::find_fast(std::span<const RigidBody> bodies, double h) {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const double limit = bodies_[b].limit / h, reach = bodies_[b].reach;
    // |v| + |w| r ≤ √2 √(v² + w² r²): most bodies need no square root.
    const double v2 = bodies[b].v.squaredNorm(), w2 = bodies[b].w.squaredNorm();
    if (!(2 * (v2 + w2 * reach * reach) > limit * limit)) continue;
    if (!(std::sqrt(v2) + std::sqrt(w2) * reach > limit)) continue;
    fast_[b] = 1;
    any_ = true;
  }
  return any_;
}

void Advance::find_stops(std::span<const RigidBody> bodies, double h, double near) {
  std::fill(stops_.begin(), stops_.end(), h);
  bool changed = true;
  for (int round = 0; changed && round < kRounds; ++round) {
    changed = false;
    for (std::size_t a = 0; a < bodies_.size(); ++a) {
      if (fast_[a] == 0) continue;
      for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const bool both = fast_[b] != 0;
        if (b == a || (both && b < a) || (!both && round > 0) || bodies_[b].pieces.empty()) continue;
        const double t = time_of_impact(bodies, a, b, h, near);
        if (both && t < std::max(stops_[a], stops_[b])) {
          changed = changed || t < stops_[a] || t < stops_[b];
          stops_[b] = std::min(stops_[b], t);
        }
        stops_[a] = std::min(stops_[a], t);
      }
    }
  }
}

/// Infinite if the bodies do not meet before both stop.
double Advance::time_of_impact(std::span<const RigidBody> bodies, std::size_t a, std::size_t b, double h, double near) {
  const RigidBody &A = bodies[a], &B = bodies[b];
  const double stop_a = stops_[a], stop_b = fast_[b] != 0 ? stops_[b] : 0;
  const Vector3d displacement = stop_a * A.v;
  const double motion = stop_b > 0 ? stop_b * B.v.norm() : 0;
  if (!bodies_[b].unbounded && distance_from_segment(B.p, A.p, displacement) > A.radius + B.radius + motion) return kInfinity;
  if (detector_->ignores(static_cast<int>(a), static_cast<int>(b))) return kInfinity;
  double end = std::max(stop_a, stop_b);
  double first = kInfinity;
  for (const Piece& of_b : bodies_[b].pieces) {
    if (of_b.convex.core == Core::kHeights) {
      const double t = time_of_impact(A, bodies_[a], B, of_b, end, near);
      if (t < end) first = end = t;
      continue;
    }
    const Vector3d offset = B.R * (B.X_PB * of_b.convex.X_BC.p);
    const double moved = motion + (stop_b > 0 ? h * B.w.norm() * offset.norm() : 0);
    const double radius = unbounded(of_b.convex) ? kInfinity : of_b.convex.extent.norm() + of_b.convex.round;
    if (distance_from_segment(B.p + offset, A.p, displacement) > A.radius + radius + moved) continue;
    for (const Piece& of_a : bodies_[a].pieces) {
      const double t = time_of_impact(A, B, of_a, of_b, stop_a, stop_b, end, near);
      if (t < end) first = end = t;
    }
  }
  return first;
}

/// Infinite if the body does not meet the ground before `stop_a`. The ground is one surface: a body that touches it somewhere slides
/// over its seams.
double Advance::time_of_impact(const RigidBody& a, const Body& pieces_of_a, const RigidBody& b, const Piece& ground,
                               double stop_a, double near) {
  const Pose X_CW = (Pose{b.R, b.p} * b.X_PB * ground.convex.X_BC).inverse();
  const Vector3d start = X_CW * a.p, end_of_way = X_CW * Vector3d(a.p + stop_a * a.v), reach = Vector3d::Constant(a.radius);
  const auto for_each = [&](const Vector3d& to, auto&& visit) {
    for (collision::Columns columns(ground.convex, start.cwiseMin(to) - reach, start.cwiseMax(to) + reach); columns.next();) {
      columns.write(column_.convex);
      column_.convex.X_BC = ground.convex.X_BC * column_.convex.X_BC;
      column_.soft = ground.soft;
      for (const Piece& piece : pieces_of_a.pieces) visit(piece);
    }
  };
  bool touches = false;
  double floor = 0;
  for_each(start, [&](const Piece& of_a) {
    const Distance d = distance(place(a, of_a, a.p), place(b, column_, a.p), scratch_);
    if (d.d > near) return;
    touches = true;
    floor = std::min(floor, std::min(d.d, 0.0) - std::min(kDeeper * half_size(of_a.convex), kDeepest));
  });
  double first = kInfinity, end = stop_a;
  for_each(end_of_way, [&](const Piece& of_a) {
    if (touches && (of_a.soft || ground.soft)) return;
    const double t = time_of_impact(a, b, of_a, column_, stop_a, 0, end, touches ? -kInfinity : near, floor);
    if (t < end) first = end = t;
  });
  return first;
}

double Advance::time_of_impact(const RigidBody& a, const RigidBody& b, const Piece& of_a, const Piece& of_b, double stop_a,
                               double stop_b, double end, double near, double floor) {
  const double least = std::min(half_size(of_a.convex), half_size(of_b.convex));
  const double reach_a = reach_of(a, of_a.convex), reach_b = reach_of(b, of_b.convex);
  double t = 0;
  for (int step = 0; step < kSteps; ++step) {
    RigidBody at_a = a, at_b = b;
    at_a.drift(std::min(t, stop_a));
    if (stop_b > 0) at_b.drift(std::min(t, stop_b));
    const Vector3d origin = of_b.convex.core == Core::kPlane ? at_a.p : at_b.p;
    const Distance d = distance(place(at_a, of_a, origin), place(at_b, of_b, origin), scratch_);
    if (step == 0 && d.d <= near) {
      if (of_a.soft || of_b.soft) return kInfinity;
      floor = std::min(d.d, 0.0) - std::min(kDeeper * least, kDeepest);
    }
    if (step > 0 && d.d <= floor + kStop) return t;
    double closing = 0;
    if (t < stop_a) closing += speed_along(at_a, d.n, reach_a, stop_a - t);
    if (t < stop_b) closing += speed_along(at_b, -d.n, reach_b, stop_b - t);
    const double left = d.d - floor - kStop / 2;
    // Until one of two bodies stops, it can only move away from the other.
    const double next = t < stop_a && t < stop_b ? std::min(stop_a, stop_b) : end;
    double dt = closing > 0 ? left / closing : kInfinity;
    if (step >= kExactSteps && closing > 0) dt = std::max(dt, kLeastShare * least / closing);
    t = std::min(t + dt, next);
    if (t >= end) return kInfinity;
  }
  return t;
}

}  // namespace cotwin::contact_world
