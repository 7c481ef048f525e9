#include "models/scene/scene.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/hull.h"
#include "models/scene/mesh.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/shapes.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::scene::scene_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string sdf(const std::string& inside) {
  return "<sdf version=\"1.9\" xmlns:cotwin=\"urn:cotwin:scene:1\">\n" + inside + "\n</sdf>";
}
std::string world(const std::string& inside) { return sdf("<world name=\"w\">" + inside + "</world>"); }
const std::string kBall = "<collision name=\"c\"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>";
const std::string kMass = "<inertial><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>";
std::string link(const std::string& name, const std::string& inside = "") {
  return "<link name=\"" + name + "\">" + kMass + kBall + inside + "</link>";
}
std::string model(const std::string& name, const std::string& inside) {
  return "<model name=\"" + name + "\">" + inside + "</model>";
}

Scene parse(const std::string& text) {
  std::vector<std::string> warnings;
  Scene scene = parse_sdf(text, "test.sdf", &warnings);
  EXPECT_THAT(warnings, ElementsAre());
  return scene;
}
std::vector<std::string> warnings_of(const std::string& text) {
  std::vector<std::string> warnings;
  parse_sdf(text, "test.sdf", &warnings);
  return warnings;
}
std::string refusal(const std::string& text) {
  return error_of([&] { parse_sdf(text, "test.sdf"); });
}

// Hulls ---------------------------------------------------------------------------------------------------------------------

void expect_sound(const Polytope& p) {
  EXPECT_EQ(p.vertices.size() + p.faces.size(), p.edges.size() + 2);  // Euler
  for (const Polytope::Face& face : p.faces) {
    EXPECT_NEAR(face.n.norm(), 1, 1e-12);
    for (const Vector3d& v : p.vertices) EXPECT_LE(face.n.dot(v), face.d + 1e-12);
    for (std::uint32_t k = 0; k < face.count; ++k) EXPECT_NEAR(face.n.dot(p.vertices[p.corners[face.begin + k]]), face.d, 1e-8);
  }
  for (std::size_t f = 0; f < p.faces.size(); ++f) {
    const Polytope::Face& face = p.faces[f];
    for (std::uint32_t k = 0; k < face.count; ++k) {  // each side is an edge of this face
      const Polytope::Edge& edge = p.edges[p.corner_edges[face.begin + k]];
      const std::uint32_t from = p.corners[face.begin + k], to = p.corners[face.begin + (k + 1) % face.count];
      EXPECT_TRUE((edge.vertices[0] == from && edge.vertices[1] == to) || (edge.vertices[1] == from && edge.vertices[0] == to));
      EXPECT_TRUE(edge.faces[0] == f || edge.faces[1] == f);
      EXPECT_NE(edge.faces[0], edge.faces[1]);
    }
  }
}

std::vector<Vector3d> sphere_points(int count) {
  std::vector<Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count, r = std::sqrt(1 - z * z), turn = 2.399963229728653 * i;
    points.emplace_back(r * std::cos(turn), r * std::sin(turn), z);
  }
  return points;
}

TEST(Hull, OfACubeWithPointsInItAndOnItIsTheCube) {
  std::vector<Vector3d> points;
  for (int x = 0; x <= 4; ++x) {
    for (int y = 0; y <= 4; ++y) {
      for (int z = 0; z <= 4; ++z) points.emplace_back(x * 0.1 + 3, y * 0.1 - 7, z * 0.1);
    }
  }
  const Polytope cube = convex_hull(points);
  expect_sound(cube);
  EXPECT_EQ(cube.vertices.size(), 8u);
  EXPECT_EQ(cube.faces.size(), 6u);
  EXPECT_EQ(cube.edges.size(), 12u);
  EXPECT_NEAR(cube.volume(), 0.064, 1e-13);
  EXPECT_TRUE(cube.centroid().isApprox(Vector3d(3.2, -6.8, 0.2), 1e-12));
}

TEST(Hull, OfABoxIsTheBox) {
  const Polytope box = box_polytope({1, 2, 3});
  expect_sound(box);
  EXPECT_EQ(box.vertices.size(), 8u);
  EXPECT_NEAR(box.volume(), 6, 1e-14);
  EXPECT_EQ(convex_hull(box.vertices).faces.size(), 6u);
}

TEST(Hull, ContainsAllPointsAndKeepsTheOuterOnes) {
  for (const int count : {4, 5, 20, 100, 1000}) {
    const Polytope ball = convex_hull(sphere_points(count));
    expect_sound(ball);
    EXPECT_EQ(ball.vertices.size(), static_cast<std::size_t>(count));  // all lie on the sphere
  }
  const Polytope ball = convex_hull(sphere_points(1000));
  EXPECT_NEAR(ball.volume(), 4 * M_PI / 3, 0.03);
  EXPECT_TRUE(ball.second_moment().isApprox(0.4 * 4 * M_PI / 3 * Eigen::Matrix3d::Identity(), 0.02));
}

TEST(Hull, OfPointsOnACurveContainsAllPoints) {
  // (sin t, cos 2t, sin 3t) is a cubic curve in sin t, with points as close together as 1e-5: rounding would break the surface.
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 200; ++i) points.emplace_back(std::sin(i), std::cos(2 * i), std::sin(3 * i));
  const Polytope hull = convex_hull(points);
  EXPECT_GT(hull.faces.size(), 50u);
  for (const Polytope::Face& face : hull.faces) {
    for (const Eigen::Vector3d& p : points) ASSERT_LT(face.n.dot(p) - face.d, 1e-6);
  }
}

TEST(Hull, WorksForNearlyEqualPoints) {
  std::vector<Vector3d> points = sphere_points(60);
  for (int i = 0; i < 60; ++i) points.push_back(points[static_cast<std::size_t>(i)] + Vector3d(1e-15, -1e-15, 1e-16));
  expect_sound(convex_hull(points));
  std::vector<Vector3d> prism;  // caps of 64 corners whose planes are only approximately planar
  for (int i = 0; i < 64; ++i) {
    const double a = 2 * M_PI * i / 64;
    for (const double z : {-0.5, 0.5}) prism.emplace_back(std::cos(a), std::sin(a), z + 1e-12 * (i % 7));
  }
  const Polytope hull = convex_hull(prism);
  expect_sound(hull);
  EXPECT_EQ(hull.faces.size(), 66u);
}

