#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::benchmark {

/// States of a robot with n joints; each vector has one entry per state.
struct States {
  std::vector<Eigen::VectorXd> q, dq, ddq, tau;  // rad, rad/s, rad/s², N.m
};

/// Reduced dynamics by another library: the same functions as ours, for states that are converted beforehand.
class DynamicsPeer {
 public:
  virtual ~DynamicsPeer() = default;
  virtual std::string name() const = 0;
  virtual void inverse_dynamics(std::size_t state) = 0;  // torques into `out`, N.m
  virtual void mass_matrix(std::size_t state) = 0;       // into `M`
  virtual void jacobian(std::size_t state) = 0;          // pose and Jacobian of the last body, into `J`
  virtual void forward_dynamics(std::size_t state) = 0;  // accelerations into `out`
  /// J M⁻¹ Jᵀ into `Lambda`, from the library's own J and M.

  Eigen::VectorXd out;   // n
  Eigen::MatrixXd M, J;  // n x n, 6 x n
};

/// Orocos KDL.
std::unique_ptr<DynamicsPeer> make_kdl(const robot::RobotModel& robot, const States& states);
/// MuJoCo, which reads the URDF itself; null with a message on stderr if it cannot.
std::unique_ptr<DynamicsPeer> make_mujoco_dynamics(const std::string& urdf, const robot::RobotModel& robot,
                                                   const States& states);

}  // namespace cotwin::benchmark
