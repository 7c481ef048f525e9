// The package of an exported unit: its robot and scene to the last bit, and nothing else.
#include "fmu/export/package.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <random>

#include "fmu/import/package.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"
#include "tests/support/listed_once.h"
#include "tests/support/places.h"

namespace cotwin::fmu::package_test {
namespace {

namespace fs = std::filesystem;

Package package_of(scene::Cell cell) {
  Package package;
  package.token = "{1}";
  package.unit = "drive_train";
  package.query = "robot=lwr4";
  if (!cell.robots.empty()) package.robot = std::make_shared<const robot::RobotModel>(cell.robots.front().model);
  package.cell = std::make_shared<const scene::Cell>(std::move(cell));
  double x = 0.1;
  Variables variables;
  variables.parameter("x", x, "m", "something");
  package.start.take(variables);
  return package;
}

/// Each robot of the library with its hulls, and each scene of library and examples.
std::vector<scene::Cell> cells() {
  std::vector<scene::Cell> cells;
  for (const char* folder : {"models/robots", "models/scenes", "examples"}) {
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(fs::path(places::source()) / folder)) {
      const fs::path& file = entry.path();
      if (file.filename() == "robot.urdf") {
        const robot::RobotModel robot = robot::load_urdf(file);
        cells.emplace_back().robots.push_back({robot.name, robot, scene::hulls_of_urdf(file, robot)});
      } else if (file.extension() == ".sdf") {
        cells.emplace_back().scene = scene::load(file);
      }
    }
  }
  return cells;
}

std::string refusal(const std::string& bytes) {
  try {
    static_cast<void>(deserialise_package(bytes, "unit.bin"));
  } catch (const Error& error) {
    return error.what();
  }
  return "none";
}

TEST(Package, CarriesEveryRobotAndSceneToTheLastBit) {
  std::size_t robots = 0, scenes = 0;
  for (const scene::Cell& cell : cells()) {
    const Package package = package_of(cell);
    const std::string bytes = serialise(package);
    const Package back = deserialise_package(bytes, "unit.bin");
    ASSERT_TRUE(back.cell != nullptr && (back.robot != nullptr) == !cell.robots.empty());
    EXPECT_TRUE(*back.cell == cell) << cell.scene.name;
    if (back.robot != nullptr) {
      EXPECT_TRUE(*back.robot == cell.robots.front().model);
    }
    EXPECT_EQ(back.token, package.token);
    EXPECT_EQ(back.unit, package.unit);
    EXPECT_EQ(back.query, package.query);
    EXPECT_EQ(back.start, package.start);
    EXPECT_EQ(serialise(back), bytes);
    robots += cell.robots.size(), scenes += !cell.scene.bodies.empty();
  }
  EXPECT_GE(robots, 10u);
  EXPECT_GE(scenes, 10u);
}

TEST(Package, CarriesWhatNoSceneOfTheLibraryHas) {
  scene::Cell cell;
  scene::Scene& scene = cell.scene;
  scene.bodies.resize(3);
  scene.bodies[0].name = "ground";
  scene.bodies[0].motion = scene::Motion::kStatic;
  scene::Shape ellipsoid, triangle;
  ellipsoid.type = scene::ShapeType::kEllipsoid;
  ellipsoid.size = {1, 2, 3};
  triangle.type = scene::ShapeType::kTriangle;
  triangle.size = {0.1, 5, 0};
  triangle.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  triangle.turns = {0, 0.25, 0};
  scene.bodies[0].shapes = {ellipsoid, triangle};
  for (const int k : {1, 2}) {
    scene::Body& body = scene.bodies[static_cast<std::size_t>(k)];
    body.name = std::to_string(k);
    body.inertia.mass = 1;
    body.inertia.I_CC.setIdentity();
    scene::Joint& joint = scene.joints.emplace_back();
    joint.name = "joint" + body.name;
    joint.child = k;
  }
  scene.gears.push_back({0, 1, -2, 0.5});
  scene.frames = {{"1.grip", 1, {Eigen::Matrix3d::Identity(), {1, 2, 3}}}, {"place", -1, {}}};
  scene.no_contact = {{0, 2}};
  EXPECT_TRUE(*deserialise_package(serialise(package_of(cell)), "unit.bin").cell == cell);
}

TEST(Package, IsRefusedIfItsPartsDoNotBelongTogether) {
  robot::RobotModel arm = robot::load_urdf(fs::path(places::source()) / "models/robots/planar2/robot.urdf");
  robot::Mimic finger;
  finger.joint.parent = arm.n() - 1;
  finger.place = arm.n();
  arm.mimics = {finger};
  arm.bodies.push_back({"finger", {}});
  const auto robot_refusal = [&](auto change) {
    robot::RobotModel robot = arm;
    change(robot);
    scene::Cell cell;
    cell.robots.push_back({"", robot, {}});
    const std::string in_cell = refusal(serialise(package_of(cell)));
    Package alone;
    alone.robot = std::make_shared<const robot::RobotModel>(robot);
    EXPECT_EQ(refusal(serialise(alone)), in_cell);
    return in_cell;
  };
  EXPECT_EQ(robot_refusal([](robot::RobotModel&) {}), "none");
  for (const int leader : {-1, arm.n()})
    EXPECT_EQ(robot_refusal([&](robot::RobotModel& r) { r.mimics[0].leader = leader; }),
              "unit.bin: has a mimic joint without a leader or place");
  for (const int place : {-1, arm.body_count()})
    EXPECT_EQ(robot_refusal([&](robot::RobotModel& r) { r.mimics[0].place = place; }),
              "unit.bin: has a mimic joint without a leader or place");
  for (const int parent : {-2, 1, arm.body_count(), 1 << 30})
    EXPECT_EQ(robot_refusal([&](robot::RobotModel& r) { r.joints[0].parent = parent; }),
              "unit.bin: has a joint before its parent");
  for (const int body : {-2, arm.body_count()})
    EXPECT_EQ(robot_refusal([&](robot::RobotModel& r) { r.frames[0].body = body; }),
              "unit.bin: has a frame on a body that does not exist");
  EXPECT_EQ(robot_refusal([](robot::RobotModel& r) { r.bodies.pop_back(); }),
            "unit.bin: has different numbers of bodies and joints");
  EXPECT_EQ(robot_refusal([](robot::RobotModel& r) { r.joints.pop_back(); }),
            "unit.bin: has different numbers of bodies and joints");
  EXPECT_EQ(robot_refusal([](robot::RobotModel& r) { r.joints[1].type = static_cast<robot::JointType>(2); }),
            "unit.bin: has the invalid enumeration value 2, expected 0 to 1");

  scene::Cell cell;
  cell.robots.push_back({"", arm, std::vector<std::vector<scene::Shape>>(arm.bodies.size() + 2)});
  EXPECT_EQ(refusal(serialise(package_of(cell))), "unit.bin: has shapes of bodies that do not exist");
  cell.robots.clear();
  cell.scene.name = "s";
  cell.scene.joints.resize(1);
  EXPECT_THAT(refusal(serialise(package_of(cell))), ::testing::StartsWith("unit.bin: scene 's': joint"));
}

TEST(Package, IsRefusedWithAnyByteDamagedOrMissing) {
  const std::string bytes = serialise(package_of({}));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    EXPECT_THROW(deserialise_package(damaged, "unit.bin"), Error) << i;
    EXPECT_THROW(deserialise_package(bytes.substr(0, i), "unit.bin"), Error) << i;
  }
}

