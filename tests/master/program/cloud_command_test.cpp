// cotwin cloud, and a monitor that takes a cloud along as FMU.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "models/cloud/cloud_file.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cloud_command_test {
namespace {

namespace fs = std::filesystem;
using cotwin::cloud::load_cloud;
using cotwin::testing::content;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using ::testing::HasSubstr;

class CloudCommand : public ::testing::Test {
 protected:
  RunResult run(std::vector<std::string> arguments) const {
    return run_program(std::move(arguments), {.folder = folder_.path()});
  }
  RunResult cloud(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "cloud");
    return run(std::move(arguments));
  }
  TemporaryFolder folder_{"cloud"};
};

TEST_F(CloudCommand, TellsWhatIsInAFileAndConvertsIt) {
  folder_.write("scan.xyz", "X Y Z I\n1000 0 0 7\n1000 0 0 7\n0 nan 0 7\n1000 20 0 7\n1000 20 50 7\n1002 19 49 7\n");
  const RunResult told = cloud({"scan.xyz", "--unit", "mm", "--pose", "0 0 1 0 0 1.5707963267948966", "-o", "scan.pcd"});
  EXPECT_EQ(told.err, "");
  EXPECT_EQ(told.code, 0);
  EXPECT_THAT(told.out, HasSubstr("read     4 points; dropped: 1 double, 1 without finite coordinates; passed over: i"));
  EXPECT_THAT(told.out, HasSubstr("box      x -0.02 to 0, y 1 to 1.002, z 1 to 1.05 m"));
  EXPECT_THAT(told.out, HasSubstr("spacing  median 0.00245, 95 % up to 0.02, largest 0.02 m: with 0.01 m the balls of 95 %"));
  const cotwin::cloud::CloudFile moved = load_cloud(folder_ / "scan.pcd");
  ASSERT_EQ(moved.cloud.points.size(), 4u);
  EXPECT_LT((moved.cloud.point(1) - Vector3d(-0.02, 1, 1)).norm(), 1e-7);
  const RunResult thin = cloud({"scan.pcd", "--voxel", "0.02", "-o", "thin.ply"});
  EXPECT_THAT(thin.out, HasSubstr("points   3\n"));
  EXPECT_THAT(cloud({"thin.ply"}).out, HasSubstr("read     3 points; dropped: 0 doubles"));
}

TEST_F(CloudCommand, DropsThePointsOfTheRobot) {
  const fs::path urdf = fs::path(cotwin::places::source()) / "models/robots/lwr4/robot.urdf";
  const cotwin::robot::RobotModel robot = cotwin::robot::load_urdf(urdf);
  const std::vector<double> q{0.3, -0.5, 0.2, 1.2, 0.1, -0.4, 0}, rest(7, 0.0);
  std::vector<cotwin::Pose> X_WL(7);
  std::vector<cotwin::Twist> V_WL(7);
  const cotwin::Pose X_WB{cotwin::rotation_from_rpy(0, 0, 1), {0.5, 0, 0.2}};
  cotwin::scene::place_links(robot, X_WB, q, rest, X_WL, V_WL);
  std::string points = "x,y,z\n";
  for (const cotwin::Pose& X : X_WL)
    points += std::to_string(X.p.x()) + "," + std::to_string(X.p.y()) + "," + std::to_string(X.p.z()) + "\n";
  folder_.write("scan.csv", points + "3,0,0\n3,0,0.1\n");
  const std::string at = "0.3,-0.5,0.2,1.2,0.1,-0.4,0";
  const RunResult told = cloud({"scan.csv", "--without", "lwr4", "--at", at, "--base", "0.5 0 0.2 0 0 1", "-o", "rest.xyz"});
  EXPECT_EQ(told.code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr(" points within 0.01 m of the hulls of "));
  EXPECT_EQ(load_cloud(folder_ / "rest.xyz").cloud.points.size(), 2u);
  EXPECT_THAT(cloud({"scan.csv", "--without", "lwr4"}).err, HasSubstr("--without: and --at, expected both or none"));
  EXPECT_THAT(cloud({"scan.csv", "--without", "lwr4", "--at", "0,0"}).err, HasSubstr("--at: 2 positions, expected 7"));
  EXPECT_EQ(cloud({"scan.csv", "--without", "lwr4", "--at", "nan,0,0,0,0,0,0"}).err,
            "cotwin: --at: nan, expected finite positions\n");
  folder_.write("own.csv", points);
  const RunResult none = cloud({"own.csv", "--without", "lwr4", "--at", at, "--base", "0.5 0 0.2 0 0 1", "-o", "none.pcd"});
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, HasSubstr("own.csv: all of its points are points of the robot"));
  EXPECT_FALSE(fs::exists(folder_ / "none.pcd"));
}

TEST_F(CloudCommand, RefusesWithOneMessage) {
  folder_.write("scan.xyz", "1 2 3\n1 2\n");
  for (const auto& [arguments, error] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"scan.xyz"}, "cotwin: scan.xyz:2: '1 2', expected a coordinate\n"},
           {{"none.pcd"}, "cotwin: none.pcd: cannot be read: No such file or directory, expected a point cloud\n"},
           {{"scan.las"},
            "cotwin: scan.las: unknown format of a point cloud, expected .pcd, .ply, .xyz, .csv, .txt, .asc or .pts\n"},
           {{"scan.xyz", "-o", "x.stl"},
            "cotwin: x.stl: unknown format of a point cloud, expected .pcd, .ply, .xyz, .csv, .txt, .asc or .pts\n"},
           {{"scan.xyz", "--unit", "s"}, "cotwin: --unit: 's', expected a length such as mm\n"},
           {{"--from", "cell_cloud"},
            "cotwin: --from cell_cloud: is a point cloud, expected a scene, or the cloud without --from\n"},
           {{"scan.xyz", "--voxel", "0"}, "cotwin: --voxel: 0, expected 1e-6 to 1e6 m\n"}}) {
    const RunResult refused = cloud(arguments);
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(refused.err, error);
  }
}

// The cloud is in the FMU, also under a name that has the separators of lists.
TEST_F(CloudCommand, MonitorsTakeTheirCloudAlong) {
  folder_.write("cells/left, 2.csv", "x,y,z\n2,0,0.5\n2,0.05,0.5\n");
  const RunResult packed = run({"pack", "unit:monitor?robot=lwr4&cloud=cells/left, 2.csv", "--fmi", "2", "-o", "monitor.fmu"});
  ASSERT_EQ(packed.code, 0) << packed.err;
  fs::remove_all(folder_ / "cells");
  const RunResult ran = run({"run", "monitor.fmu", "--stop-time", "0.002", "--output-file", "out.csv"});
  EXPECT_EQ(ran.code, 0) << ran.err;
  const std::string csv = content(folder_ / "out.csv");
  EXPECT_THAT(csv, HasSubstr("distance"));
  const std::size_t last = csv.rfind('\n', csv.size() - 2) + 1;
  EXPECT_NEAR(std::stod(csv.substr(csv.find(',', last) + 1)), 1.9, 0.1);
}

}  // namespace
}  // namespace cloud_command_test
