#pragma once
#include <cstddef>
#include <vector>

#include "models/optimisation/search.h"
#include "models/robot/inverse_kinematics.h"

namespace cotwin::optimisation {

struct SelfMotionOptions {
  double step = 0.02;       // rad or m, |Δq| between neighbours
  std::size_t most = 2000;  // postures
};

/// Postures that reach `target` on the one-dimensional self-motion through `q` (n; it is first moved to the pose), in order along
/// it and within the joint limits: predictor along the null space of J, corrector by Newton's method. Ends at joint limits, at
/// singularities of the task, and where the motion returns to its start. A robot without redundancy has one posture. Throws Error
/// if q does not lead to the pose, and for a self-motion of more than one dimension.
std::vector<std::vector<double>> self_motion(const robot::RobotModel& robot, robot::InverseKinematics& kinematics,
                                             const robot::PoseTarget& target, const std::vector<double>& q,
                                             const SelfMotionOptions& options = {});

/// Minimises the costs over motions to a pose: as minimise() with the self-motion through ends.q_to as end postures, and once more
/// with the end ends.q_to alone, and, if that is the better one, about its result; returns the best of them. The end that is found
/// between two postures is moved to the pose exactly; if the motion then violates a bound, the search is repeated for this end. End
/// postures are within the bounds of the problem.
/// Limits of the options hold for all searches together.
Solution minimise_to_pose(const Problem& problem, robot::InverseKinematics& kinematics, const robot::PoseTarget& target,
                          const SearchOptions& options = {}, numerics::Threads* threads = nullptr,
                          const SelfMotionOptions& self_motion = {});

/// The same as minimise_in_order(): the optimum of each cost that the later ones keep to is the least one over all end postures. The
/// result ends at ends.q_to or where the order of costs with free end postures ended.
Solution minimise_in_order_to_pose(const Problem& problem, double tolerance, robot::InverseKinematics& kinematics,
                                   const robot::PoseTarget& target, const SearchOptions& options = {},
                                   numerics::Threads* threads = nullptr, const SelfMotionOptions& self_motion = {});

/// The same as pareto_front(), once with the end ends.q_to and once over all end postures. Motions that end between two postures are
/// moved to the pose exactly, and left out if they then violate a bound.
std::vector<Round::Particle> pareto_front_to_pose(const Problem& problem, int directions, robot::InverseKinematics& kinematics,
                                                  const robot::PoseTarget& target, const SearchOptions& options = {},
                                                  numerics::Threads* threads = nullptr, bool* complete = nullptr,
                                                  const SelfMotionOptions& self_motion = {});

}  // namespace cotwin::optimisation
