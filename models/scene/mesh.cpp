#include "models/scene/mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/lines.h"
#include "models/foundation/support/text.h"
#include "models/scene/collada.h"
#include "models/scene/hull.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;

constexpr std::size_t kMostPoints = 20'000'000;

float little_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t word = 0;
  for (std::size_t i = 4; i-- > 0;) word = word << 8 | static_cast<unsigned char>(bytes[at + i]);
  return std::bit_cast<float>(word);
}

constexpr std::size_t kHeader = 84, kTriangle = 50;  // bytes of binary STL

bool is_binary_stl(std::string_view bytes) {
  if (bytes.size() < kHeader) return false;
  std::size_t count = 0;
  for (std::size_t i = 4; i-- > 0;) count = count << 8 | static_cast<unsigned char>(bytes[80 + i]);
  return bytes.size() == kHeader + kTriangle * count;
}

std::vector<Vector3d> binary_stl(std::string_view bytes) {
  std::vector<Vector3d> points;
  points.reserve((bytes.size() - kHeader) / kTriangle * 3);
  for (std::size_t at = kHeader; at < bytes.size(); at += kTriangle) {
    for (std::size_t corner = 0; corner < 3; ++corner) {  // after the normal
      const std::size_t p = at + 12 + 12 * corner;
      points.emplace_back(little_endian(bytes, p), little_endian(bytes, p + 4), little_endian(bytes, p + 8));
    }
  }
  return points;
}

using text::Lines;

Vector3d point_of(Lines& lines) {
  Vector3d p;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const std::string_view one = lines.word();
    if (one.empty()) lines.fail(lines.line(), "three coordinates");
    const std::optional<double> x = text::parse_real(one);
    if (!x) lines.fail(one, "a coordinate");
    p[i] = *x;
  }
  return p;
}

std::vector<Vector3d> text_stl(std::string_view bytes, const std::string& place) {
  std::vector<Vector3d> points;
  for (Lines lines(bytes, place); lines.next();) {
    if (lines.word() != "vertex") continue;
    if (points.size() == kMostPoints) lines.fail("vertex", "fewer points");
    points.push_back(point_of(lines));
  }
  return points;
}

Mesh obj(std::string_view bytes, const std::string& place) {
  Mesh mesh;
  for (Lines lines(bytes, place); lines.next();) {
    const std::string_view keyword = lines.word();
    if (keyword == "v") {
      if (mesh.vertices.size() == kMostPoints) lines.fail(keyword, "fewer points");
      mesh.vertices.push_back(point_of(lines));
    } else if (keyword == "f") {
      std::array<std::uint32_t, 3> triangle{};
      std::size_t corners = 0;
      for (std::string_view corner = lines.word(); !corner.empty(); corner = lines.word(), ++corners) {
        const auto count = static_cast<long long>(mesh.vertices.size());
        const std::optional<long long> index = text::parse_integer(corner.substr(0, corner.find('/')));
        const long long at = !index ? -1 : *index < 0 ? count + *index : *index - 1;  // negative: counted from the end
        if (at < 0 || at >= count)
          lines.fail(corner, "the number of one of the " + std::to_string(count) + " vertices before it");
        triangle[std::min<std::size_t>(corners, 2)] = static_cast<std::uint32_t>(at);
        if (corners < 2) continue;
        if (mesh.triangles.size() == kMostPoints) lines.fail(keyword, "fewer faces");
        mesh.triangles.push_back(triangle);
        triangle[1] = triangle[2];
      }
      if (corners < 3) lines.fail(lines.line(), "three or more corners");
    }
  }
  return mesh;
}

/// Three points in turn are a triangle.
Mesh of_corners(std::vector<Vector3d> points) {
  Mesh mesh;
  for (std::uint32_t k = 0; k + 2 < points.size(); k += 3) mesh.triangles.push_back({k, k + 1, k + 2});
  mesh.vertices = std::move(points);
  return mesh;
}

/// Makes equal vertices one and drops triangles without area.
void weld(Mesh& mesh) {
  std::map<std::array<double, 3>, std::uint32_t> known;
  std::vector<std::uint32_t> index;
  std::vector<Vector3d> vertices;
  for (const Vector3d& v : mesh.vertices) {
    const auto [found, is_new] = known.emplace(std::array<double, 3>{v.x(), v.y(), v.z()}, vertices.size());
    if (is_new) vertices.push_back(v);
    index.push_back(found->second);
  }
  mesh.vertices = std::move(vertices);
  for (auto& triangle : mesh.triangles) {
    for (std::uint32_t& corner : triangle) corner = index[corner];
  }
  std::erase_if(mesh.triangles, [&](const auto& t) {
    const Vector3d u = mesh.vertices[t[1]] - mesh.vertices[t[0]], v = mesh.vertices[t[2]] - mesh.vertices[t[0]];
    const double longest = std::max({u.norm(), v.norm(), (u - v).norm()});
    constexpr double kFlat = 1e-6;  // height of a triangle relative to its longest edge
    return !(u.cross(v).norm() > kFlat * longest * longest);
  });
}

}  // namespace

Mesh load_mesh(const std::filesystem::path& file, const Vector3d& scale) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension != ".stl" && extension != ".obj" && extension != ".dae")
    throw Error(file.string(), "unknown mesh format, expected .stl, .obj or .dae");
  const std::string bytes = text::read_file(file, "a mesh");
  const MeshFormat format = extension == ".obj"   ? MeshFormat::kObj
                            : extension == ".dae" ? MeshFormat::kCollada
                                                  : MeshFormat::kStl;
  return parse_mesh(bytes, format, file.string(), scale);
}

Mesh parse_mesh(std::string_view bytes, MeshFormat format, const std::string& place, const Vector3d& scale) {
  Mesh mesh = format == MeshFormat::kCollada ? parse_collada(bytes, place)
              : format == MeshFormat::kObj   ? obj(bytes, place)
              : is_binary_stl(bytes)         ? of_corners(binary_stl(bytes))
                                             : of_corners(text_stl(bytes, place));
  for (Vector3d& p : mesh.vertices) {
    p = p.cwiseProduct(scale);
    if (!p.allFinite()) throw Error(place, "a vertex is not finite");
  }
  if (scale.prod() < 0) {  // a mirror image
    for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  }
  if (mesh.vertices.empty()) throw Error(place, "0 points, expected at least 4");
  weld(mesh);
  return mesh;
}

std::vector<Vector3d> load_hull(const std::filesystem::path& file, const Vector3d& scale) {
  const Mesh mesh = load_mesh(file, scale);
  try {
    return convex_hull(mesh.vertices).vertices;
  } catch (const Error& e) {
    throw Error(file.string(), e.what());
  }
}

}  // namespace cotwin::scene
