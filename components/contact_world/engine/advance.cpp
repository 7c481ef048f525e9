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

/// Most relative motion of two near bodies, over the sum of their own |v| + |w| r.
constexpr double kMotionOfPair = 3;

using Piece = collision::Detector::Piece;

Placed place(const RigidBody& body, const Piece& piece, const Vector3d& origin) {
  const Pose X_PC = body.X_PB * piece.convex.X_BC;
  return {&piece.convex, body.R * X_PC.R, body.p - origin + body.R * X_PC.p};
}

bool unbounded(const Convex& c) { return c.core == Core::kPlane; }
double half_size(const Convex& c) { return unbounded(c) ? kInfinity : c.extent.minCoeff() + c.round; }
/// The largest distance of the core from P's origin.
double reach_of(const RigidBody& body, const Convex& c) {
  return unbounded(c) ? kInfinity : (body.X_PB * c.X_BC.p).norm() + c.extent.norm();
}

/// Gap at which a pair meets that has contact points at the gap d now. `least`: smaller half size.
double lowest(double d, double least) { return std::min(d, 0.0) - std::min(kDeeper * least, kDeepest); }

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

/// What moves on with a body that it meets: all bodies go with those that stand, free ones with all others.
int rank(const RigidBody& body, bool linked) {
  if (body.motion == scene::Motion::kStatic) return 3;
  if (body.motion == scene::Motion::kDriven) return 2;
  return linked ? 1 : 0;
}

}  // namespace

Advance::Advance(std::span<const RigidBody> bodies, std::span<const char> linked, const collision::Detector& detector)
    : pieces_(detector.pieces()), detector_(&detector), bodies_(bodies.size()) {
  std::size_t k = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies_[b];
    double least = kInfinity;
    const std::size_t first = k;
    for (; k < pieces_.size() && pieces_[k].body == static_cast<int>(b); ++k) {
      const Convex& convex = pieces_[k].convex;
      scratch_.corners.reserve(most_corners(convex));
      body.unbounded = body.unbounded || unbounded(convex);
      body.meshed = body.meshed || convex.triangle;
      least = std::min(least, half_size(convex));
    }
    body.pieces = pieces_.subspan(first, k - first);
    body.rank = rank(bodies[b], linked[b] != 0 || body.unbounded);
    has_free_ = has_free_ || (body.rank == 0 && !body.pieces.empty());
    refit(b, bodies[b]);
    body.limit = body.rank > 0 ? kMostMotion : std::clamp(kShareOfSize * least, kLeastMotion, kMostMotion);
    ways_.push_back({.start = bodies[b]});
  }
}

void Advance::Floor::add(double d, double least) {
  touches = true;
  gap = std::min(gap, lowest(d, least));
}

void Advance::refit(std::size_t b, const RigidBody& now) {
  bodies_[b].reach = 0;
  for (const Piece& piece : bodies_[b].pieces) bodies_[b].reach = std::max(bodies_[b].reach, reach_of(now, piece.convex));
}

void Advance::clear() {
  if (any_) {
    for (Body& body : bodies_) body.fast = false;
  }
  any_ = false;
}

/// Motion in the frame of the other body, m/s; the common twist is no motion. Of the two ways to see it, the one with less motion.
bool Advance::fast(std::size_t a, const RigidBody& A, std::size_t b, const RigidBody& B, double h) const {
  if (bodies_[a].rank > 0 && bodies_[b].rank > 0) return false;
  const double limit =
      (bodies_[a].rank == 1 || bodies_[b].rank == 1 ? kMostMotion : std::min(bodies_[a].limit, bodies_[b].limit)) / h;
  const Vector3d r = A.p - B.p, v = A.v - B.v;
  const double spin = (A.w - B.w).norm();
  const auto turning = [&](std::size_t k) { return spin > 0 ? spin * bodies_[k].reach : 0; };
  return (v - B.w.cross(r)).norm() + turning(a) > limit && (v - A.w.cross(r)).norm() + turning(b) > limit;
}

