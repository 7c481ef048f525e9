#pragma once
#include <tinyxml2.h>

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>

#include "models/mechanics/pose.h"

/// What <collision> and <visual> elements of a URDF have in common. For the sources of this folder.
namespace cotwin::scene {

/// "arm.urdf:12"
std::string place_in_urdf(const std::filesystem::path& file, const tinyxml2::XMLElement& element);

/// An attribute of three numbers, or `fallback` if it is absent. Throws Error for other text and for numbers from 10¹⁵ on.
Eigen::Vector3d urdf_vector(const std::filesystem::path& file, const tinyxml2::XMLElement& element, const char* attribute,
                            const Eigen::Vector3d& fallback);

/// An attribute that is a length > 0, m. Throws Error for others, or if it is absent.
double urdf_length(const std::filesystem::path& file, const tinyxml2::XMLElement& element, const char* attribute);

/// The pose of the child <origin>; the identity if there is none. Throws Error for invalid numbers.
Pose urdf_origin(const std::filesystem::path& file, const tinyxml2::XMLElement& element);

/// The file of a <mesh filename="…">. package://p/x is searched as x and p/x in the URDF's folder and every folder above.
std::optional<std::filesystem::path> find_urdf_mesh(const std::filesystem::path& urdf, const std::string& filename);

}  // namespace cotwin::scene
