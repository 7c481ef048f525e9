// Enclosing shapes of the links of robots: those of every shipped robot, those that scripts/capsules.py fits, and who reads them.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "components/contact_world/assemble.h"
#include "components/contact_world/engine/world.h"
#include "components/unit/settings.h"
#include "components/unit/unit_table.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"
#include "tests/support/unit_subject.h"

namespace cotwin::contact_world::hulls_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

fs::path robots() { return fs::path(places::source()) / "models/robots"; }

std::vector<std::string> shipped_robots() {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(robots())) names.push_back(entry.path().filename().string());
  std::ranges::sort(names);
  return names;
}

using Pairs = std::map<std::pair<std::string, std::string>, int>;

/// The pairs of bodies that overlap at q, other than neighbours.
void count_overlaps(const scene::PlacedRobot& robot, const std::vector<double>& q, Pairs& pairs) {
  scene::Scene scene;
  assemble(scene, robot, {}, Base::kFixed, q, std::vector<double>(q.size(), 0.0));
  std::vector<Pose> X_WB;
  for (const scene::Body& body : scene.bodies) X_WB.push_back(body.X_WB);
  collision::Detector detector(scene);
  detector.detect(X_WB, 0);
  std::map<std::pair<std::string, std::string>, bool> touching;
  for (const ContactPoint& point : detector.points())
    touching[{scene.bodies[static_cast<std::size_t>(point.body_a)].name,
              scene.bodies[static_cast<std::size_t>(point.body_b)].name}] = true;
  for (const auto& [pair, touches] : touching) ++pairs[pair];
}

class ShippedRobots : public ::testing::TestWithParam<std::string> {
 protected:
  scene::PlacedRobot robot() const {
    const fs::path urdf = robots() / GetParam() / "robot.urdf";
    scene::PlacedRobot placed{"", robot::load_urdf(urdf), {}};
    placed.shapes = scene::hulls_of_urdf(urdf, placed.model);
    return placed;
  }
};

TEST_P(ShippedRobots, HaveAHullForEachBody) {
  const scene::PlacedRobot placed = robot();
  for (std::size_t b = 0; b < placed.shapes.size(); ++b) EXPECT_FALSE(placed.shapes[b].empty()) << "body " << b;
}

TEST_P(ShippedRobots, DoNotTouchThemselvesAtHomeAndNoPairAlwaysOverlaps) {
  const scene::PlacedRobot placed = robot();
  const std::vector<robot::Joint>& joints = placed.model.joints;
  std::vector<double> q(joints.size());
  for (std::size_t j = 0; j < q.size(); ++j) q[j] = std::clamp(0.0, joints[j].q_min, joints[j].q_max);
  Pairs at_home;
  count_overlaps(placed, q, at_home);
  EXPECT_TRUE(at_home.empty()) << at_home.begin()->first.first << " and " << at_home.begin()->first.second;
  constexpr int kPostures = 300;
  std::mt19937_64 engine(1);
  Pairs pairs;
  for (int k = 0; k < kPostures; ++k) {
    for (std::size_t j = 0; j < q.size(); ++j) {
      const double share = static_cast<double>(engine() >> 11) * 0x1p-53;
      q[j] = joints[j].q_min + share * (joints[j].q_max - joints[j].q_min);
    }
    count_overlaps(placed, q, pairs);
  }
  for (const auto& [pair, count] : pairs) EXPECT_LT(count, kPostures / 2) << pair.first << " and " << pair.second;
}

INSTANTIATE_TEST_SUITE_P(All, ShippedRobots, ::testing::ValuesIn(shipped_robots()),
                         [](const auto& name) { return name.param; });

