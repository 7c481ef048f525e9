#include "models/scene/mesh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <string>
#include <string_view>

#include "models/scene/hull.h"
#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;

std::string read(const std::filesystem::path& file) {
  constexpr std::size_t kLargest = 500'000'000;  // bytes
  std::ifstream in(file, std::ios::binary);
  std::string bytes;
  std::array<char, 65536> block;
  while (in.read(block.data(), block.size()), in.gcount() > 0) {
    bytes.append(block.data(), static_cast<std::size_t>(in.gcount()));
    if (bytes.size() > kLargest) throw Error(file.string(), "larger than 500 MB, expected a mesh");
  }
  if (!in.is_open() || in.bad()) throw Error(file.string(), "cannot be read");
  return bytes;
}

float little_endian(const std::string& bytes, std::size_t at) {
  std::uint32_t word = 0;
  for (std::size_t i = 4; i-- > 0;) word = word << 8 | static_cast<unsigned char>(bytes[at + i]);
  return std::bit_cast<float>(word);
}

constexpr std::size_t kHeader = 84, kTriangle = 50;  // bytes of binary STL

bool is_binary_stl(const std::string& bytes) {
  if (bytes.size() < kHeader) return false;
  std::size_t count = 0;
  for (std::size_t i = 4; i-- > 0;) count = count << 8 | static_cast<unsigned char>(bytes[80 + i]);
  return bytes.size() == kHeader + kTriangle * count;
}

std::vector<Vector3d> binary_stl(const std::string& bytes) {
  std::vector<Vector3d> points;
  for (std::size_t at = kHeader; at < bytes.size(); at += kTriangle) {
    for (std::size_t corner = 0; corner < 3; ++corner) {  // after the normal
      const std::size_t p = at + 12 + 12 * corner;
      points.emplace_back(little_endian(bytes, p), little_endian(bytes, p + 4), little_endian(bytes, p + 8));
    }
  }
  return points;
}

/// Lines `<keyword> x y z …`: `vertex` in text STL, `v` in OBJ.
std::vector<Vector3d> lines(std::string_view bytes, std::string_view keyword, const std::string& place) {
  std::vector<Vector3d> points;
  std::size_t number = 0;
  for (const std::string_view line : text::split(bytes, '\n')) {
    ++number;
    std::vector<std::string_view> words;
    for (const std::string_view word : text::split(text::trim(line), ' ')) {
      if (const std::string_view bare = text::trim(word); !bare.empty()) words.push_back(bare);
    }
    if (words.empty() || words[0] != keyword) continue;
    if (words.size() < 4)
      throw Error(place + ":" + std::to_string(number), "'" + std::string(text::trim(line)) + "', expected three coordinates");
    Vector3d p;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::optional<double> x = text::parse_real(words[i + 1]);
      if (!x) throw Error(place + ":" + std::to_string(number), "'" + std::string(words[i + 1]) + "', expected a coordinate");
      p[static_cast<Eigen::Index>(i)] = *x;
    }
    points.push_back(p);
  }
  return points;
}

}  // namespace

std::vector<Vector3d> load_hull(const std::filesystem::path& file, const Vector3d& scale) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension != ".stl" && extension != ".obj") throw Error(file.string(), "a mesh of this kind, expected .stl or .obj");
  const std::string bytes = read(file);
  std::vector<Vector3d> points = extension == ".obj"    ? lines(bytes, "v", file.string())
                                 : is_binary_stl(bytes) ? binary_stl(bytes)
                                                        : lines(bytes, "vertex", file.string());
  for (Vector3d& p : points) p = p.cwiseProduct(scale);
  try {
    return convex_hull(points).vertices;
  } catch (const Error& e) {
    throw Error(file.string(), e.what());
  }
}

}  // namespace cotwin::scene