bool Advance::find_fast(std::span<const RigidBody> bodies, double h, const Vector3d& common) {
  if (!has_free_) return false;
  double most[2] = {0, 0};
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (body.pieces.empty()) continue;
    body.speed = (bodies[b].v - common).lpNorm<1>() + (body.unbounded ? 0 : bodies[b].w.lpNorm<1>() * bodies[b].radius);
    if (body.speed > most[1]) most[1] = std::min(most[0], body.speed), most[0] = std::max(most[0], body.speed);
  }
  if (kMotionOfPair * h * (most[0] + most[1]) <= kLeastMotion) return any_;
  for (std::size_t a = 0; a < bodies_.size(); ++a) {
    Body& body = bodies_[a];
    if (body.rank > 0 || body.fast || body.pieces.empty()) continue;
    for (std::size_t b = 0; b < bodies_.size() && !body.fast; ++b) {
      const Body& other = bodies_[b];
      if (b == a || other.pieces.empty() || kMotionOfPair * h * (body.speed + other.speed) <= kLeastMotion) continue;
      const double way = bodies[a].radius + bodies[b].radius + h * (body.speed + other.speed);
      if (!other.unbounded && (bodies[a].p - bodies[b].p).squaredNorm() > way * way) continue;
      if (!fast(a, bodies[a], b, bodies[b], h) || detector_->ignores(static_cast<int>(a), static_cast<int>(b))) continue;
      body.fast = any_ = true;
    }
  }
  return any_;
}

void Advance::sweep(double h, double near) {
  for (std::size_t a = 0; a < bodies_.size(); ++a) find_next(a, a, 0, h, near);
  for (;;) {
    std::size_t first = 0;
    for (std::size_t a = 1; a < bodies_.size(); ++a) {
      if (ways_[a].meets < ways_[first].meets) first = a;
    }
    const double t = ways_[first].meets;
    if (!(t < h)) return;
    join(first, ways_[first].with, t, h);
    for (std::size_t a = 0; a < bodies_.size(); ++a) {
      if (ways_[a].group == ways_[first].group || ways_[ways_[a].with].group == ways_[first].group) find_next(a, 0, t, h, near);
    }
  }
}

bool Advance::meet(std::size_t a, const RigidBody& A, std::size_t b, const RigidBody& B, double h, double near) {
  if (bodies_[a].rank > 0) return meet(b, B, a, A, h, near);
  set_start(a, A);
  set_start(b, B);
  return std::isfinite(time_of_impact(a, b, 0, h, h, near));
}

/// Lets all that moves on with a and b move on together from t: with the body of the highest rank that they have met, or else with the velocity of
/// their centre of mass.
void Advance::join(std::size_t a, std::size_t b, double t, double h) {
  const auto carrier = [&](std::size_t k) { return bodies_[k].rank > 0 ? static_cast<int>(k) : ways_[k].on; };
  const auto higher = [&](int one, int other) {
    return one < 0 || (other >= 0 && bodies_[index(other)].rank > bodies_[index(one)].rank) ? other : one;
  };
  const int on = higher(carrier(a), carrier(b));
  const std::size_t groups[2] = {ways_[a].group, ways_[b].group};
  double mass = 0;
  Vector3d momentum = Vector3d::Zero();
  const auto each = [&](const auto& f) {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      if (bodies_[k].rank == 0 && (ways_[k].group == groups[0] || ways_[k].group == groups[1])) f(ways_[k], bodies_[k]);
    }
  };
  each([&](Way& way, Body& body) {
    way.start.drift(t - way.from);
    way.from = t;
    way.group = groups[bodies_[a].rank == 0 ? 0 : 1];
    if (on >= 0 && way.on < 0) way.rides = h - t;
    way.on = on;
    body.fast = true;
    mass += way.start.mass;
    momentum += way.start.mass * way.start.v;
  });
  Vector3d v = momentum / mass;
  RigidBody then = ways_[on < 0 ? a : index(on)].start, end = then;
  if (on >= 0) {
    then.drift(t);
    end.drift(h);
  }
  each([&](Way& way, Body&) {
    const Vector3d r = way.start.p - then.p;
    if (on >= 0) v = (end.p + end.R * (then.R.transpose() * r) - then.p - r) / (h - t);
    way.start.v = v;
    way.start.w.setZero();
    way.start.L.setZero();
  });
}

/// The next impact of a body after t. With fast bodies before the `least` one it is known.
void Advance::find_next(std::size_t a, std::size_t least, double t, double h, double near) {
  Way& way = ways_[a];
  way.meets = kInfinity;
  way.with = a;
  if (!bodies_[a].fast) return;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    if (b == a || bodies_[b].pieces.empty()) continue;
    const bool parts = bodies_[b].rank == 0;
    if (parts && (ways_[b].group == way.group || (bodies_[b].fast && b < least))) continue;
    const int on = parts ? ways_[b].on : static_cast<int>(b);
    if (way.on >= 0 && on >= 0 &&
        (parts ? bodies_[index(on)].rank == bodies_[index(way.on)].rank
               : bodies_[index(on)].rank <= bodies_[index(way.on)].rank))
      continue;
    const double meets = time_of_impact(a, b, t, std::min(h, way.meets), h, near);
    if (meets < way.meets) way.meets = meets, way.with = b;
  }
}

