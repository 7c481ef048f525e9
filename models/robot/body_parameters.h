#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Inertial parameters of a robot's bodies that may change during a run. The values in force move from the old to the new
/// values along a straight line in the inertial parameters, on which every body is physical if both ends are.
class BodyParameters {
 public:
  explicit BodyParameters(const RobotModel& robot);

  std::vector<double> mass;          // n, kg
  std::vector<double> first_moment;  // 3n, kg.m: m c of body after body, in its frame
  std::vector<double> inertia;       // 6n, kg.m2: Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the origin of the body's frame
  std::vector<double> in_force;      // 10n, as Inertia::parameters(); present values of the mechanism

  /// Sets the target values at once. Throws Error `place.mass[3]: …` for an unphysical body.
  void take(const std::string& place, Mechanism& mechanism);
  /// Moves towards the target values, so that `remaining` of the difference is left. Returns true if anything changed. Throws
  /// as take() if the targets have changed. Allocates nothing.
  bool follow(const std::string& place, double remaining, Mechanism& mechanism);
  /// Whether follow() would change anything.
  bool pending() const;
  /// Gravity of the robot in force, m/s² in its base frame.
  void set_gravity(const Eigen::Vector3d& gravity) { robot_.gravity = gravity; }
  /// To be called after in_force was written.
  void restored(Mechanism& mechanism);
  /// The robot with the bodies in force.
  const RobotModel& robot() const { return robot_; }

 private:
  double wanted(std::size_t k) const;
  void check(const std::string& place);
  void adopt(Mechanism& mechanism);

  RobotModel robot_;
  std::vector<Inertia> first_;  // initial inertias and their parameters, which give the inertia only to rounding
  std::vector<double> first_pi_;
  std::vector<double> seen_;  // 10n, targets that were checked
};

}  // namespace cotwin::robot
