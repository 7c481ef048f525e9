#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A triangle mesh; equal vertices are one.
struct Mesh {
  std::vector<Eigen::Vector3d> vertices;                // m
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from outside; empty: points only
};

enum class MeshFormat { kStl, kObj, kCollada };

/// Reads a mesh file: STL (binary or text), OBJ (Wavefront; polygons become fans of triangles) or COLLADA (collada.h). Triangles without area are
/// dropped. Throws Error `file: …` (OBJ and text STL: `file:line: …`).
Mesh load_mesh(const std::filesystem::path& file, const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());
/// As load_mesh() from the bytes of a file; `place` is its name in messages.
Mesh parse_mesh(std::string_view bytes, MeshFormat format, const std::string& place,
                const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());

/// The vertices of the convex hull of a mesh. Throws Error for a mesh without extent in some direction.
std::vector<Eigen::Vector3d> load_hull(const std::filesystem::path& file,
                                       const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());

/// The triangles as shapes, numbered from 1, with solid of these depths (m, one per triangle) behind them. Edges that are smooth or
/// concave are marked.
std::vector<Shape> triangle_shapes(const Mesh& mesh, std::span<const double> depths);

/// What a mesh is for contacts.
struct MeshSurface {
  std::vector<Shape> shapes;         // one hull, or the triangles
  std::optional<Inertia> unit;       // of a closed mesh at 1 kg/m³, in its frame; absent: that of the shapes
  std::vector<std::string> remarks;  // what was done with it if not as expected
};

/// A convex mesh becomes its hull. A concave one becomes its triangles, each with solid behind it down to half of the way to the
/// opposite surface, at most a tenth of the mesh's size. An inverted mesh is turned. An open or non-manifold one is used as a
/// surface with solid behind it if `is_static`, otherwise as its hull. Throws Error for more triangles than 20 000 (static) or
/// 2 000, and for a mesh without extent.
MeshSurface surface_of(Mesh mesh, bool is_static);

}  // namespace cotwin::scene
