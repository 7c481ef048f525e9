#include "models/identification/torque_data/motor_inertia.h"

#include <Eigen/Core>
#include <algorithm>

#include "models/robot/dynamics.h"

namespace cotwin::identification {

std::vector<double> least_motor_inertia(const robot::RobotModel& robot) {
  constexpr double kShare = 1e-3, kLeast = 1e-9;  // kg·m²: bodies may have no inertia
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  Eigen::MatrixXd M(robot.n(), robot.n());
  robot::mass_matrix(mechanism, data, Eigen::VectorXd::Zero(robot.n()), M);
  std::vector<double> B(static_cast<std::size_t>(robot.n()));
  for (int j = 0; j < robot.n(); ++j)
    if (!robot.joints[static_cast<std::size_t>(j)].passive) B[static_cast<std::size_t>(j)] = std::max(kLeast, kShare * M(j, j));
  return B;
}

}  // namespace cotwin::identification
