// Files of clouds, byte by byte and damaged; the tree, against brute force.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "models/cloud/cloud_file.h"
#include "models/cloud/sample.h"
#include "models/cloud/tree.h"
#include "models/mechanics/pose.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::cloud::cloud_test {
namespace {

using cotwin::testing::error_of;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// A column of a file, and its values.
struct Column {
  std::string name;
  char type;  // as in PCD
  int size;
  std::vector<double> values;
};

std::string bytes_of(const Column& column, double value) {
  const auto as = [](auto x) { return std::string(reinterpret_cast<const char*>(&x), sizeof x); };
  if (column.type == 'F') return column.size == 4 ? as(static_cast<float>(value)) : as(value);
  if (column.size == 1) return as(static_cast<std::uint8_t>(value));
  if (column.size == 2) return as(static_cast<std::int16_t>(value));
  if (column.size == 4) return as(static_cast<std::int32_t>(value));
  return as(static_cast<std::int64_t>(value));
}

std::string number_of(double value) {
  return std::isnan(value) ? "nan" : (std::ostringstream() << std::scientific << value).str();
}

std::string rows_of(const std::vector<Column>& columns, bool ascii) {
  std::string rows;
  for (std::size_t k = 0; k < columns[0].values.size(); ++k) {
    for (const Column& column : columns)
      rows += ascii ? number_of(column.values[k]) + (&column == &columns.back() ? "\r\n" : "  ")
                    : bytes_of(column, column.values[k]);
  }
  return rows;
}

std::string word(std::size_t bytes) {
  const auto n = static_cast<std::uint32_t>(bytes);
  return {reinterpret_cast<const char*>(&n), sizeof n};
}

/// The columns one after the other, packed as runs of at most 32 bytes, with a copy where a byte repeats often.
std::string packed(const std::vector<Column>& columns) {
  std::string all, out;
  for (const Column& column : columns) {
    for (const double value : column.values) all += bytes_of(column, value);
  }
  for (std::size_t at = 0; at < all.size();) {
    std::size_t same = 1;
    while (at > 0 && at + same < all.size() && same < 264 && all[at + same] == all[at - 1] && all[at] == all[at - 1]) ++same;
    if (same >= 3) {
      const std::size_t length = same - 2;
      out += static_cast<char>(std::min<std::size_t>(length, 7) << 5);
      if (length >= 7) out += static_cast<char>(length - 7);
      out += '\0';
      at += same;
    } else {
      out += '\0';
      out += all[at++];
    }
  }
  return word(out.size()) + word(all.size()) + out;
}

std::string pcd(const std::vector<Column>& columns, const std::string& data, const std::string& viewpoint = "0 0 0 1 0 0 0") {
  std::string fields, sizes, types, counts;
  for (const Column& column : columns) {
    fields += " " + column.name;
    sizes += " " + std::to_string(column.size);
    types += std::string(" ") + column.type;
    counts += " 1";
  }
  const std::string n = std::to_string(columns[0].values.size());
  return "# .PCD v.7\nVERSION .7\nFIELDS" + fields + "\nSIZE" + sizes + "\nTYPE" + types + "\nCOUNT" + counts + "\nWIDTH " + n +
         "\nHEIGHT 1\nVIEWPOINT " + viewpoint + "\nPOINTS " + n + "\nDATA " + data + "\n" +
         (data == "binary_compressed" ? packed(columns) : rows_of(columns, data == "ascii"));
}

std::string ply(const std::vector<Column>& columns, const std::string& format, const std::string& after = "") {
  std::string header =
      "ply\nformat " + format + " 1.0\ncomment made\nelement vertex " + std::to_string(columns[0].values.size()) + "\n";
  for (const Column& column : columns) {
    const std::string type = column.type == 'F' ? (column.size == 4 ? "float" : "float64")
                             : column.size == 1 ? "uchar"
                             : column.size == 2 ? "int16"
                                                : "int";
    header += "property " + type + " " + column.name + "\n";
  }
  return header + "element face 1\nproperty list uchar int vertex_index\nend_header\n" + rows_of(columns, format == "ascii") +
         after;
}

std::vector<Column> some_columns() {
  return {{"intensity", 'F', 4, {1, 2, 3, 4, 5}},
          {"z", 'F', 8, {0.125, 3, kNan, 0.125, 1e-3}},
          {"x", 'F', 4, {-1.5, 2, 7, -1.5, 0}},
          {"rgb", 'U', 1, {255, 0, 7, 9, 0}},
          {"y", 'I', 2, {4, -300, 1, 4, 0}}};
}

void expect_some_points(const CloudFile& file) {
  ASSERT_EQ(file.cloud.points.size(), 3u);
  EXPECT_EQ(file.cloud.point(0), Vector3d(-1.5, 4, 0.125));
  EXPECT_EQ(file.cloud.point(1), Vector3d(2, -300, 3));
  EXPECT_EQ(file.cloud.point(2), Vector3d(0, 0, static_cast<double>(1e-3F)));
  EXPECT_EQ(file.not_finite, 1u);
  EXPECT_EQ(file.doubles, 1u);
  EXPECT_THAT(file.passed_over, ElementsAre("intensity", "rgb"));
}

TEST(CloudFiles, HaveTheirPointsInEachFormat) {
  for (const std::string data : {"ascii", "binary", "binary_compressed"}) {
    SCOPED_TRACE(data);
    const CloudFile file = parse_cloud(pcd(some_columns(), data), Format::kPcd, "a.pcd");
    expect_some_points(file);
    EXPECT_TRUE(file.remarks.empty());
  }
  for (const std::string format : {"ascii", "binary_little_endian"})
    expect_some_points(parse_cloud(ply(some_columns(), format, "3 0 1 2\n"), Format::kPly, "a.ply"));
  for (const std::string separator : {",", ";", "\t", " ", ", "}) {
    std::string table;
    for (const Column& column : some_columns()) table += (table.empty() ? "# " : separator) + column.name;
    for (std::size_t k = 0; k < 5; ++k) {
      table += "\n";
      for (const Column& column : some_columns())
        table += (column.name == "intensity" ? "" : separator) + number_of(column.values[k]);
    }
    expect_some_points(parse_cloud(table + "\n\n# end", Format::kText, "a.csv"));
  }
  // Without names: three numbers a line, and what else there is.
  for (const std::string text :
       {"-1.5 4 0.125 9\n2 -300 3 9\n0 0 1e-3 9", "\xEF\xBB\xBF// scan\n3\n-1.5\t4\t0.125\r\n2\t-300\t3\r\n0\t0\t1e-3"}) {
    const CloudFile file = parse_cloud(text, Format::kText, "a.xyz", 0.001);
    ASSERT_EQ(file.cloud.points.size(), 3u);
    EXPECT_LT((file.cloud.point(1) - Vector3d(0.002, -0.3, 0.003)).norm(), 3e-8);
  }
}

TEST(CloudFiles, AreWrittenAsTheyAreRead) {
  std::mt19937_64 engine(3);
  std::uniform_real_distribution<double> real(-2, 3);
  for (const Vector3d& far : {Vector3d(0, 0, 0), Vector3d(1e6, -512345.25, 99)}) {
    std::vector<Vector3d> points;
    for (int k = 0; k < 500; ++k) points.push_back(far + Vector3d(real(engine), real(engine), real(engine)));
    const Cloud cloud = make_cloud(points);
    for (std::size_t k = 0; k < points.size(); ++k) EXPECT_LT((cloud.point(k) - points[k]).norm(), 3e-7);
    for (const Format format : {Format::kPcd, Format::kPly, Format::kText}) {
      std::stringstream out;
      write_cloud(out, cloud, format);
      const CloudFile back = parse_cloud(out.str(), format, "back");
      EXPECT_EQ(back.cloud.points, cloud.points);
      EXPECT_EQ(back.cloud.origin, cloud.origin);
      EXPECT_TRUE(back.remarks.empty() && back.passed_over.empty());
    }
  }
}

std::string error_in(const std::string& bytes, Format format) {
  return error_of([&] { (void)parse_cloud(bytes, format, "a.file"); });
}

TEST(CloudFiles, ThatAreDamagedNameThePlace) {
  const std::string binary = pcd(some_columns(), "binary"), compressed = pcd(some_columns(), "binary_compressed");
  EXPECT_EQ(error_in(binary.substr(0, binary.size() - 1), Format::kPcd), "a.file: ends after 4 of 5 points");
  EXPECT_EQ(error_in(compressed.substr(0, compressed.size() - 1), Format::kPcd), "a.file: ends within its packed points");
  const auto replaced = [](std::string in, const std::string& from, const std::string& to) {
    return in.replace(in.find(from), from.size(), to);
  };
  EXPECT_THAT(error_in(replaced(compressed, "POINTS 5", "POINTS 4"), Format::kPcd),
              HasSubstr("POINTS 4, expected WIDTH × HEIGHT, 5"));
  EXPECT_THAT(error_in(replaced(replaced(compressed, "POINTS 5", "POINTS 4"), "WIDTH 5", "WIDTH 4"), Format::kPcd),
              HasSubstr("not the 76 bytes of 4 points"));
  EXPECT_THAT(error_in(replaced(binary, "SIZE 4", "SIZE x"), Format::kPcd),
              HasSubstr("a.file:4: 'SIZE x 8 4 1 2', expected a whole"));
  EXPECT_THAT(error_in(replaced(binary, " z", " h"), Format::kPcd),
              HasSubstr("has the columns intensity, h, x, rgb, y, expected x, y, z"));
  EXPECT_THAT(error_in(replaced(binary, "TYPE F F", "TYPE F I"), Format::kPcd),
              HasSubstr("expected coordinates up to 1e+07 m"));
  EXPECT_THAT(error_in(replaced(binary, "TYPE F F", "TYPE F X"), Format::kPcd), HasSubstr("column z is 1 × type X of 8 bytes"));
  EXPECT_THAT(error_in(replaced(binary, "DATA binary", "DATA bin"), Format::kPcd), HasSubstr("expected DATA ascii, binary or"));
  EXPECT_THAT(error_in(replaced(binary, "VERSION", "WARSION"), Format::kPcd), HasSubstr("a.file:2: "));
  EXPECT_THAT(error_in("", Format::kPcd), HasSubstr("has no columns"));
  EXPECT_THAT(error_in(pcd({{"x", 'F', 4, {}}, {"y", 'F', 4, {}}, {"z", 'F', 4, {}}}, "binary"), Format::kPcd),
              HasSubstr("0 points"));
  EXPECT_THAT(error_in(ply(some_columns(), "binary_big_endian"), Format::kPly),
              HasSubstr("expected format ascii or binary_little_endian"));
  EXPECT_THAT(error_in(ply(some_columns(), "ascii").substr(0, 51), Format::kPly), HasSubstr("expected end_header"));
  EXPECT_THAT(error_in("solid", Format::kPly), HasSubstr("does not begin with 'ply'"));
  EXPECT_EQ(error_in("1 2 3\n4 5", Format::kText), "a.file:2: '4 5', expected a coordinate");
  EXPECT_THAT(error_in("1,5;2,5;3,5", Format::kText), HasSubstr("a.file:1: '1,5"));
  EXPECT_THAT(error_in("1,5 2,5 3,5", Format::kText), HasSubstr("a.file:1: '5 2"));
  EXPECT_THAT(error_in("q1 q2\n1 2", Format::kText), HasSubstr("the names of columns x, y, z"));
  EXPECT_THAT(error_in("x y\n1 2", Format::kText), HasSubstr("has the columns x, y, expected x, y, z"));
  EXPECT_THAT(error_in("nan nan nan\ninf 0 0", Format::kText), HasSubstr("2 points, none with finite coordinates"));
  EXPECT_THAT(error_in("1e8 0 0", Format::kText), HasSubstr("expected coordinates up to 1e+07 m"));
  EXPECT_THAT(error_in(std::string("\xFF\xFE\0", 3), Format::kText), HasSubstr("UTF-16"));
  EXPECT_THAT(error_of([] { (void)format_of("a.las"); }), HasSubstr("a.las: unknown format of a point cloud"));
  // What can be read all the same is told.
  EXPECT_THAT(parse_cloud(binary + "  ", Format::kPcd, "").remarks, ElementsAre(HasSubstr("2 bytes after the 5 points")));
  EXPECT_THAT(parse_cloud(pcd(some_columns(), "ascii", "0 0 1 1 0 0 0"), Format::kPcd, "").remarks,
              ElementsAre(HasSubstr("VIEWPOINT 0 0 1")));
}

std::vector<Vector3d> random_points(std::size_t n, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> real;
  std::vector<Vector3d> points;
  for (std::size_t k = 0; k < n; ++k) points.emplace_back(real(engine), 0.3 * real(engine), k % 3 == 0 ? 0.0 : real(engine));
  return points;
}

// Every number of leaves and of points in the last one, also equal coordinates.
TEST(Tree, HoldsEachPointOnceInTheBoxesAboveIt) {
  for (std::size_t n = 1; n < 200; ++n) {
    const Tree tree(make_cloud(random_points(n, static_cast<unsigned>(n))));
    std::vector<int> seen(n, 0);
    std::size_t deepest = 0;
    const auto visit = [&](auto&& self, std::int32_t at, std::size_t depth, std::vector<Tree::Node> above) -> void {
      const Tree::Node node = tree.node(at);
      above.push_back(node);
      if (node.left >= 0) {
        self(self, node.left, depth + 1, above);
        self(self, node.right, depth + 1, above);
        return;
      }
      deepest = std::max(deepest, depth);
      EXPECT_LT(node.first, node.last);
      EXPECT_LE(node.last - node.first, 8u);
      for (std::uint32_t k = node.first; k < node.last; ++k) {
        ++seen[k];
        const Vector3d p = tree.cloud().points[k].cast<double>();
        for (const Tree::Node& box : above) EXPECT_TRUE(((p - box.middle).cwiseAbs() - box.half).maxCoeff() <= 1e-12);
        const Tree::Node own = tree.node(tree.nodes() + static_cast<std::int32_t>(k));
        EXPECT_EQ(own.middle, p);
        EXPECT_EQ(own.first, k);
      }
    };
    visit(visit, 0, 0, {});
    EXPECT_EQ(seen, std::vector<int>(n, 1));
    EXPECT_EQ(deepest, tree.depth());
  }
}

TEST(Tree, KnowsTheSpacing) {
  const std::vector<Vector3d> points = random_points(2000, 5);
  const Tree tree(make_cloud(points));
  std::vector<double> gaps;
  for (std::size_t k = 0; k < points.size(); ++k) {
    double least = 1e9;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (i != k) least = std::min(least, (tree.cloud().point(i) - tree.cloud().point(k)).norm());
    }
    ASSERT_EQ(tree.to_next(k), least);
    gaps.push_back(least);
  }
  std::ranges::sort(gaps);
  const Spacing all = spacing(tree), some = spacing(tree, 500);
  EXPECT_EQ(all.largest, gaps.back());
  EXPECT_EQ(all.median, gaps[999]);
  EXPECT_EQ(all.most, gaps[1899]);
  EXPECT_NEAR(some.median, all.median, 0.2 * all.median);
  EXPECT_TRUE(std::isinf(spacing(Tree(make_cloud(std::vector{Vector3d(1, 2, 3)}))).median));
}

