#include "models/scene/collada.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <vector>

#include "models/robot/urdf/urdf.h"
#include "models/scene/hull.h"
#include "models/scene/mesh.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::scene::collada_test {
namespace {

using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using ::testing::HasSubstr;

/// A prism of three quads and two triangles, in inches, in a node that mirrors, turns by 90° about z and shifts, and is instantiated in another.
const std::string kHead =
    R"(<COLLADA><asset><unit name="inch" meter="0.0254"/><up_axis>Y_UP</up_axis></asset><library_geometries>
    <geometry id="g"><mesh><source id="s"><float_array id="a" count="18">0 0 0  1 0 0  0 1 0
      0 0 2  1 0 2  0 1 2</float_array></source><source id="n"><float_array count="3">0 0 1</float_array></source>
      <vertices id="v"><input semantic="POSITION" source="#s"/></vertices>)";
const std::string kInputs =
    R"(<input semantic="NORMAL" source="#n" offset="1"/><input semantic="VERTEX" source="#v" offset="0"/>)";
const std::string kList = "<polylist count=\"3\">" + kInputs +
                          "<vcount>4 4 4</vcount><p>0 0 1 0 4 0 3 0  1 0 2 0 5 0 4 0  2 0 0 0 3 0 5 0</p></polylist>";
const std::string kCaps = "<triangles count=\"1\">" + kInputs + "<p>0 0 2 0 1 0</p></triangles><polygons>" + kInputs +
                          "<p>3 0 4 0 5 0</p></polygons>";
const std::string kNodes = R"(</mesh></geometry></library_geometries><library_nodes><node id="part"><scale>1 -1 1</scale>
    <instance_geometry url="#g"/></node></library_nodes><library_visual_scenes><visual_scene><node><translate>10 0 0</translate>
    <rotate>0 0 1 90</rotate><node><matrix>1 0 0 0  0 1 0 0  0 0 1 1  0 0 0 1</matrix><instance_node url="#part"/></node></node>
    </visual_scene></library_visual_scenes></COLLADA>)";
const std::string kPrism = kHead + kList + kCaps + kNodes;

std::string with(std::string text, const std::string& old, const std::string& other) {
  return text.replace(text.find(old), old.size(), other);
}

