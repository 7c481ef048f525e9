#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "models/collision/separation.h"

namespace cotwin::collision {

/// A contact point within a pair.
struct ManifoldPoint {
  Eigen::Vector3d p;  // halfway between the surfaces
  Eigen::Vector3d n;  // unit normal, from a to b: the pair's, or that of the place on two lines with curvature
  double gap = 0;     // along n
  std::uint64_t id = 0;
  double area = 0, share = 1;   // of a patch (patch.h): area that the point stands for, m²; its part of the whole
  double load = 0, spread = 1;  // mean depth there, m, at most -gap; ∫ d² dA relative to area · load²
};

/// Features of a and b encoded in one number: kind and index of each.
enum class FeatureKind : std::uint32_t { kVertex = 0, kEdge = 1u << 30, kFace = 2u << 30, kWhole = 3u << 30 };
inline std::uint64_t feature_pair_id(FeatureKind part_a, std::uint32_t a, FeatureKind part_b, std::uint32_t b) {
  return std::uint64_t{static_cast<std::uint32_t>(part_a) | a} << 32 | (static_cast<std::uint32_t>(part_b) | b);
}

/// Contact points between two features along the common normal n (from a to b): corners of the intersection of their outlines
/// projected along n.
class Manifold {
 public:
  /// Allocates for features of up to this number of corners.
  void reserve(std::size_t corners);

  /// Finds the features of `a` and `b` that face each other along n and appends at most four points with a gap of at most
  /// `margin` to `touches`. Returns the smallest gap of all points before that selection; infinity if the projected features
  /// are disjoint.
  double find(const Placed& a, const Placed& b, const Eigen::Vector3d& n, double margin, std::vector<ManifoldPoint>& touches);

  /// For the deepest point of the last find(): the distance across n from a corner to the border of the face above it; 0 if the
  /// point is not a corner at a face.
  double face_margin() const { return face_margin_; }

  /// As find() for a half-space bounded by the plane through `a.p` with normal n.
  void on_plane(const Placed& plane, const Placed& b, const Eigen::Vector3d& n, double margin,
                std::vector<ManifoldPoint>& touches);

 private:
  struct Point {
    Eigen::Vector2d u;             // in the plane across n
    std::uint32_t part_own = 0;    // on the clipped outline: its vertex or the edge of the point
    std::uint32_t part_other = 0;  // on the clipping outline: its face, an edge, a vertex
    std::uint32_t edge = 0;        // from here to the next point; an edge of the clipping outline if `on_other`
    bool on_other = false;
  };
  struct Side {  // of the clipping outline
    Eigen::Vector2d u, inward;
    std::uint32_t vertex, edge;
  };

  void polygons(const Eigen::Vector3d& n, double round_a, double round_b);
  void segment_on_polygon(const Feature& segment, const Feature& polygon, bool swapped, const Eigen::Vector3d& n,
                          double round_a, double round_b);
  void segments(const Placed& piece_a, const Placed& piece_b, const Eigen::Vector3d& n);
  void outline(const Feature& feature, bool clockwise);
  void clip(std::uint32_t own_face);
  double choose(double margin, std::vector<ManifoldPoint>& touches);
  Eigen::Vector2d across(const Eigen::Vector3d& p) const { return {t1_.dot(p), t2_.dot(p)}; }

  Feature a_, b_;
  Eigen::Vector3d t1_, t2_;  // right-handed frame with n
  std::vector<Point> points_, kept_;
  std::vector<Side> sides_;
  std::vector<ManifoldPoint> found_;
  double face_margin_ = 0;
  double on_ = 0;  // m; points this close to an outline are on it
};

}  // namespace cotwin::collision