TEST(Hull, OfFlatOrFewPointsIsAnError) {
  EXPECT_THAT(error_of([] { convex_hull(std::vector<Vector3d>(3, Vector3d::Zero())); }),
              HasSubstr("3 points, expected at least 4"));
  EXPECT_THAT(error_of([] { convex_hull(std::vector<Vector3d>(10, Vector3d::Zero())); }),
              HasSubstr("expected a body with volume"));
  const std::vector<Vector3d> square{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 1e-12}};
  EXPECT_THAT(error_of([&] { convex_hull(square); }), HasSubstr("of a plane"));
  const std::vector<Vector3d> nan{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, std::nan("")}};
  EXPECT_THAT(error_of([&] { convex_hull(nan); }), HasSubstr("not finite"));
}

// Solids --------------------------------------------------------------------------------------------------------------------

/// The same solid as a hull of many points: its inertia by another formulation.
TEST(SolidInertia, AgreesWithThatOfTheHull) {
  const auto hull_of = [](ShapeType type, double r, double l) {
    Shape hull;
    hull.type = ShapeType::kHull;
    for (const Vector3d& u : sphere_points(8000)) {
      if (type == ShapeType::kSphere) hull.vertices.push_back(r * u);
      if (type == ShapeType::kCapsule)
        hull.vertices.emplace_back(r * u.x(), r * u.y(), r * u.z() + std::copysign(l / 2, u.z()));
    }
    for (int i = 0; i < 720 && type == ShapeType::kCylinder; ++i) {
      for (const double z : {-l / 2, l / 2})
        hull.vertices.emplace_back(r * std::cos(i * M_PI / 360), r * std::sin(i * M_PI / 360), z);
    }
    return hull;
  };
  for (const ShapeType type : {ShapeType::kSphere, ShapeType::kCylinder, ShapeType::kCapsule}) {
    Shape shape;
    shape.type = type;
    shape.size = {0.3, 0.7, 0};
    shape.X_BS = {rotation_from_rpy(0.3, -0.4, 1), {0.1, 0.2, 0.3}};
    Shape hull = hull_of(type, 0.3, 0.7);
    hull.X_BS = shape.X_BS;
    const Inertia exact = solid_inertia(shape, 900), close = solid_inertia(hull, 900);
    EXPECT_NEAR(close.mass / exact.mass, 1, 2e-3);
    EXPECT_TRUE(close.I_CC.isApprox(exact.I_CC, 4e-3));
    EXPECT_TRUE(close.p_LC.isApprox(exact.p_LC, 1e-4));
    EXPECT_EQ(exact.unphysical(), "");
  }
  Shape box;
  box.type = ShapeType::kBox;
  box.size = {0.1, 0.2, 0.3};
  Shape hull;
  hull.type = ShapeType::kHull;
  hull.vertices = box_polytope(box.size).vertices;
  EXPECT_TRUE(solid_inertia(hull, 900).I_CC.isApprox(solid_inertia(box, 900).I_CC, 1e-12));
}

TEST(RoundHole, HasTheDocumentedRoundness) {
  RoundHole hole;
  hole.radius = 0.015;
  hole.depth = 0.04;
  hole.width = 0.1;
  hole.length = 0.14;
  hole.chamfer = 0.002;
  hole.facets = 64;
  const std::vector<Shape> ring = round_hole(hole);
  ASSERT_EQ(ring.size(), 64u);
  double volume = 0, nearest = 1, corner = 0;
  for (const Shape& piece : ring) {
    volume += convex_hull(piece.vertices).volume();
    for (const Vector3d& v : piece.vertices) {
      if (v.z() < 0) corner = std::max(corner, v.head<2>().norm() < 0.02 ? v.head<2>().norm() : 0);
    }
    // The facet: between the corners of the piece nearest to the axis.
    std::vector<Vector3d> inner;
    for (const Vector3d& v : piece.vertices) {
      if (v.z() < 0 && v.head<2>().norm() < 0.02) inner.push_back(v);
    }
    ASSERT_EQ(inner.size(), 2u);
    nearest = std::min(nearest, ((inner[0] + inner[1]) / 2).head<2>().norm());
  }
  EXPECT_NEAR(nearest, hole.radius, 1e-15);
  EXPECT_NEAR(corner - hole.radius, hole.radius * (1 / std::cos(M_PI / 64) - 1), 1e-15);  // 18.1 µm
  // Plate minus the polygon's prism minus the chamfer's frustum, whose areas are those of the inscribed circles times one
  // factor.
  const double f = 64 * std::tan(M_PI / 64), r = hole.radius, R = r + hole.chamfer, c = hole.chamfer;
  EXPECT_NEAR(volume, 0.1 * 0.14 * 0.04 - f * (r * r * (0.04 - c) + c * (r * r + r * R + R * R) / 3), 1e-15);
}

TEST(RoundHole, MustFitIntoItsPlate) {
  RoundHole hole;
  hole.radius = 0.05;
  hole.depth = 0.04;
  hole.width = hole.length = 0.1;
  EXPECT_THAT(error_of([&] { round_hole(hole); }), HasSubstr("half the plate's edge 50 mm"));
  hole.radius = 0.02;
  hole.chamfer = 0.04;
  EXPECT_THAT(error_of([&] { round_hole(hole); }), HasSubstr("chamfer 40 mm, expected ≥ 0 and less than the depth 40 mm"));
  hole.chamfer = 0;
  hole.facets = 5;
  EXPECT_THAT(error_of([&] { round_hole(hole); }), HasSubstr("5 facets, expected 6"));
}

// check() -------------------------------------------------------------------------------------------------------------------

