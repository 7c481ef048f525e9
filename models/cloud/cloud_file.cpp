#include "models/cloud/cloud_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/lines.h"

namespace cotwin::cloud {

using Eigen::Vector3d;
using text::Lines;

namespace {

constexpr std::size_t kMostPoints = 200'000'000;
constexpr std::uint64_t kMostBytes = std::uint64_t{8} << 30;
constexpr std::size_t kWidest = 1 << 20;  // bytes a point
constexpr double kFarthest = 1e7;         // m

/// A column of a file.
struct Field {
  std::string name;
  char type = 'F';  // F, I, U as in PCD
  std::size_t size = 4, count = 1;
};

enum class Encoding { kAscii, kBinary, kCompressed };

/// What the header of a PCD or PLY file says.
struct Header {
  std::vector<Field> fields;
  Encoding encoding = Encoding::kAscii;
  std::size_t points = 0;
};

std::string lower_case(std::string_view word) {
  std::string lower(word);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

std::size_t count_of(Lines& lines, std::size_t most) {
  const std::optional<long long> n = text::parse_integer(lines.word());
  if (!n || *n < 0 || static_cast<unsigned long long>(*n) > most)
    lines.fail(lines.line(), "a whole number from 0 to " + std::to_string(most));
  return static_cast<std::size_t>(*n);
}

double number(const char* bytes, char type, std::size_t size) {
  static_assert(std::endian::native == std::endian::little);
  const auto as = [bytes](auto value) {
    std::memcpy(&value, bytes, sizeof value);
    return static_cast<double>(value);
  };
  if (type == 'F') return size == 4 ? as(float{}) : as(double{});
  const bool sign = type == 'I';
  if (size == 1) return sign ? as(std::int8_t{}) : as(std::uint8_t{});
  if (size == 2) return sign ? as(std::int16_t{}) : as(std::uint16_t{});
  if (size == 4) return sign ? as(std::int32_t{}) : as(std::uint32_t{});
  return sign ? as(std::int64_t{}) : as(std::uint64_t{});
}

bool is_number(const Field& field) {
  if (field.count != 1) return false;
  if (field.type == 'F') return field.size == 4 || field.size == 8;
  return (field.type == 'I' || field.type == 'U') && std::has_single_bit(field.size) && field.size <= 8;
}

/// Unpacks LZF (Lehmann, liblzf): runs of bytes, and copies of what came before. False if the result does not have this size.
bool unpack_lzf(std::string_view packed, std::size_t size, std::string& out) {
  const auto byte = [&](std::size_t k) { return static_cast<std::size_t>(static_cast<unsigned char>(packed[k])); };
  for (std::size_t at = 0; at < packed.size();) {
    const std::size_t control = byte(at++);
    if (control < 32) {
      const std::size_t run = control + 1;
      if (run > packed.size() - at || run > size - out.size()) return false;
      out.append(packed.substr(at, run));
      at += run;
      continue;
    }
    std::size_t length = 2 + (control >> 5);
    if (length == 9 && at < packed.size()) length += byte(at++);
    if (at == packed.size()) return false;
    const std::size_t back = ((control & 31) << 8) + byte(at++) + 1;
    if (back > out.size() || length > size - out.size()) return false;
    for (std::size_t i = 0; i < length; ++i) out.push_back(out[out.size() - back]);
  }
  return out.size() == size;
}

/// The numbers of x, y, z among the fields. Others are passed over.
std::array<std::size_t, 3> coordinates(const std::vector<Field>& fields, const std::string& place, CloudFile& file) {
  std::array<std::size_t, 3> found{};
  std::string names;
  for (const Field& field : fields) text::append(names, field.name);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto at = std::ranges::find(fields, std::string(1, static_cast<char>('x' + i)), &Field::name);
    if (at == fields.end())
      throw Error(place, "has " + (names.empty() ? "no columns" : "the columns " + names) + ", expected x, y, z");
    if (!is_number(*at))
      throw Error(place, "column " + at->name + " is " + std::to_string(at->count) + " × type " + at->type + " of " +
                             std::to_string(at->size) + " bytes, expected one number of 1, 2, 4 or 8 bytes");
    found[i] = static_cast<std::size_t>(at - fields.begin());
  }
  for (std::size_t k = 0; k < fields.size(); ++k) {
    if (std::ranges::find(found, k) == found.end() && fields[k].name != "_") file.passed_over.push_back(fields[k].name);
  }
  return found;
}

double coordinate(const Lines& lines, std::string_view word) {
  const std::optional<double> x = text::parse_real(word);
  if (!x) lines.fail(word.empty() ? lines.line() : word, "a coordinate");
  return *x;
}

std::vector<Vector3d> ascii_points(const Header& header, Lines& lines, const std::array<std::size_t, 3>& xyz) {
  std::vector<Vector3d> points;
  points.reserve(std::min(header.points, lines.after().size() / 6 + 1));
  while (points.size() < header.points && lines.next()) {
    if (lines.line().empty()) continue;
    Vector3d p;
    for (std::size_t k = 0; k < header.fields.size(); ++k) {
      for (std::size_t i = 0; i < header.fields[k].count; ++i) {
        const std::string_view word = lines.word();
        const auto axis = std::ranges::find(xyz, k) - xyz.begin();
        if (word.empty()) lines.fail(lines.line(), "a value for each column");
        if (axis < 3) p[axis] = coordinate(lines, word);
      }
    }
    points.push_back(p);
  }
  return points;
}

std::vector<Vector3d> binary_points(const Header& header, const std::string& place, std::string_view& bytes,
                                    const std::array<std::size_t, 3>& xyz) {
  std::size_t width = 0;
  std::vector<std::size_t> offsets;
  for (const Field& field : header.fields) {
    offsets.push_back(width);
    width += field.size * field.count;
    if (width > kWidest) throw Error(place, "has columns of more than " + std::to_string(kWidest) + " bytes a point");
  }
  std::string unpacked;
  std::string_view data = bytes;
  const bool packed = header.encoding == Encoding::kCompressed;
  if (packed) {  // the sizes of what is packed and unpacked, and then column after column
    const auto size_at = [&](std::size_t k) {
      return bytes.size() < 8 ? 0 : static_cast<std::size_t>(number(&bytes[k], 'U', 4));
    };
    const std::size_t size = size_at(0), full = width * header.points;
    if (bytes.size() < 8 || size > bytes.size() - 8) throw Error(place, "ends within its packed points");
    if (size_at(4) != full || !unpack_lzf(bytes.substr(8, size), full, unpacked))
      throw Error(place, "has packed points that are not the " + std::to_string(full) + " bytes of " +
                             text::counted(static_cast<std::int64_t>(header.points), "point"));
    data = unpacked;
    bytes.remove_prefix(8 + size);
  } else {
    bytes.remove_prefix(std::min(bytes.size(), width * header.points));
  }
  std::vector<Vector3d> points(std::min(header.points, data.size() / width));
  for (std::size_t i = 0; i < 3; ++i) {
    const Field& field = header.fields[xyz[i]];
    std::size_t at = packed ? offsets[xyz[i]] * header.points : offsets[xyz[i]];
    for (Vector3d& p : points) {
      p[static_cast<Eigen::Index>(i)] = number(&data[at], field.type, field.size);
      at += packed ? field.size : width;
    }
  }
  return points;
}

/// Returns what is after the points.
std::string_view read_points(const Header& header, Lines& lines, CloudFile& file, std::vector<Vector3d>& points) {
  const std::array<std::size_t, 3> xyz = coordinates(header.fields, lines.place(), file);
  std::string_view after = lines.after();
  const bool ascii = header.encoding == Encoding::kAscii;
  points = ascii ? ascii_points(header, lines, xyz) : binary_points(header, lines.place(), after, xyz);
  if (points.size() < header.points)
    throw Error(lines.place(),
                "ends after " + std::to_string(points.size()) + " of " + std::to_string(header.points) + " points");
  return ascii ? text::trim(lines.after()) : after;
}

std::vector<Vector3d> read_pcd(std::string_view bytes, const std::string& place, CloudFile& file) {
  Header header;
  Lines lines(bytes, place);
  std::optional<std::size_t> points, width, height;
  std::string encoding;
  while (encoding.empty() && lines.next()) {
    const std::string_view keyword = lines.word();
    if (keyword.empty() || keyword.front() == '#' || keyword == "VERSION") continue;
    if (keyword == "FIELDS") {
      for (std::string_view name = lines.word(); !name.empty(); name = lines.word())
        header.fields.push_back({std::string(name)});
    } else if (keyword == "SIZE") {
      for (Field& field : header.fields) field.size = count_of(lines, 8);
    } else if (keyword == "COUNT") {
      for (Field& field : header.fields) field.count = count_of(lines, 1 << 16);
    } else if (keyword == "TYPE") {
      for (Field& field : header.fields) field.type = (std::string(lines.word()) + ' ').front();
    } else if (keyword == "WIDTH" || keyword == "HEIGHT" || keyword == "POINTS") {
      (keyword == "WIDTH" ? width : keyword == "HEIGHT" ? height : points) = count_of(lines, kMostPoints);
    } else if (keyword == "VIEWPOINT") {
      for (const double x : {0, 0, 0, 1, 0, 0, 0}) {
        if (text::parse_real(lines.word()) == x) continue;
        file.remarks.push_back("the points are taken as they are, whatever the viewpoint of the scanner is (" +
                               std::string(lines.line()) + ")");
        break;
      }
    } else if (keyword == "DATA") {
      encoding = lines.word();
      if (encoding != "ascii" && encoding != "binary" && encoding != "binary_compressed")
        lines.fail(lines.line(), "DATA ascii, binary or binary_compressed");
    } else {
      lines.fail(lines.line(), "a line of the header of a PCD file");
    }
  }
  header.encoding = encoding == "ascii" ? Encoding::kAscii : encoding == "binary" ? Encoding::kBinary : Encoding::kCompressed;
  const std::size_t product = width.value_or(points.value_or(0)) * height.value_or(1);
  header.points = points.value_or(product);
  if (header.points != product)
    throw Error(place,
                "says POINTS " + std::to_string(header.points) + ", expected WIDTH × HEIGHT, " + std::to_string(product));
  std::vector<Vector3d> all;
  const std::string_view after = read_points(header, lines, file, all);
  if (!after.empty())
    file.remarks.push_back(text::counted(std::ssize(after), "byte") + " after the " + std::to_string(header.points) +
                           " points that the header counts are passed over");
  return all;
}

std::vector<Vector3d> read_ply(std::string_view bytes, const std::string& place, CloudFile& file) {
  static const std::map<std::string_view, std::string_view> kTypes{
      {"char", "I1"},  {"uchar", "U1"},  {"short", "I2"},   {"ushort", "U2"}, {"int", "I4"},   {"uint", "U4"},
      {"float", "F4"}, {"double", "F8"}, {"int8", "I1"},    {"uint8", "U1"},  {"int16", "I2"}, {"uint16", "U2"},
      {"int32", "I4"}, {"uint32", "U4"}, {"float32", "F4"}, {"float64", "F8"}};
  Lines lines(bytes, place);
  if (!lines.next() || lines.line() != "ply") throw Error(place, "does not begin with 'ply'");
  Header header;
  std::size_t elements = 0;
  bool ended = false;
  while (!ended && lines.next()) {
    const std::string_view keyword = lines.word();
    if (keyword == "format") {
      const std::string_view encoding = lines.word();
      if (encoding != "ascii" && encoding != "binary_little_endian")
        lines.fail(lines.line(), "format ascii or binary_little_endian");
      header.encoding = encoding == "ascii" ? Encoding::kAscii : Encoding::kBinary;
    } else if (keyword == "element") {
      if (++elements > 1) continue;
      if (lines.word() != "vertex") lines.fail(lines.line(), "element vertex as the first one");
      header.points = count_of(lines, kMostPoints);
    } else if (keyword == "property") {
      if (elements != 1) continue;
      const auto type = kTypes.find(lines.word());
      if (type == kTypes.end()) lines.fail(lines.line(), "a number such as 'property float x'");
      header.fields.push_back({std::string(lines.word()), type->second[0], static_cast<std::size_t>(type->second[1] - '0')});
    } else if (keyword == "end_header") {
      ended = true;
    } else if (!keyword.empty() && keyword != "comment" && keyword != "obj_info") {
      lines.fail(lines.line(), "a line of the header of a PLY file");
    }
  }
  if (!ended) throw Error(place, "ends in its header, expected end_header");
  std::vector<Vector3d> points;
  read_points(header, lines, file, points);
  return points;
}

/// The cells of a line, between semicolons, commas or blanks, whichever it has first in this order.
void split_cells(Lines& lines, std::vector<std::string_view>& cells) {
  for (const char separator : {';', ','}) {
    if (lines.line().find(separator) == std::string_view::npos) continue;
    cells = text::split(lines.line(), separator);
    return;
  }
  cells.clear();
  for (std::string_view word = lines.word(); !word.empty(); word = lines.word()) cells.push_back(word);
}

/// The first line may name the columns, or be the number of points.
std::vector<Vector3d> read_text(std::string_view bytes, const std::string& place, CloudFile& file) {
  Lines lines(bytes, place);
  std::vector<Vector3d> points;
  std::array<std::size_t, 3> xyz{0, 1, 2};
  std::vector<std::string_view> cells;
  bool begun = false;
  while (lines.next()) {
    const bool comment = lines.line().starts_with('#') || lines.line().starts_with("//");
    if (lines.line().empty() || (comment && begun)) continue;
    split_cells(lines, cells);
    if (!begun && (comment || !text::parse_real(cells[0]))) {
      std::vector<Field> fields;
      for (const std::string_view cell : cells) {
        std::string name = lower_case(cell);
        std::erase_if(name, [](unsigned char c) { return std::isalnum(c) == 0 && c != '_'; });
        if (!name.empty()) fields.push_back({name});
      }
      begun = std::ranges::find(fields, "x", &Field::name) != fields.end();
      if (begun) xyz = coordinates(fields, place, file);
      if (!begun && !comment) lines.fail(lines.line(), "three numbers, or the names of columns x, y, z");
      continue;
    }
    if (!begun && cells.size() == 1) {
      begun = true;
      continue;
    }
    begun = true;
    if (points.size() == kMostPoints) lines.fail(lines.line(), "at most " + std::to_string(kMostPoints) + " points");
    Vector3d p;
    for (Eigen::Index i = 0; i < 3; ++i) {
      const std::size_t k = xyz[static_cast<std::size_t>(i)];
      p[i] = coordinate(lines, k < cells.size() ? cells[k] : std::string_view());
    }
    points.push_back(p);
  }
  return points;
}

std::optional<Format> known_format(const std::filesystem::path& file) {
  const std::string ending = lower_case(file.extension().string());
  if (ending == ".pcd") return Format::kPcd;
  if (ending == ".ply") return Format::kPly;
  for (const std::string_view text : {".xyz", ".csv", ".txt", ".asc", ".pts"}) {
    if (ending == text) return Format::kText;
  }
  return std::nullopt;
}

}  // namespace

bool is_cloud(const std::filesystem::path& file) { return known_format(file).has_value(); }

Format format_of(const std::filesystem::path& file) {
  if (const std::optional<Format> known = known_format(file)) return *known;
  throw Error(file.string(), "unknown format of a point cloud, expected .pcd, .ply, .xyz, .csv, .txt, .asc or .pts");
}

CloudFile load_cloud(const std::filesystem::path& file, double unit) {
  const Format format = format_of(file);
  return parse_cloud(text::read_file(file, "a point cloud", kMostBytes), format, file.string(), unit);
}

CloudFile parse_cloud(std::string_view bytes, Format format, const std::string& place, double unit) {
  CloudFile file;
  std::vector<Vector3d> points = format == Format::kPcd   ? read_pcd(bytes, place, file)
                                 : format == Format::kPly ? read_ply(bytes, place, file)
                                                          : read_text(bytes, place, file);
  if (points.empty()) throw Error(place, "0 points, expected at least 1");
  file.not_finite = std::erase_if(points, [](const Vector3d& p) { return !p.allFinite(); });
  if (points.empty())
    throw Error(place, text::counted(static_cast<std::int64_t>(file.not_finite), "point") + ", none with finite coordinates");
  for (Vector3d& p : points) {
    p *= unit;
    if (!(p.cwiseAbs().maxCoeff() <= kFarthest))
      throw Error(place, "a point is at (" + text::joined(std::array{p.x(), p.y(), p.z()}) +
                             ") m, expected coordinates up to " + text::to_text(kFarthest) + " m");
  }
  file.cloud = make_cloud(points);
  file.doubles = points.size() - file.cloud.points.size();
  return file;
}

void write_cloud(std::ostream& out, const Cloud& cloud, Format format) {
  const bool single = cloud.origin.isZero(0);
  const std::string count = std::to_string(cloud.points.size());
  if (format == Format::kPcd) {
    const std::string sizes = single ? "4 4 4" : "8 8 8";
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE " << sizes
        << "\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count
        << "\nDATA binary\n";
  } else if (format == Format::kPly) {
    out << "ply\nformat binary_little_endian 1.0\nelement vertex " << count << '\n';
    for (const char axis : {'x', 'y', 'z'}) out << "property " << (single ? "float " : "double ") << axis << '\n';
    out << "end_header\n";
  }
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    const Vector3d p = cloud.point(k);
    if (format == Format::kText) {
      out << text::joined(std::array{p.x(), p.y(), p.z()}) << '\n';
    } else if (single) {
      out.write(reinterpret_cast<const char*>(cloud.points[k].data()), 3 * sizeof(float));
    } else {
      out.write(reinterpret_cast<const char*>(p.data()), 3 * sizeof(double));
    }
  }
}

}  // namespace cotwin::cloud
