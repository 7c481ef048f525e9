#include "components/services/ability_service.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "components/services/extremes.h"
#include "models/foundation/support/error.h"
#include "models/robot/indices.h"

namespace cotwin::services {

PathManipulability manipulability_along(const robot::RobotModel& robot, const Move& move, const robot::Frame& frame,
                                        bool dynamic) {
  const Plan p = plan(robot, move);
  if (move.searched() && p.solution.status != optimisation::Status::kFeasible)
    throw Error("move", "no duration can be given (" + p.solution.reason + "), expected T or other bounds");
  const Eigen::Index n = robot.n();
  const std::vector<double>& bound = p.problem.bounds.tau;
  for (std::size_t j = 0; dynamic && j < bound.size(); ++j)
    if (!std::isfinite(bound[j])) throw Error("joint " + robot.joints[j].name, "has no bound of torque, expected one");
  const robot::LoadedDynamics dynamics(robot, move.loads);
  robot::LoadedDynamics::Scratch scratch(dynamics);
  robot::FrameInertia inertia(static_cast<int>(n));
  robot::Manipulability ellipsoids(static_cast<int>(n));
  Eigen::VectorXd q(n), dq(n), ddq(n);
  const auto vector = [](const std::vector<double>& x) {
    return Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  };
  const trajectory::Path& path = p.solution.path;
  const robot::FrameOnBody on_body = robot::on_body(frame);
  const auto span = [](Eigen::VectorXd& x) { return std::span(x.data(), static_cast<std::size_t>(x.size())); };
  const auto at = [&](double t) {
    path.at(t, span(q), span(dq), span(ddq));
    const robot::Mechanism& mechanism = dynamics.mechanism((t - path.begin()) / p.solution.T);
    robot::frame_inertia(mechanism, scratch.data, q, vector(move.drives.B), on_body, inertia);
    if (dynamic)
      robot::dynamic_manipulability(mechanism, scratch.data, q, dq, on_body, inertia, vector(bound), ellipsoids);
    else
      robot::kinematic_manipulability(inertia, ellipsoids);
    return ManipulabilityAt{t, ellipsoids.translation.lengths, ellipsoids.rotation.lengths, 0};
  };
  const std::size_t intervals = std::max<std::size_t>(1000, 2 * path.times().size());
  std::vector<ManipulabilityAt> grid;
  for (std::size_t i = 0; i <= intervals; ++i)
    grid.push_back(at(path.begin() + p.solution.T * static_cast<double>(i) / static_cast<double>(intervals)));
  PathManipulability r;
  r.T = p.solution.T;
  // A half-axis that is rounding everywhere does not count: a planar arm has two.
  constexpr double kRounding = 1e-9;
  for (const ManipulabilityAt& one : grid)
    r.dimensions =
        std::max(r.dimensions, static_cast<int>((one.translation.array() > kRounding * one.translation.x()).count()));
  const auto measure = [&](const ManipulabilityAt& one) { return one.translation.head(r.dimensions).prod(); };
  r.least = largest(grid, at, [&](const ManipulabilityAt& one) { return -measure(one); });
  r.greatest = largest(grid, at, measure);
  for (ManipulabilityAt* one : {&r.least, &r.greatest}) one->measure = measure(*one);
  constexpr std::size_t kSamples = 201;
  for (std::size_t i = 0; i < kSamples; ++i) {
    r.series.push_back(at(path.begin() + p.solution.T * static_cast<double>(i) / (kSamples - 1)));
    r.series.back().measure = measure(r.series.back());
  }
  return r;
}

LargestPayload largest_payload(const robot::RobotModel& robot, const Move& move, const robot::Payload& part) {
  const Plan p = plan(robot, move);
  LargestPayload found;
  if (p.solution.status != optimisation::Status::kFeasible) return found;
  found.mass = std::numeric_limits<double>::infinity();
  robot::Loads more = move.loads;
  more.payloads.push_back(part);
  const robot::LoadedDynamics with(robot, more), without(robot, move.loads);
  robot::LoadedDynamics::Scratch scratch_with(with), scratch_without(without);
  const trajectory::Path& path = p.solution.path;
  const std::size_t n = robot.joints.size();
  std::vector<double> q(n), dq(n), ddq(n), tau(n), loaded(n);
  optimisation::Problem fine = p.problem;
  fine.loads = more;
  for (const double s : optimisation::places(fine, path).s) {
    if (!part.when.has(s)) continue;
    path.at(path.begin() + s * p.solution.T, q, dq, ddq);
    without.inverse_dynamics(scratch_without, 1, &s, q.data(), dq.data(), ddq.data(), tau.data());
    with.inverse_dynamics(scratch_with, 1, &s, q.data(), dq.data(), ddq.data(), loaded.data());
    for (std::size_t j = 0; j < n; ++j) {
      const double per_kg = loaded[j] - tau[j], bound = std::copysign(p.problem.bounds.tau[j], per_kg);
      const double rest = bound - tau[j] - optimisation::drive_torque(p.problem.drives, j, dq[j], ddq[j]);
      if (per_kg == 0 || !std::isfinite(bound) || !(rest / per_kg < found.mass)) continue;
      found.mass = std::max(rest / per_kg, 0.0);
      found.at = {"tau", j, bound, path.begin() + s * p.solution.T, bound, 1};
    }
  }
  return found;
}

}  // namespace cotwin::services
