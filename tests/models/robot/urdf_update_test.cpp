// Writes a robot's values into the URDF from which it was read, and perturbs robots.
#include "models/robot/urdf/urdf_update.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/perturbed.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::robot::urdf_update_test {
namespace {

using ::testing::HasSubstr;

constexpr const char* kArm = R"(<?xml version="1.0"?>
<robot name="arm">
  <material name="blue"/>
  <link name="base"/>
  <joint name="a" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/>
  </joint>
  <link name="upper">
    <visual><geometry><mesh filename="package://arm/upper.stl"/></geometry></visual>
    <inertial><origin xyz="0 0 0.1" rpy="0.3 0 0"/><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial>
  </link>
  <joint name="mount" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0 0 0.3" rpy="0 0 0"/></joint>
  <link name="tool">
    <inertial><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <collision><geometry><sphere radius="0.02"/></geometry></collision>
  </link>
</robot>
)";

TEST(UrdfUpdate, ReadsBackAsTheRobotAndKeepsOtherElements) {
  RobotModel arm = parse_urdf(kArm, "arm.urdf");
  set_inertia(arm, 0, {2.7, {0.01, -0.02, 0.13}, Eigen::Vector3d(0.031, 0.04, 0.015).asDiagonal()}, "tuned");
  arm.joints[0].damping = 0.25;
  arm.joints[0].friction = 1.5;
  const std::string updated = updated_urdf(kArm, "arm.urdf", arm);
  const RobotModel back = parse_urdf(updated, "updated.urdf");
  EXPECT_EQ(back.bodies, arm.bodies);
  EXPECT_EQ(back.joints, arm.joints);
  for (const char* kept : {"package://arm/upper.stl", "sphere radius=\"0.02\"", "material name=\"blue\""}) {
    EXPECT_THAT(updated, HasSubstr(kept));
  }
}

TEST(UrdfUpdate, KeepsTheTextOfUnchangedBodies) {
  EXPECT_THAT(updated_urdf(kArm, "arm.urdf", parse_urdf(kArm, "arm.urdf")), HasSubstr("rpy=\"0.3 0 0\""));
}

TEST(UrdfUpdate, RefusesTheFileOfAnotherRobot) {
  RobotModel other = parse_urdf(kArm, "arm.urdf");
  other.bodies[0].name = "thigh";
  try {
    updated_urdf(kArm, "arm.urdf", other);
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("arm.urdf: has no link 'thigh'"));
  }
}

TEST(Perturbed, IsAPhysicalRobotWithinItsBound) {
  const RobotModel lwr = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const RobotModel other = perturbed(lwr, 0.3, seed);
    for (std::size_t i = 0; i < lwr.bodies.size(); ++i) {
      const Inertia &was = lwr.bodies[i].inertia, &is = other.bodies[i].inertia;
      EXPECT_EQ(is.unphysical(), "") << seed << " " << i;
      EXPECT_LE(std::abs(is.mass / was.mass - 1), 0.3 + 1e-12) << seed << " " << i;
      EXPECT_GT((is.p_LC - was.p_LC).norm(), 0) << seed << " " << i;
    }
  }
}

TEST(Perturbed, IsTheSameForTheSameSeedAndTheRobotItselfForABoundOfZero) {
  const RobotModel arm = parse_urdf(kArm, "arm.urdf");
  EXPECT_EQ(perturbed(arm, 0.2, 7).bodies, perturbed(arm, 0.2, 7).bodies);
  EXPECT_NE(perturbed(arm, 0.2, 7).bodies, perturbed(arm, 0.2, 8).bodies);
  const Inertia same = perturbed(arm, 0, 7).bodies[0].inertia;
  EXPECT_TRUE(same.I_CC.isApprox(arm.bodies[0].inertia.I_CC, 1e-14));
  EXPECT_THROW(perturbed(arm, 0.6, 1), Error);
}

}  // namespace
}  // namespace cotwin::robot::urdf_update_test