TEST(Package, WithDamageAndACorrectHashIsRefusedOrRead) {
  std::mt19937 random(1);
  int refused = 0, read = 0;
  for (const scene::Cell& cell : cells()) {
    const std::string bytes = serialise(package_of(cell));
    const std::size_t head = 2 * sizeof(std::uint64_t);
    for (int i = 0; i < 30; ++i) {
      std::string damaged = bytes.substr(head);
      const std::uint64_t number = i % 3 == 0 ? random() : std::uint64_t{1} << (random() % 64);
      const std::size_t at = random() % damaged.size(), size = i % 2 == 0 ? 1 : 8;
      std::memcpy(damaged.data() + at, &number, std::min(size, damaged.size() - at));
      damaged = sealed(ByteReader(as_bytes(bytes), "").value<std::uint64_t>(), damaged);
      try {
        const std::string again = serialise(deserialise_package(damaged, "unit.bin"));
        EXPECT_EQ(serialise(deserialise_package(again, "again")), again);
        ++read;
      } catch (const Error& error) {
        EXPECT_THAT(error.what(), ::testing::StartsWith("unit.bin: "));
        ++refused;
      }
    }
  }
  EXPECT_GT(refused, 50);
  EXPECT_GT(read, 50);
}

// That they are as many as the members is checked by the compiler.
TEST(Package, ListsEachMemberOnce) {
  testing::expect_each_member_once<
      Inertia, Pose, robot::Joint, robot::Mimic, robot::Body, robot::Frame, robot::RobotModel, scene::Material, scene::Shape,
      scene::Body, scene::Joint, scene::Gear, scene::Frame, scene::Scene, scene::PlacedRobot, scene::Cell, Package, Numeric,
      Clock, Dimension, Alias, ModelVariable, EnumerationItem, TypeDefinition, DisplayUnit, UnitDefinition, MeasurementUnit,
      Unknown, ModelStructure, Interface, DefaultExperiment, LogCategory, ModelDescription, LoadOptions, ForeignPackage>();
}

}  // namespace
}  // namespace cotwin::fmu::package_test