// The share of points and the mean of their coordinates are those of the areas; the deviation is that of the normal distribution.
TEST(Clouds, OfScenesAreEvenlyOnTheirSurfaces) {
  const auto shape = [](scene::ShapeType type, const Vector3d& size) {
    scene::Shape s;
    s.type = type;
    s.size = size;
    return s;
  };
  constexpr double kPi = 3.14159265358979323846, r = 0.3, l = 0.7;
  scene::Shape triangle = shape(scene::ShapeType::kTriangle, {0.1, 0, 0}),
               hull = shape(scene::ShapeType::kHull, Vector3d::Zero());
  triangle.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}};
  hull.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  struct Case {
    scene::Shape shape;
    double area, z2;  // m²; the mean of z²
    std::function<double(const Vector3d&)> off;
  };
  const double cap = 2 * kPi * r * r;
  const auto from_axis = [](const Vector3d& p) { return std::hypot(p.x(), p.y()); };
  const std::vector<Case> cases{
      {shape(scene::ShapeType::kSphere, {r, 0, 0}), 4 * kPi * r * r, r * r / 3, [](const Vector3d& p) { return p.norm() - r; }},
      {shape(scene::ShapeType::kCylinder, {r, l, 0}), 2 * kPi * r * l + cap,
       (2 * kPi * r * l * l * l / 12 + cap * l * l / 4) / (2 * kPi * r * l + cap),
       [&](const Vector3d& p) { return std::max(from_axis(p) - r, std::abs(p.z()) - l / 2); }},
      {shape(scene::ShapeType::kCapsule, {r, l, 0}), 2 * kPi * r * l + 2 * cap,
       (2 * kPi * r * l * l * l / 12 + 2 * cap * (l * l / 4 + l * r / 2 + r * r / 3)) / (2 * kPi * r * l + 2 * cap),
       [](const Vector3d& p) { return (p - Vector3d(0, 0, std::clamp(p.z(), -l / 2, l / 2))).norm() - r; }},
      {shape(scene::ShapeType::kBox, {0.2, 0.4, 0.6}), 2 * (0.08 + 0.12 + 0.24), (0.16 * 0.09 + 0.72 * 0.03) / 0.88,
       [](const Vector3d& p) { return (p.cwiseAbs() - Vector3d(0.1, 0.2, 0.3)).maxCoeff(); }},
      {shape(scene::ShapeType::kEllipsoid, {r, r, r}), 4 * kPi * r * r, r * r / 3,
       [](const Vector3d& p) { return p.norm() - r; }},
      {triangle, 1, 0,
       [](const Vector3d& p) {
         return std::max({std::abs(p.z()), -p.x(), -p.y(), p.x() + p.y() / 2 - 1});
       }},
      {hull, 1.5 + std::sqrt(0.75), (1 + std::sqrt(0.75)) / 6 / (1.5 + std::sqrt(0.75)), [](const Vector3d& p) {
         return std::max({-p.x(), -p.y(), -p.z(), (p.sum() - 1) / std::sqrt(3.0)});
       }}};
  for (const Case& one : cases) {
    SCOPED_TRACE(static_cast<int>(one.shape.type));
    scene::Scene scene;
    scene.bodies.resize(1);
    scene.bodies[0].shapes = {one.shape};
    scene.bodies[0].X_WB = {rotation_from_rpy(1, 2, 3), {4, 5, 6}};
    constexpr double kSpacing = 0.01, kSigma = 0.002;
    std::vector<std::string> left_out;
    const Cloud cloud = sample(scene, {.spacing = kSpacing}, left_out), rough = sample(scene, {kSpacing, kSigma, 3}, left_out);
    EXPECT_NEAR(static_cast<double>(cloud.points.size()), one.area * 1e4, 1 + 1e-3 * one.area * 1e4);
    double z2 = 0, square = 0;
    for (std::size_t k = 0; k < cloud.points.size(); ++k) {
      const Vector3d p = scene.bodies[0].X_WB.inverse() * cloud.point(k);
      EXPECT_NEAR(one.off(p), 0, 1e-6);
      z2 += p.z() * p.z() / static_cast<double>(cloud.points.size());
      square += (rough.point(k) - cloud.point(k)).squaredNorm() / static_cast<double>(cloud.points.size());
    }
    EXPECT_NEAR(z2, one.z2, 0.003);
    EXPECT_NEAR(std::sqrt(square), kSigma, 0.05 * kSigma);
    EXPECT_TRUE(left_out.empty());
    const Spacing gaps = spacing(Tree(cloud));
    EXPECT_GT(gaps.median, 0.5 * kSpacing);
    EXPECT_LT(gaps.largest, 2 * kSpacing);
  }
  scene::Scene plane;
  plane.bodies.resize(1);
  plane.bodies[0].name = "floor";
  plane.bodies[0].shapes = {shape(scene::ShapeType::kPlane, Vector3d::Zero())};
  std::vector<std::string> left_out;
  EXPECT_TRUE(sample(plane, {}, left_out).points.empty());
  EXPECT_THAT(left_out, ElementsAre("floor"));
  scene::Scene ball;
  ball.bodies.resize(1);
  ball.bodies[0].shapes = {shape(scene::ShapeType::kSphere, {1, 0, 0})};
  EXPECT_THAT(error_of([&] { (void)sample(ball, {.spacing = 1e-5}, left_out); }), HasSubstr("more than 1e8 points"));
}