// Examples whose URDF is a shipped robot with a tool have a copy of its hulls: the page shows the arm.
TEST(Hulls, OfExamplesAreThoseOfTheirRobots) {
  const fs::path examples = fs::path(places::source()) / "examples";
  for (const auto& [robot, urdf_file] : {std::pair{"lwr4", "04_peg_in_hole/lwr4_peg.urdf"},
                                         {"lwr4", "04_peg_in_hole/real/robot.urdf"},
                                         {"lwr4", "10_cooperation/lwr4_punch.urdf"},
                                         {"ur5e", "10_cooperation/ur5e_punch.urdf"},
                                         {"lwr4", "13_docking/lwr4_adapter.urdf"}}) {
    const fs::path urdf = examples / urdf_file;
    const fs::path copy = urdf.filename() == "robot.urdf" ? urdf.parent_path() / "hulls.urdf"
                                                          : urdf.parent_path() / (urdf.stem().string() + "_hulls.urdf");
    EXPECT_EQ(cotwin::testing::content(copy), cotwin::testing::content(robots() / robot / "hulls.urdf"));
    const robot::RobotModel model = robot::load_urdf(urdf);
    EXPECT_EQ(scene::hulls_of_urdf(urdf, model).back().size(),
              scene::hulls_of_urdf(robots() / robot / "robot.urdf", model).back().size() + 1)
        << "the hulls of the last link, and the tool";
  }
}

// A UR5e without torque falls onto the table that it stands on. With hulls it comes to lie there; without shapes it falls through.
TEST(Hulls, CarryAFallingRobot) {
  for (const std::string shapes : {"hulls", "all"}) {
    cotwin::testing::UnitSubject world("unit:contact_world?robot=ur5e&link_side=outside&scene=table&robot_shapes=" + shapes);
    world.set("q0", std::vector<double>{0, -0.5, 0.4, -0.3, 0, 0});
    world.initialise();
    const double start = world.real("energy");
    double deepest = 0, gain = 0, contacts = 0;
    for (int k = 0; k < 2000; ++k) {
      world.step(1e-3);
      deepest = std::max(deepest, world.real("penetration"));
      gain = std::max(gain, world.real("energy") - start);
      contacts = std::max(contacts, static_cast<double>(world.integer("contacts")));
    }
    EXPECT_LT(gain, 1e-6 * std::abs(start)) << shapes;
    if (shapes == "all") {
      EXPECT_EQ(contacts, 0);
      continue;
    }
    EXPECT_GT(contacts, 0);
    EXPECT_LT(deepest, 1e-4);
    EXPECT_LT(world.joints("dq").head(3).norm(), 1e-6) << "the arm lies; its wrist, without friction, turns on";
  }
}

// The base frame of the LWR is 0.31 m above its foot: on the table top its first link is inside the table.
TEST(Hulls, OfARobotThatStandsInTheTableAreNamed) {
  cotwin::testing::UnitSubject world("unit:contact_world?robot=lwr4&link_side=outside&scene=table&robot_shapes=hulls");
  world.initialise();
  EXPECT_THAT([&] { world.step(1e-3); },
              ::testing::ThrowsMessage<Error>(::testing::HasSubstr("(bodies 'table' and 'link_1' overlap by 0.")));
}

/// How far a point is outside a shape, m; negative inside.
double outside(const Shape& shape, const Vector3d& p_B) {
  const Vector3d p = (shape.X_BS.inverse() * p_B).cwiseAbs();
  const double rho = std::hypot(p.x(), p.y()), r = shape.size.x(), half = shape.size.y() / 2;
  if (shape.type == ShapeType::kBox) return (p - shape.size / 2).maxCoeff();
  if (shape.type == ShapeType::kCylinder) return std::max(rho - r, p.z() - half);
  EXPECT_EQ(shape.type, ShapeType::kCapsule);
  return std::hypot(rho, std::max(p.z() - half, 0.0)) - r;
}

double volume(const Shape& shape) {
  const double r = shape.size.x(), length = shape.size.y();
  if (shape.type == ShapeType::kBox) return shape.size.prod();
  return M_PI * r * r * (length + (shape.type == ShapeType::kCapsule ? 4 * r / 3 : 0));
}

