#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "components/contact_world/engine/body/body.h"
#include "models/collision/contact/detector.h"
#include "models/collision/contact/terrain.h"

namespace cotwin::contact_world {

/// Times of impact of fast bodies by conservative advancement [Mirtich 1996]: the time moves on by the distance divided by an upper
/// bound of the closing speed along the normal, so that it never passes an impact.
///
/// A free body is fast if a point of it may move farther in a step than half the least half size of its shapes, but at least
/// 10 mm, or farther than 50 mm. Bodies with joints and driven bodies are never fast here; they are obstacles at their poses at
/// the end of the step.
class Advance {
 public:
  Advance() = default;
  /// `linked`: nonzero for bodies with joints. Refers to the shapes of `detector`.
  Advance(std::span<const RigidBody> bodies, std::span<const char> linked, const collision::Detector& detector);

  /// To be called after the mass distribution of a body has changed.
  void refit(std::size_t body, const RigidBody& now);

  void clear();                                                 // no body is fast
  bool find_fast(std::span<const RigidBody> bodies, double h);  // adds those that are; returns whether there are any
  bool any() const { return any_; }
  bool is_fast(std::size_t body) const { return fast_[body] != 0; }

  /// Finds for each fast body the time until which it can move from its present pose without an impact, at most h (s). The other
  /// bodies are at their poses at the end of the step. Pairs closer than `near` (m) have contact points; they may get deeper by
  /// 0.2 mm, and without limit if they are soft.
  void find_stops(std::span<const RigidBody> bodies, double h, double near);
  double stop(std::size_t body) const { return stops_[body]; }

 private:
  using Piece = collision::Detector::Piece;
  struct Body {
    std::span<const Piece> pieces;
    double reach = 0;        // largest distance of their cores from P's origin, m
    double limit = 0;        // motion in a step beyond which it is fast, m; infinite: never
    bool unbounded = false;  // has a plane or a height field
  };

  double time_of_impact(std::span<const RigidBody> bodies, std::size_t a, std::size_t b, double h, double near);
  /// `ground`: a height field on b, which is static.
  double time_of_impact(const RigidBody& a, const Body& pieces_of_a, const RigidBody& b, const Piece& ground, double stop_a,
                        double near);
  /// `floor`: gap at which the pieces meet, if they have no contact points at the start.
  double time_of_impact(const RigidBody& a, const RigidBody& b, const Piece& of_a, const Piece& of_b, double stop_a,
                        double stop_b, double end, double near, double floor = 0);

  std::span<const Piece> pieces_;
  const collision::Detector* detector_ = nullptr;
  std::vector<Body> bodies_;
  std::vector<char> fast_;
  std::vector<double> stops_;
  Piece column_{.convex = collision::make_column()};
  collision::Feature scratch_;
  bool any_ = false;
};

}  // namespace cotwin::contact_world
