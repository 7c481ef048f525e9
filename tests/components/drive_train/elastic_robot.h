#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

#include "components/compliance/joints/link_dynamics.h"
#include "components/compliance/joints/tracking.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/dynamics.h"
#include "tests/models/robot/random_robots.h"

/// A robot with rigid and elastic joints, as the plant of control laws in continuous time.
namespace cotwin::compliance::testing {

inline Joints joints(const Eigen::VectorXd& v) { return {v.data(), v.data() + v.size()}; }
inline double decades(robot::testing::Draw& draw, double low, double high) { return std::pow(10.0, draw.number(low, high)); }

struct ElasticRobot {
  explicit ElasticRobot(robot::RobotModel robot)
      : n(robot.n()), model(std::move(robot)), mechanism(model), data(mechanism), links(model) {}

  bool elastic(int i) const { return drives.K[static_cast<std::size_t>(i)] > 0; }

  /// q̈, then the motors' θ̈ (those of rigid joints are q̈), under the motor torques tau and the torques f_e on the links.
  Eigen::VectorXd accelerations(const Eigen::VectorXd& tau, const Eigen::VectorXd& f_e, const Eigen::VectorXd& q,
                                const Eigen::VectorXd& dq, const Eigen::VectorXd& theta) {
    Eigen::MatrixXd M(n, n);
    Eigen::VectorXd h(n), f(n), result = Eigen::VectorXd::Zero(2 * n);
    robot::mass_matrix_and_bias(mechanism, data, q, dq, M, h);
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double tau_J = drives.K[k] * (theta[i] - q[i]);
      f[i] = (elastic(i) ? tau_J : tau[i]) - h[i] + f_e[i];
      if (elastic(i)) {
        result[n + i] = (tau[i] - tau_J) / drives.B[k];
      } else {
        M(i, i) += drives.B[k];
      }
    }
    result.head(n) = M.llt().solve(f);
    for (int i = 0; i < n; ++i) {
      if (!elastic(i)) result[n + i] = result[i];
    }
    return result;
  }

  /// The largest ‖∂g/∂q‖ of `samples` directions in a neighbourhood of `q`.
  double steepest_gravity(robot::testing::Draw& draw, const Eigen::VectorXd& q, int samples) {
    double steepest = 0;
    Eigen::VectorXd low(n), high(n);
    for (int k = 0; k < samples; ++k) {
      const Eigen::VectorXd at = q + draw.numbers(n, -1, 1), way = 1e-4 * draw.numbers(n, -1, 1).normalized();
      robot::gravity(mechanism, data, at - way, low);
      robot::gravity(mechanism, data, at + way, high);
      steepest = std::max(steepest, (high - low).norm() / 2e-4);
    }
    return steepest;
  }

  int n;
  robot::RobotModel model;
  robot::Mechanism mechanism;
  robot::Data data;
  LinkDynamics links;
  robot::DriveParameters drives;
};

}  // namespace cotwin::compliance::testing
