#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <vector>

namespace cotwin::scene {

/// The vertices of the hull of a mesh file: STL, binary or text, or OBJ (Wavefront); its triangles are not needed. Throws Error
/// `file: …` (OBJ and text STL: `file:line: …`).
std::vector<Eigen::Vector3d> load_hull(const std::filesystem::path& file,
                                       const Eigen::Vector3d& scale = Eigen::Vector3d::Ones());

}  // namespace cotwin::scene
