#pragma once
#include <cstddef>
#include <filesystem>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "models/cloud/cloud.h"

/// Files of points: PCD 0.7 (Point Cloud Library; ascii, binary, binary_compressed), PLY 1.0 (ascii, binary_little_endian), and text with three numbers
/// a line (XYZ) or columns x, y, z (CSV). Further columns, faces, colours and normals are passed over.
namespace cotwin::cloud {

enum class Format { kPcd, kPly, kText };

/// By the ending of a name: .pcd, .ply; .xyz, .csv, .txt, .asc, .pts. Throws Error for others.
Format format_of(const std::filesystem::path& file);

/// Whether a name has one of these endings.
bool is_cloud(const std::filesystem::path& file);

struct CloudFile {
  Cloud cloud;                                // at least one point
  std::size_t not_finite = 0, doubles = 0;    // points that were dropped
  std::vector<std::string> passed_over = {};  // names of columns
  std::vector<std::string> remarks = {};
};

/// `unit`: of the coordinates, m. Throws Error for what is not in these formats, for fewer points than the file says, for none whose coordinates are
/// finite, and for points farther than 1e7 m from 0.
CloudFile load_cloud(const std::filesystem::path& file, double unit = 1);
/// As load_cloud() from the bytes of a file; `place` is its name in messages.
CloudFile parse_cloud(std::string_view bytes, Format format, const std::string& place, double unit = 1);

/// Writes x, y, z in m: PCD and PLY binary, in single precision where that is exact, otherwise in double; text with the shortest numbers.
void write_cloud(std::ostream& out, const Cloud& cloud, Format format);

}  // namespace cotwin::cloud
