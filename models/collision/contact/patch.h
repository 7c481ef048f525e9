#pragma once
#include <Eigen/Core>
#include <vector>

#include "models/collision/contact/manifold.h"
#include "models/collision/separation.h"

namespace cotwin::collision {

/// Contact points of surfaces whose stiffness is a pressure per depth (elastic foundation). Seen along the contact normal, two
/// shapes overlap in a region of area A with the depth d ≥ 0; the pressure k d gives the force k V with V = ∫ d dA, and A = dV/dδ.
/// The region is replaced by four points (two for a line, one for a ball) of the same area, centre and second moments, with the
/// linear depth that has the same V and ∫ d x dA: force and moment, and their derivatives, do not depend on how many corners the
/// region has.
///
/// Exact for planes and faces against faces, boxes and hulls at any angle; discs are polygons of equal area; spheres, ellipsoids
/// and capsules lie within the other's face. Between two shapes without faces, the second one is pressed into the plane across
/// the normal (two spheres: exact for small depths).
class Patch {
 public:
  /// Allocates for faces of up to this number of corners.
  void reserve(std::size_t corners);

  /// Replaces the points of the pair, which has the normal n from a to b, and at least one point. Open pairs: the region that
  /// comes to a gap below the smallest one plus `margin` (m). `prefer_b`: b is the plane where both shapes have a face.
  void find(const Placed& a, const Placed& b, bool prefer_b, const Eigen::Vector3d& n, double margin,
            std::vector<ManifoldPoint>& touches);

 private:
  struct Point {
    Eigen::Vector2d u;
    double depth = 0;
  };
  struct Sums {
    double area = 0, volume = 0, square = 0;                                          // ∫ 1, ∫ d, ∫ d² dA
    Eigen::Vector2d first = Eigen::Vector2d::Zero(), load = Eigen::Vector2d::Zero();  // ∫ x, ∫ d x
    Eigen::Matrix2d second = Eigen::Matrix2d::Zero();                                 // ∫ x xᵀ
    Point deepest{Eigen::Vector2d::Zero(), -1e300};
  };

  Eigen::Vector2d across(const Eigen::Vector3d& p) const { return Eigen::Vector2d(t1_.dot(p), t2_.dot(p)) - origin_; }
  double base_at(const Eigen::Vector2d& u) const { return height_ + slope_.dot(u); }
  void set_base(const Placed& base);
  void add_corner(const Eigen::Vector3d& p);
  void add_polygon(double level);
  void add_polytope(const Placed& piece, double level);
  void add_disc(const Placed& piece, double level);
  void add_side(const Placed& piece, double radius, double level);
  void add_ellipsoid(const Eigen::Vector3d& centre, const Eigen::Vector3d& extent, const Eigen::Matrix3d& R, double share);
  void add_piece(const Placed& base, const Placed& piece, double level);
  void emit(bool swapped, bool round, const Eigen::Vector2d* line, std::vector<ManifoldPoint>& touches) const;

  Eigen::Vector3d n_, t1_, t2_;  // right-handed frame, n_ from the base to the piece
  Eigen::Vector2d origin_;       // across n_, near the region: its moments about a far one would cancel
  Eigen::Vector2d slope_;        // of the base's plane
  double height_ = 0;
  Feature feature_;
  struct Border {
    Eigen::Vector2d u, inward;
  };
  std::vector<Border> outline_;  // of the base; empty: unbounded
  std::vector<Point> corners_, kept_;
  Sums sums_;
};

}  // namespace cotwin::collision
