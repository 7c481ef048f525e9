#pragma once
#include <Eigen/Core>
#include <vector>

#include "components/services/services.h"

/// How freely a robot moves a frame along a motion, and how much more it could carry there.
namespace cotwin::services {

/// Half-axes of the ellipsoids of a frame at a time, longest first (models/robot/indices.h).
struct ManipulabilityAt {
  double t = 0;  // s
  Eigen::Vector3d translation = Eigen::Vector3d::Zero(), rotation = Eigen::Vector3d::Zero();
  double measure = 0;  // Yoshikawa's, of the translation: product of as many of the half-axes as the robot has along the motion
};
struct PathManipulability {
  double T = 0;        // s
  int dimensions = 0;  // of the measure
  ManipulabilityAt least, greatest;
  std::vector<ManipulabilityAt> series;  // at 201 equidistant times
};
/// Velocities for ‖q̇‖ ≤ 1 (m/s, rad/s), or with `dynamic` accelerations for torques of the motors within an ellipsoid that touches their bounds
/// (m/s², rad/s²; M with the inertia of the motors of move.drives, and with what is carried). Throws Error for an unknown frame, for `dynamic` with
/// a joint without a bound of torque, and if no duration meets the bounds.
PathManipulability manipulability_along(const robot::RobotModel& robot, const Move& move, const robot::Frame& frame,
                                        bool dynamic);

/// The largest point mass that the robot can carry beside the loads of the move.
struct LargestPayload {
  double mass = 0;             // kg; +∞: no bound of torque limits it
  optimisation::Peak at = {};  // the torque that is then at its bound
};
/// `part`: a point mass of 1 kg. Torques are linear in the mass: exact at the places at which plan() looks for their peaks. 0 for a motion that is
/// infeasible without it. Throws Error as robot::attach() does.
LargestPayload largest_payload(const robot::RobotModel& robot, const Move& move, const robot::Payload& part);

}  // namespace cotwin::services