/// Triangles of a box from `low` to `high`, rotated by 0.4 rad about (1, 2, 3).
void add_box(std::vector<std::array<Vector3d, 3>>& triangles, const Vector3d& low, const Vector3d& high) {
  const Eigen::Matrix3d R = Eigen::AngleAxisd(0.4, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  const auto corner = [&](int k) {
    return Vector3d(
        R * Vector3d((k & 1) != 0 ? high.x() : low.x(), (k & 2) != 0 ? high.y() : low.y(), (k & 4) != 0 ? high.z() : low.z()));
  };
  for (const std::array<int, 4>& f :
       {std::array{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}) {
    triangles.push_back({corner(f[0]), corner(f[1]), corner(f[2])});
    triangles.push_back({corner(f[0]), corner(f[2]), corner(f[3])});
  }
}

/// Debian's interpreter, because NumPy is Debian's.
const std::string kPython = fs::exists("/usr/bin/python3") ? "/usr/bin/python3" : "python3";

bool has_numpy() { return cotwin::testing::run_command({kPython, "-c", "import numpy"}).code == 0; }

// An L: one shape around it has more than twice its volume, two have little more.
TEST(Capsules, EncloseTheSurfaceOfAMesh) {
  if (!has_numpy()) GTEST_SKIP() << "needs python3 with numpy";
  const TemporaryFolder folder("capsules");
  std::vector<std::array<Vector3d, 3>> triangles;
  add_box(triangles, {0, -20, -20}, {600, 20, 20});
  add_box(triangles, {0, -20, -20}, {40, 20, 500});
  std::ofstream mesh(folder.path() / "l.stl");
  mesh.precision(9);
  mesh << "solid l\n";
  for (const auto& triangle : triangles) {
    mesh << "facet normal 0 0 1\nouter loop\n";
    for (const Vector3d& p : triangle) mesh << "vertex " << p.transpose() << "\n";
    mesh << "endloop\nendfacet\n";
  }
  mesh << "endsolid\n";
  mesh.close();
  std::ofstream(folder.path() / "arm.urdf")
      << R"(<robot name="arm"><link name="base"/><link name="l"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial><visual><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.5 0.7"/><geometry>
  <mesh filename="package://any/l.stl" scale="0.001 0.001 0.001"/></geometry></visual></link><joint name="j" type="continuous"><parent link="base"/>
  <child link="l"/><axis xyz="0 0 1"/></joint></robot>)";
  const auto run =
      cotwin::testing::run_command({kPython, places::source() + "/scripts/capsules.py", folder.path() / "arm.urdf"});
  ASSERT_EQ(run.code, 0) << run.out << run.err;
  const robot::RobotModel model = robot::load_urdf(folder.path() / "arm.urdf");
  const std::vector<Shape> shapes = scene::hulls_of_urdf(folder.path() / "arm.urdf", model)[1];
  ASSERT_GE(shapes.size(), 2U);
  const Pose X_BM{rotation_from_rpy(0.3, -0.5, 0.7), {0.1, 0.2, 0.3}};
  double all = 0;
  for (const Shape& shape : shapes) all += volume(shape);
  EXPECT_LT(all, 3 * 0.04 * 0.04 * (0.6 + 0.46));
  // The whole surface, not only the corners.
  std::mt19937_64 engine(1);
  const auto share = [&] { return static_cast<double>(engine() >> 11) * 0x1p-53; };
  for (int k = 0; k < 20000; ++k) {
    const auto& [a, b, c] = triangles[static_cast<std::size_t>(k) % triangles.size()];
    double u = share(), v = share();
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const Vector3d p = X_BM * (1e-3 * (a + u * (b - a) + v * (c - a)));
    double nearest = HUGE_VAL;
    for (const Shape& shape : shapes) nearest = std::min(nearest, outside(shape, p));
    ASSERT_LT(nearest, 1e-5);
  }
}

TEST(Capsules, RefuseWhatTheyCannotEnclose) {
  if (!has_numpy()) GTEST_SKIP() << "needs python3 with numpy";
  const TemporaryFolder folder("capsules");
  const auto refusal = [&](const std::string& link) {
    std::ofstream(folder.path() / "arm.urdf") << "<robot name=\"arm\"><link name=\"base\">" << link << "</link></robot>";
    const auto run =
        cotwin::testing::run_command({kPython, places::source() + "/scripts/capsules.py", folder.path() / "arm.urdf"});
    EXPECT_NE(run.code, 0);
    EXPECT_FALSE(fs::exists(folder.path() / "arm_hulls.urdf"));
    EXPECT_EQ(run.err.find("Traceback"), std::string::npos) << run.err;
    return run.err;
  };
  const auto mesh = [](const char* name) {
    return "<visual><geometry><mesh filename=\"" + std::string(name) + "\"/></geometry></visual>";
  };
  EXPECT_THAT(refusal(""), ::testing::HasSubstr("no link has a mesh"));
  EXPECT_THAT(refusal(mesh("none.stl")), ::testing::HasSubstr("the mesh 'none.stl' is not found"));
  std::ofstream(folder.path() / "a.dae") << "<COLLADA/>";
  EXPECT_THAT(refusal(mesh("a.dae")), ::testing::HasSubstr("expected .stl or .obj"));
  std::ofstream(folder.path() / "empty.stl") << "solid\nendsolid\n";
  EXPECT_THAT(refusal(mesh("empty.stl")), ::testing::HasSubstr("no triangles"));
  std::ofstream(folder.path() / "words.stl") << "solid\nvertex 0 zero 0\nendsolid\n";
  EXPECT_THAT(refusal(mesh("words.stl")), ::testing::HasSubstr("words.stl: could not convert"));
  std::ofstream(folder.path() / "faceless.obj") << "v 0 0 0\n";
  EXPECT_THAT(refusal(mesh("faceless.obj")), ::testing::HasSubstr("no triangles"));
  std::ofstream(folder.path() / "far.obj") << "v 0 0 0\nf 1 2 3\n";
  EXPECT_THAT(refusal(mesh("far.obj")), ::testing::HasSubstr("far.obj: index"));
  EXPECT_THAT(refusal("<"), ::testing::HasSubstr("arm.urdf: not well-formed"));
}

TEST(Hulls, StandInAFileBesideTheUrdf) {
  const TemporaryFolder folder("hulls");
  const auto link = [](const char* name, const char* shape) {
    return "<link name=\"" + std::string(name) +
           "\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>" +
           (*shape != 0 ? "<collision><geometry>" + std::string(shape) + "</geometry></collision>" : "") + "</link>";
  };
  const std::string arm =
      "<robot name=\"arm\"><link name=\"base\"/>" + link("a", "<sphere radius=\"0.1\"/>") +
      link("b", "<sphere radius=\"0.2\"/>") +
      "<joint name=\"1\" type=\"continuous\"><parent link=\"base\"/><child link=\"a\"/><axis xyz=\"0 0 1\"/></joint>"
      "<joint name=\"2\" type=\"continuous\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 0 1\"/></joint></robot>";
  const std::string hulls = "<robot name=\"arm\">" + link("a", "<capsule radius=\"0.3\" length=\"1\"/>") + link("b", "") +
                            link("other", "<sphere radius=\"9\"/>") + "</robot>";
  const auto shapes = [&](const fs::path& urdf, const std::string& choice) {
    Settings settings("contact_world", "robot=" + urdf.string() + "&robot_shapes=" + choice, {}, {});
    settings.declare(settings_of(find_type("contact_world", unit_types())));
    return settings.cell().robots.at(0).shapes;
  };
  for (const auto& [urdf, beside] : {std::pair{"robot.urdf", "hulls.urdf"}, {"other.urdf", "other_hulls.urdf"}}) {
    std::ofstream(folder.path() / urdf) << arm;
    EXPECT_EQ(shapes(folder.path() / urdf, "hulls")[1].at(0).type, ShapeType::kSphere) << "without a file";
    std::ofstream(folder.path() / beside) << hulls;
    const auto found = shapes(folder.path() / urdf, "hulls");
    EXPECT_EQ(found[1].at(0).type, ShapeType::kCapsule);
    EXPECT_EQ(found[1].size(), 1U);
    EXPECT_EQ(found[2].at(0).size.x(), 0.2) << "of a link without hulls, the collision shape";
    EXPECT_EQ(shapes(folder.path() / urdf, "all")[1].at(0).size.x(), 0.1);
    EXPECT_TRUE(shapes(folder.path() / urdf, "none")[1].empty());
  }
  std::ofstream(folder.path() / "hulls.urdf") << "<robot";
  EXPECT_THAT([&] { shapes(folder.path() / "robot.urdf", "hulls"); },
              ::testing::ThrowsMessage<Error>(::testing::HasSubstr("hulls.urdf")));
}

}  // namespace
}  // namespace cotwin::contact_world::hulls_test