Scene good() {
  Scene scene;
  scene.name = "s";
  Body ground;
  ground.name = "ground";
  ground.motion = Motion::kStatic;
  Shape plane;
  plane.type = ShapeType::kPlane;
  ground.shapes = {plane};
  Body ball;
  ball.name = "ball";
  Shape sphere;
  sphere.size = {0.1, 0, 0};
  ball.shapes = {sphere};
  ball.inertia = solid_inertia(sphere, 1000);
  scene.bodies = {ground, ball};
  Joint joint;
  joint.name = "hinge";
  joint.parent = 0;
  joint.child = 1;
  scene.joints = {joint};
  return scene;
}

TEST(Check, NamesTheBodyAndTheFact) {
  EXPECT_EQ(error_of([] { check(good()); }), "");
  struct Case {
    std::function<void(Scene&)> spoil;
    std::string message;
  };
  const double nan = std::nan("");
  const std::vector<Case> cases{
      {[](Scene& s) { s.bodies[1].inertia.mass = -1; }, "scene 's': body 'ball': "},
      {[](Scene& s) { s.bodies[1].inertia.I_CC(0, 0) = 1; }, "triangle inequality"},
      {[&](Scene& s) { s.bodies[1].inertia.mass = nan; }, "body 'ball': inertia is not finite"},
      {[](Scene& s) { s.bodies[1].shapes[0].size.x() = 0; }, "body 'ball': shape 0: radius 0 m, expected > 0"},
      {[](Scene& s) { s.bodies[1].shapes[0].size.x() = 1e-12; }, "radius 1e-12 m, expected 1e-09 … 1e+09 m"},
      {[](Scene& s) { s.bodies[1].X_WB.p.x() = 1e10; }, "pose is 1e+10 m away"},
      {[](Scene& s) { s.bodies[1].shapes[0].type = ShapeType::kPlane; }, "a plane on a dynamic body"},
      {[](Scene& s) { s.bodies[1].shapes[0].type = ShapeType::kHull; }, "0 points, expected at least 4"},
      {[](Scene& s) { s.bodies[1].shapes[0].material.mu = -0.1; }, "friction -0.1, expected ≥ 0"},
      {[](Scene& s) { s.bodies[1].shapes[0].material.restitution = 1.5; }, "restitution 1.5, expected 0 … 1"},
      {[](Scene& s) { s.bodies[1].shapes[0].material.stiffness = 0; }, "stiffness 0 N/m"},
      {[](Scene& s) { s.bodies[1].X_WB.R(0, 0) = 2; }, "pose: the matrix is not a rotation"},
      {[&](Scene& s) { s.bodies[0].X_WB.p.x() = nan; }, "body 'ground': pose is not finite"},
      {[](Scene& s) { s.bodies[0].V_WB[0] = 1; }, "a static body with a velocity"},
      {[](Scene& s) { s.bodies[1].name = "ground"; }, "two bodies with the name 'ground'"},
      {[](Scene& s) { s.joints[0].child = 2; }, "joint 'hinge': child 2, expected 0 … 1"},
      {[](Scene& s) { s.joints[0].parent = -2; }, "parent -2"},
      {[](Scene& s) { s.joints[0].parent = 1; }, "parent and child are the same body"},
      {[](Scene& s) {
         s.joints[0].axis = {0, 0, 2};
       },
       "axis of length 2, expected 1"},
      {[](Scene& s) { s.joints[0].q_min = 1, s.joints[0].q_max = 0; }, "limits 1 … 0, expected lower ≤ upper"},
      {[](Scene& s) { s.joints[0].damping = -1; }, "damping -1"},
      {[](Scene& s) { s.joints.push_back(s.joints[0]); }, "two joints with the name 'hinge'"},
      {[](Scene& s) {
         s.no_contact = {{0, 2}};
       },
       "bodies 0, 2 without contact"},
      {[&](Scene& s) { s.gravity.z() = nan; }, "gravity is not finite"},
  };
  for (const Case& c : cases) {
    Scene scene = good();
    c.spoil(scene);
    EXPECT_THAT(error_of([&] { check(scene); }), HasSubstr(c.message));
  }
}

TEST(Check, LetsJointsFormLoops) {
  Scene scene = good();
  Joint back = scene.joints[0];
  back.name = "back";
  std::swap(back.parent, back.child);
  scene.joints.push_back(back);
  EXPECT_EQ(error_of([&] { check(scene); }), "");
}

// SDF -----------------------------------------------------------------------------------------------------------------------

