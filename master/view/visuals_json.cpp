#include "master/view/visuals_json.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <utility>

#include "models/cloud/cloud_file.h"
#include "models/cloud/tree.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

constexpr std::uint64_t kMostMeshBytes = 20'000'000;  // of one file
constexpr std::uint64_t kMostMeshBytesInAll = 60'000'000;

/// A glTF with the contents of the files that it names inside. They must be beside it or below. Throws Error.
std::string with_buffers_inside(const fs::path& file, const std::string& gltf) {
  Json json = Json::parse(gltf, nullptr, false);
  if (!json.is_object()) throw Error(file.string(), "is no JSON, expected glTF");
  if (!json.contains("buffers") || !json["buffers"].is_array()) return gltf;
  for (Json& buffer : json["buffers"]) {
    if (!buffer.is_object() || !buffer.contains("uri") || !buffer["uri"].is_string()) continue;
    const std::string uri = buffer["uri"].get<std::string>();
    if (uri.starts_with("data:")) continue;
    const fs::path named = fs::path(uri).lexically_normal();
    if (uri.find(':') != std::string::npos || named.is_absolute() || (!named.empty() && *named.begin() == ".."))
      throw Error(file.string(), "has its data in '" + uri + "', expected a file beside it");
    const std::string bytes = text::read_file(file.parent_path() / named, "the data of a glTF", kMostMeshBytes);
    buffer["uri"] = "data:application/octet-stream;base64," + to_base64(bytes);
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

Json vector_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

void add_pose(Json& json, const Pose& X) {
  const Eigen::Quaterniond quat(X.R);
  json["p"] = vector_json(X.p);
  json["quat"] = {quat.w(), quat.x(), quat.y(), quat.z()};
}

std::optional<std::size_t> VisualWriter::mesh(const fs::path& file) {
  const auto [known, is_new] = known_meshes_.emplace(file, std::nullopt);
  if (!is_new) return known->second;
  std::string format = file.extension().string();
  std::transform(format.begin(), format.end(), format.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (!format.empty()) format.erase(0, 1);
  constexpr std::array<std::string_view, 5> kFormats = {"stl", "obj", "dae", "gltf", "glb"};
  try {
    if (std::ranges::find(kFormats, format) == kFormats.end())
      throw Error(file.string(), "is a mesh in a format that is not shown, expected stl, obj, dae, gltf or glb");
    std::string bytes = text::read_file(file, "a mesh", kMostMeshBytes);
    if (format == "gltf") bytes = with_buffers_inside(file, bytes);
    mesh_bytes_ += bytes.size();
    if (mesh_bytes_ > kMostMeshBytesInAll)
      throw Error(file.string(),
                  "is left out: all meshes together have more than " + std::to_string(kMostMeshBytesInAll) + " bytes");
    Json entry = packer_.add_bytes(bytes);
    entry["name"] = file.filename().string();
    entry["format"] = format;
    meshes_.push_back(std::move(entry));
    known->second = meshes_.size() - 1;
  } catch (const Error& error) {
    remarks_.push_back(error.what());
  }
  return known->second;
}

Json VisualWriter::visual_json(const scene::Visual& visual) {
  static constexpr const char* kWords[] = {"box", "sphere", "cylinder", "capsule", "mesh"};
  Json json = {{"kind", kWords[static_cast<std::size_t>(visual.type)]}, {"size", vector_json(visual.size)}};
  add_pose(json, visual.X_BS);
  if (visual.colour) json["colour"] = *visual.colour;
  if (visual.type == scene::VisualType::kMesh) {
    const std::optional<std::size_t> index = mesh(visual.mesh);
    if (!index) return nullptr;
    json["mesh"] = *index;
  }
  return json;
}

Json VisualWriter::shape_json(const scene::Shape& shape) {
  using scene::ShapeType;
  static constexpr std::pair<ShapeType, const char*> kWords[] = {
      {ShapeType::kSphere, "sphere"},       {ShapeType::kBox, "box"},   {ShapeType::kCylinder, "cylinder"},
      {ShapeType::kCapsule, "capsule"},     {ShapeType::kHull, "hull"}, {ShapeType::kPlane, "plane"},
      {ShapeType::kEllipsoid, "ellipsoid"},
  };
  for (const auto& [type, word] : kWords) {
    if (shape.type != type) continue;
    Json json = {{"kind", word}, {"size", vector_json(shape.size)}};
    add_pose(json, shape.X_BS);
    if (type == ShapeType::kHull) {
      std::vector<double> points;
      for (const Eigen::Vector3d& p : shape.vertices) points.insert(points.end(), p.data(), p.data() + 3);
      json["points"] = packer_.add_reals(points);
    }
    return json;
  }
  return nullptr;
}

Json VisualWriter::write(const std::vector<scene::Visual>& visuals) {
  Json all = Json::array();
  for (const scene::Visual& visual : visuals) {
    if (Json entry = visual_json(visual); !entry.is_null()) all.push_back(std::move(entry));
  }
  return all;
}

Json VisualWriter::write(const std::vector<scene::Shape>& shapes) {
  Json visuals = Json::array();
  std::vector<double> triangles;
  for (const scene::Shape& shape : shapes) {
    if (shape.type == scene::ShapeType::kTriangle) {
      for (const Eigen::Vector3d& corner : shape.vertices) {
        const Eigen::Vector3d p = shape.X_BS * corner;
        triangles.insert(triangles.end(), p.data(), p.data() + 3);
      }
    } else if (Json visual = shape_json(shape); !visual.is_null()) {
      visuals.push_back(std::move(visual));
    }
  }
  if (!triangles.empty()) {
    Json surface = {{"kind", "triangles"}, {"size", {1, 1, 1}}};
    add_pose(surface, {});
    surface["points"] = packer_.add_reals(triangles);
    visuals.push_back(std::move(surface));
  }
  return visuals;
}

Json cloud_json(const std::string& name, const fs::path& file, const Pose& X_WC, Packer& packer,
                std::vector<std::string>& remarks) {
  constexpr std::size_t kMost = 300'000;
  constexpr double kSteps = 65535;
  const cloud::Cloud whole = cloud::load_cloud(file).cloud;
  Eigen::Vector3f nearest = whole.points.front(), farthest = nearest;
  for (const Eigen::Vector3f& p : whole.points) {
    nearest = nearest.cwiseMin(p);
    farthest = farthest.cwiseMax(p);
  }
  const Eigen::Vector3d low = nearest.cast<double>(), high = farthest.cast<double>();
  cloud::Cloud shown = whole;
  for (double cube = 1e-3 * (high - low).norm(); shown.points.size() > kMost;
       cube *= 1.1 * std::sqrt(static_cast<double>(shown.points.size()) / kMost))
    shown = cloud::thinned(whole, cube);
  if (shown.points.size() < whole.points.size())
    remarks.push_back("of the " + std::to_string(whole.points.size()) + " points of " + file.filename().string() +
                      " the page shows " + std::to_string(shown.points.size()) + ", the means of cubes");
  const Eigen::Vector3d origin = whole.origin + low, step = ((high - low) / kSteps).cwiseMax(1e-9);
  std::vector<double> steps;
  steps.reserve(3 * shown.points.size());
  for (Eigen::Index i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < shown.points.size(); ++k)
      steps.push_back(std::clamp(std::round((shown.point(k)[i] - origin[i]) / step[i]), 0.0, kSteps));
  }
  Json json = {{"name", name}, {"low", vector_json(origin)}, {"step", vector_json(step)}};
  add_pose(json, X_WC);
  json["size"] = shown.points.size() > 1 ? cloud::spacing(cloud::Tree(shown), 2000).median : 0.01;
  json["points"] = packer.add_reals(steps);
  return json;
}

}  // namespace cotwin::master
