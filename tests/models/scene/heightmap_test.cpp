// <heightmap> of SDF: images, their heights and triangles, and what is refused.
#include "models/scene/heightmap.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/scene/png.h"
#include "models/scene/sdf/sdf.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/png.h"

namespace cotwin::scene::heightmap_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::grey_png;
using cotwin::testing::png;
using cotwin::testing::png_chunk;
using cotwin::testing::png_header;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr std::size_t kMost = 1000;  // pixels

std::string terrain(const std::string& inside, bool is_static = true) {
  return std::string("<sdf version='1.6'><world name='w'><model name='m'><static>") + (is_static ? "true" : "false") +
         "</static><link name='l'><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
         "<visual name='v'><geometry><heightmap><uri>none.png</uri></heightmap></geometry></visual>"
         "<collision name='c'><geometry><heightmap>" +
         inside + "</heightmap></geometry></collision></link></model></world></sdf>";
}

/// Height of the triangles at (x, y) in the body's frame; NaN where there is none.
double height(const Shape& ground, double x, double y) {
  for (std::size_t number = 0; number < ground.heights->triangles(); ++number) {
    const HeightField::Triangle t = ground.heights->triangle(number);
    const Vector3d a = ground.X_BS * t.corners[0], u = t.corners[1] - t.corners[0], v = t.corners[2] - t.corners[0];
    const double det = u.x() * v.y() - u.y() * v.x(), p = x - a.x(), q = y - a.y();
    const double s = (p * v.y() - q * v.x()) / det, r = (u.x() * q - u.y() * p) / det;
    if (s >= -1e-9 && r >= -1e-9 && s + r <= 1 + 1e-9) return a.z() + s * u.z() + r * v.z();
  }
  return std::nan("");
}

TEST(Png, OfEveryDepthAndKindGivesThePixelsAsStored) {
  const std::string grey8("\x00\x80\xFF\x07", 4);
  const auto pixels = [](const std::string& bytes) { return parse_png(bytes, "p", kMost).pixels; };
  EXPECT_THAT(pixels(png(2, 2, 8, 0, grey8)), ElementsAre(0, 128, 255, 7));
  EXPECT_THAT(pixels(png(2, 1, 16, 0, std::string("\x01\x02\xFF\xFE", 4))), ElementsAre(258, 65534));
  EXPECT_THAT(pixels(png(4, 1, 2, 0, std::string("\x1B", 1))), ElementsAre(0, 85, 170, 255));  // 0, 1, 2, 3 of 3
  EXPECT_THAT(pixels(png(2, 1, 8, 4, std::string("\x05\x00\x06\xFF", 4))), ElementsAre(5, 6));
  EXPECT_THAT(pixels(png(2, 1, 8, 2, std::string("\x05\x05\x05\x09\x09\x09", 6))), ElementsAre(5, 9));
  EXPECT_THAT(pixels(png(2, 1, 8, 3, std::string("\x01\x00", 2), png_chunk("PLTE", "aaazzz"))), ElementsAre('z', 'a'));
  // gamma does not change heights
  EXPECT_THAT(pixels(png(2, 2, 8, 0, grey8, png_chunk("gAMA", std::string("\x00\x00\xB1\x8F", 4)))),
              ElementsAre(0, 128, 255, 7));
}

TEST(Png, ThatIsColouredDamagedOrHugeIsAnErrorWithItsFile) {
  const auto error = [](const std::string& bytes) { return error_of([&] { parse_png(bytes, "p.png", kMost); }); };
  EXPECT_EQ(error(png(2, 1, 8, 2, std::string("\x05\x05\x05\x09\x0A\x09", 6))),
            "p.png: the pixel in column 2, row 1 is coloured, expected grey pixels");
  EXPECT_EQ(error("GIF89a"), "p.png: no PNG image, expected a greyscale PNG");
  EXPECT_EQ(error(""), "p.png: no PNG image, expected a greyscale PNG");
  EXPECT_EQ(error(png_header(40000, 40000, 16, 0) + png_chunk("IDAT", "")),
            "p.png: 40000 × 40000 pixels, expected 1000 pixels at most: scale the image down");
  EXPECT_THAT(error(png_header(0, 5, 16, 0)), StartsWith("p.png: damaged: "));
  const std::string whole = grey_png(5, 5, [](auto x, auto y) { return 100 * x + y; });
  for (std::size_t k = 0; k < whole.size(); ++k) {
    EXPECT_THAT(error(whole.substr(0, k)), StartsWith("p.png: ")) << k;
    std::string damaged = whole;
    damaged[k] = static_cast<char>(damaged[k] ^ 0x10);
    EXPECT_THAT(error(damaged), StartsWith("p.png: ")) << k;
  }
}