TEST(Clouds, AreThinnedToTheMeansOfCubes) {
  const Cloud cloud = make_cloud(std::vector<Vector3d>{{0.1, 0.2, 0.3}, {0.3, 0.2, 0.1}, {1.5, 0.2, 0.3}, {-0.1, 0.2, 0.3}});
  const Cloud thin = thinned(cloud, 1);
  ASSERT_EQ(thin.points.size(), 3u);
  EXPECT_LT((thin.point(0) - Vector3d(-0.1, 0.2, 0.3)).norm(), 1e-7);
  EXPECT_LT((thin.point(1) - Vector3d(0.2, 0.2, 0.2)).norm(), 1e-7);
  EXPECT_LT((thin.point(2) - Vector3d(1.5, 0.2, 0.3)).norm(), 1e-7);
}

TEST(Clouds, MoveAsTheirFrame) {
  const Pose X{rotation_from_rpy(0.1, -0.7, 2), {1e6, 2, -3}};
  const std::vector<Vector3d> points = random_points(50, 9);
  const Cloud cloud = make_cloud(points), there = moved(cloud, X), back = moved(there, X.inverse());
  EXPECT_FALSE(there.origin.isZero());
  for (std::size_t k = 0; k < points.size(); ++k) {
    EXPECT_LT((there.point(k) - X * cloud.point(k)).norm(), 1e-6);
    EXPECT_LT((back.point(k) - cloud.point(k)).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace cotwin::cloud::cloud_test
