// What a mesh is for contacts: surface_of() of mesh.h.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/hull.h"
#include "models/scene/mesh.h"
#include "models/scene/shapes.h"

namespace cotwin::scene {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Triangle = std::array<std::uint32_t, 3>;
using Edge = std::pair<std::uint32_t, std::uint32_t>;  // from, to

constexpr std::size_t kMostStatic = 20'000, kMostDynamic = 2'000;
constexpr double kConvex = 1e-3;        // part of the hull's volume that a convex mesh may lack
constexpr double kDeepestOfMesh = 0.1;  // depth of the solid behind a triangle, of the mesh's size
constexpr double kShallowestOfMesh = 1e-4;
constexpr double kSmooth = 0.02;  // rad: edges below are smooth

Vector3d normal(const Mesh& mesh, const Triangle& t) {
  return (mesh.vertices[t[1]] - mesh.vertices[t[0]]).cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]).normalized();
}

double volume(const Mesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles) sum += mesh.vertices[t[0]].dot(mesh.vertices[t[1]].cross(mesh.vertices[t[2]])) / 6;
  return sum;
}

/// Of the solid at 1 kg/m³: tetrahedra from the origin to each triangle.
Inertia solid(const Mesh& mesh) {
  Inertia inertia;
  Vector3d first = Vector3d::Zero();
  Matrix3d second = Matrix3d::Zero();  // ∫ x xᵀ dV
  for (const Triangle& t : mesh.triangles) {
    const Vector3d &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]], s = a + b + c;
    const double v = a.dot(b.cross(c)) / 6;
    inertia.mass += v;
    first += v / 4 * s;
    second += v / 20 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + s * s.transpose());
  }
  inertia.p_LC = first / inertia.mass;
  second -= inertia.mass * inertia.p_LC * inertia.p_LC.transpose();
  second = Matrix3d((second + second.transpose()) / 2);
  inertia.I_CC = second.trace() * Matrix3d::Identity() - second;
  return inertia;
}

/// The triangle of each directed edge; of an edge that several have, the first.
std::map<Edge, std::size_t> owners_of_edges(const Mesh& mesh, bool& manifold) {
  std::map<Edge, std::size_t> owner;
  manifold = true;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k)
      manifold = owner.emplace(Edge{mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]}, t).second && manifold;
  }
  return owner;
}

/// Distance along d from p to a triangle; infinite if the ray misses it [Möller, Trumbore 1997].
double distance(const Mesh& mesh, const Triangle& t, const Vector3d& p, const Vector3d& d) {
  const Vector3d u = mesh.vertices[t[1]] - mesh.vertices[t[0]], v = mesh.vertices[t[2]] - mesh.vertices[t[0]];
  const Vector3d across = d.cross(v), from = p - mesh.vertices[t[0]];
  const double det = u.dot(across);
  if (det == 0) return kInfinity;
  const double a = from.dot(across) / det;
  if (!(a >= 0 && a <= 1)) return kInfinity;  // most rays pass by
  const Vector3d up = from.cross(u);
  const double b = d.dot(up) / det, way = v.dot(up) / det;
  return b >= 0 && a + b <= 1 && way > 0 ? way : kInfinity;
}

/// Depth of the solid behind a triangle: half of the way to the opposite surface. `normals`: of all triangles.
double depth_behind(const Mesh& mesh, const std::vector<Vector3d>& normals, std::size_t number, double deepest) {
  const Triangle& own = mesh.triangles[number];
  const Vector3d& n = normals[number];
  const Vector3d& a = mesh.vertices[own[0]];
  const Vector3d &b = mesh.vertices[own[1]], &c = mesh.vertices[own[2]], middle = (a + b + c) / 3;
  double depth = 2 * deepest;
  for (const Vector3d& corner : {middle, a, b, c}) {
    const Vector3d p = 0.1 * middle + 0.9 * corner - 1e-9 * deepest * n;
    for (std::size_t t = 0; t < normals.size(); ++t) {
      if (t == number || normals[t].dot(n) > 0) continue;
      depth = std::min(depth, distance(mesh, mesh.triangles[t], p, -n));
    }
  }
  return depth / 2;
}

}  // namespace

