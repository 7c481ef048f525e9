#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "components/contact_world/engine/body/body.h"
#include "models/collision/contact/detector.h"

namespace cotwin::contact_world {

/// Fast bodies move until they meet something, by conservative advancement [Mirtich 1996]: the time moves on by the distance divided by an upper
/// bound of the closing speed along the normal, so that it never passes an impact. All bodies are on their ways at the same time. What has met
/// moves on together, without turning.
///
/// Two bodies are fast if one is free and they may move farther in a step, in the frame of either, than half the least half size of its shapes, but at
/// least 10 mm, or than 50 mm; with bodies with joints only the latter. Only free bodies are stopped.
class Advance {
 public:
  Advance() = default;
  /// `linked`: nonzero for bodies with joints. Refers to the shapes of `detector`.
  Advance(std::span<const RigidBody> bodies, std::span<const char> linked, const collision::Detector& detector);

  /// To be called after the mass distribution of a body has changed.
  void refit(std::size_t body, const RigidBody& now);

  void clear();  // no body is fast
  /// Adds the free bodies that are fast against others; returns whether there are any. `common`: velocity that all may have, m/s.
  bool find_fast(std::span<const RigidBody> bodies, double h, const Vector3d& common);
  bool any() const { return any_; }
  bool is_fast(std::size_t body) const { return bodies_[body].fast; }
  /// Whether these bodies are fast against one another, at the given poses and velocities.
  bool fast(std::size_t a, const RigidBody& A, std::size_t b, const RigidBody& B, double h) const;

  bool has_joints(std::size_t body) const { return bodies_[body].rank == 1; }
  /// Whether the two, one of which is free, would meet in the step.
  bool meet(std::size_t a, const RigidBody& A, std::size_t b, const RigidBody& B, double h, double near);

  /// To be called for all bodies before sweep(), which adds those to the fast ones that these meet.
  void set_start(std::size_t body, const RigidBody& start) { ways_[body] = {.start = start, .group = body, .with = body}; }
  /// Moves the fast bodies over the step. Pairs closer than `near` (m) have contact points, which hold slow ones; fast ones may get deeper by
  /// 0.2 mm, and without limit if they are soft.
  void sweep(double h, double near);
  /// Of a fast body at the end of the step; with its velocities, if it has met nothing.
  RigidBody end(std::size_t body, double h) const { return at(body, h); }
  double rides(std::size_t body) const {
    return ways_[body].rides;
  }  // time at the end of the step on a body that is not free, s

 private:
  using Piece = collision::Detector::Piece;
  struct Body {
    std::span<const Piece> pieces;
    double reach = 0;        // largest distance of their cores from P's origin, m
    double limit = 0;        // motion in a step beyond which it is fast, m
    double speed = 0;        // upper bound of that of its points, less the common velocity, m/s
    bool unbounded = false;  // has a plane
    bool meshed = false;     // has triangles
    int rank = 0;            // 0: free, 1: with joints, 2: driven, 3: static
    bool fast = false;
  };
  /// From the time `from` on, s.
  struct Way {
    RigidBody start;
    double from = 0, rides = 0;
    std::size_t group = 0;  // the same for free bodies that move on together
    int on = -1;            // the body with a rank above 0 with which they move
    double meets = 0;       // time of the next impact, s; infinite: none
    std::size_t with = 0;   // the other body
  };

  /// Gap at which the pieces of one surface meet another body, that touches it now or not.
  struct Floor {
    double gap = 0;
    bool touches = false;
    void add(double d, double least);
  };

  RigidBody at(std::size_t body, double t) const;
  void find_next(std::size_t a, std::size_t least, double t, double h, double near);
  void join(std::size_t a, std::size_t b, double t, double h);
  double time_of_impact(std::size_t a, std::size_t b, double start, double end, double h, double near);
  Floor floor_of_mesh(const RigidBody& a, const Body& pieces_of_a, const RigidBody& b, const Body& pieces_of_b, double near);
  /// `floor`: gap at which the pieces meet, if they have no contact points at the start.
  double time_of_impact(const RigidBody& a, const RigidBody& b, const Piece& of_a, const Piece& of_b, double end, double near,
                        bool slow, double floor = 0);

  std::span<const Piece> pieces_;
  const collision::Detector* detector_ = nullptr;
  std::vector<Body> bodies_;
  std::vector<Way> ways_;
  collision::Feature scratch_;
  bool has_free_ = false;  // with shapes
  bool any_ = false;
};

}  // namespace cotwin::contact_world