TEST(Collada, PlacesPolygonsByTheNodesOfTheScene) {
  const TemporaryFolder folder("collada");
  const Mesh mesh = load_mesh(folder.write("prism.dae", kPrism), {2, 2, 2});
  const double kScale = 2 * 0.0254;
  ASSERT_EQ(mesh.vertices.size(), 6u);  // welded
  ASSERT_EQ(mesh.triangles.size(), 8u);
  // (x, y, z) → (10 + y, x, z + 1), in which y is mirrored before it is turned.
  Vector3d low = mesh.vertices[0], high = low;
  double volume = 0;
  for (const Vector3d& p : mesh.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  EXPECT_TRUE(low.isApprox(kScale * Vector3d(10, 0, 1), 1e-12)) << low.transpose();
  EXPECT_TRUE(high.isApprox(kScale * Vector3d(11, 1, 3), 1e-12)) << high.transpose();
  for (const auto& t : mesh.triangles) volume += mesh.vertices[t[0]].dot(mesh.vertices[t[1]].cross(mesh.vertices[t[2]])) / 6;
  EXPECT_NEAR(volume, 0.5 * 1 * 2 * std::pow(kScale, 3), 1e-12);  // > 0: the triangles are counter-clockwise from outside
  EXPECT_NEAR(convex_hull(load_hull(folder / "prism.dae")).volume(), 1 * std::pow(0.0254, 3), 1e-12);
}

TEST(Collada, TakesTheSceneThatIsShownAndThePointsThatAreUsed) {
  const auto vertices = [](const std::string& xml) { return parse_collada(xml, "x").vertices.size(); };
  EXPECT_EQ(vertices(kHead + "<triangles>" + kInputs + "<p>0 0 1 0 2 0</p></triangles>" + kNodes), 3u);  // of six points
  const std::string two =
      with(kPrism, "<visual_scene>", "<visual_scene id=\"none\"><node/></visual_scene><visual_scene id=\"it\">");
  EXPECT_THAT(error_of([&] { vertices(two); }), HasSubstr("no triangles in the visual scene"));
  EXPECT_EQ(vertices(with(two, "</COLLADA>", "<scene><instance_visual_scene url=\"#it\"/></scene></COLLADA>")),
            vertices(kPrism));
}

TEST(Collada, IsReadAsCollisionMeshOfARobot) {
  const TemporaryFolder folder("collada");
  folder.write("prism.dae", kPrism);
  const auto urdf =
      folder.write("arm.urdf",
                   "<robot name='arm'><link name='base'/><link name='tip'><inertial><mass value='1'/><inertia "
                   "ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial><collision><geometry><mesh "
                   "filename='prism.dae'/></geometry></collision></link><joint name='j' type='continuous'><parent "
                   "link='base'/><child link='tip'/></joint></robot>");
  std::vector<std::string> warnings;
  const auto shapes = shapes_of_urdf(urdf, robot::load_urdf(urdf), &warnings);
  EXPECT_THAT(warnings, ::testing::IsEmpty());
  ASSERT_EQ(shapes.size(), 2u);  // of the base and of the tip
  ASSERT_EQ(shapes[1].size(), 1u);
  EXPECT_EQ(shapes[1][0].type, ShapeType::kHull);
  EXPECT_EQ(shapes[1][0].vertices.size(), 6u);
}

TEST(Collada, NamesPlaceAndFactOfAFault) {
  const TemporaryFolder folder("collada");
  const auto refusal = [&](const std::string& text) { return error_of([&] { load_mesh(folder.write("bad.dae", text)); }); };
  EXPECT_THAT(refusal("<COLLADA>"), HasSubstr("bad.dae:1: not well-formed XML"));
  EXPECT_THAT(refusal("<sdf/>"), HasSubstr("expected a COLLADA file"));
  EXPECT_THAT(refusal("<COLLADA/>"), HasSubstr("no triangles"));
  EXPECT_THAT(refusal(with(kPrism, "2 0 0 0 3 0 5 0", "2 0 0 0 3 0 6 0")), HasSubstr("vertex 6, expected less than 6"));
  EXPECT_THAT(refusal(with(kPrism, "url=\"#g\"", "url=\"#h\"")),
              HasSubstr("url '#h' of <instance_geometry>, expected # and an id of the file"));
  EXPECT_THAT(refusal(with(kPrism, "<instance_geometry", "<instance_node url=\"#part\"/><instance_geometry")),
              HasSubstr("nodes within more than 100 nodes"));
  EXPECT_THAT(refusal(with(kPrism, "<vcount>4 4 4", "<vcount>4 4 5")), HasSubstr("fewer corners than polygons have"));
  for (const char* const metre : {"0", "abc", "0,0254", "1m", "", "inf"})
    EXPECT_THAT(refusal(with(kPrism, "0.0254", metre)),
                HasSubstr("bad.dae:1: <unit meter> is '" + std::string(metre) + "', expected a length > 0"));
  EXPECT_THAT(refusal(with(kPrism, "offset=\"1\"", "offset=\"one\"")),
              HasSubstr("offset 'one' of <input>, expected a whole number"));
  EXPECT_THAT(refusal(with(kPrism, "10 0 0", "10 0")), HasSubstr("<translate> has 2 numbers, expected 3"));
  EXPECT_THAT(refusal(with(kPrism, "<triangles", "<tristrips/><triangles")), HasSubstr("<tristrips>, expected <triangles>"));
  EXPECT_THAT(refusal(with(kPrism, "<translate>", "<instance_controller/><translate>")), HasSubstr("(a skin)"));
  EXPECT_THAT(refusal(with(kPrism, "<translate>", "<skew/><translate>")), HasSubstr("<skew>, expected <matrix>"));
}

TEST(Collada, RefusesWhatItWouldReadOnlyInPart) {
  const auto refusal = [](const std::string& xml) { return error_of([&] { parse_collada(xml, "x"); }); };
  EXPECT_THAT(refusal(with(kPrism, "<p>3 0 4 0 5 0</p>", "<ph><p>3 0 4 0 5 0</p><h>3 0 4 0 5 0</h></ph>")),
              HasSubstr("<ph> (polygons with holes), expected <p>"));
  EXPECT_THAT(refusal(with(kPrism, "<translate>", "<lookat>1 0 0  0 0 0  0 0 1</lookat><translate>")),
              HasSubstr("<lookat>, expected <matrix>"));
  EXPECT_THAT(refusal(with(kPrism, "<geometry id=\"g\">", "<geometry id=\"g\"><convex_mesh convex_hull_of=\"#k\"/>")),
              HasSubstr("<convex_mesh>, expected <mesh>"));
  EXPECT_THAT(refusal(with(kPrism, "<vcount>4 4 4</vcount>", "")), HasSubstr("<polylist> with <p> but without <vcount>"));
  const auto accessed = [](const std::string& accessor) {
    return with(kPrism, "</float_array>", "</float_array><technique_common><accessor " + accessor + "/></technique_common>");
  };
  EXPECT_EQ(refusal(accessed("source=\"#a\" count=\"6\" stride=\"3\"")), "");
  EXPECT_EQ(refusal(accessed("source=\"#a\" stride=\"3\" offset=\"0\"")), "");
  EXPECT_THAT(refusal(accessed("source=\"#a\" stride=\"6\"")), HasSubstr("positions with stride 6 and offset 0, expected"));
  EXPECT_THAT(refusal(accessed("source=\"#a\" stride=\"3\" offset=\"3\"")),
              HasSubstr("stride 3 and offset 3, expected stride 3"));
  EXPECT_THAT(refusal(accessed("source=\"#a\"")), HasSubstr("stride 1 and offset 0"));  // the standard's default
  EXPECT_THAT(refusal(accessed("source=\"#a\" stride=\"3x\"")),
              HasSubstr("stride '3x' of <accessor>, expected a whole number"));
  EXPECT_THAT(refusal(accessed("source=\"#s\" stride=\"3\"")), HasSubstr("not in the <float_array> of their <source>"));
}

TEST(Collada, ReadsNumbersBehindComments) {
  const Mesh whole = parse_collada(kPrism, "x");
  const auto same = [&](const std::string& old, const std::string& other) {
    const Mesh mesh = parse_collada(with(kPrism, old, other), "x");
    return mesh.vertices == whole.vertices && mesh.triangles == whole.triangles;
  };
  EXPECT_TRUE(same("4 4 4</vcount>", "4 <!-- two more -->4 4</vcount>"));
  EXPECT_TRUE(same("4 0 3 0  1 0 2 0", "4 0 3 0 <!-- next -->  <!-- 9 9 --> 1 0 2 0"));
  EXPECT_TRUE(same("0 0 0  1 0 0", "<!-- points -->0 0 0<!-- second --> 1 0 0"));
  EXPECT_TRUE(same("10 0 0</translate>", "10 <![CDATA[0 0]]></translate>"));
  EXPECT_THAT(error_of([&] { same("0 0 0  1 0 0", "0 0 0 1<!-- -->0 0 0"); }),
              HasSubstr("a comment between '1' and '0', expected blanks beside it"));
  EXPECT_THAT(error_of([&] { same("0 0 0  1 0 0", "0 0 0 <x/> 1 0 0"); }), HasSubstr("<x> among numbers"));
}

TEST(Collada, BoundsWhatNodesInNodesAskFor) {
  // Each of 9 nodes has the next one twice: 512 instances of a geometry with one triangle and 100 empty primitives on 1000 points.
  const auto nested = [](const std::string& primitives) {
    std::string points, nodes;
    for (int k = 0; k < 1000; ++k) points += " " + std::to_string(k) + " 0 " + std::to_string(k * k);
    for (int k = 0; k < 9; ++k) {
      const std::string next = "<instance_node url=\"#n" + std::to_string(k + 1) + "\"/>";
      nodes += "<node id=\"n" + std::to_string(k) + "\">" + next + next + "</node>";
    }
    return "<COLLADA><library_geometries><geometry id=\"g\"><mesh><source id=\"s\"><float_array>" + points +
           "</float_array></source><vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices>" + primitives +
           "</mesh></geometry></library_geometries><library_nodes>" + nodes +
           "<node id=\"n9\"><instance_geometry url=\"#g\"/></node></library_nodes><library_visual_scenes><visual_scene>"
           "<node><instance_node url=\"#n0\"/></node></visual_scene></library_visual_scenes></COLLADA>";
  };
  const std::string input = "<input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>";
  std::string empty;
  for (int k = 0; k < 100; ++k) empty += "<triangles>" + input + "</triangles>";
  const std::string one = "<triangles>" + input + "<p>1 2 3</p></triangles>";
  // Of the geometry, read once: 3000 numbers, again to find points by index, 101 primitives, their inputs and corners. Of the 1 + 2 + … + 512 nodes: their
  // elements. Of each instance: 3 vertices and 1 triangle.
  constexpr std::size_t kRead = 2 * 3000 + 101 + 2 * 101 + 3 + 4, kNodes = 2 * 1024, kPlaced = 512 * 3 * (3 + 1);
  const std::string xml = nested(empty + one);
  EXPECT_EQ(parse_collada(xml, "x", kRead + kNodes + kPlaced).triangles.size(), 512u);
  const auto refused = [](const std::string& text, std::size_t most) {
    return error_of([&] { parse_collada(text, "x", most); });
  };
  EXPECT_THAT(refused(xml, kRead + kNodes), HasSubstr("x:1: more than 8358 numbers and elements"));
  EXPECT_THAT(refused(nested(empty), 1000), HasSubstr("more than 1000 numbers and elements"));
  EXPECT_THAT(refused(nested(empty), kRead + kNodes), HasSubstr("no triangles in the visual scene"));
}

}  // namespace
}  // namespace cotwin::scene::collada_test