std::vector<Shape> triangle_shapes(const Mesh& mesh, std::span<const double> depths) {
  bool manifold = true;
  const std::map<Edge, std::size_t> owner = owners_of_edges(mesh, manifold);
  std::vector<Shape> shapes;
  shapes.reserve(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Triangle& t = mesh.triangles[i];
    Shape shape;
    shape.type = ShapeType::kTriangle;
    shape.name = std::to_string(i + 1);
    const Vector3d n = normal(mesh, t);
    int edges = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d& p = mesh.vertices[t[k]];
      shape.vertices.push_back(p);
      const auto neighbour = owner.find({t[(k + 1) % 3], t[k]});
      if (neighbour == owner.end()) continue;
      // Convex where the neighbour's third corner is below this triangle's plane by more than the angle of a smooth edge.
      const Vector3d across = (mesh.vertices[t[(k + 1) % 3]] - p).cross(n);  // outwards
      const Vector3d m = normal(mesh, mesh.triangles[neighbour->second]);
      const double angle = std::atan2(m.dot(across.normalized()), m.dot(n));
      if (!(angle < kSmooth)) continue;
      edges |= 1 << k;
      shape.turns[static_cast<Eigen::Index>(k)] = std::max(0.0, angle);
    }
    shape.size = {depths[i], static_cast<double>(edges), 0};
    shapes.push_back(std::move(shape));
  }
  return shapes;
}

MeshSurface surface_of(Mesh mesh, bool is_static) {
  MeshSurface surface;
  const auto remark = [&](const std::string& what) { surface.remarks.push_back(what); };
  const auto percent = [](double share) { return text::to_text(100 * share, 3) + " %"; };
  const auto use_hull = [&] {
    Shape shape;
    shape.type = ShapeType::kHull;
    shape.vertices = convex_hull(mesh.vertices).vertices;
    surface.shapes = {shape};
    surface.unit.reset();
  };
  if (mesh.triangles.empty()) {
    use_hull();
    return surface;
  }

  bool manifold = true;
  const std::map<Edge, std::size_t> owner = owners_of_edges(mesh, manifold);
  const bool closed = manifold && std::all_of(owner.begin(), owner.end(), [&](const auto& edge) {
                        return owner.contains({edge.first.second, edge.first.first});
                      });
  Vector3d low = mesh.vertices[0], high = low;
  for (const Vector3d& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  const double size = (high - low).norm();
  if (closed) {
    if (volume(mesh) < 0) {
      for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
      remark("its triangles face inwards; they are turned");
    }
    const double hull = convex_hull(mesh.vertices).volume(), own = volume(mesh);
    if (own >= (1 - kConvex) * hull) {
      use_hull();
      return surface;
    }
    surface.unit = solid(mesh);
    remark("concave (its hull has " + percent(hull / own - 1) + " more volume): its " + std::to_string(mesh.triangles.size()) +
           " triangles are the surface");
  } else {
    const std::string what = manifold ? "open" : "not manifold (an edge has several triangles on one side)";
    if (!is_static) {
      use_hull();
      remark(what + ", so that it has no volume: its convex hull is used");
      return surface;
    }
    remark(what + ": its " + std::to_string(mesh.triangles.size()) +
           " triangles are a surface, with solid behind it for contacts only");
  }
  const std::size_t most = is_static ? kMostStatic : kMostDynamic;
  if (mesh.triangles.size() > most) {
    throw Error(std::to_string(mesh.triangles.size()) + " triangles of a concave mesh on a " +
                (is_static ? "static" : "moving") + " body, expected " + std::to_string(most) + " at most: simplify it");
  }
  std::vector<double> depths;
  std::vector<Vector3d> normals;
  for (const Triangle& t : mesh.triangles) normals.push_back(normal(mesh, t));
  for (std::size_t t = 0; t < normals.size(); ++t) {
    const double depth = closed ? depth_behind(mesh, normals, t, kDeepestOfMesh * size) : kDeepestOfMesh * size;
    depths.push_back(std::max(depth, kShallowestOfMesh * size));
  }
  surface.shapes = triangle_shapes(mesh, depths);
  return surface;
}

}  // namespace cotwin::scene
