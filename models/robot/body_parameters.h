#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// The bodies of a robot as numbers that may change while it moves: what a tuner finds, or a what-if. What is in force goes
/// from the old values to the new ones along a line in the inertial parameters, on which every body is a physical one if both
/// ends are.
class BodyParameters {
 public:
  explicit BodyParameters(const RobotModel& robot);

  std::vector<double> mass;          // n, kg
  std::vector<double> first_moment;  // 3n, kg.m: m c of body after body, in its frame
  std::vector<double> inertia;       // 6n, kg.m2: Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the origin of the body's frame
  std::vector<double> in_force;      // 10n, as Inertia::parameters(); what the mechanism has

  /// Takes the wanted values at once. Throws Error `place.mass[3]: …` for a body that cannot be.
  void take(const std::string& place, Mechanism& mechanism);
  /// Goes on towards the wanted values: `remaining` of the difference is left. Throws as take(), when they were changed.
  /// Allocates nothing. True if anything changed.
  bool follow(const std::string& place, double remaining, Mechanism& mechanism);
  /// in_force was written.
  void restored(Mechanism& mechanism);

 private:
  double wanted(std::size_t k) const;
  void check(const std::string& place);
  void adopt(Mechanism& mechanism);

  RobotModel robot_;
  std::vector<Inertia> first_;  // of the robot as it came, and its parameters: those give the inertia only to rounding
  std::vector<double> first_pi_;
  std::vector<double> seen_;  // 10n, wanted values that were checked
};

}  // namespace cotwin::robot
