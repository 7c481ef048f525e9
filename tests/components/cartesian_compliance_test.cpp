// Cartesian compliance (3a), (3b) of the whole unit, with the flexible robot behind it.
#include "tests/components/cartesian_harness.h"

namespace cotwin::testing {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

TEST(CartesianCompliance, AFlexibleRobotShowsTheStiffnessOfTableTwoAtItsLinkSide) {
  Kinematics kinematics("lwr4");
  const VectorXd q = lwr4_posture();
  const Pose X = kinematics.at(q);
  CartesianLoop loop("", "lwr4");
  for (const char* friction : {"tau_C", "tau_S", "sigma0", "sigma1", "sigma2"}) {
    loop.unit[friction].setZero();
    loop.drive[friction].setZero();
  }
  desire(loop.unit, X);
  loop.unit["M_T"].setConstant(10);
  loop.unit["S_T"] = Vector3d(1500, 1000, 500);
  loop.unit["M_R"].setConstant(1);
  loop.unit["K_o"].setConstant(500);
  loop.start(q);
  const Vector3d f(30, -20, 15), m(5, -3, 4);
  loop.unit["f_e"] = f;
  loop.unit["m_e"] = m;
  for (int n = 0; n < 4000; ++n) loop.step();
  EXPECT_EQ(loop.unit.warning(), "");
  const Pose now = kinematics.at(loop.drive["q"]);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double deflection = f[i] / loop.unit["S_T"][i];
    EXPECT_NEAR(loop.unit["p_c"][i] - X.p[i], deflection, 1e-10) << i;
    EXPECT_NEAR(now.p[i] - X.p[i], deflection, 1e-3 * std::abs(deflection)) << i;
  }
  const Eigen::AngleAxisd turn(now.R * X.R.transpose());
  EXPECT_NEAR(turn.angle(), std::asin(m.norm() / 500), 1e-3 * turn.angle());
  EXPECT_NEAR(turn.axis().dot(m.normalized()), 1, 1e-6);
}

}  // namespace
}  // namespace cotwin::testing