TEST(Sdf, ReadsABodyWithItsShapesAndSurface) {
  const Scene scene = parse(world(R"(
    <gravity>0 1 -9.7</gravity>
    <model name="m"><pose>1 2 3 0 0 1.5707963267948966</pose>
      <link name="l"><pose>0.1 0 0 0 0 0</pose>
        <inertial><pose>0.01 0 0 0 0 1.5707963267948966</pose><mass>2</mass>
          <inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz><ixy>0.01</ixy></inertia></inertial>
        <collision name="a"><pose>0 0 0.5 0 0 0</pose><geometry><box><size>0.1 0.2 0.3</size></box></geometry>
          <surface><friction><ode><mu>0.3</mu><mu2>0.3</mu2></ode></friction><bounce><restitution_coefficient>0.2</restitution_coefficient></bounce>
            <contact><ode><kp>1e5</kp><kd>20</kd></ode></contact></surface></collision>
        <collision name="b"><geometry><capsule><radius>0.1</radius><length>0.5</length></capsule></geometry></collision>
        <visual name="v"><geometry><box><size>1 1 1</size></box></geometry></visual>
        <cotwin:velocity>1 2 3 4 5 6</cotwin:velocity>
      </link></model>)"));
  EXPECT_EQ(scene.name, "w");
  EXPECT_EQ(scene.gravity, Vector3d(0, 1, -9.7));
  ASSERT_EQ(scene.bodies.size(), 1u);
  const Body& body = scene.bodies[0];
  EXPECT_EQ(body.name, "m");  // its only link
  EXPECT_EQ(body.motion, Motion::kDynamic);
  EXPECT_TRUE(body.X_WB.p.isApprox(Vector3d(1, 2.1, 3), 1e-14));
  EXPECT_EQ(body.inertia.mass, 2);
  EXPECT_EQ(body.inertia.p_LC, Vector3d(0.01, 0, 0));
  // Rotated by 90 degrees about z: x and y are exchanged, ixy changes its sign.
  EXPECT_NEAR(body.inertia.I_CC(0, 0), 0.2, 1e-15);
  EXPECT_NEAR(body.inertia.I_CC(1, 1), 0.1, 1e-15);
  EXPECT_NEAR(body.inertia.I_CC(0, 1), -0.01, 1e-15);
  Twist V;
  V << 1, 2, 3, 4, 5, 6;
  EXPECT_EQ(body.V_WB, V);
  ASSERT_EQ(body.shapes.size(), 2u);
  EXPECT_EQ(body.shapes[0].type, ShapeType::kBox);
  EXPECT_EQ(body.shapes[0].size, Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(body.shapes[0].X_BS.p, Vector3d(0, 0, 0.5));
  EXPECT_EQ(body.shapes[0].material, (Material{0.3, 0.2, 1e5, 20}));
  EXPECT_EQ(body.shapes[1].type, ShapeType::kCapsule);
  EXPECT_EQ(body.shapes[1].size, Vector3d(0.1, 0.5, 0));
  EXPECT_EQ(body.shapes[1].material, (Material{1, 0, kInfinity, 0}));  // SDF's defaults; its kp of 1e12 is rigid
}

TEST(Sdf, MakesInertiaFromDensity) {
  const Scene scene = parse(world(model("m", R"(<link name="l"><inertial auto="true"><density>500</density></inertial>
    <collision name="a"><geometry><box><size>1 1 1</size></box></geometry></collision>
    <collision name="b"><density>1000</density><pose>2 0 0 0 0 0</pose><geometry><box><size>1 1 1</size></box></geometry></collision></link>)")));
  EXPECT_NEAR(scene.bodies[0].inertia.mass, 1500, 1e-10);
  EXPECT_NEAR(scene.bodies[0].inertia.p_LC.x(), 4.0 / 3, 1e-12);
}

TEST(Sdf, ResolvesPosesRelativeToOtherFrames) {
  const Scene scene = parse(world(
      "<frame name=\"corner\"><pose>10 0 0 0 0 1.5707963267948966</pose></frame>"
      "<model name=\"m\"><pose relative_to=\"corner\">1 0 0 0 0 0</pose>"
      "<frame name=\"f\" attached_to=\"a\"><pose>0 0 1 0 0 0</pose></frame>"
      "<link name=\"b\"><pose relative_to=\"f\">0 0 1 0 0 0</pose>" +
      kMass + kBall + "</link>" + "<link name=\"a\"><pose degrees=\"true\">0 0 5 180 0 0</pose>" + kMass + kBall + "</link>" +
      "<link name=\"q\"><pose rotation_format=\"quat_xyzw\">0 0 0 1 0 0 0</pose>" + kMass + kBall + "</link></model>"));
  ASSERT_EQ(scene.bodies.size(), 3u);
  EXPECT_EQ(scene.bodies[0].name, "m.b");
  EXPECT_TRUE(scene.bodies[1].X_WB.p.isApprox(Vector3d(10, 1, 5), 1e-14));
  EXPECT_TRUE(scene.bodies[0].X_WB.p.isApprox(Vector3d(10, 1, 3), 1e-14));  // a hangs upside down
  EXPECT_NEAR(scene.bodies[2].X_WB.R(2, 2), -1, 1e-15);
  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.frames[0].name, "m.f");
  EXPECT_EQ(scene.frames[0].body, 1);
  EXPECT_TRUE(scene.frames[0].X_BF.p.isApprox(Vector3d(0, 0, 1), 1e-14));
  EXPECT_EQ(scene.frames[1].name, "corner");
  EXPECT_EQ(scene.frames[1].body, -1);
  EXPECT_TRUE(scene.frames[1].X_BF.p.isApprox(Vector3d(10, 0, 0), 1e-14));
}

TEST(Sdf, KeepsFramesOfLinksAndReadsOthers) {
  const Scene scene = parse(world(model("m", link("a") + link("b", "<pose>1 0 0 0 0 0</pose>") + R"(
    <frame name="first"><pose>0 0 2 0 0 0</pose></frame>
    <frame name="on_first" attached_to="second"/>
    <frame name="second" attached_to="b"><pose>0 3 0 0 0 0</pose></frame>
    <frame name="on_joint" attached_to="j"/>
    <frame name="round" attached_to="trip"/><frame name="trip" attached_to="round"/>
    <joint name="j" type="fixed"><parent>a</parent><child>b</child></joint>)")));
  ASSERT_EQ(scene.frames.size(), 3u);
  EXPECT_EQ(scene.frames[0].body, 0) << "the model's first link";
  EXPECT_TRUE(scene.frames[0].X_BF.p.isApprox(Vector3d(0, 0, 2), 1e-14));
  EXPECT_EQ(scene.frames[1].body, 1);
  EXPECT_TRUE(scene.frames[1].X_BF.p.isApprox(Vector3d(0, 3, 0), 1e-14));
}

TEST(Sdf, ReadsJoints) {
  const Scene scene = parse(world(model("m", link("a") + link("b", "<pose>1 0 0 0 0 1.5707963267948966</pose>") + R"(
    <joint name="h" type="revolute"><pose>0 0.5 0 0 0 0</pose><parent>a</parent><child>b</child>
      <axis><xyz expressed_in="__model__">1 0 0</xyz><limit><lower>-1</lower><upper>2</upper></limit>
        <dynamics><damping>0.5</damping><friction>0.25</friction></dynamics></axis></joint>
    <joint name="c" type="continuous"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>
    <joint name="s" type="prismatic"><parent>world</parent><child>a</child><axis><xyz>0 0 1</xyz></axis></joint>
    <joint name="k" type="ball"><parent>a</parent><child>b</child></joint>
    <joint name="f" type="fixed"><parent>a</parent><child>b</child></joint>)")));
  ASSERT_EQ(scene.joints.size(), 5u);
  const Joint& hinge = scene.joints[0];
  EXPECT_EQ(hinge.name, "m.h");
  EXPECT_EQ(hinge.parent, 0);
  EXPECT_EQ(hinge.child, 1);
  EXPECT_TRUE(hinge.X_CJ.p.isApprox(Vector3d(0, 0.5, 0), 1e-15));
  EXPECT_TRUE(hinge.X_PJ.p.isApprox(Vector3d(0.5, 0, 0), 1e-15));  // b is rotated by 90 degrees
  EXPECT_TRUE(hinge.axis.isApprox(Vector3d(0, -1, 0), 1e-15));
  EXPECT_EQ(hinge.q_min, -1);
  EXPECT_EQ(hinge.q_max, 2);
  EXPECT_EQ(hinge.damping, 0.5);
  EXPECT_EQ(hinge.friction, 0.25);
  EXPECT_EQ(scene.joints[1].q_max, kInfinity);
  EXPECT_EQ(scene.joints[2].parent, -1);
  EXPECT_EQ(scene.joints[3].type, JointType::kSpherical);
  EXPECT_EQ(scene.joints[4].type, JointType::kFixed);
}

TEST(Sdf, LinksOfAModelTouchEachOtherOnlyIfItSaysSo) {
  EXPECT_THAT(parse(world(model("m", link("a") + link("b")))).no_contact, ElementsAre(std::pair(0, 1)));
  EXPECT_THAT(parse(world(model("m", "<self_collide>true</self_collide>" + link("a") + link("b")))).no_contact, ElementsAre());
  EXPECT_THAT(parse(world(model("m", link("a")) + model("n", link("a")))).no_contact, ElementsAre());
}

TEST(Sdf, ReadsStaticAndDrivenBodies) {
  const Scene scene = parse(world(model("s", "<static>true</static><link name=\"l\">" + kBall + "</link>") +
                                  model("d", "<link name=\"l\"><kinematic>true</kinematic>" + kBall + "</link>")));
  EXPECT_EQ(scene.bodies[0].motion, Motion::kStatic);
  EXPECT_EQ(scene.bodies[1].motion, Motion::kDriven);
}

TEST(Sdf, IncludesFilesWithinFiles) {
  const TemporaryFolder folder("scene");
  folder.write("part/model.sdf", sdf(model("part", "<pose>0 0 1 0 0 0</pose>" + link("l"))));
  folder.write("cell/cell.sdf", world("<include><uri>../part</uri><name>p</name><pose>1 0 0 0 0 0</pose></include>"
                                      "<include><uri>model://part</uri></include>"));
  const fs::path file = folder.write(
      "scene/scene.sdf",
      world("<include><uri>../cell/cell.sdf</uri><name>left</name><pose>0 5 0 0 0 0</pose><static>1</static></include>"));
  const Scene scene = load(file);
  ASSERT_EQ(scene.bodies.size(), 2u);
  EXPECT_EQ(scene.bodies[0].name, "left.p");
  EXPECT_EQ(scene.bodies[0].X_WB.p, Vector3d(1, 5, 0));  // the include's pose instead of the model's own
  EXPECT_EQ(scene.bodies[0].motion, Motion::kStatic);
  EXPECT_EQ(scene.bodies[1].name, "left.part");
  EXPECT_EQ(scene.bodies[1].X_WB.p, Vector3d(0, 5, 1));
}

TEST(Sdf, AnIncludeThatIncludesItselfIsAnError) {
  const TemporaryFolder folder("scene");
  const fs::path file = folder.write("a.sdf", world("<include><uri>a.sdf</uri><name>a</name></include>"));
  EXPECT_THAT(error_of([&] { load(file); }), HasSubstr("more than 16 deep"));
}

TEST(Sdf, JointsReachIntoNestedModels) {
  const Scene scene =
      parse(world(model("m", link("a") + model("n", "<pose>0 0 2 0 0 0</pose>" + link("b") + link("c")) +
                                 "<joint name=\"j\" type=\"fixed\"><parent>a</parent><child>n::c</child></joint>")));
  ASSERT_EQ(scene.bodies.size(), 3u);
  EXPECT_EQ(scene.bodies[2].name, "m.n.c");
  EXPECT_EQ(scene.joints[0].child, 2);
  EXPECT_EQ(scene.joints[0].X_PJ.p, Vector3d(0, 0, 2));
}

TEST(Sdf, WarnsOfIgnoredElements) {
  EXPECT_THAT(
      warnings_of(world("<physics name=\"p\" type=\"ode\"/>" + model("m", link("a", "<enable_wind>true</enable_wind>")))),
      ElementsAre(HasSubstr("test.sdf:2: <physics> in <world> is ignored"), HasSubstr("<enable_wind> in <link> is ignored")));
  EXPECT_THAT(warnings_of(world(model("m", "<plugin name=\"p\" filename=\"f\"/>" + link("a")))),
              ElementsAre(HasSubstr("<plugin> in <model>")));
  const std::string slip =
      "<collision "
      "name=\"d\"><geometry><sphere><radius>1</radius></sphere></geometry><surface><friction><ode><mu>1</mu><mu2>2</mu2>"
      "<slip1>0.1</slip1></ode></friction></surface></collision>";
  EXPECT_THAT(warnings_of(world(model("m", link("a", slip)))),
              ElementsAre(HasSubstr("<slip1> in <ode>"), HasSubstr("<mu2> differs from <mu>")));
}

std::string with_foundation(const std::string& inside, const std::string& ode = "") {
  return world(
      model("m", link("a", "<collision name=\"x\"><geometry><box><size>1 1 1</size></box></geometry><surface><contact>" + ode +
                               "<cotwin:foundation>" + inside + "</cotwin:foundation></contact></surface></collision>")));
}

TEST(Sdf, ReadsFoundationsOfAnAreaAndOfAWholeContact) {
  const std::string of_area =
      "<cotwin:young_modulus>5e6</cotwin:young_modulus><cotwin:thickness>0.05</cotwin:thickness><cotwin:damping>2e4</"
      "cotwin:damping>"
      "<cotwin:yield_stress>1e5</cotwin:yield_stress><cotwin:breakthrough>0.04</cotwin:breakthrough>";
  const Material area = parse_sdf(with_foundation(of_area), "test.sdf").bodies[0].shapes.back().material;
  EXPECT_EQ(area.foundation, 1e8);
  EXPECT_EQ(area.foundation_damping, 2e4);
  EXPECT_EQ(area.yield, 1e5);
  EXPECT_EQ(area.breakthrough, 0.04);
  EXPECT_FALSE(area.whole);
  EXPECT_TRUE(area.soft());
  const std::string of_whole = "<cotwin:stiffness>3e4</cotwin:stiffness><cotwin:yield_force>30</cotwin:yield_force>";
  const Material whole = parse_sdf(with_foundation(of_whole), "test.sdf").bodies[0].shapes.back().material;
  EXPECT_EQ(whole.foundation, 3e4);
  EXPECT_EQ(whole.yield, 30);
  EXPECT_EQ(whole.breakthrough, kInfinity);
  EXPECT_TRUE(whole.whole);
}

TEST(Sdf, RefusesInvalidFoundations) {
  const auto own = [](const std::string& name, const std::string& value) {
    return "<cotwin:" + name + ">" + value + "</cotwin:" + name + ">";
  };
  const std::string E = own("young_modulus", "5e6"), t = own("thickness", "0.05"), k = own("stiffness", "1e4");
  const std::vector<std::pair<std::string, std::string>> cases{
      {with_foundation(""), "<foundation> without <thickness>"},
      {with_foundation(E), "<foundation> without <thickness>"},
      {with_foundation(t), "<foundation> without <young_modulus>"},
      {with_foundation(E + own("thickness", "0")), "<thickness> 0 m, expected > 0"},
      {with_foundation(own("young_modulus", "-1") + t), "<young_modulus> in <foundation>: -20, expected > 0"},
      {with_foundation(k + t), "<thickness> besides <stiffness>"},
      {with_foundation(k + own("yield_stress", "1e5")), "<yield_stress> besides <stiffness>"},
      {with_foundation(E + t + own("yield_force", "1")), "<yield_force> without <stiffness>"},
      {with_foundation(E + t + own("yield_stress", "0")), "yield limit 0 Pa, expected > 0"},
      {with_foundation(E + t + own("yield_stress", "nan")), "'nan', expected a finite number"},
      {with_foundation(k + own("yield_force", "-3")), "yield limit -3 N, expected > 0"},
      {with_foundation(E + t + own("breakthrough", "-1")), "breakthrough -1 m, expected > 0"},
      {with_foundation(E + t + own("damping", "-1")), "damping of the foundation -1"},
      {with_foundation(E + t + own("strength", "1")), "'strength' is not an element of 'foundation'"},
      {with_foundation(E + t, "<ode><kp>1e5</kp></ode>"), "<kp> besides <foundation>"},
  };
  for (const auto& [text, message] : cases) EXPECT_THAT(refusal(text), HasSubstr(message)) << text;
}

TEST(Sdf, RefusesInvalidAndUnsupportedElements) {
  const auto joint = [](const std::string& type, const std::string& inside) {
    return world(model("m", link("a") + link("b") + "<joint name=\"j\" type=\"" + type + "\">" + inside + "</joint>"));
  };
  const auto shape = [](const std::string& inside) {
    return world(model("m", link("a", "<collision name=\"x\"><geometry>" + inside + "</geometry></collision>")));
  };
  const std::vector<std::pair<std::string, std::string>> cases{
      {"<robot/>", "test.sdf:1: <robot>, expected <sdf>"},
      {"<sdf version=\"2.0\"/>", "SDF version '2.0', expected 1.5 … 1.12"},
      {"<sdf version=\"1.4\"/>", "SDF version '1.4'"},
      {sdf(""), "expected one <world> or one <model>"},
      {world(model("m", "<link name=\"l\">" + kBall + "</link>")), "a dynamic link without <inertial>"},
      {world(model("m", link("a") + link("a"))), "duplicate name 'a'"},
      {world(model("m", "<link name=\"l\"><pose>1 2 3</pose></link>")), "<pose> of 3 numbers, expected 6"},
      {world(model("m", "<link name=\"l\"><pose>1 2 3 a b c</pose></link>")), "'a', expected a finite number"},
      {world(model("m", "<link name=\"l\"><pose>1 2 1e308 0 0 0</pose></link>")),
       "'1e308', expected a magnitude of 1e+20 at most"},
      {world(model("m", "<link name=\"l\"><pose relative_to=\"ll\"/>" + kMass + "</link>")), "did you mean 'l'?"},
      {world(model("m", link("a", "<pose relative_to=\"b\"/>") + link("b", "<pose relative_to=\"a\"/>"))), "depends on itself"},
      {world(model(
           "m",
           "<link "
           "name=\"l\"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>3</izz></inertia></inertial></link>")),
       "triangle inequality"},
      {joint("rope", "<parent>a</parent><child>b</child>"), "a joint of type 'rope'"},
      {joint("gearbox",
             "<parent>a</parent><child>b</child><gearbox_ratio>2</gearbox_ratio><axis><xyz>0 0 1</xyz></axis>"
             "<gearbox_reference_body>a</gearbox_reference_body>"),
       "no hinge about the axis between the gearbox's reference body"},
      {joint("revolute", "<parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz><mimic joint=\"k\"/></axis>"),
       "'k' is no joint here"},
      {joint("revolute", "<parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz><mimic joint=\"j\"/></axis>"),
       "expected two different hinges"},
      {joint("universal", "<parent>a</parent><child>b</child><axis><xyz>1 0 0</xyz></axis><axis2><xyz>2 0 0</xyz></axis2>"),
       "<axis> and <axis2> are parallel"},
      {joint("screw", "<parent>a</parent><child>b</child><axis><xyz>1 0 0</xyz></axis>"), "without <screw_thread_pitch>"},
      {joint("fixed", "<parent>a</parent><child>c</child>"), "'c' is not a link, joint, frame or model here"},
      {joint("fixed", "<parent>a</parent><child>world</child>"), "the world is the child"},
      {joint("revolute", "<parent>a</parent><child>b</child>"), "<joint> without <axis>"},
      {joint("revolute", "<parent>a</parent><child>b</child><axis><xyz>0 0 0</xyz></axis>"), "<xyz> of length 0"},
      {shape("<ellipsoid><radii>1 0 1</radii></ellipsoid>"), "radius 0 m, expected > 0"},
      {shape("<cone><radius>0</radius><length>1</length></cone>"), "a cone of radius 0 m"},
      {shape("<heightmap><uri>h.png</uri></heightmap>"), "<heightmap> as a shape, expected a mesh: convert it"},
      {shape("<polyline/>"), "<polyline> as a shape, expected box"},
      {shape("<mesh><uri>none.stl</uri><submesh><name>a</name></submesh></mesh>"),
       "<submesh> is not supported, expected a separate file"},
      {shape(""), "<geometry> without a shape"},
      {shape("<sphere><radius>-1</radius></sphere>"), "radius -1 m, expected > 0"},
      {shape("<plane><normal>0 0 1</normal></plane>"), "a plane on a dynamic body"},
      {shape("<mesh><uri>none.stl</uri></mesh>"), "no file 'none.stl'"},
      {shape("<cotwin:round_hole><cotwin:radius>0.1</cotwin:radius></cotwin:round_hole>"), "<round_hole> without <depth>"},
      {shape("<cotwin:square_hole/>"), "<square_hole> as a shape"},
      {world(model("m", link("a", "<cotwin:speed>1</cotwin:speed>"))), "'speed' is not an element of 'link'"},
  };
  for (const auto& [text, message] : cases) EXPECT_THAT(refusal(text), HasSubstr(message)) << text;
  const std::string missing = refusal(shape("<mesh><uri>none.stl</uri></mesh>"));
  EXPECT_EQ(missing.find("test.sdf:"), missing.rfind("test.sdf:")) << "the place must appear once";
}

// Meshes --------------------------------------------------------------------------------------------------------------------

TEST(Mesh, ReadsObjAndBothKindsOfStlAlike) {
  const TemporaryFolder folder("scene");
  const Polytope box = box_polytope({1, 2, 3});
  std::string obj = "# a box\n", text = "solid box\n", binary(80, ' '), triangles;
  for (const Vector3d& v : box.vertices)
    obj += "v " + std::to_string(v.x()) + " " + std::to_string(v.y()) + "  " + std::to_string(v.z()) + "\n";
  std::uint32_t count = 0;
  for (const Polytope::Face& face : box.faces) {
    for (std::uint32_t k = 1; k + 1 < face.count; ++k, ++count) {
      text += "facet normal 0 0 0\nouter loop\n";
      triangles += std::string(12, '\0');
      for (const std::uint32_t c : {0u, k, k + 1}) {
        const Vector3d& v = box.vertices[box.corners[face.begin + c]];
        text += "  vertex " + std::to_string(v.x()) + " " + std::to_string(v.y()) + " " + std::to_string(v.z()) + "\r\n";
        for (int i = 0; i < 3; ++i) {
          const auto x = static_cast<float>(v[i]);
          triangles.append(reinterpret_cast<const char*>(&x), 4);
        }
      }
      triangles += std::string(2, '\0');
      text += "endloop\nendfacet\n";
    }
  }
  binary.append(reinterpret_cast<const char*>(&count), 4);
  binary += triangles;
  for (const fs::path& file :
       {folder.write("b.obj", obj), folder.write("t.stl", text + "endsolid\n"), folder.write("b.STL", binary)}) {
    const std::vector<Vector3d> vertices = load_hull(file, {1, 1, 2});
    ASSERT_EQ(vertices.size(), 8u) << file;
    EXPECT_NEAR(convex_hull(vertices).volume(), 12, 1e-6);
  }
  EXPECT_THAT(error_of([&] { load_hull(folder.write("x.ply", "")); }), HasSubstr("expected .stl, .obj or .dae"));
  EXPECT_THAT(error_of([&] { load_hull(folder.write("x.obj", "v 1 2\n")); }),
              HasSubstr("x.obj:1: 'v 1 2', expected three coordinates"));
  EXPECT_THAT(error_of([&] { load_hull(folder.write("y.obj", "v 1 2 z\n")); }), HasSubstr("'z', expected a coordinate"));
  EXPECT_THAT(error_of([&] { load_hull(folder.write("z.stl", binary.substr(0, 100))); }), HasSubstr("z.stl"));
}

// Shapes of robots ----------------------------------------------------------------------------------------------------------

TEST(UrdfShapes, AreInTheFramesOfTheirBodies) {
  const TemporaryFolder folder("scene");
  folder.write("meshes/tool.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n");
  const std::string inertia =
      "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>";
  const fs::path file = folder.write(
      "robot.urdf",
      R"(<robot name="r"><link name="base"><collision><geometry><box size="1 1 1"/></geometry></collision></link>
    <link name="arm">)" +
          inertia +
          R"(<collision name="tube"><origin xyz="0 0 1" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
      <collision><geometry><sphere radius="0.2"/></geometry></collision></link>
    <link name="tool"><collision><geometry><mesh filename="package://r/meshes/tool.obj" scale="2 2 2"/></geometry></collision>
      <collision><geometry><mesh filename="package://r/meshes/none.stl"/></geometry></collision></link>
    <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
    <joint name="t" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 3"/></joint></robot>)");
  const robot::RobotModel robot = robot::load_urdf(file);
  std::vector<std::string> warnings;
  const auto shapes = shapes_of_urdf(file, robot, &warnings);
  ASSERT_EQ(shapes.size(), 2u);  // the base and the arm, to which the tool is fixed
  ASSERT_EQ(shapes[0].size(), 1u);
  EXPECT_EQ(shapes[0][0].type, ShapeType::kBox);
  ASSERT_EQ(shapes[1].size(), 3u);
  EXPECT_EQ(shapes[1][0].name, "tube");
  EXPECT_EQ(shapes[1][0].X_BS.p, Vector3d(0, 0, 1));
  EXPECT_NEAR(shapes[1][0].X_BS.R(0, 2), 1, 1e-15);  // along x
  EXPECT_EQ(shapes[1][1].name, "arm_2");
  EXPECT_EQ(shapes[1][2].type, ShapeType::kHull);
  EXPECT_EQ(shapes[1][2].X_BS.p, Vector3d(0, 0, 3));
  EXPECT_NEAR(convex_hull(shapes[1][2].vertices).volume(), 8.0 / 6, 1e-12);
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("mesh 'package://r/meshes/none.stl' not found; the shape is ignored")));
}

TEST(UrdfShapes, OfInvalidElementsAreErrors) {
  const TemporaryFolder folder("scene");
  const auto with = [&](const std::string& geometry) {
    const fs::path file = folder.write(
        "robot.urdf", "<robot name=\"r\"><link name=\"base\"><collision>" + geometry + "</collision></link></robot>");
    return error_of([&] { shapes_of_urdf(file, robot::load_urdf(file)); });
  };
  EXPECT_THAT(with("<geometry><sphere radius=\"-1\"/></geometry>"),
              HasSubstr("robot.urdf:1: <sphere> with radius=\"-1\", expected a length > 0"));
  EXPECT_THAT(with("<geometry><box size=\"1 1\"/></geometry>"), HasSubstr("expected three numbers"));
  EXPECT_THAT(with("<geometry/>"), HasSubstr("<collision> without a geometry"));
}

TEST(UrdfShapes, OfLengthZeroAreIgnored) {
  const TemporaryFolder folder("scene");
  for (const std::string shape :
       {R"(sphere radius="0")", R"(cylinder radius="0.1" length="0")", R"(cylinder radius="0.0" length="1")",
        R"(box size="1 0 1")", R"(capsule radius="0" length="1")"}) {
    const fs::path file = folder.write("robot.urdf", "<robot name=\"r\"><link name=\"base\"><collision><geometry><" + shape +
                                                         "/></geometry></collision><collision><geometry><sphere radius=\"1\"/>"
                                                         "</geometry></collision></link></robot>");
    std::vector<std::string> warnings;
    EXPECT_EQ(shapes_of_urdf(file, robot::load_urdf(file), &warnings)[0].size(), 1u) << shape;
    EXPECT_THAT(warnings, ElementsAre(HasSubstr("of length 0 is ignored")));
  }
}

// Scenes of the repository --------------------------------------------------------------------------------------------------

class EveryScene : public ::testing::TestWithParam<std::string> {};

std::vector<std::string> shipped() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(fs::path(places::source()) / "models/scenes")) {
    if (fs::exists(entry.path() / "scene.sdf")) names.push_back(entry.path().filename());
  }
  std::sort(names.begin(), names.end());
  return names;
}

INSTANTIATE_TEST_SUITE_P(Shipped, EveryScene, ::testing::ValuesIn(shipped()), [](const auto& test) { return test.param; });

TEST_P(EveryScene, LoadsWithoutAWarning) {
  std::vector<std::string> warnings;
  const Scene scene = load(fs::path(places::source()) / "models/scenes" / GetParam() / "scene.sdf", &warnings);
  EXPECT_THAT(warnings, ElementsAre());
  EXPECT_EQ(scene.name, GetParam());
  EXPECT_FALSE(scene.bodies.empty());
}

TEST(Scenes, ThePegHasTheDocumentedClearance) {
  for (const auto& [name, clearance] : {std::pair("peg_in_hole", 0.5e-3), std::pair("peg_in_hole_tight", 0.1e-3)}) {
    const Scene scene = load(fs::path(places::source()) / "models/scenes" / name / "scene.sdf");
    double nearest = 1;
    const Body& plate = scene.bodies[0];
    for (const Shape& piece : plate.shapes) {
      const Polytope hull = convex_hull(piece.vertices);
      for (const Polytope::Face& face : hull.faces) {
        if (std::abs(face.n.z()) < 1e-9 && face.d < -1e-6) nearest = std::min(nearest, -face.d);  // pieces that face the axis
      }
    }
    EXPECT_NEAR(2 * (nearest - scene.bodies[1].shapes[0].size.x()), clearance, 1e-12);
  }
}

// A solid of density 3 with axes a, b, c has the mass 4π abc and the moments m (b² + c²)/5; a ball is the one with a = b = c.
TEST(SolidInertia, OfAnEllipsoidIsThatOfTheBookAndOfABallIfItIsOne) {
  Shape ellipsoid, ball;
  ellipsoid.type = ShapeType::kEllipsoid;
  ellipsoid.size = {0.1, 0.2, 0.3};
  const Inertia of_ellipsoid = solid_inertia(ellipsoid, 3);
  EXPECT_NEAR(of_ellipsoid.mass, 4 * M_PI * 0.006, 1e-15);
  EXPECT_NEAR(of_ellipsoid.I_CC(0, 0), of_ellipsoid.mass * (0.04 + 0.09) / 5, 1e-15);
  EXPECT_NEAR(of_ellipsoid.I_CC(2, 2), of_ellipsoid.mass * (0.01 + 0.04) / 5, 1e-15);
  ball.type = ShapeType::kSphere;
  ball.size = {0.2, 0, 0};
  ellipsoid.size = {0.2, 0.2, 0.2};
  const Inertia of_ball = solid_inertia(ball, 3), of_round = solid_inertia(ellipsoid, 3);
  EXPECT_NEAR(of_ball.mass, of_round.mass, 1e-15);
  EXPECT_LE((of_ball.I_CC - of_round.I_CC).norm(), 1e-15);
}

}  // namespace
}  // namespace cotwin::scene::scene_test
