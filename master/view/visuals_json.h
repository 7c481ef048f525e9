#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "master/view/packer.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"
#include "models/scene/urdf/urdf_visuals.h"

/// What is seen of bodies, as the page reads it (Visual of page/source/format.ts).
namespace cotwin::master {

nlohmann::ordered_json vector_json(const Eigen::Vector3d& v);

/// Adds the members p (m) and quat (w, x, y, z).
void add_pose(nlohmann::ordered_json& json, const Pose& X);

/// Writes visuals, and collects the meshes that they name. Corners and meshes go into the packer; pieces that cannot be shown are left out with a
/// remark. One for a page.
class VisualWriter {
 public:
  VisualWriter(Packer& packer, std::vector<std::string>& remarks) : packer_(packer), remarks_(remarks) {}

  /// Arrays of visuals in the frame of the body.
  nlohmann::ordered_json write(const std::vector<scene::Visual>& visuals);
  /// Triangles of a surface become one visual.
  nlohmann::ordered_json write(const std::vector<scene::Shape>& shapes);
  /// The meshes of all visuals so far.
  const nlohmann::ordered_json& meshes() const { return meshes_; }

 private:
  nlohmann::ordered_json visual_json(const scene::Visual& visual);
  nlohmann::ordered_json shape_json(const scene::Shape& shape);
  std::optional<std::size_t> mesh(const std::filesystem::path& file);

  Packer& packer_;
  std::vector<std::string>& remarks_;
  std::map<std::filesystem::path, std::optional<std::size_t>> known_meshes_;
  std::uint64_t mesh_bytes_ = 0;
  nlohmann::ordered_json meshes_ = nlohmann::ordered_json::array();
};

/// The points of a file (Cloud of page/source/format.ts), at most 300 000, with 16 bits a coordinate. Throws Error.
nlohmann::ordered_json cloud_json(const std::string& name, const std::filesystem::path& file, const Pose& X_WC, Packer& packer,
                                  std::vector<std::string>& remarks);

}  // namespace cotwin::master
