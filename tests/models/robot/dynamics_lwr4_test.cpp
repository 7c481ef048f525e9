// The LWR 4+ of models/robots/lwr4 compared with 150 samples of KUKA's own M and g as published (Gaz, Flacco, De Luca, ICRA
// 2014); the robot's inertial parameters were fitted to the same coefficients.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "models/foundation/formats/csv.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::robot::dynamics_lwr4_test {
namespace {

TEST(Lwr4, MassMatrixAndGravityAreThePublishedOnesToTheFitsError) {
  RobotModel robot = load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  robot.gravity = {0, 0, -9.80665};  // of the samples themselves
  const Mechanism mechanism(robot);
  Data data(mechanism);
  csv::Reader samples(places::source() + "/tests/models/data/lwr4_M_g_samples.csv");
  Eigen::VectorXd q(7), g(7);
  Eigen::MatrixXd M(7, 7);
  double g_squares = 0, M_squares = 0, M_worst = 0;
  int rows = 0;
  for (; samples.next(); ++rows) {
    const auto column = [&](const std::string& name) { return samples.real(samples.column(name)); };
    for (int i = 0; i < 7; ++i) q[i] = column("q" + std::to_string(i + 1));
    gravity(mechanism, data, q, g);
    mass_matrix(mechanism, data, q, M);
    for (int i = 0; i < 7; ++i) {
      g_squares += std::pow(g[i] - column("g" + std::to_string(i + 1)), 2);
      for (int j = 0; j < 7; ++j) {
        const double error = M(i, j) - column("M" + std::to_string(i + 1) + std::to_string(j + 1));
        M_squares += error * error;
        M_worst = std::max(M_worst, std::abs(error));
      }
    }
  }
  ASSERT_EQ(rows, 150);
  EXPECT_LE(std::sqrt(g_squares / (7 * rows)), 0.008);    // N.m, documented error of the fit
  EXPECT_LE(std::sqrt(M_squares / (49 * rows)), 0.0055);  // kg m²: 0.005 rounded
  EXPECT_LE(M_worst, 0.045);                              // 0.04 rounded
}

}  // namespace
}  // namespace cotwin::robot::dynamics_lwr4_test