RigidBody Advance::at(std::size_t b, double t) const {
  RigidBody body = ways_[b].start;
  body.drift(t - ways_[b].from);
  return body;
}

/// Infinite if the bodies do not meet from `start` until `end`.
double Advance::time_of_impact(std::size_t a, std::size_t b, double start, double end, double h, double near) {
  const RigidBody A = at(a, start), B = at(b, start);
  const double duration = end - start;
  const Vector3d displacement = duration * (A.v - B.v);
  if (!bodies_[b].unbounded && distance_from_segment(B.p, A.p, displacement) > A.radius + B.radius) return kInfinity;
  if (detector_->ignores(static_cast<int>(a), static_cast<int>(b))) return kInfinity;
  const bool slow = !fast(a, A, b, B, h);
  // A mesh is one surface: a body that touches it somewhere slides over its seams.
  const Floor mesh = floor_of_mesh(A, bodies_[a], B, bodies_[b], near);
  double first = kInfinity;
  for (const Piece& of_b : bodies_[b].pieces) {
    double t = kInfinity;
    const Vector3d offset = B.R * (B.X_PB * of_b.convex.X_BC.p);
    const double moved = duration * B.w.norm() * offset.norm();
    const double radius = unbounded(of_b.convex) ? kInfinity : of_b.convex.extent.norm() + of_b.convex.round;
    if (distance_from_segment(B.p + offset, A.p, displacement) > A.radius + radius + moved) continue;
    for (const Piece& of_a : bodies_[a].pieces) {
      const bool on_mesh = mesh.touches && (of_a.convex.triangle || of_b.convex.triangle) && !of_a.soft && !of_b.soft;
      if (on_mesh && slow) continue;
      const double closer = on_mesh ? -kInfinity : near;
      t = std::min(t, start + time_of_impact(A, B, of_a, of_b, end - start, closer, slow, mesh.gap));
    }
    if (t < end) first = end = t;
  }
  return first;
}

/// What the triangles of a pair of bodies allow together, if one of them touches.
Advance::Floor Advance::floor_of_mesh(const RigidBody& a, const Body& pieces_of_a, const RigidBody& b, const Body& pieces_of_b,
                                      double near) {
  Floor floor;
  for (const Piece& of_b : pieces_of_b.pieces) {
    if (!of_b.convex.triangle && !pieces_of_a.meshed) continue;
    const Vector3d middle = b.p + b.R * (b.X_PB * of_b.convex.X_BC.p);
    if (unbounded(of_b.convex) || (middle - a.p).norm() > a.radius + of_b.convex.extent.norm() + of_b.convex.round + near)
      continue;
    for (const Piece& of_a : pieces_of_a.pieces) {
      if (!of_a.convex.triangle && !of_b.convex.triangle) continue;
      const Distance d = distance(place(a, of_a, b.p), place(b, of_b, b.p), scratch_);
      if (d.d <= near) floor.add(d.d, std::min(half_size(of_a.convex), half_size(of_b.convex)));
    }
  }
  return floor;
}

/// Time from now until the pieces meet; infinite if they do not before `end`.
double Advance::time_of_impact(const RigidBody& a, const RigidBody& b, const Piece& of_a, const Piece& of_b, double end,
                               double near, bool slow, double floor) {
  const double least = std::min(half_size(of_a.convex), half_size(of_b.convex));
  const double reach_a = reach_of(a, of_a.convex), reach_b = reach_of(b, of_b.convex);
  double t = 0;
  for (int step = 0; step < kSteps; ++step) {
    RigidBody at_a = a, at_b = b;
    at_a.drift(t);
    at_b.drift(t);
    const Vector3d origin = of_b.convex.core == Core::kPlane ? at_a.p : at_b.p;
    const Distance d = distance(place(at_a, of_a, origin), place(at_b, of_b, origin), scratch_);
    if (step == 0 && d.d <= near) {
      if (slow || of_a.soft || of_b.soft) return kInfinity;
      floor = lowest(d.d, least);
    }
    if (step > 0 && d.d <= floor + kStop) return t;
    const double closing = speed_along(at_a, d.n, reach_a, end - t) +
                           (b.motion == scene::Motion::kStatic ? 0 : speed_along(at_b, -d.n, reach_b, end - t));
    const double left = d.d - floor - kStop / 2;
    double dt = closing > 0 ? left / closing : kInfinity;
    if (step >= kExactSteps && closing > 0) dt = std::max(dt, kLeastShare * least / closing);
    t += dt;
    if (t >= end) return kInfinity;
  }
  return t;
}

}  // namespace cotwin::contact_world
