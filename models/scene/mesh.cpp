#include "models/scene/mesh.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "models/scene/hull.h"
#include "models/support/error.h"
#include "models/support/file.h"
#include "models/support/text.h"

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

/// Lines `<keyword> x y z …`: `vertex` in text STL, `v` in OBJ.
std::vector<Vector3d> lines(std::string_view bytes, std::string_view keyword, const std::string& place) {
  constexpr std::string_view kBlanks = " \t\r";
  if (bytes.starts_with("\xFF\xFE") || bytes.starts_with("\xFE\xFF"))
    throw Error(place, "is UTF-16 text, expected ASCII or UTF-8");
  std::vector<Vector3d> points;
  std::size_t number = 0;
  while (!bytes.empty()) {
    ++number;
    std::string_view line = bytes.substr(0, bytes.find('\n'));
    bytes.remove_prefix(std::min(line.size() + 1, bytes.size()));
    line = text::trim(line);
    std::string_view rest = line;
    const auto next_word = [&] {
      rest.remove_prefix(std::min(rest.find_first_not_of(kBlanks), rest.size()));
      const std::string_view word = rest.substr(0, rest.find_first_of(kBlanks));
      rest.remove_prefix(word.size());
      return word;
    };
    if (next_word() != keyword) continue;
    const auto fail = [&](std::string_view what, const char* expected) {
      throw Error(place + ":" + std::to_string(number), "'" + std::string(what.substr(0, 60)) + "', expected " + expected);
    };
    Vector3d p;
    for (Eigen::Index i = 0; i < 3; ++i) {
      const std::string_view word = next_word();
      if (word.empty()) fail(line, "three coordinates");
      const std::optional<double> x = text::parse_real(word);
      if (!x) fail(word, "a coordinate");
      p[i] = *x;
    }
    if (points.size() == kMostPoints) fail(keyword, "fewer points");
    points.push_back(p);
  }
  return points;
}

}  // namespace

std::vector<Vector3d> load_hull(const std::filesystem::path& file, const Vector3d& scale) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension != ".stl" && extension != ".obj") throw Error(file.string(), "unknown mesh format, expected .stl or .obj");
  const std::string bytes = text::read_file(file, "a mesh");
  return parse_hull(bytes, extension == ".obj" ? MeshFormat::kObj : MeshFormat::kStl, file.string(), scale);
}

std::vector<Vector3d> parse_hull(std::string_view bytes, MeshFormat format, const std::string& place, const Vector3d& scale) {
  std::vector<Vector3d> points = format == MeshFormat::kObj ? lines(bytes, "v", place)
                                 : is_binary_stl(bytes)     ? binary_stl(bytes)
                                                            : lines(bytes, "vertex", place);
  for (Vector3d& p : points) p = p.cwiseProduct(scale);
  try {
    return convex_hull(points).vertices;
  } catch (const Error& e) {
    throw Error(place, e.what());
  }
}

}  // namespace cotwin::scene