TEST(Heightmap, HasTheBrightestPixelAtItsSizeAndTheTopRowAtTheLargestY) {
  const TemporaryFolder folder("heightmap");
  folder.write("h.png", grey_png(5, 5, [](auto x, auto y) { return 400 * x + 1000 * (4 - y); }));  // 0 … 5600
  std::vector<std::string> warnings;
  const Scene scene = parse_sdf(terrain("<uri>h.png</uri><size>4 8 1.4</size><pos>10 20 -3</pos><texture/>"),
                                folder.path() / "s.sdf", &warnings);
  EXPECT_THAT(warnings, IsEmpty());
  ASSERT_EQ(scene.bodies[0].shapes.size(), 1u);
  const Shape& ground = scene.bodies[0].shapes[0];
  ASSERT_EQ(ground.heights->triangles(), 32u);
  for (const double x : {-2., -1.3, 0., 0.6, 2.}) {
    for (const double y : {-4., -3.3, 0., 1.7, 4.}) {
      const double value = 400 * (x + 2) + 1000 * (y + 4) / 2;  // a plane, so that interpolation is exact
      EXPECT_NEAR(height(ground, 10 + x, 20 + y), -3 + 1.4 * value / 5600, 1e-12) << x << " " << y;
    }
  }
  EXPECT_TRUE(std::isnan(height(ground, 12.01, 20)));
}

TEST(Heightmap, HasTrianglesThatShareTheirEdges) {
  const GreyImage image = parse_png(grey_png(4, 3, [](auto x, auto y) { return 100 * x * x + 77 * y; }), "a", kMost);
  const Shape ground = heightmap_shape(image, {{3, 2, 1}, {0, 0, 0}, 1});
  const HeightField& field = *ground.heights;
  int borders = 0;
  for (std::size_t number = 0; number < field.triangles(); ++number) {
    const HeightField::Triangle t = field.triangle(number);
    EXPECT_GT((t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]).z(), 0) << number;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d from = t.corners[k], to = t.corners[(k + 1) % 3];
      int neighbours = 0;
      for (std::size_t other = 0; other < field.triangles(); ++other) {
        const HeightField::Triangle o = field.triangle(other);
        for (std::size_t e = 0; e < 3; ++e) {
          if (o.corners[e] != to || o.corners[(e + 1) % 3] != from) continue;
          ++neighbours;
          EXPECT_EQ(o.corners[(e + 2) % 3], t.beyond[k]) << number << " " << k;
        }
      }
      EXPECT_EQ(neighbours, t.border[k] ? 0 : 1) << number << " " << k;
      borders += t.border[k] ? 1 : 0;
    }
  }
  EXPECT_EQ(borders, 2 * (3 + 2));
}

TEST(Heightmap, IsTheSameFromEightAndSixteenBits) {
  const GreyImage eight = parse_png(png(3, 3, 8, 0, std::string("\x00\x10\x20\x05\x30\x40\x50\x20\x00", 9)), "a", kMost);
  GreyImage sixteen = eight;
  sixteen.white = 65535;
  for (std::uint16_t& p : sixteen.pixels) p = static_cast<std::uint16_t>(257 * p);
  const Heightmap map{{2, 3, 4}, {0, 0, 0}, 1};
  const Shape a = heightmap_shape(eight, map), b = heightmap_shape(sixteen, map);
  for (std::size_t column = 0; column <= 2; ++column) {
    for (std::size_t row = 0; row <= 2; ++row)
      EXPECT_LT((a.heights->node(column, row) - b.heights->node(column, row)).norm(), 1e-14);
  }
}

TEST(Heightmap, SamplingDividesTheCellsAndInterpolatesBilinearly) {
  const GreyImage image = parse_png(png(2, 2, 8, 0, std::string("\x00\xFF\x00\x00", 4)), "a", kMost);
  const Shape ground = heightmap_shape(image, {{4, 4, 1}, {0, 0, 0}, 4});
  ASSERT_EQ(ground.heights->triangles(), 32u);
  for (int i = 0; i <= 4; ++i) {
    for (int j = 0; j <= 4; ++j) EXPECT_NEAR(height(ground, i - 2, j - 2), i * j / 16., 1e-12);  // top right is white
  }
}

TEST(Heightmap, OfABlackImageIsFlatAtItsPosition) {
  const Shape ground = heightmap_shape({2, 2, {0, 0, 0, 0}, 255}, {{1, 1, 5}, {0, 0, 2}, 1});
  EXPECT_DOUBLE_EQ(height(ground, 0.1, 0.2), 2);
}

