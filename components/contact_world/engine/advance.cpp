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

Placed place(const RigidBody& body, const Pose& X_PC, const Convex& convex, const Vector3d& origin) {
  return {&convex, body.R * X_PC.R, body.p - origin + body.R * X_PC.p};
}

double distance_from_segment(const Vector3d& p, const Vector3d& start, const Vector3d& way) {
  const double square = way.squaredNorm();
  const double s = square > 0 ? std::clamp((p - start).dot(way) / square, 0.0, 1.0) : 0;
  return (start + s * way - p).norm();
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

Advance::Advance(const scene::Scene& scene, std::span<const RigidBody> bodies, std::span<const char> linked,
                 const collision::Detector& detector)
    : detector_(&detector), bodies_(bodies.size()), fast_(bodies.size(), 0), stops_(bodies.size(), 0) {
  const std::span<const collision::Detector::Piece> all = detector.pieces();
  pieces_.reserve(all.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies_[b];
    body.first = pieces_.size();
    double least = kInfinity;
    for (; pieces_.size() < all.size() && all[pieces_.size()].body == static_cast<int>(b);) {
      const collision::Detector::Piece& from = all[pieces_.size()];
      Piece piece;
      piece.convex = &from.convex;
      scratch_.corners.reserve(most_corners(from.convex));
      piece.X_PC = bodies[b].X_PB * from.convex.X_BC;
      piece.rigid = !scene.bodies[b].shapes[static_cast<std::size_t>(from.shape)].material.soft();
      if (from.convex.core == Core::kPlane || from.convex.core == Core::kHeights) {
        piece.radius = piece.reach = piece.least = kInfinity;
        body.unbounded = true;
      } else {
        piece.radius = from.convex.extent.norm() + from.convex.round;
        piece.reach = piece.X_PC.p.norm() + from.convex.extent.norm();
        piece.least = from.convex.extent.minCoeff() + from.convex.round;
      }
      least = std::min(least, piece.least);
      body.reach = std::max(body.reach, piece.reach);
      pieces_.push_back(piece);
    }
    body.end = pieces_.size();
    const bool free = bodies[b].dynamic() && linked[b] == 0 && body.end > body.first && !body.unbounded;
    body.limit = free ? std::clamp(kShareOfSize * least, kLeastMotion, kMostMotion) : kInfinity;
  }
}

void Advance::refit(std::size_t b, const RigidBody& now) {
  Body& body = bodies_[b];
  body.reach = 0;
  for (std::size_t i = body.first; i < body.end; ++i) {
    Piece& piece = pieces_[i];
    piece.X_PC = now.X_PB * piece.convex->X_BC;
    if (piece.convex->core != Core::kPlane) piece.reach = piece.X_PC.p.norm() + piece.convex->extent.norm();
    body.reach = std::max(body.reach, piece.reach);
  }
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
        if (b == a || (both && b < a) || (!both && round > 0) || bodies_[b].first == bodies_[b].end) continue;
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
  const Vector3d way = stop_a * A.v;
  const double motion = stop_b > 0 ? stop_b * B.v.norm() : 0;
  if (!bodies_[b].unbounded && distance_from_segment(B.p, A.p, way) > A.radius + B.radius + motion) return kInfinity;
  if (detector_->ignores(static_cast<int>(a), static_cast<int>(b))) return kInfinity;
  double end = std::max(stop_a, stop_b);
  double first = kInfinity;
  for (std::size_t j = bodies_[b].first; j < bodies_[b].end; ++j) {
    const Piece& of_b = pieces_[j];
    if (of_b.convex->core == Core::kHeights) {
      const double t = time_of_impact(A, bodies_[a], B, of_b, end, near);
      if (t < end) first = end = t;
      continue;
    }
    const Vector3d offset = B.R * of_b.X_PC.p;
    const double moved = motion + (stop_b > 0 ? h * B.w.norm() * offset.norm() : 0);
    if (distance_from_segment(B.p + offset, A.p, way) > A.radius + of_b.radius + moved) continue;
    for (std::size_t i = bodies_[a].first; i < bodies_[a].end; ++i) {
      const double t = time_of_impact(A, B, pieces_[i], of_b, stop_a, stop_b, end, near);
      if (t < end) first = end = t;
    }
  }
  return first;
}

/// Infinite if the body does not meet the ground before `stop_a`. The ground is one surface: a body that touches it somewhere slides
/// over its seams.
double Advance::time_of_impact(const RigidBody& a, const Body& pieces_of_a, const RigidBody& b, const Piece& ground,
                               double stop_a, double near) {
  const Pose X_WP{b.R, b.p}, X_CW = (X_WP * ground.X_PC).inverse();
  const Vector3d start = X_CW * a.p, end_of_way = X_CW * Vector3d(a.p + stop_a * a.v), reach = Vector3d::Constant(a.radius);
  Piece of_b = ground;
  of_b.convex = &column_;
  const auto for_each = [&](const Vector3d& to, auto&& visit) {
    for (collision::Columns columns(*ground.convex, start.cwiseMin(to) - reach, start.cwiseMax(to) + reach); columns.next();) {
      columns.write(column_);
      of_b.X_PC = ground.X_PC * column_.X_BC;
      of_b.least = column_.extent.minCoeff();
      for (std::size_t i = pieces_of_a.first; i < pieces_of_a.end; ++i) visit(pieces_[i]);
    }
  };
  bool touches = false;
  double floor = 0;
  for_each(start, [&](const Piece& of_a) {
    const Distance d = distance(place(a, of_a.X_PC, *of_a.convex, a.p), place(b, of_b.X_PC, column_, a.p), scratch_);
    if (d.d > near) return;
    touches = true;
    floor = std::min(floor, std::min(d.d, 0.0) - std::min(kDeeper * of_a.least, kDeepest));
  });
  double first = kInfinity, end = stop_a;
  for_each(end_of_way, [&](const Piece& of_a) {
    if (touches && (!of_a.rigid || !ground.rigid)) return;
    const double t = time_of_impact(a, b, of_a, of_b, stop_a, 0, end, touches ? -kInfinity : near, floor);
    if (t < end) first = end = t;
  });
  return first;
}

double Advance::time_of_impact(const RigidBody& a, const RigidBody& b, const Piece& of_a, const Piece& of_b, double stop_a,
                               double stop_b, double end, double near, double floor) {
  const double least = std::min(of_a.least, of_b.least);
  double t = 0;
  for (int step = 0; step < kSteps; ++step) {
    RigidBody at_a = a, at_b = b;
    at_a.drift(std::min(t, stop_a));
    if (stop_b > 0) at_b.drift(std::min(t, stop_b));
    const Vector3d origin = of_b.convex->core == Core::kPlane ? at_a.p : at_b.p;
    const Distance d =
        distance(place(at_a, of_a.X_PC, *of_a.convex, origin), place(at_b, of_b.X_PC, *of_b.convex, origin), scratch_);
    if (step == 0 && d.d <= near) {
      if (!of_a.rigid || !of_b.rigid) return kInfinity;
      floor = std::min(d.d, 0.0) - std::min(kDeeper * least, kDeepest);
    }
    if (step > 0 && d.d <= floor + kStop) return t;
    double closing = 0;
    if (t < stop_a) closing += speed_along(at_a, d.n, of_a.reach, stop_a - t);
    if (t < stop_b) closing += speed_along(at_b, -d.n, of_b.reach, stop_b - t);
    const double way = d.d - floor - kStop / 2;
    // Until one of two bodies stops, it can only move away from the other.
    const double next = t < stop_a && t < stop_b ? std::min(stop_a, stop_b) : end;
    double dt = closing > 0 ? way / closing : kInfinity;
    if (step >= kExactSteps && closing > 0) dt = std::max(dt, kLeastShare * least / closing);
    t = std::min(t + dt, next);
    if (t >= end) return kInfinity;
  }
  return t;
}

}  // namespace cotwin::contact_world
