#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin::scene {

/// The vertices of a mesh file, for its convex hull: STL (binary or text) or OBJ (Wavefront); triangles are ignored. Throws
/// Error `file: …` (OBJ and text STL: `file:line: …`).
std::vector<Eigen::Vector3d> load_hull(const std::filesystem::path& file,
                                       const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());

enum class MeshFormat { kStl, kObj };
/// As load_hull() from the bytes of a file; `place` is its name in messages.
std::vector<Eigen::Vector3d> parse_hull(std::string_view bytes, MeshFormat format, const std::string& place,
                                        const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());

}  // namespace cotwin::scene
