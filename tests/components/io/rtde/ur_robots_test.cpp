// models/robots/ur*: the chain of each URDF against Denavit-Hartenberg parameters that UR publishes, masses, and the gravity of both.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::ur_robots_test {
namespace {

struct Published {
  const char* name;
  std::array<double, 6> d, a;  // m; α = 90, 0, 0, 90, −90, 0 deg
  double moving_mass;          // kg
  double upper_arm, forearm;   // masses, kg
  double c_2, c_3;             // centres of these masses: x in their frames of Denavit and Hartenberg, m
};

class UrRobot : public ::testing::TestWithParam<Published> {};

TEST_P(UrRobot, HasThePublishedChainAndMasses) {
  const Published& p = GetParam();
  const robot::RobotModel model =
      robot::load_urdf(std::filesystem::path(places::source()) / "models/robots" / p.name / "robot.urdf");
  ASSERT_EQ(model.n(), 6);
  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  const robot::FrameOnBody flange = robot::on_body(model.end_effector());
  for (int k = 0; k < 50; ++k) {
    Eigen::VectorXd q(6);
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    const std::array<double, 6> alpha{90, 0, 0, 90, -90, 0};
    for (int i = 0; i < 6; ++i) {
      const auto j = static_cast<std::size_t>(i);
      q[i] = 3 * std::sin(1.7 * k + 2.3 * i);
      X = X * Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ()) * Eigen::Translation3d(p.a[j], 0, p.d[j]) *
          Eigen::AngleAxisd(alpha[j] * std::numbers::pi / 180, Eigen::Vector3d::UnitX());
    }
    const Pose pose = robot::forward_kinematics(mechanism, data, q, flange);
    EXPECT_LE((pose.p - X.translation()).norm(), 1e-9);
    EXPECT_LE((pose.R - X.linear()).norm(), 1e-9);
  }
  double mass = 0;
  for (const robot::Body& body : model.bodies) mass += body.inertia.mass;
  EXPECT_NEAR(mass, p.moving_mass, 1e-9);
  EXPECT_NEAR(model.bodies[1].inertia.mass, p.upper_arm, 1e-9);
  EXPECT_NEAR(model.bodies[2].inertia.mass, p.forearm, 1e-9);
  // Arm stretched out horizontally (q = 0): the wrist's masses are at the end of the forearm.
  Eigen::VectorXd g(6), straight = Eigen::VectorXd::Zero(6);
  robot::gravity(mechanism, data, straight, g);
  const double wrist = mass - model.bodies[0].inertia.mass - p.upper_arm - p.forearm;
  const double elbow = std::abs(p.a[1]), reach = elbow + std::abs(p.a[2]);
  EXPECT_NEAR(g[0], 0, 1e-9);  // vertical axis
  EXPECT_NEAR(std::abs(g[1]), 9.81 * (p.upper_arm * (elbow - p.c_2) + p.forearm * (reach - p.c_3) + wrist * reach), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(
    All, UrRobot,
    ::testing::Values(
        Published{"ur3e",
                  {0.15185, 0, 0, 0.13105, 0.08535, 0.0921},
                  {0, -0.24355, -0.2132, 0, 0, 0},
                  8.7985,
                  3.4445,
                  1.437,
                  0.13,
                  0.05},
        Published{
            "ur5e", {0.1625, 0, 0, 0.1333, 0.0997, 0.0996}, {0, -0.425, -0.3922, 0, 0, 0}, 17.7, 8.058, 2.846, 0.2125, 0.15},
        Published{
            "ur10", {0.1273, 0, 0, 0.163941, 0.1157, 0.0922}, {0, -0.612, -0.5723, 0, 0, 0}, 28.435, 12.7, 4.27, 0.38, 0.24},
        Published{"ur10e",
                  {0.1807, 0, 0, 0.17415, 0.11985, 0.11655},
                  {0, -0.6127, -0.57155, 0, 0, 0},
                  29.104,
                  13.051,
                  3.989,
                  0.38,
                  0.24},
        Published{"ur16e",
                  {0.1807, 0, 0, 0.17415, 0.11985, 0.11655},
                  {0, -0.4784, -0.36, 0, 0, 0},
                  27.26,
                  10.45,
                  4.321,
                  0.302,
                  0.194},
        Published{"ur20",
                  {0.2363, 0, 0, 0.201, 0.1593, 0.1543},
                  {0, -0.862, -0.7287, 0, 0, 0},
                  60.96,
                  29.632,
                  7.879,
                  0.5226,
                  0.3234}),
    [](const auto& robot) { return std::string(robot.param.name); });

}  // namespace
}  // namespace cotwin::ur_robots_test