TEST(Heightmap, KnowsWhereItIsLowAndHigh) {
  constexpr int kWidth = 61, kHeight = 39;
  const auto grey = [](int x, int y) { return 500 + (37 * x * x + 91 * y * y + 13 * x * y) % 997; };
  for (const std::size_t sampling : {1, 3}) {
    const Shape ground =
        heightmap_shape(parse_png(grey_png(kWidth, kHeight, grey), "a", 10 * kMost), {{6, 4, 2}, {0, 0, 0}, sampling});
    const HeightField& field = *ground.heights;
    ASSERT_EQ(field.columns(), 60 * sampling);
    double low = 1e9, high = -1e9;
    for (std::size_t row = 0; row < field.rows(); ++row) {
      for (std::size_t column = 0; column < field.columns(); ++column) {
        for (const std::size_t right : {0, 1}) {
          const double z = field.node(column + right, row + 1).z();
          EXPECT_LE(z, field.high_of_tile(column, row));
          EXPECT_GE(z - field.depth(), field.bottom(column, row));
          low = std::min(low, z);
          high = std::max(high, z);
        }
      }
    }
    EXPECT_NEAR(field.high(), high, 1e-12);
    EXPECT_LE(field.low(), low);
  }
}

TEST(Heightmap, IsSharedAndComparedByItsHeights) {
  const auto map = [](int extra) {
    return heightmap_shape(parse_png(grey_png(3, 3, [&](int x, int y) { return x + y + extra; }), "a", kMost),
                           {{1, 1, 1}, {0, 0, 0}, 1});
  };
  const Shape a = map(0), copy = a;
  EXPECT_EQ(copy.heights.field, a.heights.field);
  EXPECT_EQ(a, map(0));
  EXPECT_FALSE(a == map(1));
}

TEST(Heightmap, ThatIsNotASquareOfGazebosSizeIsReadWithAWarning) {
  const TemporaryFolder folder("heightmap");
  const auto flat = [](auto, auto) { return 1; };
  folder.write("a.png", grey_png(5, 3, flat));
  folder.write("b.png", grey_png(7, 7, flat));
  for (const char* file : {"a.png", "b.png"}) {
    std::vector<std::string> warnings;
    parse_sdf(terrain(std::string("<uri>") + file + "</uri>"), folder.path() / "s.sdf", &warnings);
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_THAT(warnings[0], HasSubstr("pixels are read, but Gazebo expects a square with 2^n + 1 pixels on a side"));
  }
}

TEST(Heightmap, ThatCannotBeGroundIsRefusedWithAReason) {
  const TemporaryFolder folder("heightmap");
  const auto flat = [](auto, auto) { return 1; };
  folder.write("h.png", grey_png(5, 5, flat));
  folder.write("row.png", grey_png(5, 1, flat));
  folder.write("large.png", png_header(8193, 8193, 16, 0) + png_chunk("IDAT", ""));
  folder.write("six.png", grey_png(6, 6, flat));
  folder.write("cut.png", grey_png(5, 5, flat).substr(0, 60));
  folder.write("text.png", "a picture");
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "<heightmap> without <uri>"},
      {"<uri>none.png</uri>", "no file 'none.png'"},
      {"<uri>text.png</uri>", "text.png: no PNG image, expected a greyscale PNG"},
      {"<uri>cut.png</uri>", "cut.png: damaged: "},
      {"<uri>row.png</uri>", "row.png: 5 × 1 pixels, expected 2 × 2 at least"},
      {"<uri>large.png</uri>", "large.png: 8193 × 8193 pixels, expected 33554434 pixels at most: scale the image down"},
      {"<uri>six.png</uri><sampling>1024</sampling>",
       "six.png: 6 × 6 pixels at sampling 1024 are 52428800 triangles, expected 33554432 at most (4097 × 4097 pixels)"},
      {"<uri>h.png</uri><sampling>1025</sampling>", "<sampling>: 1025, expected a whole number from 1 to 1024"},
      {"<uri>h.png</uri><sampling>0</sampling>", "<sampling>: 0, expected a whole number from 1 to 1024"},
      {"<uri>h.png</uri><sampling>1.5</sampling>", "<sampling>: 1.5, expected a whole number"},
      {"<uri>h.png</uri><size>1 0 1</size>", "size 1 0 1 m, expected > 0 along x and y"},
      {"<uri>h.png</uri><size>1 1 -1</size>", "size 1 1 -1 m, expected > 0 along x and y, ≥ 0 along z"},
      {"<uri>h.png</uri><size>1 1</size>", "<size> of 2 numbers, expected 3"},
  };
  for (const auto& [inside, message] : cases) {
    const std::string error = error_of([&, heightmap = inside] { parse_sdf(terrain(heightmap), folder.path() / "s.sdf"); });
    EXPECT_THAT(error, HasSubstr(message)) << inside;
    EXPECT_THAT(error, HasSubstr("s.sdf:1: ")) << inside;
  }
  EXPECT_THAT(error_of([&] { parse_sdf(terrain("<uri>h.png</uri>", false), folder.path() / "s.sdf"); }),
              HasSubstr("a <heightmap> on a moving body, expected a static one"));
}

}  // namespace
}  // namespace cotwin::scene::heightmap_test
