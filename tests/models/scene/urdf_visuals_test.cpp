// The visible pieces of robots: <visual> elements of URDFs.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/urdf/urdf_visuals.h"
#include "tests/support/files.h"

namespace cotwin::scene::urdf_visuals_test {
namespace {

using cotwin::testing::TemporaryFolder;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::vector<Visual>> read(const TemporaryFolder& folder, const std::string& of_base, const std::string& of_arm,
                                      std::vector<std::string>& warnings) {
  const std::string inertial =
      "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
  const auto file =
      folder.write("arm/urdf/arm.urdf",
                   "<robot name='arm'><material name='grey'><color rgba='0.5 0.5 0.5 1'/></material><link name='base'>" +
                       of_base + "</link><link name='arm'>" + inertial + of_arm + "</link><link name='flange'>" +
                       "<visual><geometry><sphere radius='0.02'/></geometry></visual></link>" +
                       "<joint name='j' type='continuous'><parent link='base'/><child link='arm'/></joint>" +
                       "<joint name='f' type='fixed'><parent link='arm'/><child link='flange'/>"
                       "<origin xyz='0 0 0.3'/></joint></robot>");
  return visuals_of_urdf(file, robot::load_urdf(file), &warnings);
}

TEST(UrdfVisuals, AreInTheFramesOfTheBodiesWithTheirColours) {
  const TemporaryFolder folder("visuals");
  folder.write("arm/meshes/arm.STL", "solid");
  std::vector<std::string> warnings;
  const auto visuals =
      read(folder,
           "<visual><origin xyz='0 0 0.1' rpy='0 0 1.5707963267948966'/><geometry><box size='1 2 3'/></geometry><material "
           "name='grey'/></visual>",
           "<visual><geometry><mesh filename='package://arm/meshes/arm.STL' scale='1e-3 1e-3 1e-3'/></geometry>"
           "<material name='own'><color rgba='1 0 0 0.5'/></material></visual>",
           warnings);
  EXPECT_THAT(warnings, IsEmpty());
  ASSERT_EQ(visuals.size(), 2u);
  ASSERT_EQ(visuals[0].size(), 1u);
  EXPECT_EQ(visuals[0][0].type, VisualType::kBox);
  EXPECT_EQ(visuals[0][0].size, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(visuals[0][0].X_BS.R(1, 0), 1, 1e-12);
  EXPECT_THAT(*visuals[0][0].colour, ElementsAre(0.5, 0.5, 0.5, 1));
  ASSERT_EQ(visuals[1].size(), 2u);  // of the arm, and of the flange that is fixed to it
  EXPECT_EQ(visuals[1][0].mesh.filename(), "arm.STL");
  EXPECT_EQ(visuals[1][0].size, Eigen::Vector3d::Constant(1e-3));
  EXPECT_THAT(*visuals[1][0].colour, ElementsAre(1, 0, 0, 0.5));
  EXPECT_EQ(visuals[1][1].type, VisualType::kSphere);
  EXPECT_EQ(visuals[1][1].X_BS.p, Eigen::Vector3d(0, 0, 0.3));
  EXPECT_FALSE(visuals[1][1].colour);
}

TEST(UrdfVisuals, ThatCannotBeReadAreLeftOutWithAWarning) {
  const TemporaryFolder folder("visuals");
  for (const char* bad :
       {"<visual/>", "<visual><geometry><mesh filename='package://arm/none.dae'/></geometry></visual>",
        "<visual><geometry><sphere radius='-1'/></geometry></visual>", "<visual><geometry><torus/></geometry></visual>",
        "<visual><geometry><sphere radius='1'/></geometry><material><color rgba='1 2 3 4'/></material></visual>",
        "<visual><origin xyz='a'/><geometry><sphere radius='1'/></geometry></visual>"}) {
    std::vector<std::string> warnings;
    const auto visuals = read(folder, bad, "", warnings);
    EXPECT_THAT(visuals[0], IsEmpty()) << bad;
    EXPECT_THAT(warnings, ElementsAre(HasSubstr("arm.urdf:1"))) << bad;
  }
}

}  // namespace
}  // namespace cotwin::scene::urdf_visuals_test
